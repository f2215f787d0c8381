"""A result as people see it: what a terminal, a notebook and a data frame show agrees with its document."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from massid.result.file import plain, read_document, write_json
from massid.result.posterior import INTERVAL_95
from tests.result.results import ESTIMATE, STD, small_result
from tests.result.samples import HIDDEN


def test_a_result_is_the_document_that_is_read_back(tmp_path: Path) -> None:
    for noisy in (True, False):
        written = small_result(noisy).document(options={"noise": "auto", "search": {"scan": []}}, sidecar_sha256="0")
        write_json(written, tmp_path / "r.json")
        assert read_document(tmp_path / "r.json") == written


def test_json_is_the_document() -> None:
    result = small_result()
    assert result.to_json() == plain(result.document())
    assert not {"reference", "options", "sidecar_sha256"} & result.to_json().keys()
    assert plain(result.document(reference=None))["reference"] is None


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)


@pytest.mark.parametrize("noisy", [True, False])
@pytest.mark.parametrize("hidden", [True, False])
def test_the_columns_say_what_the_document_says(noisy: bool, hidden: bool) -> None:
    result = small_result(noisy, hidden)
    table, links = result.table(), result.document().links
    assert {len(column) for column in table.values()} == {2}
    rows = [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
    for row, (link, entry) in zip(rows, links.items(), strict=True):
        low, high = entry.interval95_kg or (None, None)
        expected = {
            "link": link,
            "nominal_kg": entry.nominal_kg,
            "estimate_kg": entry.estimate_kg,
            "std_kg": entry.std_kg,
            "low95_kg": low,
            "high95_kg": high,
            "identifiable": entry.identifiable,
        }
        assert {name: None if _is_nan(value) else value for name, value in row.items()} == expected
    assert math.isnan(table["estimate_kg"][1]) == hidden
    assert math.isnan(table["std_kg"][0]) != noisy


def test_a_notebook_shows_names_as_words() -> None:
    shown = replace(small_result(), warnings=("a sensor drifts",))._repr_html_()
    assert HIDDEN not in shown
    assert "calf&lt;b&gt;" in shown
    assert not re.search("<script|<style|https?:|url\\(", shown)
    assert "1 warning in .warnings" in shown


def test_a_notebook_shows_what_was_found_and_nothing_else() -> None:
    shown = small_result()._repr_html_()
    for text in ("4.4000", f"±{INTERVAL_95 * STD[0]:.3f}", "not identifiable", "com/torso/x", "0.12000"):
        assert f">{text}<" in shown, text
    assert f"{ESTIMATE[1]:.4f}" not in shown  # what the search ended with for a hidden link
    clean = small_result(noisy=False, hidden=False)._repr_html_()
    assert "95 %" not in clean
    assert "±" not in clean


def test_colours_are_those_of_the_notebook() -> None:
    """Neither a light nor a dark page hides a text that has the page's own colour on the page's own ground."""
    colours = re.findall(r"(?:^|[;\"])(?:color|background[^:]*):([^;\"]+)", small_result()._repr_html_())
    assert set(colours) == {"inherit"}


def test_a_result_is_shown_in_two_lines() -> None:
    first, second = repr(small_result()).split("\n")
    assert first.startswith("Result: not identifiable after 1 dwell window ")
    assert second == f"torso 4.400 +-0.2 kg, {HIDDEN} not identifiable (+-: 95 %)"
    assert repr(small_result(noisy=False, hidden=False)).endswith(f"\ntorso 4.400 kg, {HIDDEN} 2.300 kg")
