"""The walker: time of a solve on the programmes of its own walk, and how many walks end in a fall.

    python scripts/bench_walker.py
    python scripts/bench_walker.py --robot light --walks 5

A programme is solved again and again, and the best time of each counts, since other programs may share the machine.
The hidden mass errors of the walks are those of `massid record` with the same seed.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from massid.assets import resolve_model
from massid.plant import record_walk
from massid.typing import FloatArray
from massid.walking import qp

ROUNDS = 5


@dataclass(frozen=True)
class Bench:
    """Measure the walker."""

    robot: str = "atlas"
    """Robot."""
    gait: str = "random"
    """How it walks."""
    walks: int = 20
    """Walks of seeds 0, 1, ...; none to measure the solver alone."""
    seconds: float = 30.0
    """Length of each walk [s]."""
    solver_seconds: float = 4.0
    """Length of the walk whose programmes are timed [s]; its seed is 0."""


def programmes(bench: Bench, folder: Path) -> list[tuple[Any, ...]]:
    """What the walker asks of the solver in one walk."""
    asked = []

    def watched(*programme: Any) -> FloatArray | None:
        asked.append(programme)
        return minimise(*programme)

    minimise = qp.minimise
    with patch.object(qp, "minimise", watched):
        record_walk(resolve_model(bench.robot), folder / "solver.mcap", bench.solver_seconds, gait=bench.gait)
    return asked


def best_us(programme: tuple[Any, ...]) -> float:
    """Shortest time of a solve [us]."""
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        qp.minimise(*programme)
        times.append(time.perf_counter() - start)
    return min(times) * 1e6


def main(bench: Bench) -> None:
    """Print one row per size of the programme, and one line about the walks."""
    console = Console(highlight=False)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        asked = programmes(bench, folder)
        table = Table("variables", "rows", "equalities", "programmes", "solve: median [us]", "99 % [us]", "unsolved")
        for size in sorted({(*problem[2].shape[::-1], problem[5]) for problem in asked}):
            same = [problem for problem in asked if (*problem[2].shape[::-1], problem[5]) == size]
            times = [best_us(problem) for problem in same]
            failed = sum(qp.minimise(*problem) is None for problem in same)
            spread = (f"{np.percentile(times, share):.0f}" for share in (50, 99))
            table.add_row(*map(str, size), str(len(same)), *spread, str(failed))
        console.print(table)
        fallen, unsolved = [], 0
        for seed in range(bench.walks):
            path = folder / "walk.mcap"
            report = record_walk(resolve_model(bench.robot), path, bench.seconds, gait=bench.gait, seed=seed)
            unsolved += report.failed_solves
            if report.fell:
                fallen.append(f"seed {seed} after {report.duration_s:.1f} s")
        console.print(
            f"{bench.walks} walks of {bench.seconds:g} s: {len(fallen)} falls, {unsolved} programmes without a solution"
        )
        for fall in fallen:
            console.print(fall)


if __name__ == "__main__":
    main(tyro.cli(Bench, description=__doc__))
