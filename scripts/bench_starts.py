"""V-B from random starts all over Theta, with and without a scan: how many converge, and in how many windows.

python scripts/bench_starts.py --starts 300
python scripts/bench_starts.py --starts 300 --p2-upper 4.6
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from massid.paper.non_affine_case import TARGET_WINDOWS, first_below
from massid.paper.setting import CONVERGED, DEFAULT, NonAffineRun, as_start, random_starts
from massid.systems import non_affine


@dataclass(frozen=True)
class Bench:
    """Measure convergence over random starts."""

    starts: int = 300
    """Number of starts."""
    windows: int = 12
    """Dwell windows of 4 s for each."""
    direction: str = "gauss-newton"
    """Search direction."""
    p2_upper: float = 4.0
    """Upper end of Theta in p2; with 4 one of the scanned values is p* itself."""


def main(bench: Bench) -> None:
    """Run all starts and print the table."""
    table = Table(
        "scanned", "converged", f"0.01 within {TARGET_WINDOWS}", "windows: median", "90 %", "worst", "median error"
    )
    theta = (non_affine.THETA[0], (0.0, bench.p2_upper), non_affine.THETA[2])
    for scan in ((), ("p2",), ("p2", "p3")):
        search = replace(DEFAULT, scan=scan, direction=bench.direction)
        runs = [
            NonAffineRun(start=as_start(start), seed=i, windows=bench.windows, search=search, theta=theta).run()
            for i, start in enumerate(random_starts(bench.starts, theta))
        ]
        found = [run for run in runs if run.errors(non_affine.TRUTH)[-1] < CONVERGED]
        windows = [first_below(run) or bench.windows for run in found]
        errors = [run.errors(non_affine.TRUTH)[-1] for run in found]
        table.add_row(
            ", ".join(scan) or "nothing",
            f"{len(found)} of {len(runs)}",
            f"{sum(count <= TARGET_WINDOWS for count in windows)} of {len(runs)}",
            *(f"{np.percentile(windows, share):.0f}" for share in (50, 90, 100)),
            f"{np.median(errors):.4f}",
        )
    Console(highlight=False).print(table)


if __name__ == "__main__":
    main(tyro.cli(Bench, description=__doc__))
