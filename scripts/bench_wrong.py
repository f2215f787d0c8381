"""Wrong sensors, conventions, models and situations: what comes out, and what massid says about it.

    python scripts/bench_wrong.py --draws 3 --json wrong.json
    python scripts/bench_wrong.py --only "degrees" "feet swapped" --presets realistic

Nothing may end with exit code 0 and a link further off than 2.5 times its 95 % interval; a log without noise has no
interval, there 0.1 kg counts. The right cause should be the first warning's.
"""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from lab.harness import Harness, hang, marching_control, plan_march
from lab.motions import draw
from lab.plant import simulate, wriggling_control, write_ros2
from massid import weigh
from massid.assets import resolve_model
from massid.cli.identify import EXIT_CODES
from massid.errors import MassidError
from massid.identify.options import IdentifyOptions
from massid.log import read_walk
from massid.model.robot import Robot
from massid.plant import MassErrors, record_walk, sensors_of, truth_path
from massid.score import Truth
from massid.walk import Walk
from massid.walk.noise import NoisePreset
from wrong.faults import FAULTS, Fault

FAR, FAR_KG = 2.5, 0.1
FEET = ("l_foot", "r_foot")


@dataclass(frozen=True)
class Bench:
    """Weigh with one thing wrong at a time."""

    only: tuple[str, ...] = ()
    """Names of the faults; empty for all."""
    presets: tuple[NoisePreset, ...] = ("clean", "realistic")
    """Sensors."""
    draws: int = 3
    """Walks of each, with sensors of their own; of `clean` one."""
    seconds: float = 6.0
    """Length of each [s]."""
    robot: str = "light"
    """A shipped robot with joints and links as the light one's."""
    logs: Path = Path("bench_wrong_logs")
    """Folder of recorded walks."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write every number, a line each; what stands there is not measured again."""


@dataclass(frozen=True)
class Outcome:
    """What came of one log.

    Attributes:
        fault: its name.
        preset: sensors.
        seed: of walk and sensors.
        exit_code: that `massid identify` would have.
        error_kg: L2; None if nothing came out.
        half_widths: the link that is furthest off, in 95 % half-widths; None without intervals.
        warnings: as said.
    """

    fault: str
    preset: str
    seed: int
    exit_code: int
    error_kg: float | None
    half_widths: float | None
    warnings: tuple[str, ...]

    @property
    def silent(self) -> bool:
        """Whether a wrong answer passes as a good one."""
        if self.exit_code or self.error_kg is None:
            return False
        return self.error_kg > FAR_KG if self.half_widths is None else self.half_widths > FAR

    @property
    def named(self) -> bool:
        """Whether the first warning names the cause."""
        return bool(self.warnings) and any(word in self.warnings[0] for word in FAULTS[self.fault].words)


def main(bench: Bench) -> int:
    """Run all cells and print the table; returns 1 if a wrong answer passed as a good one."""
    console = Console(highlight=False)
    logging.getLogger("absl").setLevel(logging.ERROR)  # dm_control passes on what engines say that diverge
    bench.logs.mkdir(parents=True, exist_ok=True)
    outcomes = [Outcome(**json.loads(line)) for line in _lines(bench.json)]
    known = {(one.fault, one.preset, one.seed) for one in outcomes}
    for name in bench.only or FAULTS:
        for preset in bench.presets:
            for seed in range(1 if preset == "clean" else bench.draws):
                if (name, preset, seed) in known:
                    continue
                started = time.perf_counter()
                outcome = _outcome(name, preset, seed, bench)
                outcomes.append(outcome)
                if bench.json:
                    with bench.json.open("a") as file:
                        file.write(json.dumps(asdict(outcome)) + "\n")
                first = outcome.warnings[0] if outcome.warnings else "-"
                console.print(
                    f"{name}, {preset}, {seed}: exit {outcome.exit_code}, {_number(outcome.error_kg)} kg, "
                    f"{_number(outcome.half_widths)} half-widths ({time.perf_counter() - started:.0f} s): {first}",
                    markup=False,
                )
    console.print(_table(outcomes))
    return int(any(one.silent for one in outcomes))


def _lines(path: Path | None) -> list[str]:
    return path.read_text().splitlines() if path and path.exists() else []


