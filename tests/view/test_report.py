"""The report of a result: one file that needs nothing else, and says what the result says."""

from __future__ import annotations

import contextlib
import hashlib
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from massid.errors import BadInputError
from massid.result.document import Document
from massid.result.file import plain, write_json
from massid.view.chart import Chart
from massid.view.page import HtmlPage
from massid.view.report import write_report
from tests.result.samples import JUNK, changed, document, entries


def _store(path: Path, written: Document, covariance: tuple[float, float] = (0.01, 1.0)) -> None:
    """A document with its sidecar."""
    np.savez(path.with_suffix(".npz"), covariance=np.diag(covariance))
    digest = hashlib.sha256(path.with_suffix(".npz").read_bytes()).hexdigest()
    write_json(replace(written, sidecar_sha256=digest), path)


def test_the_page_is_whole_and_hides_what_was_not_found(tmp_path: Path) -> None:
    _store(tmp_path / "r.json", document())
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


def test_a_document_from_before_nuisances_had_labels_shows_their_names(tmp_path: Path) -> None:
    written = plain(document()) | {"sidecar_sha256": None}
    for entry in written["uncertainty"]["nuisances"].values():
        for name in ("kind", "title", "label", "log"):
            entry.pop(name, None)
    write_json(written, tmp_path / "old.json")
    write_report(tmp_path / "old.json", tmp_path / "r.html")
    assert "effort_offset/knee +0.1 ±0.78 N m" in (tmp_path / "r.html").read_text()


def _swap(sidecar: Path) -> None:
    _store(sidecar.with_name("other.json"), document(), (0.02, 1.0))
    sidecar.with_name("other.npz").replace(sidecar)


def _truncate(sidecar: Path) -> None:
    sidecar.write_bytes(sidecar.read_bytes()[:-40])


def _litter(sidecar: Path) -> None:
    sidecar.write_bytes(b"garbage")


@pytest.mark.parametrize("spoil", [_swap, _truncate, _litter])
def test_a_sidecar_that_is_not_the_results_is_refused(spoil: Callable[[Path], None], tmp_path: Path) -> None:
    _store(tmp_path / "r.json", document())
    spoil(tmp_path / "r.npz")
    with pytest.raises(BadInputError, match=r"r\.npz is not the sidecar that was written with .*r\.json"):
        write_report(tmp_path / "r.json", tmp_path / "r.html")
    assert not (tmp_path / "r.html").exists()


def test_a_sidecar_beside_a_result_that_names_none_is_refused(tmp_path: Path) -> None:
    _store(tmp_path / "r.json", document())
    write_json(document(), tmp_path / "r.json")
    with pytest.raises(BadInputError, match="which names none"):
        write_report(tmp_path / "r.json", tmp_path / "r.html")


def test_a_report_without_a_sidecar_says_so(tmp_path: Path) -> None:
    _store(tmp_path / "r.json", document())
    (tmp_path / "r.npz").unlink()
    (warning,) = write_report(tmp_path / "r.json", tmp_path / "r.html")
    assert "r.npz does not exist" in warning


def test_a_document_that_is_not_whole_makes_no_page(tmp_path: Path) -> None:
    _store(tmp_path / "r.json", replace(document(), status=None))
    with pytest.raises(BadInputError, match="/status is null; expected a text"):
        write_report(tmp_path / "r.json", tmp_path / "r.html")
    assert not (tmp_path / "r.html").exists()


@pytest.mark.parametrize("junk", JUNK, ids=lambda junk: str(junk)[:8])
def test_no_document_breaks_the_page(junk: object, tmp_path: Path) -> None:
    whole, path = plain(document()), tmp_path / "r.json"
    for where in entries(whole):
        write_json(changed(whole, where, junk), path)
        with contextlib.suppress(BadInputError):
            write_report(path, tmp_path / "r.html")


def test_lines_break_where_values_are_missing() -> None:
    chart = Chart("a", (0.0, 4.0), (0.0, 1.0))
    chart.line(np.arange(5.0), np.array([0.0, 1.0, np.nan, 0.5, 0.6]), "red")
    assert chart.svg().count("<polyline") == 2


def test_only_columns_of_numbers_stand_to_the_right(tmp_path: Path) -> None:
    page = HtmlPage("t")
    page.table(["name", "value"], [["a", "1.5"], ["b", "-2 %"]])
    page.write(tmp_path / "p.html")
    assert '<td>a</td><td class="n">1.5</td>' in (tmp_path / "p.html").read_text()
