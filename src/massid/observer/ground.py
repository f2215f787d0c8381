"""Which feet carry, and how much, where no sensor says so: judged from the inverse dynamics of the whole log.

A foot off the ground has no wrench, and that is what its own mass shows by; a foot that may be loaded has one that is
not known. The two errors are not alike: a load that is not there costs precision, one that is missed goes into the
masses. Runs of load are therefore widened at both ends.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.ndimage import maximum_filter1d

from massid.model.ground import Asked, GroundDemand, Supplied
from massid.model.inverse import recorded_steps
from massid.model.kinematics import body_rotations
from massid.model.realisation import Realisation
from massid.model.robot import Robot
from massid.observer.contact_gate import is_unloaded
from massid.observer.neighbours import level, slope
from massid.observer.spans import SETTLING_S, Spans
from massid.typing import BoolArray, FloatArray
from massid.walk import Segment, Walk
from massid.walk.noise import PRESETS, SensorNoise


@dataclass(frozen=True)
class Judgement:
    """What a foot without a sensor must be asked for to count as loaded, and how far its runs of load are widened.

    Attributes:
        least_share: of the robot's weight.
        margin_s: before and after [s].
    """

    least_share: float
    margin_s: float


AT_FIRST = Judgement(0.1, 2.0 * SETTLING_S)
"""With the masses of a model file. With a mass wrong by a third, a leg that swings seems to carry some percents of the
weight; what is missed below the threshold, as of a heel that rolls off, lasts for some tens of milliseconds."""
MASSES_FOUND = Judgement(0.025, SETTLING_S)
"""With masses that a first weighing has found."""
WITHOUT_NOISE = (MASSES_FOUND, Judgement(1e-3, SETTLING_S), Judgement(1e-5, SETTLING_S), Judgement(1e-7, SETTLING_S))
"""The same for readings without error: each weighing lets the next one see smaller loads."""
_SURE = 2.0
"""Deviations of what a foot is asked for that must be less than what counts as load for it to be in the air."""
_PIECE = 1000
"""Samples that are solved for together: what they take of memory is the same for any log."""


def with_ground(
    walk: Walk,
    robot: Robot,
    noise: SensorNoise | None,
    judgement: Judgement = AT_FIRST,
    realisation: Realisation | None = None,
) -> Walk:
    """A walk with the wrenches that no sensor measured as its motion asks for them, zero where a foot is in the air.

    Args:
        walk: aligned with the robot.
        robot: the robot.
        noise: of the sensors; None for readings without error.
        judgement: when a foot without any sensor counts as loaded.
        realisation: parameters of the robot and errors of the sensors, of which the first count; default nominal ones
            and none.

    Returns:
        The walk as it is if everything was measured.
    """
    if not walk.open_axes:
        return walk
    open_ = ~walk.measured
    read = _corrected(walk, robot, realisation)
    measured = np.where(open_, 0.0, read.wrench)
    wrench = np.where(open_, 0.0, walk.wrench)
    demand = _demand(walk, robot, noise, realisation)
    for segment in walk.segments:
        if len(segment) < 2:
            continue
        given = _supplied(read, robot, segment, measured, noise)
        carries = np.zeros((len(segment), len(open_)), dtype=np.bool_)
        for rows, part in _pieces(given):
            asked = demand.wrenches(part, np.broadcast_to(open_, part.wrench.shape))
            carries[rows] = _carries(walk, robot, part, asked, judgement)
        loaded = _loaded(walk, segment, carries, noise, judgement)
        for rows, part in _pieces(given):
            found = demand.wrenches(part, open_ & loaded[rows, :, None]).wrench
            at = slice(segment.start + rows.start, segment.start + rows.start + len(found))
            wrench[at] = np.where(open_, found, wrench[at])
    return replace(walk, wrench=wrench)


def _corrected(walk: Walk, robot: Robot, realisation: Realisation | None) -> Walk:
    """The walk without what its sensors are known to read wrong; lags are small."""
    if realisation is None or realisation.sensors is None:
        return walk
    sensors, layout = {name: values[0] for name, values in vars(realisation.sensors).items()}, robot.layout
    offset = sensors["state_offset"][: robot.model.nv][layout.joint_dof]
    wrench_offset, wrench_gain = (sensors[name].reshape(-1, 6) for name in ("wrench_offset", "wrench_gain"))
    return replace(
        walk,
        qpos=np.hstack([walk.qpos[:, :7], walk.qpos[:, 7:] - offset]),
        effort=(walk.effort - sensors["effort_offset"]) / (1.0 + sensors["effort_gain"]),
        wrench=(walk.wrench - wrench_offset) / (1.0 + wrench_gain),
    )


def _demand(walk: Walk, robot: Robot, noise: SensorNoise | None, realisation: Realisation | None) -> GroundDemand:
    """With accelerations as uncertain as slopes of velocities over the shortest average leave them."""
    exact, noise = noise is None, noise or PRESETS["white"]
    spans = Spans.at(walk.timestep_s)
    width = spans.reach - spans.gap
    spread = np.sqrt(6.0 / (width * (width**2 - 1.0))) / walk.timestep_s
    joints = len(robot.joint_names)
    std = spread * robot.layout.to_qvel(noise.state_std(joints)[6 + joints :])
    return GroundDemand(robot, walk.contact_bodies, walk.timestep_s, std, noise.effort, realisation, exact=exact)


def _supplied(walk: Walk, robot: Robot, segment: Segment, measured: FloatArray, noise: SensorNoise | None) -> Supplied:
    """What moved and acted: of readings with noise, averages around each sample."""
    layout, rows = robot.layout, np.arange(segment.start, segment.stop)
    if noise is None:
        rows[-1] = rows[-2]  # after the last sample no step begins
    effort = np.zeros((len(rows), robot.model.nv))
    effort[:, layout.joint_dof] = walk.effort[rows]
    wrench = measured[rows]
    if noise is None:
        return Supplied(*recorded_steps(walk, layout, rows), effort=effort, wrench=wrench)
    spans, own = Spans.at(walk.timestep_s), slice(0, len(rows))
    velocity = layout.to_qvel(walk.qvel[rows])
    joints = len(robot.joint_names)
    std = layout.to_qvel(noise.state_std(joints)[6 + joints :])
    return Supplied(
        position=layout.to_qpos(walk.qpos[rows]),
        velocity=level(velocity, own, spans),
        acceleration=slope(velocity, own, spans, std) / walk.timestep_s,
        effort=level(effort, own, spans),
        wrench=level(wrench.reshape(len(rows), -1), own, spans).reshape(wrench.shape),
    )


def _pieces(given: Supplied) -> Iterator[tuple[slice, Supplied]]:
    for start in range(0, len(given.position), _PIECE):
        rows = slice(start, start + _PIECE)
        yield rows, Supplied(**{name: values[rows] for name, values in vars(given).items()})


def _carries(walk: Walk, robot: Robot, given: Supplied, asked: Asked, judgement: Judgement) -> BoolArray:
    """Which feet are asked for more than counts as load, or may be for all that the motion tells, shape (n, n_c)."""
    gravity = robot.model.opt.gravity
    size = float(np.linalg.norm(gravity)) or 1.0
    rotation = body_rotations(robot.model, given.position, walk.contact_bodies)
    up = np.einsum("kcij,i->kcj", rotation, -gravity / size)
    of_foot = _feet(robot.model, walk.contact_bodies)
    lift = np.einsum("kcj,kcj->kc", up, asked.wrench[:, :, :3]) @ of_foot
    doubt = np.linalg.norm(np.einsum("kcj,kcjm,cd->kdm", up, asked.spread[:, :, :3], of_foot), axis=2)
    return np.asarray(np.maximum(lift, _SURE * doubt) > judgement.least_share * robot.total_mass_kg * size)


def _feet(model: mujoco.MjModel, bodies: Sequence[str]) -> FloatArray:
    """Which contact bodies are parts of one foot, 1 or 0, shape (n_c, n_c): those a joint away from what bears both.

    What toe, sole and heel carry together the motion tells; what each of them does it hardly tells.
    """
    ids = [model.body(name).id for name in bodies]
    above = [_joints_to_ancestors(model, body) for body in ids]
    same = np.eye(len(ids))
    for i, one in enumerate(above):
        for j, other in enumerate(above):
            nearest = [max(joints, other[body]) for body, joints in one.items() if body in other]
            same[i, j] = float(min(nearest) <= 1)
    return same


def _joints_to_ancestors(model: mujoco.MjModel, body: int) -> dict[int, int]:
    """Joints between a body and each of those that bear it, itself included, up to the world's."""
    found, joints = {}, 0
    while body:
        found[body] = joints
        joints += int(model.body_jntnum[body])
        body = int(model.body_parentid[body])
    return found | {0: 2 + joints}


def _loaded(
    walk: Walk, segment: Segment, carries: BoolArray, noise: SensorNoise | None, judgement: Judgement
) -> BoolArray:
    """Which feet may be loaded, shape (n, n_c): by what their sensors read; where they have none, by what is asked."""
    margin = max(1, round(judgement.margin_s / walk.timestep_s))
    widened = maximum_filter1d(carries.astype(np.uint8), 2 * margin + 1, axis=0, mode="nearest") > 0
    readings = np.where(walk.measured, walk.wrench[segment.start : segment.stop], 0.0).reshape(len(carries), -1)
    unloaded = is_unloaded(readings, noise or SensorNoise(), walk.timestep_s, open_axes=walk.open_axes)
    return np.where(walk.measured.any(axis=1), ~unloaded, widened)
