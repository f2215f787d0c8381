"""Walks of the benchmark: recorded once without noise, cut and measured for every case."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np

from accuracy.case import Case, Fault, Friction
from massid.assets import resolve_model
from massid.errors import BadInputError
from massid.log import read_walk
from massid.model.robot import Robot
from massid.model.unknowns.bodies import Mass
from massid.model.unknowns.spaces import mass_space
from massid.plant import (
    HiddenMasses,
    MassErrors,
    motorised,
    record_walk,
    sensors_of,
    truth_path,
    variant,
    without_wrenches,
)
from massid.score import Truth
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Walk
from massid.walking.gait import DEFAULT_GAIT
from massid.walking.morphology import torque_limits

COM_ERROR_M = 0.03
INERTIA_ERROR = 0.2
UNMODELLED_FRICTION_NM = 3.0
PERIODS_S = {"nimble": 0.002}
"""Sample periods of robots whose logs are slower than their steps."""
FALLS_BORNE = 40
SEED_STRIDE = 1000


@dataclass(frozen=True)
class Given:
    """What a method is given, and what only the score may know.

    Attributes:
        clean: the walk without noise, with the wrenches that acted.
        noisy: as the sensors logged it.
        robot: the model that is believed.
        space: masses that are asked for.
        true_kg: by link.
    """

    clean: Walk
    noisy: Walk
    robot: Robot
    space: ParameterSpace
    true_kg: dict[str, float]

    @property
    def links(self) -> list[str]:
        """The links that are asked for."""
        return [parameter.target for parameter in self.space.parameters]

    def truth(self, space: ParameterSpace) -> FloatArray:
        """True masses and zero sensor errors, shape (n_p,)."""
        return np.array([self.true_kg[p.target] if isinstance(p, Mass) else 0.0 for p in space.parameters])


def prepare(case: Case, logs: Path, recorded_s: float, skipped_s: float = 0.0) -> Given:
    """Record the walk of a case or find it, cut it to length, and put noise on it.

    Args:
        case: which one.
        logs: folder of the recorded walks.
        recorded_s: how long walks are recorded, at least what is skipped and the length of the case [s].
        skipped_s: left out at the beginning [s].
    """
    robot = with_friction(Robot.load(resolve_model(case.robot)), case.friction)
    path = _recorded(case, robot, logs, recorded_s)
    clean = robot.align(cut(read_walk(path), skipped_s, case.seconds))
    noisy = sensors_of(clean, case.preset, case.seed).measure(clean)
    if case.sensors == "no-wrench":
        noisy = without_wrenches(noisy)
        clean = replace(clean, open_axes=noisy.open_axes)
    return Given(
        clean=clean,
        noisy=noisy,
        robot=robot,
        space=mass_space(robot, robot.walking_links()),
        true_kg=Truth.load(truth_path(path)).mass_kg,
    )


def cut(walk: Walk, start_s: float, seconds: float) -> Walk:
    """Some seconds of a walk without gaps."""
    first = round(start_s / walk.timestep_s)
    rows = slice(first, first + round(seconds / walk.timestep_s))
    fields = {name: getattr(walk, name)[rows] for name in ("stamps_ns", "qpos", "qvel", "effort", "wrench")}
    return replace(walk, segments=(), **fields)


def with_friction(robot: Robot, friction: Friction) -> Robot:
    """The robot with the friction loss of a case; none leaves what its file says."""
    if friction == "none":
        return robot
    if friction == "0.1":
        return variant(robot, friction_loss_nm=0.1)
    alone = motorised(robot)
    limits = torque_limits(alone.model)
    finite = {name: 0.05 * limit for name, limit in zip(alone.joint_names, limits, strict=True) if np.isfinite(limit)}
    return variant(robot, friction_loss_nm=finite)


def with_fault(robot: Robot, fault: Fault, rng: np.random.Generator) -> Robot:
    """The true robot of which `robot` is the wrong model."""
    if fault == "friction":
        return variant(robot, friction_loss_nm=UNMODELLED_FRICTION_NM)
    if fault not in ("com", "inertia"):
        return robot
    spec = robot.spec.copy()
    for link in robot.walking_links():
        compiled, body = robot.model.body(link), spec.body(link)
        shift, factor = np.zeros(3), 1.0
        if fault == "com":
            direction = rng.normal(size=3)
            shift = COM_ERROR_M * direction / np.linalg.norm(direction)
        else:
            factor = 1.0 + INERTIA_ERROR * rng.choice([-1.0, 1.0])
        body.explicitinertial = True
        body.mass, body.iquat = compiled.mass[0], compiled.iquat
        body.ipos, body.inertia = compiled.ipos + shift, factor * compiled.inertia
        body.fullinertia = np.full(6, np.nan)
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    return Robot(spec, robot.source)


def _recorded(case: Case, robot: Robot, logs: Path, recorded_s: float) -> Path:
    """The log without noise that the case starts from; walks that end in a fall are replaced by others."""
    friction = case.friction.replace("%", "pc")
    gait = "" if case.gait == DEFAULT_GAIT else f"_{case.gait}"
    stem = f"{case.robot}_{friction}_{case.fault}_{case.other_links:g}{gait}_{recorded_s:g}s_{case.walk_seed}"
    path = logs / f"{stem}.mcap"
    for attempt in range(FALLS_BORNE):
        if path.exists():
            break
        seed = case.walk_seed + SEED_STRIDE * attempt
        rng = np.random.default_rng(seed)
        true_robot = with_fault(robot, case.fault, rng)
        hidden = _masses(robot, case.other_links, rng)
        # Another process may record the same walk: each in a folder of its own, and the log comes last, complete.
        with TemporaryDirectory(prefix="draft_", dir=logs) as folder:
            draft = Path(folder) / path.name
            report = record_walk(
                true_robot,
                draft,
                recorded_s,
                gait=case.gait,
                hidden=hidden,
                period_s=PERIODS_S.get(case.robot),
                seed=seed,
            )
            if report.end == "complete":
                truth_path(draft).replace(truth_path(path))
                draft.replace(path)
    if not path.exists():
        raise BadInputError(f"{stem}: {FALLS_BORNE} walks in a row ended in a fall.")
    return path


def _masses(robot: Robot, other_links: float, rng: np.random.Generator) -> HiddenMasses:
    errors = dict(MassErrors().draw(robot, rng).error_kg)
    for link in robot.links if other_links else ():
        errors.setdefault(link, other_links * robot.nominal_mass_kg(link) * float(rng.normal()))
    return HiddenMasses(errors)
