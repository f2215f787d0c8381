"""mu along what the verdict calls hidden, beside mu along what it calls known, on logs of a robot that stands still.

    python scripts/bench_verdict.py
    python scripts/bench_verdict.py --robots atlas --presets clean white --seconds 5

The verdict is made before any fit. Then models are placed around the true masses along the combination of links that it
calls worst known, and along the link that it calls best known, in relative masses, and mu is summed over the log.
Twice: with all else held, and with sensors' errors and the other masses settled where they fit best (`settled`), which
is the mu that the verdict's standard deviation is about: mu rises by one at one deviation. A log without noise is
judged with the sensors that the verdict supposes for it, and by the mu that a search in it uses (`none`).
How the predicted deviations compare with those of estimates is what `bench_accuracy.py --verdict 20` measures.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from accuracy.along import STEPS, Curve, mu_along, n_models
from accuracy.case import Case
from accuracy.methods import options_of
from accuracy.walks import Given, prepare
from massid import Weighing
from massid.errors import MassidError
from massid.identify.prepare import prepare_logs
from massid.judge.foresee import REFERENCE
from massid.observer.blas import single_threaded
from massid.result.verdict import Verdict
from massid.typing import FloatArray
from massid.walk.noise import NoisePreset

SETTLING_S = 0.5
"""Left out at the beginning: the feet meet the floor, and that shakes every link."""
SHOWN = 0.1
"""Relative change of masses at which the rise of mu is printed."""


@dataclass(frozen=True)
class Bench:
    """Measure mu along hidden and known directions."""

    logs: Path = Path("bench_accuracy_logs")
    """Folder of the logs without noise."""
    robots: tuple[str, ...] = ("atlas", "light", "heavy")
    """Shipped robots."""
    presets: tuple[NoisePreset, ...] = ("clean", "white", "realistic")
    """Sensor noise."""
    gait: str = "stand"
    """What the robot does."""
    seconds: float = 3.0
    """Length of the log [s]."""
    seed: int = 0
    """Of the sensors."""
    threads: int = 0
    """Threads of the models; 0 for one per processor."""


@dataclass(frozen=True)
class Line:
    """A direction through the true masses.

    Attributes:
        name: by links.
        direction: unit vector in relative masses, shape (n_asked,).
        std: standard deviation along it that the verdict predicts, in relative masses.
        hidden: whether the verdict says that it cannot be known.
    """

    name: str
    direction: FloatArray
    std: float
    hidden: bool


def main(bench: Bench) -> None:
    """Measure and print."""
    bench.logs.mkdir(parents=True, exist_ok=True)
    table = Table(title=f"Rise of mu at -{SHOWN:.0%} and +{SHOWN:.0%} of the masses along a direction")
    for name in ("robot", "noise of the log", "noise in mu", "along", "verdict"):
        table.add_column(name)
    for name in ("mu, all else held", "mu, settled", "std predicted", "std from mu"):
        table.add_column(name, justify="right")
    for robot in bench.robots:
        for preset in bench.presets:
            case = Case("verdict", "offline", robot, preset, "none", 0.0, bench.seconds, bench.seed, gait=bench.gait)
            given = prepare(case, bench.logs, SETTLING_S + bench.seconds, SETTLING_S)
            options = options_of(case, bench.threads)
            verdict = Weighing.prepare(given.noisy, given.robot, given.links, held_out=0.0, options=options).foresee()
            lines = [worst_known(verdict), best_known(verdict)]
            for assumed in (REFERENCE, "clean") if preset == "clean" else (preset,):
                curves = measure(
                    replace(case, preset=assumed), given, [line.direction for line in lines], bench.threads
                )
                for line, curve in zip(lines, curves, strict=True):
                    said = "hidden" if line.hidden else "known"
                    noise = "none" if assumed == "clean" else assumed
                    table.add_row(robot, preset, noise, line.name, said, *numbers(curve, line))
            table.add_section()
    Console(highlight=False, width=220).print(table)


def worst_known(verdict: Verdict) -> Line:
    """The combination that the verdict names first; if it names none, the direction that it knows worst."""
    relative = verdict.covariance / np.outer(verdict.space.scale, verdict.space.scale)
    if verdict.combinations:
        named = verdict.combinations[0]
        return Line(named.text, named.change, named.std, hidden=True)
    values, vectors = np.linalg.eigh(relative)
    return Line("worst known", vectors[:, -1], float(np.sqrt(values[-1])), hidden=False)


def best_known(verdict: Verdict) -> Line:
    """The link whose mass the verdict knows best."""
    relative = verdict.std / verdict.space.scale
    best = int(np.argmin(relative))
    return Line(verdict.links[best], np.eye(len(relative))[best], float(relative[best]), not verdict.identifiable[best])


def measure(case: Case, given: Given, directions: list[FloatArray], threads: int) -> list[Curve]:
    """Curves of mu through the true masses, with the noise that the case says, or none."""
    (log,) = prepare_logs([given.noisy], given.robot, given.space, options_of(case, threads))
    walk, space, count = log.walk, log.space, n_models(len(directions))
    with single_threaded():
        bank = log.sensors.bank(given.robot, space, walk.contact_bodies, walk.timestep_s, count, threads)
        return mu_along(walk, bank, space, given.truth(space), directions)


def numbers(curve: Curve, line: Line) -> list[str]:
    """Cells of the table."""
    rows = [STEPS.index(-SHOWN), STEPS.index(SHOWN)]
    held = " / ".join(f"{value:.3g}" for value in curve.held[rows])
    settled = "-" if curve.settled is None else " / ".join(f"{value:.3g}" for value in curve.settled[rows])
    return [held, settled, f"{line.std:.2%}", "-" if curve.std is None else f"{curve.std:.2%}"]


if __name__ == "__main__":
    try:
        main(tyro.cli(Bench, description=__doc__))
    except MassidError as error:
        sys.stderr.write(f"bench_verdict: error: {error}\n")
        sys.exit(error.exit_code)
