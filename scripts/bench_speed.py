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

from massid.assets import resolve_model, sample_walk
from massid.identify import IdentifyOptions, identify_online
from massid.identify.assembly import assemble
from massid.identify.online import BLOCK_STEPS
from massid.log import read_walk
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.observer.replay import replay_block, split
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
        options = IdentifyOptions(threads=threads, bank_size=bench.bank_size)
        bank = assemble(robot, space, walk.contact_bodies, walk.timestep_s, None, options).bank
        bank.place(points)

        def replay(bank=bank) -> float:  # type: ignore[no-untyped-def]
            scores = MonitoringFilter(bench.bank_size, walk.timestep_s)
            start = time.perf_counter()
            for part in split(window, BLOCK_STEPS):
                block = replay_block(walk, robot.layout, part)
                if part.start == window.start:
                    bank.restart(block)
                scores.update(bank.advance(block))
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
    result = identify_online(walk, robot, space)
    console.print(f"identify until converged: {result.wall_s:.2f} s for {result.log_s:.1f} s of walking")
    start = time.perf_counter()
    identify_online(walk, robot, space, _never_ending())
    elapsed_s = time.perf_counter() - start
    console.print(f"identify, every window of the log: {elapsed_s:.2f} s for {walk.duration_s:.1f} s of walking")


def _never_ending() -> IdentifyOptions:
    from massid.search.guided import SearchOptions

    return IdentifyOptions(search=SearchOptions(step_tolerance=0.0))


if __name__ == "__main__":
    main(tyro.cli(Bench, description=__doc__))
