"""Record a simulated walk: hidden masses, a walker that does not know them, a log, and the truth beside it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import dm_env
import numpy as np

from massid.model.file import file_sha256
from massid.model.robot import Robot
from massid.plant.corruption import check_noise, corrupt_log
from massid.plant.embodiment import motorised
from massid.plant.environment import PlantOptions, make_environment
from massid.plant.masses import HiddenMasses, MassErrors
from massid.plant.recorder import Progress, record
from massid.plant.truth import truth_path, write_truth
from massid.typing import FloatArray
from massid.walk.noise import NoisePreset
from massid.walking import Gait, Walker, find_gait

FELL = "fell"
INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class RecordingReport:
    """What came of a recorded walk.

    Attributes:
        path: the log.
        truth_path: true masses and seed.
        samples: physics steps in the log.
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

    def __init__(self, walker: Walker, environment: Any) -> None:
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
    hidden: HiddenMasses | MassErrors | None = None,
    noise: NoisePreset = "clean",
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
        hidden: the mass errors, or how to draw them; None draws `MassErrors()`.
        noise: of the sensors: clean, white, realistic or harsh; the walker senses without noise.
        seed: of mass errors, gait and sensors.
        progress: told where the recording stands.

    Raises:
        ModelError: the robot cannot be simulated or cannot walk, or lacks a link that was named.
        BadInputError: no such gait or sensor noise, impossible mass errors, or too short a duration.
        LogError: the log cannot be written.
    """
    path = Path(path)
    if noise == "clean":
        return _record_clean(source, path, duration_s, gait, hidden, seed, progress)
    check_noise(noise)
    clean = path.with_name(f".{path.stem}.clean.mcap")
    leftovers = (clean, truth_path(clean))
    try:
        report = _record_clean(source, clean, duration_s, gait, hidden, seed, progress)
    finally:
        try:
            if clean.exists():  # an interrupted recording, too
                corrupt_log(clean, path, noise, seed)
        finally:
            for leftover in leftovers:
                leftover.unlink(missing_ok=True)
    return replace(report, path=path, truth_path=truth_path(path))


def _record_clean(
    source: Robot | str | Path,
    path: Path,
    duration_s: float,
    gait: Gait | str,
    hidden: HiddenMasses | MassErrors | None,
    seed: int,
    progress: Progress | None,
) -> RecordingReport:
    """Record without noise."""
    gait = find_gait(gait) if isinstance(gait, str) else gait
    robot = source if isinstance(source, Robot) else Robot.load(source)
    masses_rng, gait_rng = np.random.default_rng(seed).spawn(2)
    hidden = MassErrors() if hidden is None else hidden
    drawn = isinstance(hidden, MassErrors)
    masses = hidden.draw(robot, masses_rng) if isinstance(hidden, MassErrors) else hidden
    walker = Walker(motorised(robot).model, gait, gait_rng)
    environment = make_environment(
        robot, masses, initial_qpos=walker.initial_qpos(), options=PlantOptions(feet=walker.foot_names)
    )
    before, end = _identity(path), INTERRUPTED
    try:
        recording = record(
            environment,
            WalkerAgent(walker, environment),
            path,
            duration_s,
            metadata={"model_file": robot.source, "model_sha256": _fingerprint(source, robot), "gait": gait.name},
            contact_bodies=walker.foot_names,
            terminated=FELL,
            progress=progress,
        )
        end = FELL if recording.terminated else recording.end
    finally:
        environment.close()
        if _identity(path) != before:  # also an interrupted recording leaves a log
            write_truth(truth_path(path), robot, masses, seed, {"masses_drawn": drawn, "gait": gait.name, "end": end})
    return RecordingReport(
        path=recording.path,
        truth_path=truth_path(path),
        samples=recording.samples,
        duration_s=recording.duration_s,
        fell=recording.terminated,
        end=end,
        self_contact_samples=recording.self_contact_samples,
        error_norm_kg=masses.norm_kg,
        failed_solves=walker.failed_solves,
    )


def _identity(path: Path) -> tuple[int, int] | None:
    """Tells one version of a file from the next; None if there is none."""
    if not path.exists():
        return None
    status = path.stat()
    return status.st_ino, status.st_mtime_ns


def _fingerprint(source: Robot | str | Path, robot: Robot) -> str:
    """SHA-256 of the model file, or of the model's text if there is no file."""
    if isinstance(source, Robot):
        return hashlib.sha256(robot.spec.to_xml().encode()).hexdigest()
    return file_sha256(Path(source))
