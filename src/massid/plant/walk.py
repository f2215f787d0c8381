"""Record a simulated walk: hidden masses, a walker that does not know them, a log, and the truth beside it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import dm_env
import numpy as np

from massid.errors import BadInputError, unknown_name
from massid.model.file import file_sha256
from massid.model.robot import Robot
from massid.outputs import beside, uninterrupted
from massid.plant.corruption import check_noise, corrupt_log
from massid.plant.embodiment import motorised
from massid.plant.environment import PlantOptions, make_environment
from massid.plant.masses import HiddenMasses, MassErrors
from massid.plant.recorder import COMPLETE, DIVERGED, TRUNCATED, Progress, record
from massid.plant.truth import truth_of, truth_path
from massid.typing import FloatArray
from massid.walk.noise import NoisePreset
from massid.walking import Gait, Servos, ServoWalker, Walker, driven_by_servos, find_gait

FELL = "fell"
INTERRUPTED = "interrupted"

Controller: TypeAlias = Literal["auto", "torque", "servo"]
"""What moves a robot: torques, or targets of its joints' servos; auto as its file drives it."""


@dataclass(frozen=True)
class RecordingReport:
    """What came of a recorded walk.

    Attributes:
        path: the log.
        truth_path: true masses and seed.
        samples: in the log.
        duration_s: time they cover [s].
        fell: the robot fell; the log ends there.
        end: what the log says about its end; "complete" if it has the length asked for.
        self_contact_samples: samples in which the robot's own links pressed on each other.
        error_norm_kg: L2 norm of the hidden mass errors [kg].
        failed_solves: controls at which the walker's programme had no solution and the last torques were held.
    """

    path: Path
    truth_path: Path
    samples: int
    duration_s: float
    fell: bool
    end: str
    self_contact_samples: int
    error_norm_kg: float
    failed_solves: int


class WalkerAgent:
    """Lets a walker act in the plant: observations in, motor torques out."""

    def __init__(self, walker: Walker | ServoWalker, environment: Any) -> None:
        self._walker = walker
        self._period_s = float(environment.control_timestep())
        humanoid = environment.task.humanoid
        motors = [motor.name for motor in humanoid.mjcf_model.find_all("actuator")]
        self._columns = np.array([walker.joint_names.index(motor) for motor in motors])
        self._prefix = humanoid.mjcf_model.model
        self._steps = 0

    def __call__(self, timestep: dm_env.TimeStep) -> FloatArray:
        """Torques for what the plant shows."""
        if timestep.first():
            self._steps = 0
        seen = {name: timestep.observation[f"{self._prefix}/{name}"] for name in ("qpos", "qvel", "foot_load")}
        torques = self._walker.control(self._steps * self._period_s, seen["qpos"], seen["qvel"], seen["foot_load"])
        self._steps += 1
        action: FloatArray = torques[self._columns]
        return action


