"""What massid costs against what one could use instead: its bank, its identifications, and what makes them dearer.

    python scripts/bench_costs.py
    python scripts/bench_costs.py --quick
    python scripts/bench_costs.py --parts peers --robot atlas --seconds 10 --json costs.json
    python scripts/bench_costs.py --log walk.mcap --model robot.xml --truth walk.truth.json --links torso l_thigh

Every figure is a ratio of two that were measured in one run, in turns, and the least of all rounds counts, since other
programs may share the machine. Processor time is user and system time of all threads. Every identification runs in a
process of its own, from the log in memory to the masses. The log of `--log` takes the place of the recorded walks, and
what is not asked for in it is taken to be right. docs/speed.md says more.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from costs.bank import bank_sheet, measure_banks
from costs.machine import describe_machine
from costs.peers import compare, peers_sheet
from costs.problem import Problem, given_problem, record_problems, truth_of
from costs.scaling import measure_scaling, scaling_sheet, variations
from costs.sheet import Sheet, as_markdown
from massid.errors import BadInputError, MassidError
from massid.plant import default_links

Part = Literal["bank", "peers", "scaling"]
PARTS: tuple[Part, ...] = ("bank", "peers", "scaling")


@dataclass(frozen=True)
class Bench:
    """Measure costs."""

    parts: tuple[Part, ...] = PARTS
    """Bank against engine, identification against other methods, identification against its size."""
    robot: str = "light"
    """Shipped robot, or model file of one that can walk, for the recorded walks."""
    seconds: float = 8.0
    """Length of the walks that all methods weigh [s]."""
    seed: int = 0
    """Of masses, steps, sensors and methods."""
    log: Path | None = None
    """A log to use in place of recorded walks; scaling, which needs walks of several lengths, is left out."""
    model: str | None = None
    """The robot of that log."""
    truth: Path | None = None
    """Its true masses; default NAME.truth.json beside it."""
    links: tuple[str, ...] = ()
    """Links to weigh in it; default the usual ones."""
    threads: int = 1
    """Threads of every method."""
    rounds: int = 1
    """How often each identification but CMA-ES is measured, in turns; more on a busy machine."""
    bank_rounds: int = 7
    """How often each step of the bank is, in turns."""
    sysid: tuple[Literal["chunks", "observer"], ...] = ("chunks",)
    """Forms of mujoco.sysid: rollouts of 50 samples, which err less in noise, or of 0.5 s with our output injection."""
    cma_budget: float = 20.0
    """Processor time of CMA-ES in times of massid's; 0 for none."""
    bank_sizes: tuple[int, ...] = (8, 24, 48)
    """Models of a bank that is timed."""
    bank_threads: tuple[int, ...] = (1, 2)
    """Threads of it, and of identifications that are scaled."""
    unknowns: tuple[int, ...] = (2, 7, 12, 20)
    """Numbers of unknowns to scale to."""
    lengths: tuple[float, ...] = (4.0, 8.0, 16.0)
    """Lengths of the log to scale to; all else is varied at the middle one [s]."""
    scaled_banks: tuple[int, ...] = (15, 24, 48)
    """Banks to scale to."""
    quick: bool = False
    """Less of everything: two to three minutes of processor time."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write every number."""
    markdown: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write the tables for a document; default print them after the others."""

    def shortened(self) -> Bench:
        """As `quick` has it."""
        if not self.quick:
            return self
        return replace(
            self, seconds=2.0, rounds=1, bank_rounds=3, cma_budget=3.0, bank_sizes=(8, 24), unknowns=(2, 7, 12),
            lengths=(1.0, 2.0, 3.0), scaled_banks=(15, 24),
        )  # fmt: skip


def main(bench: Bench) -> None:
    """Measure, print, write."""
    bench = bench.shortened()
    console, progress = Console(highlight=False), Console(stderr=True, highlight=False)
    machine = describe_machine()
    console.print(machine, soft_wrap=True)
    document: dict[str, Any] = {"machine": machine}
    sheets: list[Sheet] = []
    with TemporaryDirectory(prefix="bench_costs_") as folder:
        for part in bench.parts:
            if part == "scaling" and bench.log is not None:
                continue
            rows, sheet = MEASURES[part](bench, Path(folder), lambda line: progress.print(line, soft_wrap=True))
            document[part] = [asdict(row) for row in rows]
            sheets.append(sheet)
            console.print(sheet.rich())
    text = as_markdown(sheets, machine)
    if bench.markdown is None:
        console.print(f"\n{text}", soft_wrap=True, markup=False)
    else:
        bench.markdown.write_text(text)
    if bench.json is not None:
        bench.json.write_text(json.dumps(document, indent=1))


Measured = tuple[Sequence[Any], Sheet]
Measure = Callable[[Bench, Path, Callable[[str], None]], Measured]


def measure_bank(bench: Bench, folder: Path, _: Callable[[str], None]) -> Measured:
    """The bank against the engine."""
    costs = measure_banks(problems(bench, folder), bench.bank_sizes, bench.bank_threads, bench.bank_rounds)
    return costs, bank_sheet(costs)


def measure_peers(bench: Bench, folder: Path, tell: Callable[[str], None]) -> Measured:
    """Ours against other methods."""
    rows = [
        row
        for problem in problems(bench, folder)
        for row in compare(problem, truth_of(problem, bench.truth), bench.sysid, bench.cma_budget, bench.rounds, tell)
    ]
    what = bench.log.name if bench.log else f"{bench.seconds:g} s of {bench.robot}"
    return rows, peers_sheet(rows, f"Weighing from {what}, {bench.threads} thread{'s' * (bench.threads > 1)}")


def measure_scales(bench: Bench, folder: Path, tell: Callable[[str], None]) -> Measured:
    """Ours against its size, on a walk on which the model errs in the links alone that are always asked for."""
    links = default_links(Problem("", Path(), bench.robot, "clean").robot)[: min(bench.unknowns)]
    _, noisy = record_problems(bench.robot, folder, max(bench.lengths), bench.seed, 1, links)
    cases = variations(
        noisy,
        unknowns=bench.unknowns,
        seconds=bench.lengths,
        threads=bench.bank_threads,
        bank_sizes=bench.scaled_banks,
    )
    costs = measure_scaling(cases, bench.rounds, tell)
    return costs, scaling_sheet(costs)


MEASURES: dict[Part, Measure] = {"bank": measure_bank, "peers": measure_peers, "scaling": measure_scales}


def problems(bench: Bench, folder: Path) -> tuple[Problem, ...]:
    """The logs that are weighed."""
    if bench.log is None:
        return record_problems(bench.robot, folder, bench.seconds, bench.seed, bench.threads)
    if bench.model is None:
        raise BadInputError("`--log` needs `--model`, a shipped robot or a model file.")
    return (given_problem(bench.log, bench.model, bench.links or None, bench.seed, bench.threads),)


if __name__ == "__main__":
    try:
        main(tyro.cli(Bench, description=__doc__))
    except MassidError as error:
        sys.stderr.write(f"bench_costs: error: {error}\n")
        sys.exit(error.exit_code)
