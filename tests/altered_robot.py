"""The small biped as it might really be: a shifted centre of mass, more inertia, something carried along.

The true robot is written as a model of its own, body by body, and not by what identification writes models with.
"""

from __future__ import annotations

import numpy as np

from massid.model.robot import Robot
from massid.typing import FloatArray
from tests.pushed_robot import make_robot

COM_SHIFT_M = np.array([0.03, -0.01, 0.02])
INERTIA_GAIN = 1.2
PAYLOAD_KG, PAYLOAD_AT = 2.0, (0.1, 0.25, 0.3)
PAYLOAD = "torso@{:g},{:g},{:g}".format(*PAYLOAD_AT)


def altered(com: str = "", inertia: str = "", payload: str = "", friction_loss: float = 0.0) -> Robot:
    """The biped with another centre of mass, inertia or load of the bodies named."""
    nominal = make_robot(friction_loss=friction_loss)
    spec = nominal.spec.copy()
    for name in {com, inertia} - {""}:
        row, body = nominal.model.body(name), spec.body(name)
        body.explicitinertial = True
        body.mass, body.iquat = float(row.mass[0]), row.iquat
        body.ipos = row.ipos + (COM_SHIFT_M if name == com else 0.0)
        body.inertia = row.inertia * (INERTIA_GAIN if name == inertia else 1.0)
    if payload:
        body = spec.body(payload).add_body(name="bag", pos=PAYLOAD_AT)
        body.explicitinertial = True
        body.mass, body.inertia = PAYLOAD_KG, np.full(3, 1e-12)
        body.ipos, body.iquat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    return Robot(spec)


def moments(robot: Robot, body: str) -> FloatArray:
    """Principal moments, smallest first [kg m^2]."""
    return np.sort(robot.model.body(body).inertia)
