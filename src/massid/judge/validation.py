"""Is the result right, as far as the log itself can tell? Torques of a part that was not fitted, and the weight.

Neither check knows the truth. Joint torques are predicted for the held-out end of a log by inverse dynamics of its
low-passed motion, once with the model file's masses and once with what was found. The mass of the whole robot must
carry the mean vertical contact force, less what went into the momentum of its centre of mass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from massid.compare.inverse_dynamics import InverseDynamics
from massid.compare.motion import smooth_motion
from massid.judge.motion import is_carried
from massid.model.kinematics import body_rotations
from massid.model.robot import Robot
from massid.model.unknowns.sensors import FORCE_AXES
from massid.model.unknowns.unknown import adds_mass
from massid.observer.contact_gate import ForceOffsets
from massid.result.checks import CUTOFF_HZ, TorquePrediction, Validation, WeightCheck
from massid.result.result import Result
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray, IntArray
from massid.walk import Segment, Walk
from massid.walk.noise import SensorNoise

SHORTEST_HELD_OUT_S = 1.0
"""A held-out part that would be shorter is not held out."""
LONGEST_CHECK_S = 60.0
"""Torques of a longer held-out part are compared over its first minute."""
_TAPER_S = 0.3
_PIECE = 2000
"""Samples that are looked at together: what they take of memory is the same for any log."""
_LEAST_WEIGHT_ERROR = 1e-3
"""Of the weight: what nominal instead of true masses do to the velocity of the centre of mass."""


@dataclass(frozen=True)
class Split:
    """A log in two parts.

    Attributes:
        fitted: what masses are found from.
        held: the rest, at the end; None if it would be too short to say anything.
    """

    fitted: Walk
    held: Walk | None


def hold_out(walk: Walk, share: float) -> Split:
    """Cut the end off a log.

    Args:
        walk: the log.
        share: of its samples, in [0, 1).
    """
    if share * walk.duration_s < SHORTEST_HELD_OUT_S:
        return Split(walk, None)
    left = round((1.0 - share) * sum(len(segment) for segment in walk.segments))
    fitted, held = [], []
    for segment in walk.segments:
        cut = min(max(segment.start + left, segment.start), segment.stop)
        fitted += [Segment(segment.start, cut)] if cut > segment.start else []
        held += [Segment(cut, segment.stop)] if cut < segment.stop else []
        left -= cut - segment.start
    return Split(replace(walk, segments=tuple(fitted)), replace(walk, segments=tuple(held)))


def validate(result: Result, walks: Sequence[Walk], held: Sequence[Walk | None], robot: Robot) -> Validation:
    """Check a result against the log it came from.

    Args:
        result: what was found.
        walks: the whole logs, aligned with the robot; the first is checked.
        held: the parts of them that were not fitted.
        robot: with nominal masses.
    """
    torques = None if held[0] is None else predict_torques(result, held[0], robot)
    return Validation(
        held_out_s=0.0 if held[0] is None else held[0].duration_s,
        torques=torques,
        weight=check_total(result, walks[0], robot),
    )


def predict_torques(result: Result, walk: Walk, robot: Robot) -> TorquePrediction:
    """Predict the joint torques of a part of a log, before and after.

    What inverse dynamics leaves unexplained is low-passed, sample by sample as it is, not the motion that it follows
    from: dynamics of a low-passed motion are not the low-passed dynamics of the motion, and true masses may look worse.
    """
    space, point = result.unknowns()
    dynamics = InverseDynamics(robot, space, walk.contact_bodies, walk.timestep_s)
    dof = robot.layout.joint_dof
    first = walk.segments[0].start
    start_s = walk.time_s[first]
    walk = walk.between(first, _end_of_check(walk))

    def low_passed(torques: FloatArray) -> FloatArray:
        return smooth_motion(replace(walk, effort=torques), robot.layout, CUTOFF_HZ).effort[:, dof]

    before, after = np.zeros((2, *walk.effort.shape))
    for segment in walk.segments:
        for start in range(segment.start, segment.stop - 1, _PIECE):
            piece = Segment(start, min(start + _PIECE + 1, segment.stop))  # the last sample ends the last step
            motion = smooth_motion(walk.between(piece.start, piece.stop), robot.layout, None)
            rows = slice(piece.start, piece.stop - 1)
            unknown = ~walk.measured.ravel() & (motion.wrench != 0.0)
            before[rows] = dynamics.beyond(dynamics.residual(motion), motion, unknown)[:, dof]
            after[rows] = dynamics.beyond(dynamics.residual_at(motion, point), motion, unknown)[:, dof]
    # The instants that the low-pass keeps are found by passing the clock through it.
    clock = np.repeat(walk.time_s[:, None], walk.effort.shape[1], axis=1)
    return TorquePrediction(
        joints=robot.joint_names,
        time_s=start_s + low_passed(clock)[:, 0],
        measured=low_passed(walk.effort),
        nominal=low_passed(walk.effort + before),
        identified=low_passed(walk.effort + after),
    )


def _end_of_check(walk: Walk) -> int:
    """Sample before which a walk has as much in use as is looked at."""
    left = round(LONGEST_CHECK_S / walk.timestep_s)
    for segment in walk.segments:
        if len(segment) >= left:
            return segment.start + left
        left -= len(segment)
    return walk.segments[-1].stop


def check_total(result: Result, walk: Walk, robot: Robot) -> WeightCheck | None:
    """Compare the mass found with what the ground carried; None if nothing does, or no sensor reads all of it."""
    if walk.open_axes or not is_carried(robot, walk):
        return None
    space, point = result.unknowns()
    found_kg = robot.total_mass_kg + float(adds_mass(space) @ (point - space.nominal))
    noise = SensorNoise() if result.uncertainty is None else result.uncertainty.noise
    found_std_kg = 0.0 if result.uncertainty is None else result.uncertainty.total_std_kg
    offset, offset_std = _force_offsets(space, walk, noise)
    carried_kg, carried_std_kg = _carried(
        robot, replace(walk, wrench=walk.wrench - offset), replace(noise, force_offset=offset_std)
    )
    carried_kg += robot.lifted_kg(result.estimate_kg)
    return WeightCheck(found_kg, found_std_kg, carried_kg, carried_std_kg)


def _force_offsets(space: ParameterSpace, walk: Walk, noise: SensorNoise) -> tuple[FloatArray, float]:
    """What the force sensors read too much, as far as it was known before the fit, shape (n_contacts, 6), and its std.

    A foot in the air shows its sensor's offset; what the fit found besides would not be a check of the fit.
    """
    believed = ForceOffsets.believed(space, walk.contact_bodies, noise)
    std = believed.std.reshape(-1, 6)[:, :FORCE_AXES]
    return believed.mean.reshape(-1, 6), float(np.sqrt(np.mean(np.square(std)))) if std.size else noise.force_offset


def _carried(robot: Robot, walk: Walk, noise: SensorNoise) -> tuple[float, float]:
    """Mass that the mean vertical force carried, and its standard error [kg].

    With a weight w(t) that rises and falls linearly over a taper at both ends of a segment, the integral of w a is the
    mean velocity over the end's taper less that over the start's, so no single noisy velocity decides.
    """
    gravity = robot.model.opt.gravity
    size = float(np.linalg.norm(gravity))
    up = -gravity / size
    rotation = body_rotations(robot.model, robot.layout.to_qpos(walk.qpos), walk.contact_bodies)
    vertical = np.einsum("kcij,kcj,i->kc", rotation, walk.wrench[:, :, :3], up)
    impulse, time_s, gained = np.zeros(len(walk.contact_bodies)), 0.0, 0.0
    velocity_variance = 0.0
    for segment in walk.segments:
        taper = min(round(_TAPER_S / walk.timestep_s), len(segment) // 3)
        if taper < 1:
            continue
        ramp = (np.arange(taper) + 0.5) / taper
        weight = np.ones(len(segment))
        weight[:taper], weight[-taper:] = ramp, ramp[::-1]
        impulse += weight @ vertical[segment.start : segment.stop] * walk.timestep_s
        time_s += float(weight.sum()) * walk.timestep_s
        first, last = (np.arange(start, start + taper) for start in (segment.start, segment.stop - taper))
        gained += float((_centre_velocity(robot, walk, last) - _centre_velocity(robot, walk, first)) @ up)
        velocity_variance += 2.0 * noise.base_linear_velocity**2 / taper
    per_kg = size * time_s + gained
    carried_kg = float(impulse.sum()) / per_kg
    load_kg = impulse / per_kg
    n_c = len(walk.contact_bodies)
    samples = max(1.0, time_s / walk.timestep_s)
    variance = (
        n_c * (noise.force_offset / size) ** 2
        + noise.wrench_gain**2 * float(load_kg @ load_kg)
        + n_c * noise.force**2 / samples / size**2
        + carried_kg**2 * velocity_variance / per_kg**2
        + (_LEAST_WEIGHT_ERROR * carried_kg) ** 2
    )
    return carried_kg, float(np.sqrt(variance))


def _centre_velocity(robot: Robot, walk: Walk, rows: IntArray) -> FloatArray:
    """Mean velocity of the centre of mass over some samples, in the world, shape (3,) [m/s]."""
    model, data = robot.model, mujoco.MjData(robot.model)
    qpos, qvel = robot.layout.to_qpos(walk.qpos[rows]), robot.layout.to_qvel(walk.qvel[rows])
    total = np.zeros(3)
    body = model.body(robot.root_body).id
    for position, velocity in zip(qpos, qvel, strict=True):
        data.qpos[:], data.qvel[:] = position, velocity
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_subtreeVel(model, data)
        total += data.subtree_linvel[body]
    return np.asarray(total / len(rows))
