"""One measurement of the benchmark, named by what it was made with, and the file that keeps those made so far."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from massid.walk.noise import NoisePreset
from massid.walking.gait import DEFAULT_GAIT

OWN_GAITS = {"nimble": "stamp", "geared": "stamp"}
"""How robots walk that are not walked as all others."""

Part = Literal["accuracy", "coverage", "verdict", "wrong", "lengths", "speed"]
Method = Literal["online", "offline", "bound", "least-squares", "sysid", "sysid-observer"]
Friction = Literal["none", "0.1", "5%"]
Fault = Literal["none", "com", "inertia", "friction", "links"]
SensorSet = Literal["all", "no-wrench"]


@dataclass(frozen=True)
class Case:
    """What is measured, on which walk, through which sensors.

    Attributes:
        part: of the benchmark.
        method: what weighs the robot, or bounds it.
        robot: a shipped one.
        preset: sensor noise.
        friction: friction loss of every joint in truth and model: N m, a share of the joint's torque limit, or none
            but what the robot's file says.
        other_links: relative standard deviation of the masses of links that are not asked for, in truth and belief.
        seconds: of walking.
        seed: of masses, gait, sensors and search.
        fault: what else is wrong in the model.
        gait: how the robot walks.
        sensors: which the robot has; no-wrench for none at its feet.
    """

    part: Part
    method: Method
    robot: str
    preset: NoisePreset
    friction: Friction
    other_links: float
    seconds: float
    seed: int
    fault: Fault = "none"
    gait: str = DEFAULT_GAIT
    sensors: SensorSet = "all"

    @property
    def walk_seed(self) -> int:
        """Seed of masses and steps: a verdict is judged by one walk that is measured again and again."""
        return 0 if self.part == "verdict" else self.seed

    @property
    def believed_other_links(self) -> float:
        """What is believed of links that are not asked for; with a wrong model, what is the default."""
        return 0.02 if self.part == "wrong" else self.other_links

    @property
    def believed_link_inertia(self) -> float:
        """What is believed of rotational inertias: they are right, or with a wrong model, what is the default."""
        return 0.1 if self.part == "wrong" else 0.0

    @property
    def believed_lag_s(self) -> float:
        """What is believed of the times by which inputs are stamped late, likewise."""
        return 5e-4 if self.part == "wrong" else 0.0


def own_gait(robot: str) -> str:
    """How a robot walks where no gait is asked for."""
    return OWN_GAITS.get(robot, DEFAULT_GAIT)


class Ledger:
    """A file with one finished case a line: what was measured survives whatever happens later.

    Args:
        path: made if it does not exist; a last line that was cut off is dropped.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._results: dict[Case, dict[str, Any]] = {}
        lines = path.read_text().splitlines() if path.exists() else []
        for line in lines:
            try:
                entry = json.loads(line)
            except ValueError:
                continue
            self._results[Case(**entry["case"])] = entry["result"]
        path.write_text("".join(_line(case, result) for case, result in self._results.items()))

    def missing(self, cases: Iterable[Case]) -> list[Case]:
        """Those not measured yet, in order."""
        return [case for case in cases if case not in self._results]

    def add(self, case: Case, result: dict[str, Any]) -> None:
        """Keep a result."""
        self._results[case] = result
        with self._path.open("a") as file:
            file.write(_line(case, result))

    def rows(self, part: Part) -> Iterator[tuple[Case, dict[str, Any]]]:
        """Results of one part."""
        return ((case, result) for case, result in self._results.items() if case.part == part)


def _line(case: Case, result: dict[str, Any]) -> str:
    return json.dumps({"case": asdict(case), "result": result}) + "\n"
