"""How well the masses are known under sensor noise: our error, its interval, the bound, and what others get.

    python scripts/bench_accuracy.py --json accuracy.jsonl
    python scripts/bench_accuracy.py --json accuracy.jsonl --robots atlas --presets white --seeds 2 --sysid
    python scripts/bench_accuracy.py --json accuracy.jsonl --seeds 0 --coverage 100 --wrong-models 20 --verdict 20

Every finished case is added to --json at once, one a line, and a rerun takes up what is missing. Two processes with
--threads 1 and a --json of their own can share two processors and the folder of walks. Walks are recorded once into
--logs, each with masses, steps and sensors of its own seed; --verdict measures one walk with the sensors of many. The
estimator is told the noise preset and what is believed of other links; the bound and least squares get the same
unknowns and priors. Friction loss is in truth and model alike. In the table, `bound` takes it as known that the wrench
on a foot in the air is zero, `no gate` does not. docs/accuracy.md says more.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Literal

import tyro
from rich.console import Console
from rich.table import Table

from accuracy.case import Case, Fault, Friction, Ledger, Method, Part, SensorSet, own_gait
from accuracy.methods import measure
from accuracy.sysid import load_sysid
from accuracy.tables import (
    accuracy_table,
    coverage_table,
    problems,
    slope_table,
    speed_table,
    verdict_table,
    wrong_table,
)
from accuracy.walks import prepare
from massid.errors import MassidError
from massid.observer.blas import single_threaded
from massid.walk.noise import NoisePreset
from massid.walking.gait import DEFAULT_GAIT

FAULTS: tuple[Fault, ...] = ("com", "inertia", "friction", "links")
SPEED_SECONDS = 20.0
LENGTHS_SECONDS = 30.0
"""Walks are recorded that long and cut, so that a longer one begins as a shorter one."""


@dataclass(frozen=True)
class Bench:
    """Measure errors, intervals, the bound and other methods."""

    json: Path
    """File of finished cases, one a line."""
    logs: Path = Path("bench_accuracy_logs")
    """Folder of the walks without noise."""
    robots: tuple[str, ...] = ("atlas", "light", "heavy")
    """Shipped robots; nimble and geared are walked by position servos and stamp."""
    presets: tuple[NoisePreset, ...] = ("white", "realistic")
    """Sensor noise."""
    friction: tuple[Friction, ...] = ("none", "0.1", "5%")
    """Friction loss of every joint: none but the file's, 0.1 N m, 5 % of the torque limit."""
    seeds: int = 20
    """Walks of each problem; 0 for other parts only."""
    seconds: float = 10.0
    """Length of each walk [s]."""
    mode: Literal["auto", "online", "offline"] = "auto"
    """How our estimator sees the log; auto as massid identify does: a noisy one offline."""
    threads: int = 0
    """Threads of each process; 0 for one per processor."""
    other_links: float = 0.0
    """Relative deviation of the masses of links that are not asked for, in truth and belief."""
    sensors: SensorSet = "all"
    """Which the robots have; no-wrench for none at their feet, where least squares has nothing to go by."""
    baselines: bool = True
    """Also the bound and least squares."""
    bound_seeds: int = 20
    """Walks of each problem for which the bound is computed at most."""
    sysid: bool = False
    """Also mujoco.sysid, and its time against ours on a clean log of 20 s."""
    sysid_seeds: int = 3
    """Walks of each problem for mujoco.sysid at most: it takes minutes for one."""
    coverage: int = 0
    """Walks for the coverage of the intervals."""
    coverage_seconds: float = 5.0
    """Length of these [s]."""
    verdict: int = 0
    """Sensors that measure the same walk, for the deviations that the verdict predicts."""
    verdict_seconds: float = 5.0
    """Length of that walk [s]."""
    verdict_gait: str = DEFAULT_GAIT
    """How it is walked; stand leaves the verdict something to refuse."""
    wrong_models: int = 0
    """Walks with each kind of wrong model."""
    lengths: tuple[float, ...] = ()
    """Seconds of walking to compare."""

    def method(self, preset: NoisePreset) -> Method:
        """How our estimator sees a log with such noise."""
        if self.mode != "auto":
            return self.mode
        return "online" if self.sensors == "all" and preset == "clean" else "offline"


def main(bench: Bench) -> None:
    """Measure what is missing and print the tables."""
    console = Console(highlight=False, width=220)
    if bench.sysid:
        load_sysid()
    bench.logs.mkdir(parents=True, exist_ok=True)
    ledger = Ledger(bench.json)
    cases = ledger.missing([*accuracy_cases(bench), *other_cases(bench)])
    for number, case in enumerate(cases, start=1):
        started = time.perf_counter()
        result = run(case, bench)
        ledger.add(case, result)
        said = result.get("error") or f"{result.get('l2_kg', result.get('gated_l2_kg')):.3g} kg"
        name = f"{case.part} {case.robot} {case.preset} {case.friction} {case.fault} {case.seconds:g} s #{case.seed}"
        console.print(f"{number}/{len(cases)} {name} {case.method}: {said} ({time.perf_counter() - started:.0f} s)")
    print_tables(ledger, console)