def record_walk(
    source: Robot | str | Path,
    path: Path | str,
    duration_s: float = 10.0,
    *,
    gait: Gait | str = "random",
    controller: Controller = "auto",
    hidden: HiddenMasses | MassErrors | None = None,
    payload_kg: Mapping[str, float] | None = None,
    noise: NoisePreset = "clean",
    wrenches: bool = True,
    period_s: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> RecordingReport:
    """Let a robot with hidden mass errors walk, and log it.

    The walker knows the nominal masses only. A robot that falls leaves a log that ends there and says so. The same seed
    gives the same walk, and the same mass errors at whatever gait and sensor noise. A noisy log is what `corrupt_log`
    makes of the clean one, which is kept in a hidden file as long as the robot walks.

    Args:
        source: a robot with nominal masses, or its model file.
        path: the log to write, NAME.mcap; NAME.truth.json goes beside it.
        duration_s: how long to walk [s].
        gait: how to walk, or a gait's name.
        controller: whether the walker commands torques, or targets of the position servos that the file gives the
            joints; auto as the file drives them.
        hidden: the mass errors, or how to draw them; None draws `MassErrors()`.
        payload_kg: what links carry besides, however light, as `HiddenMasses` has it.
        noise: of the sensors: clean, white, realistic or harsh; the walker senses without noise.
        wrenches: whether the robot has contact sensors.
        period_s: of the log's samples [s], a whole number of the model's steps; None for one. Torques and wrenches are
            means over it.
        seed: of mass errors, gait and sensors.
        progress: told where the recording stands.

    Raises:
        ModelError: the robot cannot be simulated or cannot walk, lacks a link that was named, or has no servos.
        BadInputError: no such gait, controller or sensor noise, impossible mass errors, too short a duration, or a
            period of other than whole steps.
        LogError: the log cannot be written.
    """
    path = Path(path)
    walk = _Walk(gait, controller, duration_s, period_s, seed, payload_kg or {})
    if noise == "clean" and wrenches:
        return _record_clean(source, path, walk, hidden, progress)
    check_noise(noise)
    clean = beside(path, ".mcap")
    leftovers = (clean, truth_path(clean))
    try:
        report = _record_clean(source, clean, walk, hidden, progress)
    finally:
        try:
            if clean.exists():  # an interrupted recording, too
                corrupt_log(clean, path, noise, seed, wrenches=wrenches)
        finally:
            with uninterrupted():
                for leftover in leftovers:
                    leftover.unlink(missing_ok=True)
    return replace(report, path=path, truth_path=truth_path(path))


@dataclass(frozen=True)
class _Walk:
    """How to walk and to log it, as `record_walk` was told."""

    gait: Gait | str
    controller: Controller
    duration_s: float
    period_s: float | None
    seed: int
    payload_kg: Mapping[str, float]


def _record_clean(
    source: Robot | str | Path,
    path: Path,
    asked: _Walk,
    hidden: HiddenMasses | MassErrors | None,
    progress: Progress | None,
) -> RecordingReport:
    """Record without noise."""
    gait = find_gait(asked.gait) if isinstance(asked.gait, str) else asked.gait
    robot = source if isinstance(source, Robot) else Robot.load(source)
    masses_rng, gait_rng = np.random.default_rng(asked.seed).spawn(2)
    hidden = MassErrors() if hidden is None else hidden
    details = {"masses_drawn": isinstance(hidden, MassErrors), "gait": gait.name}
    masses = hidden.draw(robot, masses_rng) if isinstance(hidden, MassErrors) else hidden
    masses = replace(masses, payload_kg={**masses.payload_kg, **asked.payload_kg})
    walker = _walker(robot, gait, asked.controller, gait_rng)
    options = PlantOptions(control_period_s=walker.control_period_s, feet=walker.foot_names)
    environment = make_environment(robot, masses, initial_qpos=walker.initial_qpos(), options=options)

    def truth(end: str) -> Mapping[Path, bytes]:
        said = end if end in (COMPLETE, FELL, TRUNCATED, DIVERGED) else INTERRUPTED
        return {truth_path(path): truth_of(robot, masses, asked.seed, {**details, "end": said})}

    try:
        recording = record(
            environment,
            WalkerAgent(walker, environment),
            path,
            asked.duration_s,
            period_s=asked.period_s,
            metadata={"model_file": robot.source, "model_sha256": _fingerprint(source, robot), "gait": gait.name},
            contact_bodies=walker.foot_names,
            terminated=FELL,
            companions=truth,
            progress=progress,
        )
    finally:
        environment.close()
    return RecordingReport(
        path=recording.path,
        truth_path=truth_path(path),
        samples=recording.samples,
        duration_s=recording.duration_s,
        fell=recording.terminated,
        end=FELL if recording.terminated else recording.end,
        self_contact_samples=recording.self_contact_samples,
        error_norm_kg=masses.norm_kg,
        failed_solves=walker.failed_solves,
    )


def _walker(robot: Robot, gait: Gait, controller: Controller, rng: np.random.Generator) -> Walker | ServoWalker:
    """What walks a robot: its motors by torques, or the servos of its own file by targets."""
    if controller not in get_args(Controller):
        raise BadInputError(unknown_name("controller", controller, get_args(Controller), "The plant"))
    alone = motorised(robot)
    servos = driven_by_servos(robot.model, alone.joint_names) if controller == "auto" else controller == "servo"
    if not servos:
        return Walker(alone.model, gait, rng)
    return ServoWalker(alone.model, gait, rng, Servos.from_model(robot.model, alone.joint_names))


def _fingerprint(source: Robot | str | Path, robot: Robot) -> str:
    """SHA-256 of the model file, or of the model's text if there is no file."""
    if isinstance(source, Robot):
        return hashlib.sha256(robot.spec.to_xml().encode()).hexdigest()
    return file_sha256(Path(source))
