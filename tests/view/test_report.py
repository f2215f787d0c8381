"""The report of a result: one file that needs nothing else, and says what the result says."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from massid.errors import BadInputError
from massid.view.chart import Chart
from massid.view.page import HtmlPage
from massid.view.report import write_report


def _document() -> dict[str, object]:
    """A result of two links, one of which was hidden."""
    seen = {"nominal_kg": 4.0, "estimate_kg": 4.4, "std_kg": 0.1, "interval95_kg": [4.2, 4.6], "identifiable": True}
    return {
        "schema": 1,
        "links": {"torso": seen, "calf<b>": {"nominal_kg": 2.0, "estimate_kg": None, "identifiable": False}},
        "together": {"estimate_kg": 6.5, "std_kg": 0.2},
        "verdict": {
            "motion": "standing still",
            "sensors": "the log's own noise",
            "predicted_std_kg": {"torso": 0.1, "calf<b>": 1.0},
            "total_std_kg": 0.3,
            "combinations": [{"text": "calf<b>", "relative_std": 0.5}],
            "sums": [],
            "advice": ["walk"],
        },
        "validation": None,
        "uncertainty": {
            "chi2_per_sample": 1.01,
            "noise": {"force_offset": 4.0},
            "nuisances": {
                "effort_offset/knee": {
                    "kind": "effort_offset", "title": "torque offsets", "label": "knee", "log": None,
                    "unit": "N m", "estimate": 0.1, "std": 0.4, "prior_std": 0.4, "nominal": 0.0,
                },
                "wrench_offset/sole/2@2": {
                    "kind": "wrench_offset", "title": "force offsets", "label": "sole force z", "log": 2,
                    "unit": "N", "estimate": 3.0, "std": 0.06, "prior_std": 0.06, "nominal": 3.0,
                },
            },
        },
        "iterations": [
            {"window": k, "time_s": 0.5 * (k + 1), "chi2": 1.0, "std_kg": None}
            | {"estimate_kg": {"torso": 4.4, "calf<b>": 2.3}}
            for k in range(2)
        ],
        "status": "not identifiable",
        "mode": "online",
        "logs": ["walk.mcap"],
        "warnings": ["a sensor drifts"],
        "wall_s": 1.0,
        "log_s": 1.0,
        "reference": {"estimate_kg": {"torso": 4.5, "calf<b>": 9.876}, "method": "least squares", "cutoff_hz": 10.0},
        "options": {"noise": "auto", "bank_size": 24, "search": {"radius": 0.1}},
    }  # fmt: skip


def _store(path: Path, document: dict[str, object], covariance: tuple[float, float] = (0.01, 1.0)) -> None:
    """A document with its sidecar."""
    np.savez(path.with_suffix(".npz"), covariance=np.diag(covariance))
    digest = hashlib.sha256(path.with_suffix(".npz").read_bytes()).hexdigest()
    path.write_text(json.dumps(document | {"sidecar_sha256": digest}))


def test_the_page_is_whole_and_hides_what_was_not_found(tmp_path: Path) -> None:
    _store(tmp_path / "r.json", _document())
    assert write_report(tmp_path / "r.json", tmp_path / "r.html") == ()
    page = (tmp_path / "r.html").read_text()
    assert not re.search(r"https?:|<script|<link|<img|url\(", page)
    assert "calf<b>" not in page
    assert "calf&lt;b&gt;" in page
    assert "2.300" not in page  # what the search ended with for a hidden link
    assert "9.876" not in page  # what least squares say of it
    for text in ("knee +0.1 ±0.78 N m", "sole force z (log 2) +3 ±0.12 N", "read off the log", "bank-size"):
        assert text in page, text
    assert '<td>force offsets</td><td class="n">1</td><td class="n">1</td>' in page
    for text in ("4.400", "4.200 – 4.600", "not identifiable", "a sensor drifts", "what would help: walk", "±98%"):
        assert text in page, text


@pytest.mark.parametrize("text", ["nonsense", "[1, 2]", '{"links": {}}'])
def test_what_is_not_a_result_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "r.json").write_text(text)
    with pytest.raises(BadInputError, match="massid identify --json"):
        write_report(tmp_path / "r.json", tmp_path / "r.html")


def _swap(sidecar: Path) -> None:
    _store(sidecar.with_name("other.json"), _document(), (0.02, 1.0))
    sidecar.with_name("other.npz").replace(sidecar)


def _truncate(sidecar: Path) -> None:
    sidecar.write_bytes(sidecar.read_bytes()[:-40])


def _litter(sidecar: Path) -> None:
    sidecar.write_bytes(b"garbage")


@pytest.mark.parametrize("spoil", [_swap, _truncate, _litter])
def test_a_sidecar_that_is_not_the_results_is_refused(spoil: Callable[[Path], None], tmp_path: Path) -> None:
    _store(tmp_path / "r.json", _document())
    spoil(tmp_path / "r.npz")
    with pytest.raises(BadInputError, match=r"r\.npz is not the sidecar that was written with .*r\.json"):
        write_report(tmp_path / "r.json", tmp_path / "r.html")
    assert not (tmp_path / "r.html").exists()


def test_a_sidecar_beside_a_result_that_names_none_is_refused(tmp_path: Path) -> None:
    _store(tmp_path / "r.json", _document())
    (tmp_path / "r.json").write_text(json.dumps(_document()))
    with pytest.raises(BadInputError, match="which names none"):
        write_report(tmp_path / "r.json", tmp_path / "r.html")


def test_a_report_without_a_sidecar_says_so(tmp_path: Path) -> None:
    _store(tmp_path / "r.json", _document())
    (tmp_path / "r.npz").unlink()
    (warning,) = write_report(tmp_path / "r.json", tmp_path / "r.html")
    assert "r.npz does not exist" in warning


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": 7}, "has schema 7; expected schema 1"),
        ({"schema": None}, "has no schema; expected schema 1"),
        ({"log_s": math.nan}, "holds the number NaN; expected finite ones"),
        ({"log_s": "long"}, "/log_s is 'long'; expected a finite number"),
        ({"log_s": None}, "/log_s is null; expected a finite number"),
        ({"links": {"torso": {"estimate_kg": 4.0, "identifiable": True}}}, "has no entry /links/torso/nominal_kg"),
        ({"links": []}, "/links is a list; expected an object"),
        ({"iterations": [{"window": 0, "time_s": 0.5}]}, "has no entry /iterations/0/estimate_kg"),
        ({"uncertainty": {"chi2_per_sample": 1.0}}, "has no entry /uncertainty/nuisances"),
    ],
)
def test_a_document_that_lacks_something_is_refused(changes: dict[str, object], message: str, tmp_path: Path) -> None:
    _store(tmp_path / "r.json", _document() | changes)
    with pytest.raises(BadInputError, match=re.escape(message)):
        write_report(tmp_path / "r.json", tmp_path / "r.html")


def test_numbers_too_large_are_not_finite(tmp_path: Path) -> None:
    _store(tmp_path / "r.json", _document())
    text = (tmp_path / "r.json").read_text().replace('"wall_s": 1.0', '"wall_s": 1e999')
    (tmp_path / "r.json").write_text(text)
    with pytest.raises(BadInputError, match="holds the number 1e999"):
        write_report(tmp_path / "r.json", tmp_path / "r.html")


def test_lines_break_where_values_are_missing() -> None:
    chart = Chart("a", (0.0, 4.0), (0.0, 1.0))
    chart.line(np.arange(5.0), np.array([0.0, 1.0, np.nan, 0.5, 0.6]), "red")
    assert chart.svg().count("<polyline") == 2


def test_only_columns_of_numbers_stand_to_the_right(tmp_path: Path) -> None:
    page = HtmlPage("t")
    page.table(["name", "value"], [["a", "1.5"], ["b", "-2 %"]])
    page.write(tmp_path / "p.html")
    assert '<td>a</td><td class="n">1.5</td>' in (tmp_path / "p.html").read_text()