def run(case: Case, bench: Bench) -> dict[str, Any]:
    """Measure one case; what a method refuses is a result, too."""
    recorded_s = max(case.seconds, LENGTHS_SECONDS) if case.part == "lengths" else case.seconds
    try:
        given = prepare(case, bench.logs, recorded_s)
        with single_threaded() if bench.threads == 1 else nullcontext():
            return measure(case, given, bench.threads)
    except MassidError as error:
        return {"error": str(error)}


def accuracy_cases(bench: Bench) -> list[Case]:
    """Every method on every walk of every problem; seeds come last, so that an early end leaves whole rounds."""
    return [
        Case(
            "accuracy",
            method,
            robot,
            preset,
            friction,
            bench.other_links,
            bench.seconds,
            seed,
            gait=own_gait(robot),
            sensors=bench.sensors,
        )
        for seed, robot, preset, friction in product(range(bench.seeds), bench.robots, bench.presets, bench.friction)
        for method in methods(bench, preset, seed)
    ]


def methods(bench: Bench, preset: NoisePreset, seed: int) -> list[Method]:
    """What weighs the robot on one walk; what takes long is spared from the later ones."""
    found: list[Method] = [bench.method(preset)]
    if bench.baselines:
        found += ["bound"] if seed < bench.bound_seeds else []
        found += ["least-squares"] if bench.sensors == "all" else []
    if bench.sysid and seed < bench.sysid_seeds:
        found += ["sysid", "sysid-observer"]
    return found


def other_cases(bench: Bench) -> list[Case]:
    """Coverage, verdict, wrong models, lengths, speed."""
    cases: list[Case] = []
    settings = list(product(bench.robots, bench.presets))
    for seed, (robot, preset) in product(range(bench.coverage), settings):
        seconds, gait = bench.coverage_seconds, own_gait(robot)
        method = bench.method(preset)
        cases.append(
            Case(
                "coverage",
                method,
                robot,
                preset,
                "none",
                bench.other_links,
                seconds,
                seed,
                gait=gait,
                sensors=bench.sensors,
            )
        )
    for seed, (robot, preset) in product(range(bench.verdict), settings):
        seconds, gait = bench.verdict_seconds, bench.verdict_gait
        cases.append(Case("verdict", bench.method(preset), robot, preset, "none", 0.0, seconds, seed, gait=gait))
    for seed, (robot, preset), fault in product(range(bench.wrong_models), settings, FAULTS):
        off = 0.02 if fault == "links" else 0.0
        method, gait = bench.method(preset), own_gait(robot)
        cases.append(Case("wrong", method, robot, preset, "none", off, bench.seconds, seed, fault, gait))
    if bench.lengths:
        for seed, (robot, preset), seconds in product(range(bench.seeds), settings, bench.lengths):
            both: tuple[Method, ...] = (bench.method(preset), "bound")
            cases += [
                Case("lengths", method, robot, preset, "none", bench.other_links, seconds, seed, gait=own_gait(robot))
                for method in (both if seed < bench.bound_seeds else both[:1])
            ]
    if bench.sysid:
        for robot, method in product(bench.robots, (bench.method("clean"), "sysid", "sysid-observer")):
            cases.append(Case("speed", method, robot, "clean", "none", 0.0, SPEED_SECONDS, 0, gait=own_gait(robot)))
    return cases


def print_tables(ledger: Ledger, console: Console) -> None:
    """Print whatever was measured."""
    by_length = partial(accuracy_table, title="L2 error in kg against seconds of walking")
    tables: tuple[tuple[Part, Callable[..., Table]], ...] = (
        *(("accuracy", accuracy_table), ("lengths", by_length), ("lengths", slope_table)),
        *(("coverage", coverage_table), ("verdict", verdict_table)),
        *(("wrong", wrong_table), ("speed", speed_table)),
    )
    for part, table in tables:
        if any(ledger.rows(part)):
            console.print(table(ledger.rows(part)))
    for line in problems(ledger.rows("accuracy")):
        console.print(f"bound and least squares: {line}")


if __name__ == "__main__":
    try:
        main(tyro.cli(Bench, description=__doc__))
    except MassidError as error:
        sys.stderr.write(f"bench_accuracy: error: {error}\n")
        sys.exit(error.exit_code)
