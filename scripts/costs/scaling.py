"""Processor time of a noisy identification against what makes it larger, relative to a middle case."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, product

from costs.apart import Spent, Work, run_apart
from costs.problem import Problem
from costs.sheet import Sheet, number
from massid import IdentifyOptions, weigh
from massid.errors import MassidError
from massid.model.robot import Robot
from massid.model.unknowns.spaces import parameter_space
from massid.plant import default_links

MIDDLE = "middle"


@dataclass(frozen=True)
class Variation:
    """One thing that differs from the middle case.

    Attributes:
        what: it is.
        value: of it.
        problem: with it.
        usual: whether nuisances are those by default, instead of none.
    """

    what: str
    value: str
    problem: Problem
    usual: bool = False

    @property
    def options(self) -> IdentifyOptions:
        """How to identify."""
        return self.problem.usual_options() if self.usual else self.problem.plain_options()


@dataclass(frozen=True)
class Cost:
    """What an identification took.

    Attributes:
        what: differs from the middle case.
        value: of it.
        processor: time over that of the middle case; None if there is no answer, like all that follows.
        wall: likewise.
        memory: its peak over that of the middle case.
        processor_s: user and system time, the least of all rounds [s].
        passes: how often the log was replayed.
        by_pass: processor time of a pass over that of the middle case.
        note: why there is no answer.
    """

    what: str
    value: str
    processor: float | None = None
    wall: float | None = None
    memory: float | None = None
    processor_s: float | None = None
    passes: int | None = None
    by_pass: float | None = None
    note: str = ""


def variations(
    problem: Problem,
    *,
    unknowns: Sequence[int],
    seconds: Sequence[float],
    threads: Sequence[int],
    bank_sizes: Sequence[int],
) -> list[Variation]:
    """The middle case first, which is the usual links, the middle of `seconds` and one thread; then what differs."""
    robot = problem.robot
    links = default_links(robot)
    middle = replace(problem, seconds=seconds[len(seconds) // 2], threads=1, links=links)
    usual_bank = middle.usual_options().models(len(links))
    found = [Variation(MIDDLE, f"{_described(middle)}, {middle.seconds:g} s, 1 thread", middle)]
    asked = [ask_for(middle, robot, n) for n in unknowns if n != len(links)]
    asked.append(replace(middle, unknowns=(f"com/{links[0]}",)))
    found += [Variation("unknowns", _described(one), one) for one in asked]
    found.append(Variation("unknowns", f"{len(links)} links and the default nuisances", middle, usual=True))
    found += [Variation("length", f"{s:g} s", replace(middle, seconds=s)) for s in seconds if s != middle.seconds]
    found += [Variation("threads", f"{k}", replace(middle, threads=k)) for k in threads if k != 1]
    sizes = [n for n in bank_sizes if n != usual_bank]
    return [*found, *(Variation("bank", f"{n} models", replace(middle, bank_size=n)) for n in sizes)]


def ask_for(problem: Problem, robot: Robot, n: int) -> Problem:
    """The problem with n unknowns: links, the usual ones first, and centres of mass for what is missing then.

    A centre of mass is three unknowns, so there may be up to two more.
    """
    usual = default_links(robot)
    others = (link for link in robot.links if link not in usual and robot.welded_to(link) is None)
    links = tuple(islice((*usual, *others), n))
    missing = -(-(n - len(links)) // 3)
    return replace(problem, links=links, unknowns=tuple(f"com/{link}" for link in links[:missing]))


def measure_scaling(cases: Sequence[Variation], rounds: int, tell: Callable[[str], None]) -> list[Cost]:
    """Identify every case in a process of its own, in turns; the least time of each counts."""
    best: dict[Variation, Spent[int]] = {}
    notes: dict[Variation, str] = {}
    for _, case in product(range(rounds), cases):
        try:
            spent = run_apart(partial(_prepare, case))
        except MassidError as error:
            notes[case] = str(error)
            tell(f"{case.what}, {case.value}: {error}")
            continue
        tell(f"{case.what}, {case.value}: {spent.processor_s:.1f} s in {spent.value} passes")
        if case not in best or spent.processor_s < best[case].processor_s:
            best[case] = spent
    return costs_of(cases, best, notes)


def costs_of(
    cases: Sequence[Variation], spent: Mapping[Variation, Spent[int]], notes: Mapping[Variation, str]
) -> list[Cost]:
    """What was spent on each case, over what was spent on the first."""
    middle, costs = spent.get(cases[0]), []
    for case in cases:
        cost = Cost(case.what, case.value, note=notes.get(case, ""))
        if case in spent:
            own = spent[case]
            cost = replace(cost, processor_s=own.processor_s, passes=own.value)
            if middle is not None:
                processor = own.processor_s / middle.processor_s
                cost = replace(
                    cost,
                    processor=processor,
                    by_pass=processor * middle.value / own.value,
                    wall=own.wall_s / middle.wall_s,
                    memory=own.peak_mib / middle.peak_mib,
                )
        costs.append(cost)
    return costs


def scaling_sheet(costs: Sequence[Cost]) -> Sheet:
    """A row for each case."""
    return Sheet(
        "A noisy identification relative to the middle case",
        (
            *("what differs", "value", "processor", "processor of a pass", "wall", "memory"),
            *("processor, s", "passes", "note"),
        ),
        tuple(
            (
                *(one.what, one.value, number(one.processor), number(one.by_pass), number(one.wall)),
                *(number(one.memory), number(one.processor_s), number(one.passes), one.note),
            )
            for one in costs
        ),
    )


def _prepare(case: Variation) -> Work[int]:
    problem = case.problem
    walk, robot = problem.walk, problem.robot

    def work() -> int:
        result = weigh(
            walk, robot, problem.links, unknowns=problem.unknowns, mode="offline", held_out=0.0, checks=False,
            options=case.options,
        )  # fmt: skip
        return len(result.windows)

    return work


def _described(problem: Problem) -> str:
    space = parameter_space(problem.robot, problem.links or (), problem.unknowns)
    n_com = len(problem.unknowns)
    coms = f" and {n_com} centre{'s' * (n_com > 1)} of mass" if n_com else ""
    models = problem.usual_options().models(len(space))
    return f"{len(space)}: {len(problem.links or ())} links{coms}, {models} models"
