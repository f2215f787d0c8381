"""Whatever weighs a robot from a log: ours, and what one could use instead, all from the nominal masses."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from accuracy.sysid import load_sysid, weigh_by_chunks, weigh_by_observer
from costs.apart import Work
from costs.problem import Problem, by_link
from massid import weigh
from massid.compare import fit_masses, scan_cutoffs, self_chosen
from massid.errors import BadInputError
from massid.observer.blas import single_threaded

CMA_STEP = 0.2
"""Initial step of CMA-ES, in nominal masses."""


@dataclass(frozen=True)
class Found:
    """What a method found.

    Attributes:
        mass_kg: by link.
        note: what a reader of the table should know.
        on_the_way: masses found earlier, by the processor time that they had taken [s].
    """

    mass_kg: dict[str, float]
    note: str = ""
    on_the_way: tuple[tuple[float, dict[str, float]], ...] = ()


Prepare = Callable[[], Work[Found]]


def prepare_massid(problem: Problem, as_it_comes: bool = False) -> Work[Found]:
    """Ours; as it comes it has more unknowns, holds out part of the log, judges before the fit and checks after it."""
    robot, walk = problem.robot, problem.walk

    def work() -> Found:
        if as_it_comes:
            result = weigh(walk, robot, problem.links, options=problem.usual_options())
        else:
            options = problem.plain_options()
            result = weigh(walk, robot, problem.links, held_out=0.0, checks=False, options=options)
        what = f"{result.status}, {result.log_s:.1f} s of the log"
        if result.uncertainty is not None and result.uncertainty.nuisances:
            what += f", {len(result.uncertainty.nuisances)} more unknowns"
        return Found(by_link(result.space, result.estimate), what)

    return work


def prepare_least_squares(problem: Problem) -> Work[Found]:
    """Filtered inverse dynamics at the cut-off that predicts held-out torques best; of a clean log also unfiltered."""
    job = problem.prepare()
    walk, robot, space = job.logs[0].walk, job.robot, job.asked

    def work() -> Found:
        with single_threaded():
            fits = scan_cutoffs(walk, robot, space)
            if not problem.noisy:
                fits = (*fits, fit_masses(walk, robot, space, None))
        chosen = self_chosen(fits)
        note = "no filter" if chosen.cutoff_hz is None else f"{chosen.cutoff_hz:g} Hz, of {len(fits)} cut-offs"
        return Found(by_link(space, chosen.estimate), note)

    return work


def prepare_sysid(problem: Problem, observed: bool) -> Work[Found]:
    """mujoco.sysid: short rollouts from measured states, or longer ones with our output injection.

    Raises:
        BadInputError: it is not installed.
    """
    load_sysid()
    job = problem.prepare()
    walk, robot, space = job.logs[0].walk, job.robot, job.asked
    how = weigh_by_observer if observed else weigh_by_chunks

    def work() -> Found:
        with single_threaded():
            return Found(by_link(space, how(walk, robot, space, problem.threads).estimate))

    return work


def prepare_cma(problem: Problem, budget_s: float, marks_s: tuple[float, ...] = ()) -> Work[Found]:
    """CMA-ES on our bank, until it has spent its budget or gives up.

    Args:
        problem: what to weigh.
        budget_s: processor time [s].
        marks_s: processor times whose best point is kept [s].

    Raises:
        BadInputError: it is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import cma
    except ImportError:
        raise BadInputError("cma is not installed: pip install cma") from None
    _ = problem.robot, problem.walk  # loaded now; what massid is charged for beyond that is charged here as well

    def work() -> Found:
        started = time.process_time()
        job = problem.prepare()
        space, n_models = job.logs[0].space, job.options.models(len(job.asked))
        bank = job.replay(n_models)
        bounds = [space.lower / space.nominal, space.upper / space.nominal]
        # What it takes for converged by default would end it long before a clean log is solved.
        settings = {
            "popsize": n_models, "seed": problem.seed + 1, "bounds": bounds, "verbose": -9, "tolfun": 0.0,
            "tolfunhist": 0.0, "tolx": 1e-14,
        }  # fmt: skip
        search = cma.CMAEvolutionStrategy(np.ones(len(space)), CMA_STEP, settings)
        on_the_way: list[tuple[float, dict[str, float]]] = []
        left, generations, spent_s = list(marks_s), 0, 0.0
        while spent_s < budget_s and not search.stop():
            points = search.ask()
            mu = bank.score(np.array(points) * space.nominal)
            search.tell(points, np.where(np.isfinite(mu), mu, np.finfo(float).max).tolist())
            generations, spent_s = generations + 1, time.process_time() - started
            while left and spent_s >= left[0]:
                on_the_way.append((left.pop(0), by_link(space, search.result.xbest * space.nominal)))
        note = f"{generations} generation{'s' * (generations != 1)} of {n_models}"
        note += "" if spent_s >= budget_s else ", gave up"
        return Found(by_link(space, search.result.xbest * space.nominal), note, tuple(on_the_way))

    return work


def peers(problem: Problem, sysid: tuple[str, ...]) -> dict[str, Prepare]:
    """What needs no budget, by its name in tables."""
    named: dict[str, Prepare] = {"least squares": partial(prepare_least_squares, problem)}
    if "chunks" in sysid:
        named["mujoco.sysid"] = partial(prepare_sysid, problem, False)
    if "observer" in sysid:
        named["mujoco.sysid, our observer"] = partial(prepare_sysid, problem, True)
    return named
