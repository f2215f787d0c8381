"""The logs that are weighed, and how every process gets hold of them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from accuracy.walks import cut
from massid import IdentifyOptions, Weighing
from massid.assets import resolve_model
from massid.errors import BadInputError
from massid.log import read_walk
from massid.model.robot import Robot
from massid.observer.sensors import NoisySensors
from massid.plant import MassErrors, corrupt_log, default_links, record_walk, truth_path
from massid.score import Truth
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Walk
from massid.walk.noise import NoisePreset


@dataclass(frozen=True)
class Problem:
    """A log to weigh a robot from.

    Attributes:
        name: for tables.
        log: MCAP file.
        model: shipped robot or model file.
        noise: what its sensors are said to do.
        threads: of whatever takes a number of threads.
        seed: of whatever draws.
        links: whose masses are asked for; None for the usual ones.
        unknowns: what else is.
        bank_size: models of our bank; None for what is usual.
        seconds: that are used of it; None for all.
    """

    name: str
    log: Path
    model: str
    noise: NoisePreset
    threads: int = 1
    seed: int = 0
    links: tuple[str, ...] | None = None
    unknowns: tuple[str, ...] = ()
    bank_size: int | None = None
    seconds: float | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Without what was loaded: other processes load it themselves, and a robot cannot be handed over."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @property
    def noisy(self) -> bool:
        """Whether the log has sensor noise."""
        return self.noise != "clean"

    def plain_options(self) -> IdentifyOptions:
        """What everybody assumes: all but the masses asked for is right, sensors have white noise alone or none."""
        return replace(self.usual_options(), noise=self.noise, other_links=0.0, link_inertia=0.0, lag_s=0.0)

    def usual_options(self) -> IdentifyOptions:
        """The defaults, on so many threads."""
        return IdentifyOptions(threads=self.threads, seed=self.seed, bank_size=self.bank_size)

    @cached_property
    def robot(self) -> Robot:
        """With nominal masses."""
        return Robot.load(resolve_model(self.model))

    @cached_property
    def walk(self) -> Walk:
        """The log in memory."""
        walk = read_walk(self.log)
        return walk if self.seconds is None else cut(walk, 0.0, self.seconds)

    def prepare(self) -> Weighing:
        """The log as massid sees it, all of it to be fitted, under the assumptions of `plain_options`."""
        options = self.plain_options()
        return Weighing.prepare(
            self.walk, self.robot, self.links, unknowns=self.unknowns, held_out=0.0, options=options
        )


def record_problems(
    model: str, folder: Path, seconds: float, seed: int, threads: int, links: tuple[str, ...] = ()
) -> tuple[Problem, Problem]:
    """Let a robot walk, and measure the walk without noise and with white noise.

    Args:
        model: shipped robot or model file.
        folder: of the logs.
        seconds: of walking.
        seed: of masses, steps, sensors and methods.
        threads: of the methods.
        links: that are not as the model says; default those that are asked for if none are named.

    Raises:
        BadInputError: it fell.
    """
    robot = Robot.load(resolve_model(model))
    clean, noisy = (folder / f"{seconds:g}s_{len(links)}_{kind}.mcap" for kind in ("clean", "noisy"))
    report = record_walk(robot, clean, seconds, hidden=MassErrors(links), seed=seed)
    if report.end != "complete":
        raise BadInputError(f"{model} fell on its walk of {seconds:g} s with `--seed {seed}`; take another seed.")
    corrupt_log(clean, noisy, "white", seed)
    asked = default_links(robot)
    return (
        Problem("clean", clean, model, "clean", threads, seed, asked),
        Problem("noisy", noisy, model, "white", threads, seed, asked),
    )


def given_problem(log: Path, model: str, links: tuple[str, ...] | None, seed: int, threads: int) -> Problem:
    """A user's log; whether it has noise is read off it."""
    job = Weighing.prepare(log, model, links, held_out=0.0)
    noise: NoisePreset = "white" if isinstance(job.logs[0].sensors, NoisySensors) else "clean"
    return Problem(log.stem, log, model, noise, threads, seed, links)


def error_kg(found_kg: dict[str, float], truth: Truth) -> float:
    """L2 mass error over the links asked for [kg].

    Raises:
        BadInputError: the truth does not know one of them.
    """
    missing = [link for link in found_kg if link not in truth.mass_kg]
    if missing:
        raise BadInputError(f"{truth.source} does not have the mass of {', '.join(missing)}.")
    return float(np.linalg.norm([mass_kg - truth.mass_kg[link] for link, mass_kg in found_kg.items()]))


def by_link(space: ParameterSpace, values: FloatArray) -> dict[str, float]:
    """Masses by link, of a space of masses."""
    return dict(zip((one.target for one in space.parameters), values.tolist(), strict=True))


def truth_of(problem: Problem, truth: Path | None) -> Truth:
    """The truth beside a log, or where the user says it is."""
    return Truth.load(truth_path(problem.log) if truth is None else truth)