def _outcome(name: str, preset: NoisePreset, seed: int, bench: Bench) -> Outcome:
    fault, believed = FAULTS[name], Robot.load(resolve_model(bench.robot))
    walk, true_kg = _logged(name, fault, believed, seed, bench)
    links = list(true_kg)
    if preset != "clean":
        walk = sensors_of(walk, preset, seed).measure(walk)
    if fault.log is not None:
        walk = fault.log(walk)
    told: list[str] = []

    def tell(said: object) -> None:
        if isinstance(said, str):
            told.append(said.removeprefix(f"{walk.source}: "))

    try:
        result = weigh(walk, believed, links, options=IdentifyOptions(threads=1), tell=tell)
    except MassidError as error:
        return Outcome(name, preset, seed, 2, None, None, (*told, str(error)))
    errors = result.estimate[: len(links)] - np.array([true_kg[link] for link in links])
    width = None if result.uncertainty is None else 1.96 * result.uncertainty.std[: len(links)]
    far = None if width is None else float(np.max(np.abs(errors) / width))
    return Outcome(name, preset, seed, EXIT_CODES[result.status], float(np.linalg.norm(errors)), far, tuple(told))


def _logged(name: str, fault: Fault, believed: Robot, seed: int, bench: Bench) -> tuple[Walk, dict[str, float]]:
    """A log without noise, and what the links that are asked for weigh with all that is fixed to them."""
    true_robot = believed if fault.robot is None else fault.robot(believed)
    if fault.situation != "walk":
        return _held(fault, believed, seed, bench)
    stem = name.replace(" ", "_") if fault.robot else "walk"
    path = bench.logs / f"{bench.robot}_{stem}_{bench.seconds:g}s_{seed}.mcap"
    if not path.exists():
        hidden = MassErrors().draw(believed, np.random.default_rng(seed))
        with TemporaryDirectory(dir=bench.logs) as folder:
            draft = Path(folder) / path.name
            report = record_walk(true_robot, draft, bench.seconds, hidden=hidden, seed=seed)
            if report.fell:
                raise MassidError(f"{name}, seed {seed}: the robot fell.")
            truth_path(draft).replace(truth_path(path))
            draft.replace(path)
    masses = dict(Truth.load(truth_path(path)).mass_kg)
    true_kg = {link: masses[link] for link in believed.walking_links()}
    for link in true_kg:
        if fault.robot is not None and "payload" in true_robot.links and true_robot.welded_to("payload") == link:
            true_kg[link] += true_robot.nominal_mass_kg("payload")
    walk = read_walk(path)
    return replace(walk, metadata={}), true_kg


def _held(fault: Fault, robot: Robot, seed: int, bench: Bench) -> tuple[Walk, dict[str, float]]:
    """A robot that something else than its feet bears, of which the log says nothing."""
    space, truth = draw(robot, seed)
    true_kg = dict(zip([parameter.target for parameter in space.parameters], truth.tolist(), strict=True))
    if fault.situation == "lying":
        control, start = wriggling_control(robot, seed, 40.0, 0.5)
        recorded = simulate(robot, space, truth, control, start, bench.seconds)
    else:
        plan = plan_march(robot, FEET)
        control, start = marching_control(robot, plan, seed), hang(robot, plan, FEET)
        support = Harness(robot, 0.6 if fault.situation == "harness" else 0.0)
        recorded = simulate(robot, space, truth, control, start, bench.seconds, FEET, support=support)
    n = len(recorded.qpos)
    recorded.wrenches = {foot: recorded.wrenches.get(foot, np.zeros((n, 6))) for foot in FEET}
    with TemporaryDirectory(dir=bench.logs) as folder:
        return read_walk(write_ros2(recorded, Path(folder) / "bag")), true_kg


def _table(outcomes: Sequence[Outcome]) -> Table:
    table = Table("fault", "sensors", "error [kg]", "half-widths", "exit codes", "silent", "cause first", "first words")
    for name, preset in dict.fromkeys((one.fault, one.preset) for one in outcomes):
        cell = [one for one in outcomes if (one.fault, one.preset) == (name, preset)]
        errors = [one.error_kg for one in cell if one.error_kg is not None]
        widths = [one.half_widths for one in cell if one.half_widths is not None]
        first = next((one.warnings[0] for one in cell if one.warnings), "-")
        table.add_row(
            name,
            preset,
            _number(max(errors, default=None)),
            _number(max(widths, default=None)),
            " ".join(str(one.exit_code) for one in cell),
            str(sum(one.silent for one in cell)),
            f"{sum(one.named for one in cell)} of {len(cell)}",
            first[:90],
        )
    return table


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2g}"


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Bench, description=__doc__)))
