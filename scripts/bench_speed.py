"""Time of one bank step against the engine's own step, in one run.

    python scripts/bench_speed.py

Raw is `mj_step` of the identification model in a C loop with no Python in between. The bound of the bank is
N x raw / threads; the bank adds output injection, output errors and the Gram matrix. Rounds alternate and the best
of each counts, since other programs may share the machine.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from massid import ExactSensors, IdentifyOptions, SearchOptions, weigh
from massid.assets import resolve_model, sample_walk
from massid.log import read_walk
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.observer.replay import replay_block
from massid.search.monitoring import MonitoringFilter
from massid.search.proposal import Proposal, Role
from massid.walk import Segment

ROUNDS = 7
STEPS = 500


@dataclass(frozen=True)
class Bench:
    """Measure the bank's speed."""

    log: Path = field(default_factory=sample_walk)
    """Log to replay."""
    model: str = "atlas"
    """Robot."""
    bank_size: int = 24
    """Models."""


def main(bench: Bench) -> None:
    """Print one row per number of threads, and the wall time of a whole identification."""
    walk = read_walk(bench.log)
    robot = Robot.load(resolve_model(bench.model))
    walk = robot.align(walk)
    space = mass_space(robot, robot.walking_links())
    points = space.project(space.nominal * np.random.default_rng(0).normal(1.0, 0.05, (bench.bank_size, len(space))))
    proposal = Proposal(points, (Role.CENTRE, *[Role.SAMPLE] * (bench.bank_size - 1)))
    window = Segment(1500, 1501 + STEPS)

    model = robot.identification_model(walk.contact_bodies)
    first = replay_block(walk, robot.layout, window)

    def raw() -> float:
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = first.qpos[0], first.qvel[0], first.wrench[0]
        start = time.perf_counter()
        mujoco.mj_step(model, data, STEPS // 10)
        return (time.perf_counter() - start) / (STEPS // 10)

    table = Table("threads", "raw mj_step [us]", "bank per model step [us]", "bound / bank")
    for threads in (1, 2):
        bank = ExactSensors().bank(robot, space, walk.contact_bodies, walk.timestep_s, bench.bank_size, threads)
        bank.place(points)

        def replay(bank=bank) -> float:  # type: ignore[no-untyped-def]
            scores = MonitoringFilter(bench.bank_size, walk.timestep_s)
            start = time.perf_counter()
            for _, errors in bank.replay(walk, window):
                scores.update(errors)
            scores.result(proposal)
            return (time.perf_counter() - start) / STEPS

        rounds = [(raw(), replay()) for _ in range(ROUNDS)]
        raw_s, bank_s = (min(values) for values in zip(*rounds, strict=True))
        bound_s = bench.bank_size * raw_s / threads
        table.add_row(
            str(threads), f"{raw_s * 1e6:.1f}", f"{bank_s / bench.bank_size * 1e6:.1f}", f"{bound_s / bank_s:.2f}"
        )
    console = Console(highlight=False)
    console.print(table)
    result = weigh(walk, robot, mode="online", held_out=0.0, checks=False)
    console.print(f"identify until converged: {result.wall_s:.2f} s for {result.log_s:.1f} s of walking")
    never_ending = IdentifyOptions(search=SearchOptions(step_tolerance=0.0))
    whole = weigh(walk, robot, mode="online", held_out=0.0, checks=False, options=never_ending)
    console.print(f"identify, every window of the log: {whole.wall_s:.2f} s for {walk.duration_s:.1f} s of walking")


if __name__ == "__main__":
    main(tyro.cli(Bench, description=__doc__))
