"""massid paper: files, the schema of results.json, the page, and what it does when something is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from massid.cli import main
from massid.paper.illustration import TRUTH, illustrate
from massid.paper.page import write_page
from massid.paper.recorded import Check
from massid.paper.reproduce import Reproduction, reproduce, results
from massid.paper.walk_theory import WalkTheory


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """V-A, as the command writes it."""
    folder = tmp_path_factory.mktemp("paper") / "new"
    assert main(["paper", "--only", "A", "--out", str(folder)]) == 0
    return folder


def test_results_hold_what_was_asked_for(folder: Path) -> None:
    document = json.loads((folder / "results.json").read_text())
    assert set(document) == {"A", "theory"}
    assert all(check["holds"] for check in document["theory"])
    assert set(document["A"]) == {"error", "iterations"}
    assert document["A"]["error"] < 0.11  # the paper's
    assert document["A"]["iterations"] < 9


def test_the_page_has_the_papers_numbers_and_its_pictures(folder: Path) -> None:
    page = (folder / "index.html").read_text()
    assert "21.9" in page
    assert "9, 0.11" in page
    assert "does not hold" not in page
    assert "Theorem 2" in page
    assert (folder / "fig2.png").stat().st_size > 10_000
    assert 'src="fig2.png"' in page


def test_a_statement_that_does_not_hold_stands_out(tmp_path: Path) -> None:
    checks = [Check("V-A", "Theorem 0", "p < <b>0</b>", "p = 1", holds) for holds in (True, False)]
    write_page(Reproduction(checks=checks), tmp_path / "index.html")
    page = (tmp_path / "index.html").read_text()
    assert '<td class="good">holds</td>' in page
    assert '<td class="bad">does not hold</td>' in page
    assert "p &lt; &lt;b&gt;0&lt;/b&gt;" in page


def test_v_d_on_the_sample_walk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(WalkTheory, "checks", lambda theory, progress: [])  # they have tests of their own
    out = reproduce(tmp_path, ("D",), walk_s=0.0)
    windows = results(out)["D"]["windows_to_0_5kg"]
    assert set(windows) == {"gradient", "gauss-newton"}
    assert windows["gauss-newton"] <= 2
    assert windows["gradient"] is None  # 5 s are too short for it
    write_page(out, tmp_path / "index.html")
    assert {path.name for path in tmp_path.iterdir()} == {"fig5.png", "fig6.png", "results.json", "index.html"}


def test_fig_1_is_a_real_step() -> None:
    case = illustrate()
    lowest = np.unravel_index(np.argmin(case.mu), case.mu.shape)
    np.testing.assert_allclose([case.p1[lowest[1]], case.p3[lowest[0]]], TRUTH, atol=0.3)
    assert np.linalg.norm(case.path[-1] - TRUTH) < np.linalg.norm(case.path[0] - TRUTH)
    assert len(case.points) == 9


def test_nothing_run_gives_an_empty_page(tmp_path: Path) -> None:
    out = Reproduction()
    assert results(out) == {}
    write_page(out, tmp_path / "index.html")
    assert "<h1>" in (tmp_path / "index.html").read_text()


def test_a_folder_that_cannot_be_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["paper", "--only", "A", "--out", str(tmp_path / "file" / "x")]) == 2
    assert "Cannot make the folder" in capsys.readouterr().err
