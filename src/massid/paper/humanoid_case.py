"""V-D run again: a walk is recorded, the masses of seven links are found with each direction, Section IV is checked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from massid.assets import resolve_model, sample_walk
from massid.errors import FallError
from massid.identify import IdentifyOptions
from massid.log import read_walk
from massid.model.robot import Robot
from massid.paper.recorded import Check
from massid.paper.setting import DIRECTION_NAMES, Progress, silent
from massid.paper.walk_drift import WalkDrift, run_walk_drift
from massid.paper.walk_theory import WalkTheory
from massid.plant import record_walk, truth_path
from massid.score import Truth, score
from massid.search.guided import SearchOptions
from massid.typing import FloatArray
from massid.walk import Walk
from massid.weighing import weigh

THRESHOLD_KG = 0.5


@dataclass(frozen=True)
class MassErrors:
    """L2 mass error of one direction.

    Attributes:
        times_s: end of each window, from the start at 0, shape (1 + n,).
        l2_kg: shape (1 + n,).
        windows_to_threshold: windows after which the error stays below 0.5 kg; None if it does not.
    """

    times_s: FloatArray
    l2_kg: FloatArray
    windows_to_threshold: int | None


@dataclass(frozen=True)
class HumanoidCase:
    """All of V-D.

    Attributes:
        errors: by direction.
        walk: what was recorded.
        robot: with nominal masses.
        links: whose masses were unknown.
        dwell_s: T [s].
        checks: Section IV on models of this walk.
        drift: online against offline while the torso grows heavier; None where no walk was recorded.
    """

    errors: dict[str, MassErrors]
    walk: Walk
    robot: Robot
    links: tuple[str, ...]
    dwell_s: float
    checks: list[Check]
    drift: WalkDrift | None


def run_humanoid_case(
    folder: Path, seconds: float, seed: int = 0, robot_name: str = "atlas", progress: Progress = silent
) -> HumanoidCase:
    """Record a walk and identify from it with every direction.

    Args:
        folder: where the log is written; a log of the same length and seed is used again.
        seconds: length of the walk [s]; 0 for the sample walk that comes with massid.
        seed: of mass errors, gait and search.
        robot_name: shipped robot or MJCF file.
        progress: told the fraction done.

    Raises:
        FallError: the robot fell.
    """
    if seconds > 0.0:
        log = folder / f"{Path(robot_name).stem}_walk_{seconds:g}s_{seed}.mcap"
        if not (log.exists() and truth_path(log).exists()):
            report = record_walk(
                resolve_model(robot_name), log, seconds, seed=seed, progress=lambda f, w: progress(0.3 * f, w)
            )
            if report.fell:
                log.unlink()
                raise FallError(f"The robot fell after {report.duration_s:.1f} s; try another --seed.")
    else:
        log = sample_walk()
    walk, truth = read_walk(log), Truth.load(truth_path(log))
    robot = Robot.load(resolve_model(robot_name))
    links = tuple(robot.walking_links())
    options = IdentifyOptions(seed=seed)
    initial = float(np.linalg.norm([truth.mass_kg[link] - robot.nominal_mass_kg(link) for link in links]))
    errors = {}
    for i, name in enumerate(DIRECTION_NAMES):
        progress(0.3 + 0.2 * i / len(DIRECTION_NAMES), f"masses, {name}")
        with_direction = replace(options, search=SearchOptions(direction=name))
        result = weigh(walk, robot, links, mode="online", held_out=0.0, checks=False, options=with_direction)
        l2 = np.concatenate([[initial], score(result, truth).l2_error_kg])
        times = np.array([0.0, *(window.time_s for window in result.windows)])
        above = np.flatnonzero(l2 >= THRESHOLD_KG)
        last = int(above[-1]) + 1 if len(above) else 0
        errors[name] = MassErrors(times, l2, last if last < len(l2) else None)
    true_kg = np.array([truth.mass_kg[link] for link in links])
    theory = WalkTheory(robot, robot.align(walk), true_kg, links)
    checks = theory.checks(lambda fraction, what: progress(0.5 + 0.2 * fraction, what))
    drift = None
    if seconds > 0.0:
        drift = run_walk_drift(robot, folder, seed, lambda fraction, what: progress(0.7 + 0.3 * fraction, what))
    return HumanoidCase(errors, walk, robot, links, options.dwell_s, checks, drift)
