"""The truth of a simulated walk, which lies beside its log and is read by the score alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from massid.model.robot import Robot
from massid.plant.masses import HiddenMasses


def truth_path(log_path: Path) -> Path:
    """NAME.truth.json beside NAME.mcap."""
    return log_path.with_name(f"{log_path.stem}.truth.json")


def truth_of(robot: Robot, hidden: HiddenMasses, seed: int | None, details: Mapping[str, Any] | None = None) -> bytes:
    """What a log must not say, as the content of its truth file: true masses of all links, and the seed behind them.

    Args:
        robot: the robot with nominal masses.
        hidden: what was added to them.
        seed: of the recording; None if the masses were given.
        details: more keys of the document, such as the gait.
    """
    true_kg = hidden.true_kg(robot)
    document = {
        "links": {
            link: {"true_kg": mass_kg, "nominal_kg": robot.nominal_mass_kg(link)} for link, mass_kg in true_kg.items()
        },
        "changed_links": list(hidden.error_kg),
        "error_norm_kg": hidden.norm_kg,
        **_carried(robot, hidden),
        "seed": seed,
        **(details or {}),
    }
    return as_json(document)


def _carried(robot: Robot, hidden: HiddenMasses) -> dict[str, Any]:
    """Payloads, named as what identification may be asked for; nothing if there are none."""
    payloads = {payload.name: mass_kg for payload, mass_kg in hidden.payloads(robot)}
    return {"quantities": payloads} if payloads else {}


def as_json(document: Mapping[str, Any]) -> bytes:
    """A truth document as the content of its file."""
    return f"{json.dumps(document, indent=2)}\n".encode()
