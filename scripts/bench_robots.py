"""Robots that nobody here wrote, and every trait of other people's model files: walk, log through rosbags, identify.

    python scripts/bench_robots.py --json robots.json

Seven links are off by a quarter of the norm of their masses, in a random direction. The log is written by rosbags and
read back by `massid.weigh`. Each identified model is saved into another folder and loaded.
"""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from lab.motions import LINKS, march, walk, wriggle
from lab.plant import Recorded, write_ros2
from lab.traits import TRAITS, atlas_with, stepping_humanoid, suite_robot
from massid import weigh
from massid.model.robot import Robot
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray

WINDOWS = 20


@dataclass(frozen=True)
class Bench:
    """Measure identification of many robots."""

    only: tuple[str, ...] = ()
    """Names of the cases to run; empty for all."""
    seconds: float = 10.5
    """Length of each log [s]."""
    seed: int = 0
    """Seeds mass errors and motion."""
    folder: Path = Path("bench_robots")
    """Where models and logs go."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write every number."""


@dataclass(frozen=True)
class Outcome:
    """One robot."""

    name: str
    motion: str
    landings: tuple[int, ...]
    bodies_in_contact: int
    self_contact: int
    before_kg: float
    after_kg: float
    windows: int
    status: str
    warnings: tuple[str, ...]


def identify(
    name: str, recorded: Recorded, motion: str, space: ParameterSpace, truth: FloatArray, bench: Bench
) -> Outcome:
    """Log through rosbags, read back, identify, save and load the model."""
    path = write_ros2(recorded, bench.folder / name.replace(" ", "_").replace(",", "") / "bag")
    links = [parameter.target for parameter in space.parameters]
    result = weigh(path, recorded.robot, links, mode="online", held_out=0.0, checks=False)
    errors = [float(np.linalg.norm(window.estimate[:LINKS] - truth)) for window in result.windows][:WINDOWS]
    saved = bench.folder / "saved" / f"{name.replace(' ', '_')}.xml"
    saved.parent.mkdir(parents=True, exist_ok=True)
    result.save_model(saved)
    Robot.load(saved)
    warnings = tuple(w.partition(": ")[2] for w in result.warnings if "checksum" not in w)
    return Outcome(
        name, motion, recorded.landings, len(recorded.wrenches), recorded.self_contact_samples,
        float(np.linalg.norm(space.nominal - truth)), errors[-1], len(errors), str(result.status), warnings,
    )  # fmt: skip


def cases(bench: Bench) -> dict[str, Callable[[], tuple[Recorded, str, ParameterSpace, FloatArray]]]:
    """Every robot by name."""
    found: dict[str, Callable[[], tuple[Recorded, str, ParameterSpace, FloatArray]]] = {}
    for trait in TRAITS:
        found[f"atlas: {trait}"] = lambda trait=trait: walk(
            atlas_with(trait, (bench.folder / "models" / trait.replace(" ", "_")).resolve()), bench
        )
    found["suite humanoid, steps"] = lambda: walk(stepping_humanoid()[0], bench, stepping_humanoid()[1])
    for name, feet in (("humanoid", ("left_foot", "right_foot")), ("humanoid_CMU", ("lfoot", "rfoot"))):
        found[f"suite {name}, harness"] = lambda name=name, feet=feet: march(suite_robot(name), feet, bench)
    for name in ("humanoid", "humanoid_CMU"):
        found[f"suite {name}, floor"] = lambda name=name: wriggle(suite_robot(name), bench)
    return found


def main(bench: Bench) -> None:
    """Run all cases and print the table."""
    console, outcomes = Console(highlight=False), []
    known = cases(bench)
    for name in bench.only or known:
        started = time.perf_counter()
        try:
            recorded, motion, space, truth = known[name]()
            outcome = identify(name, recorded, motion, space, truth, bench)
        except Exception as error:  # a bench shows what fails and goes on
            traceback.print_exc()
            console.print(f"{name}: {type(error).__name__}: {error}", markup=False)
            continue
        outcomes.append(outcome)
        console.print(
            f"{name}: {motion}, {outcome.landings} landings by foot, {outcome.before_kg:.3f} -> {outcome.after_kg:.2e} "
            f"kg in {outcome.windows} windows ({time.perf_counter() - started:.0f} s) {list(outcome.warnings)}",
            markup=False,
        )
    table = Table(
        "robot", "motion", "landings", "bodies", "self-contact", "before [kg]", "after [kg]", "windows", "status"
    )
    for o in outcomes:
        cells = (o.landings, o.bodies_in_contact, o.self_contact, f"{o.before_kg:.3f}", f"{o.after_kg:.1e}", o.windows)
        table.add_row(o.name, o.motion, *(str(cell) for cell in cells), o.status)
    console.print(table)
    if bench.json:
        bench.json.write_text(json.dumps([asdict(outcome) for outcome in outcomes], indent=1))


if __name__ == "__main__":
    main(tyro.cli(Bench, description=__doc__))
