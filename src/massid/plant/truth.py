"""The truth of a simulated walk, written beside its log and read by the score alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from massid.errors import BadInputError
from massid.model.robot import Robot
from massid.plant.masses import HiddenMasses


def truth_path(log_path: Path) -> Path:
    """NAME.truth.json beside NAME.mcap."""
    return log_path.with_name(f"{log_path.stem}.truth.json")


def write_truth(
    path: Path, robot: Robot, hidden: HiddenMasses, seed: int | None, details: Mapping[str, Any] | None = None
) -> None:
    """Write what a log must not say: true masses of all links, and the seed that could regenerate them.

    Args:
        path: where to write, as `truth_path` says.
        robot: the robot with nominal masses.
        hidden: what was added to them.
        seed: of the recording; None if the masses were given.
        details: more keys of the document, such as the gait.

    Raises:
        BadInputError: the file cannot be written.
    """
    true_kg = hidden.true_kg(robot)
    document = {
        "links": {
            link: {"true_kg": mass_kg, "nominal_kg": robot.nominal_mass_kg(link)} for link, mass_kg in true_kg.items()
        },
        "changed_links": list(hidden.error_kg),
        "error_norm_kg": hidden.norm_kg,
        "seed": seed,
        **(details or {}),
    }
    save_truth(path, document)


def save_truth(path: Path, document: Mapping[str, Any]) -> None:
    """Write a truth document.

    Raises:
        BadInputError: the file cannot be written.
    """
    try:
        path.write_text(json.dumps(document, indent=2) + "\n")
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written: {error.strerror}.") from error
