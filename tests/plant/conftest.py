from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pytest

from massid.assets import shipped_models
from massid.log.reader import read_walk
from massid.model.robot import Robot
from massid.plant import RecordingReport, record_walk
from massid.walk import Walk

ATLAS = shipped_models()["atlas"]


@dataclass(frozen=True)
class Walked:
    """A recorded walk with what only tests may know."""

    report: RecordingReport
    walk: Walk
    true_kg: dict[str, float]


@pytest.fixture(scope="session")
def atlas() -> Robot:
    return Robot.load(ATLAS)


@pytest.fixture(scope="session")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Walked:
    """Two and a half seconds of the default walk: the first shift, two swings and touchdowns."""
    report = record_walk(ATLAS, tmp_path_factory.mktemp("walk") / "walk.mcap", 2.5, seed=4)
    return Walked(report, read_walk(report.path), true_masses(report.truth_path))


def true_masses(path: Path) -> dict[str, float]:
    return {link: entry["true_kg"] for link, entry in json.loads(path.read_text())["links"].items()}
