"""Error, processor time and memory of every method on one log, and their ratios to ours."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from costs.apart import Spent, run_apart
from costs.methods import Found, Prepare, peers, prepare_cma, prepare_massid
from costs.problem import Problem, error_kg
from costs.sheet import Sheet, number
from massid.errors import MassidError
from massid.score import Truth

OURS = "massid"
CMA = "CMA-ES on our bank"


@dataclass(frozen=True)
class Row:
    """What one method did with one log.

    Attributes:
        log: its name.
        method: its name.
        error_kg: L2 over the links asked for [kg]; None if there is no answer, like all that follows.
        processor_s: user and system time from the log in memory to the masses, the least of all rounds [s].
        peak_mib: most memory that its process held [MiB].
        before_mib: of that, before it began [MiB].
        note: how it went, or why not.
    """

    log: str
    method: str
    error_kg: float | None = None
    processor_s: float | None = None
    peak_mib: float | None = None
    before_mib: float | None = None
    note: str = ""


def compare(
    problem: Problem, truth: Truth, sysid: tuple[str, ...], budget: float, rounds: int, tell: Callable[[str], None]
) -> list[Row]:
    """Weigh the robot by every method, each time in a process of its own, in turns.

    Args:
        problem: the log.
        truth: what is to be found.
        sysid: forms of mujoco.sysid: chunks, observer.
        budget: processor time that CMA-ES gets, in times of ours; 0 for none.
        rounds: how often each method but CMA-ES runs.
        tell: told what has been measured.
    """
    methods: dict[str, Prepare] = {
        OURS: partial(prepare_massid, problem),
        f"{OURS}, as it comes": partial(prepare_massid, problem, as_it_comes=True),
        **peers(problem, sysid),
    }
    best: dict[str, Row] = {}
    for _ in range(rounds):
        for name, prepare in methods.items():
            row = _run(problem, truth, name, prepare)
            tell(f"{row.log}, {name}: {number(row.error_kg)} kg in {number(row.processor_s)} s {row.note}")
            best[name] = min(best.get(name, row), row, key=lambda one: one.processor_s or math.inf)
    ours_s = best[OURS].processor_s
    if budget > 0.0 and ours_s is not None:
        marks_s = (ours_s,) if budget > 1.0 else ()
        best[CMA] = _run(problem, truth, CMA, partial(prepare_cma, problem, budget * ours_s, marks_s))
        tell(f"{problem.name}, {CMA}: {number(best[CMA].error_kg)} kg, {best[CMA].note}")
    return list(best.values())


def _run(problem: Problem, truth: Truth, name: str, prepare: Prepare) -> Row:
    try:
        spent: Spent[Found] = run_apart(prepare)
    except MassidError as error:
        return Row(problem.name, name, note=str(error))
    found = spent.value
    early = [f"{number(error_kg(kg, truth))} kg after {number(at_s)} s" for at_s, kg in found.on_the_way]
    return Row(
        log=problem.name,
        method=name,
        error_kg=error_kg(found.mass_kg, truth),
        processor_s=spent.processor_s,
        peak_mib=spent.peak_mib,
        before_mib=spent.before_mib,
        note="; ".join(filter(None, (found.note, *early))),
    )


def peers_sheet(rows: list[Row], title: str) -> Sheet:
    """A row for each method and log: ratios first, then what they are ratios of."""
    return Sheet(
        title,
        (
            *("log", "method", "error / massid's", "processor / massid's", "memory / massid's"),
            *("error, kg", "processor, s", "peak (before it began), MiB", "note"),
        ),
        tuple(_lines(rows)),
    )


def _lines(rows: list[Row]) -> Iterator[tuple[str, ...]]:
    ours = {row.log: row for row in rows if row.method == OURS}
    for row in rows:
        reference = ours[row.log]
        yield (
            row.log,
            row.method,
            _ratio(row.error_kg, reference.error_kg),
            _ratio(row.processor_s, reference.processor_s),
            _ratio(row.peak_mib, reference.peak_mib),
            number(row.error_kg),
            number(row.processor_s),
            "-" if row.peak_mib is None else f"{row.peak_mib:.0f} ({row.before_mib:.0f})",
            row.note,
        )


def _ratio(value: float | None, reference: float | None) -> str:
    return number(None if value is None or not reference else value / reference)
