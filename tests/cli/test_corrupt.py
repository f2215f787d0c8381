from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massid.assets import sample_walk
from massid.cli import main
from massid.log import read_walk, write_walk


def test_a_clean_log_gets_noise_and_its_truth_comes_along(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "noisy.mcap"
    assert main(["corrupt", str(sample_walk()), str(out), "--noise", "white", "--seed", "4"]) == 0
    assert "noisy.truth.json" in capsys.readouterr().out
    assert read_walk(out).metadata["model_sha256"] == read_walk(sample_walk()).metadata["model_sha256"]
    truth = json.loads((tmp_path / "noisy.truth.json").read_text())
    assert truth["sensors"]["seed"] == 4
    assert "torso" in truth["links"]


@pytest.mark.parametrize(
    ("source", "out", "message"),
    [
        ("walk.mcap", "missing/noisy.mcap", "the folder {folder}/missing does not exist"),
        ("nothing.mcap", "noisy.mcap", "nothing.mcap: does not exist"),
        ("walk.mcap", "walk.mcap", "is the clean log itself"),
    ],
)
def test_bad_input_is_one_line(
    source: str, out: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "walk.mcap").write_bytes(sample_walk().read_bytes())
    assert main(["corrupt", str(tmp_path / source), str(tmp_path / out)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message.format(folder=tmp_path) in error


def test_a_robot_without_force_sensors_logs_no_wrench_and_names_its_feet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "blind.mcap"
    assert main(["corrupt", str(sample_walk()), str(out), "--noise", "clean", "--drop", "wrench"]) == 0
    before, after = read_walk(sample_walk()), read_walk(out)
    assert after.contact_bodies == before.contact_bodies
    assert not after.measured.any()
    assert not after.wrench.any()
    assert after.effort.tobytes() == before.effort.tobytes()
    capsys.readouterr()
    assert main(["inspect", str(out), "--links", "torso"]) == 0
    said = capsys.readouterr().out
    assert "no sensor reads what l_foot, r_foot carry" in said
    assert "ground carries" not in said


def test_sensors_that_are_dropped_from_a_noisy_log_leave_the_others_as_they_were(tmp_path: Path) -> None:
    noisy, blind = tmp_path / "noisy.mcap", tmp_path / "blind.mcap"
    assert main(["corrupt", str(sample_walk()), str(noisy), "--seed", "4"]) == 0
    assert main(["corrupt", str(noisy), str(blind), "--drop", "wrench"]) == 0
    np.testing.assert_allclose(read_walk(blind).qvel, read_walk(noisy).qvel, rtol=0, atol=1e-12)
    truths = [json.loads(path.with_suffix(".truth.json").read_text()) for path in (noisy, blind)]
    assert truths[0] == truths[1]


def test_noise_on_top_of_noise_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    walk = read_walk(sample_walk())
    shaken = replace(walk, qvel=walk.qvel + 0.02 * np.random.default_rng(0).normal(size=walk.qvel.shape))
    write_walk(shaken, tmp_path / "real.mcap")
    assert main(["corrupt", str(tmp_path / "real.mcap"), str(tmp_path / "out.mcap")]) == 0
    assert "--noise realistic comes on top of it" in capsys.readouterr().err
