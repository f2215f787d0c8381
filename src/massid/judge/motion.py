"""What the robot of a log does, as far as it decides which masses can be seen: stands, walks, falls, hangs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massid.model.robot import Robot
from massid.result.verdict import Motion, MotionFacts
from massid.typing import FloatArray
from massid.walk import Walk

_CARRIED = 0.05
"""Share of its weight that a robot on the ground has in its measured contact forces; in the air it is noise."""
_FALLING = 0.5
"""Share of g with which the base of a robot in the air must fall; less, and something unseen holds it."""
_STILL_RAD = 0.02
"""Typical excursion of the joints (standard deviation) below which a robot on the ground stands still."""
_SMOOTHING_S = 0.02


def observe_motion(robot: Robot, walk: Walk) -> MotionFacts:
    """Look at contact forces, the base's fall and the joints' excursions.

    Args:
        robot: with nominal masses.
        walk: aligned with the robot.
    """
    inside = np.concatenate([np.arange(segment.start, segment.stop) for segment in walk.segments])
    width = max(1, round(_SMOOTHING_S / walk.timestep_s))
    joints = _blockwise(walk.qpos[inside, 7:], width)
    excursion = joints.std(axis=0)
    named = dict(zip(robot.joint_names, excursion.tolist(), strict=True))
    gravity = robot.model.opt.gravity
    size = float(np.linalg.norm(gravity))
    if size == 0.0 or is_carried(robot, walk):
        still = float(np.median(excursion)) < _STILL_RAD if len(excursion) else True
        return MotionFacts(Motion.STANDING if still else Motion.MOVING, named)
    gained, time_s = np.zeros(3), 0.0
    for segment in walk.segments:
        edge = max(1, min(width, len(segment) // 4))
        gained += walk.qvel[segment.stop - edge : segment.stop, :3].mean(axis=0)
        gained -= walk.qvel[segment.start : segment.start + edge, :3].mean(axis=0)
        time_s += (len(segment) - edge) * walk.timestep_s
    falls = float(gained @ gravity) / (size * time_s) > _FALLING * size
    return MotionFacts(Motion.IN_THE_AIR if falls else Motion.HELD, named)


def is_carried(robot: Robot, walk: Walk) -> bool:
    """Whether measured contacts carry the robot; without gravity nothing does."""
    weight = robot.total_mass_kg * float(np.linalg.norm(robot.model.opt.gravity))
    if weight == 0.0:
        return False
    inside = np.concatenate([np.arange(segment.start, segment.stop) for segment in walk.segments])
    width = max(1, round(_SMOOTHING_S / walk.timestep_s))
    # Means over short blocks, so that the noise of unloaded force sensors does not add up to a weight.
    force = _blockwise(walk.wrench[inside, :, :3].reshape(len(inside), -1), width).reshape(-1, 3)
    carried = float(np.linalg.norm(force, axis=1).mean()) * len(walk.contact_bodies)
    return carried > _CARRIED * weight


def neighbouring_joints(robot: Robot, links: Sequence[str], among: Sequence[str]) -> tuple[str, ...]:
    """The joints that move some links, and between them and the links they carry, in the model's order.

    Args:
        robot: the robot.
        links: names of links.
        among: links that count as carried ones.
    """
    model = robot.model
    bodies = {model.body(link).id for link in links}
    carried = {model.body(link).id for link in among}
    found = []
    for name in robot.joint_names:
        joint = model.joint(name)
        body = int(joint.bodyid[0])
        if body in bodies or (body in carried and int(model.body_parentid[body]) in bodies):
            found.append(name)
    return tuple(found)


def _blockwise(values: FloatArray, width: int) -> FloatArray:
    """Means over blocks of samples, shape (n // width, ...); the values themselves if there are too few."""
    n = len(values) // width
    if n < 2:
        return values
    return np.asarray(values[: n * width].reshape(n, width, -1).mean(axis=1))
