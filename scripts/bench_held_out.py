"""Held-out torques of walks whose masses are known: what the model file, what was found and the truth leave of them.

    python scripts/bench_held_out.py
    python scripts/bench_held_out.py --robots atlas nimble --presets white --seeds 3
    python scripts/bench_held_out.py --log walk.mcap --model robot.xml --truth walk.truth.json

The true masses must leave least, or the check would mislead. Sensor errors are those that the fit found, in all three
but the first: the file is taken with nominal values of everything, as `massid identify` does.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from accuracy.case import Case, own_gait
from accuracy.walks import prepare
from massid import IdentifyOptions, Weighing
from massid.errors import MassidError
from massid.judge.validation import predict_torques
from massid.log import read_walk
from massid.model.robot import Robot
from massid.score import Truth
from massid.walk import Walk
from massid.walk.noise import NoisePreset

ROBOTS = ("atlas", "heavy", "light", "nimble", "geared")


@dataclass(frozen=True)
class Bench:
    """Compare what the model file, the masses found and the true ones leave of held-out torques."""

    robots: tuple[str, ...] = ROBOTS
    """Shipped robots, each as the accuracy benchmark walks it."""
    presets: tuple[NoisePreset, ...] = ("clean", "white", "realistic")
    """Sensors."""
    seeds: int = 1
    """Walks of each."""
    seconds: float = 10.0
    """Length of a walk, a fifth of which is held out [s]."""
    logs: Path = Path("bench_accuracy_logs")
    """Folder of recorded walks."""
    log: Path | None = None
    """A log of your own instead, with --model and --truth."""
    model: Path | None = None
    """Its robot."""
    truth: Path | None = None
    """A JSON file with "links": {NAME: {"true_kg": ...}}, as massid record writes it."""


@dataclass(frozen=True)
class Trial:
    """A log, and what only the score may know.

    Attributes:
        name: of the row.
        walk: the log.
        robot: with nominal masses.
        true_kg: by link, of those that are weighed.
    """

    name: str
    walk: Walk
    robot: Robot
    true_kg: dict[str, float]


def main() -> int:
    """Run the benchmark; returns the exit code: 1 if the truth is beaten by the model file anywhere."""
    bench, console = tyro.cli(Bench, description=__doc__), Console()
    table = Table(title="Held-out torques, root mean square below 5 Hz [N m]")
    for head in ("log", "mass error [kg]", "file", "found", "true"):
        table.add_column(head, justify="left" if head == "log" else "right")
    beaten = False
    try:
        for trial in trials(bench):
            error, file, found, true = measure(trial)
            beaten |= true >= file
            table.add_row(trial.name, f"{error:.2g}", *(f"{value:.3g}" for value in (file, found, true)))
    except MassidError as error:
        console.print(f"[red]{error}[/red]")
        return 2
    console.print(table)
    return int(beaten)


def trials(bench: Bench) -> Iterator[Trial]:
    """The logs to look at."""
    if bench.log and bench.model and bench.truth:
        truth = Truth.load(bench.truth)
        yield Trial(bench.log.name, read_walk(bench.log), Robot.load(bench.model), dict(truth.mass_kg))
        return
    bench.logs.mkdir(parents=True, exist_ok=True)
    for robot in bench.robots:
        for preset in bench.presets:
            for seed in range(bench.seeds):
                case = Case(
                    "accuracy", "offline", robot, preset, "none", 0.0, bench.seconds, seed, gait=own_gait(robot)
                )
                given = prepare(case, bench.logs, bench.seconds)
                true_kg = {link: given.true_kg[link] for link in given.links}
                yield Trial(f"{robot}, {preset}, seed {seed}", given.noisy, given.robot, true_kg)


def measure(trial: Trial, held_out: float = 0.2, passes: int = IdentifyOptions.passes) -> tuple[float, ...]:
    """Error of the masses found [kg], and what file, estimate and truth leave [N m].

    Args:
        trial: the log.
        held_out: share of it that is predicted.
        passes: over the rest, at most.
    """
    links = [link for link in trial.true_kg if link in trial.robot.links]
    job = Weighing.prepare(trial.walk, trial.robot, links, held_out=held_out, options=IdentifyOptions(passes=passes))
    result, (held,) = job.identify(), job.held
    if held is None:
        raise MassidError(f"{trial.name}: the log is too short to hold anything out.")
    true = np.array([trial.true_kg[link] for link in links])
    at_truth = replace(result, estimate=true)
    file, found = predict_torques(result, held, job.robot).rms
    _, best = predict_torques(at_truth, held, job.robot).rms
    return float(np.linalg.norm(result.estimate - true)), file, found, best


if __name__ == "__main__":
    sys.exit(main())
