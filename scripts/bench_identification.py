"""Walk and identify many times: falls, dwell windows until the L2 mass error is below 0.5 kg, error after 6 and 20.

    python scripts/bench_identification.py --robot atlas --walks 10 --seconds 60 --json atlas.json

Every walk has other hidden masses, other steps and another seed of the search. Logs are kept in --logs and used again.
"""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from massid import IdentifyOptions, weigh
from massid.assets import resolve_model
from massid.log import read_walk
from massid.model.robot import Robot
from massid.plant import record_walk
from massid.score import Truth, score
from massid.search.guided import SearchOptions

THRESHOLD_KG = 0.5


@dataclass(frozen=True)
class Bench:
    """Measure walking and identification over several seeds."""

    robot: str = "atlas"
    """Shipped robot or MJCF file."""
    walks: int = 10
    """Number of walks."""
    seconds: float = 60.0
    """Length of each [s]."""
    gait: str = "random"
    """How to walk."""
    directions: tuple[str, ...] = ("gauss-newton", "gradient")
    """Search directions to compare; none to record only."""
    logs: Path = Path("bench_logs")
    """Folder of the logs."""
    workers: int = 2
    """Processes."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write every number."""


@dataclass(frozen=True)
class Outcome:
    """One walk."""

    seed: int
    walked_s: float
    fell: bool
    l2_initial_kg: float
    l2_error_kg: dict[str, list[float]] = field(default_factory=dict)


def run(bench: Bench, seed: int) -> Outcome:
    """Record one walk, or find it, and identify from it with every direction."""
    path = bench.logs / f"{Path(bench.robot).stem}_{bench.gait}_{bench.seconds:g}s_{seed}.mcap"
    if not path.exists():
        record_walk(resolve_model(bench.robot), path, bench.seconds, gait=bench.gait, seed=seed)
    walk = read_walk(path)
    robot = Robot.load(resolve_model(bench.robot))
    links = robot.walking_links()
    truth = Truth.load(path.with_suffix(".truth.json"))
    initial = np.linalg.norm([truth.mass_kg[link] - robot.nominal_mass_kg(link) for link in links])
    errors = {}
    for direction in bench.directions:
        options = IdentifyOptions(threads=1, seed=seed, search=SearchOptions(direction=direction))
        result = weigh(walk, robot, links, mode="online", held_out=0.0, checks=False, options=options)
        errors[direction] = score(result, truth).l2_error_kg.tolist()
    return Outcome(seed, walk.duration_s, walk.metadata.get("end") == "fell", float(initial), errors)


def windows_until(errors: list[float], threshold_kg: float) -> float:
    """Windows after which the error stays below the threshold; inf if it never does."""
    above = [k for k, error in enumerate(errors) if error >= threshold_kg]
    last = above[-1] + 1 if above else 0
    return last + 1 if last < len(errors) else np.inf


def after(errors: list[float], windows: int) -> float:
    """Error after so many windows; a search that converged earlier stays where it ended."""
    return errors[min(windows, len(errors)) - 1]


def main(bench: Bench) -> None:
    """Run all walks and print the table."""
    bench.logs.mkdir(parents=True, exist_ok=True)
    outcomes = []
    console = Console(highlight=False)
    with ProcessPoolExecutor(bench.workers) as pool:
        for outcome in pool.map(run, [bench] * bench.walks, range(bench.walks)):
            outcomes.append(outcome)
            last = {name: f"{errors[-1]:.1e}" for name, errors in outcome.l2_error_kg.items()}
            console.print(f"seed {outcome.seed}: {outcome.walked_s:.0f} s, {outcome.l2_initial_kg:.2f} kg -> {last} kg")
    falls = sum(outcome.fell for outcome in outcomes)
    initial = np.mean([outcome.l2_initial_kg for outcome in outcomes])
    console.print(
        f"\n{bench.robot}: {bench.walks} walks of {bench.seconds:g} s ({bench.gait}), {falls} falls, "
        f"L2 mass error {initial:.2f} kg before"
    )
    table = Table(
        "direction", "windows to 0.5 kg: mean", "worst", "L2 after 6 [kg]: mean", "worst", "after 20: mean", "worst"
    )
    for direction in bench.directions:
        runs = [outcome.l2_error_kg[direction] for outcome in outcomes]
        windows = [windows_until(errors, THRESHOLD_KG) for errors in runs]
        row = [f"{np.mean(windows):.1f}", f"{np.max(windows):.0f}"]
        for count in (6, 20):
            values = [after(errors, count) for errors in runs]
            row += [f"{np.mean(values):.2g}", f"{np.max(values):.2g}"]
        table.add_row(direction, *row)
    if bench.directions:
        console.print(table)
    if bench.json:
        bench.json.write_text(json.dumps([asdict(outcome) for outcome in outcomes], indent=1))


if __name__ == "__main__":
    main(tyro.cli(Bench, description=__doc__))
