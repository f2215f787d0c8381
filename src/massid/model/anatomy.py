"""Which links of a robot to weigh when nobody says: its trunk, and of each leg the thigh, the shank and the foot.

They are found in the kinematic tree, at the model's own position, in which a robot stands on legs that are nearly
straight.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from massid.typing import FloatArray, IntArray

_GROUND = 0.15
"""Ends of limbs within this share of the robot's height from its lowest point are feet."""
_LEAST_LEG = 3
"""Links that move by themselves in a leg."""


def default_links(model: mujoco.MjModel, base: str, moving: Sequence[str]) -> tuple[str, ...]:
    """The trunk, then thighs, shanks and feet; () if there are no two legs.

    A leg is a chain from the base to a foot. Its knee is the joint that parts it most evenly; the thigh is the heaviest
    link above the knee, the shank the heaviest between knee and ankle, the foot the heaviest below that. What weighs
    little beside them, such as the crosses of hips and ankles, hardly shows in a walk.

    Args:
        model: the robot alone.
        base: its floating base.
        moving: links with a mass and a joint of their own.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    numbers = {model.body(link).id for link in moving}
    legs = [leg for leg in _legs(model, _feet(model, data, numbers), numbers) if len(leg) >= _LEAST_LEG]
    if len(legs) < 2:
        return ()
    parts = [_parts(model, data.xpos, leg) for leg in legs]
    in_legs = {body for leg in legs for body in leg}
    trunk = max(numbers - in_legs, key=lambda body: float(model.body_mass[body]))
    bodies = [trunk, *(leg[part] for part in range(3) for leg in parts)]
    return tuple(str(model.body(body).name) for body in bodies)


def _feet(model: mujoco.MjModel, data: mujoco.MjData, moving: set[int]) -> list[int]:
    """The last links of those limbs that reach down to the ground, in model order."""
    up = -model.opt.gravity if np.any(model.opt.gravity) else np.array([0.0, 0.0, 1.0])
    height = data.xipos @ (up / np.linalg.norm(up))
    carriers = {_mover(model, int(model.body_parentid[body]), moving) for body in moving}
    ends = sorted(moving - carriers)
    span = max(height[body] for body in moving) - min(height[body] for body in moving)
    lowest = min(height[body] for body in ends)
    return [body for body in ends if height[body] <= lowest + _GROUND * span]


def _mover(model: mujoco.MjModel, body: int, moving: set[int]) -> int:
    """The nearest of the moving links at or above a body; 0 for none."""
    while body and body not in moving:
        body = int(model.body_parentid[body])
    return body


def _legs(model: mujoco.MjModel, feet: Sequence[int], moving: set[int]) -> list[list[int]]:
    """Chains of links from below the trunk to a foot. What carries all feet is the trunk; toes may share a leg."""
    chains = [_chain(model, foot, moving) for foot in feet]
    trunk = set.intersection(*map(set, chains)) if chains else set()
    legs: dict[int, list[int]] = {}
    for chain in chains:
        own = [body for body in chain if body not in trunk]
        if own and len(own) > len(legs.get(own[0], ())):
            legs[own[0]] = own
    return list(legs.values())


def _chain(model: mujoco.MjModel, foot: int, moving: set[int]) -> list[int]:
    """Moving links from the base to a foot."""
    chain, body = [], foot
    while body:
        chain.append(body)
        body = _mover(model, int(model.body_parentid[body]), moving)
    return chain[::-1]


def _parts(model: mujoco.MjModel, origin: FloatArray, leg: Sequence[int]) -> tuple[int, int, int]:
    """Thigh, shank and foot of a leg."""
    places: FloatArray = origin[list(leg)]
    to_hip = np.linalg.norm(places - places[0], axis=1)
    to_foot = np.linalg.norm(places - places[-1], axis=1)
    inner: IntArray = np.arange(1, len(leg) - 1)
    knee = int(inner[np.argmax(np.minimum(to_hip, to_foot)[inner])])
    to_knee = np.linalg.norm(places - places[knee], axis=1)
    ankle = next(k for k in range(knee + 1, len(leg)) if to_foot[k] < to_knee[k])

    def heaviest(bodies: Sequence[int]) -> int:
        return max(bodies, key=lambda body: float(model.body_mass[body]))

    return heaviest(leg[:knee]), heaviest(leg[knee:ankle]), heaviest(leg[ankle:])
