"""How the robot moved and what pushed it, at the rate of a picture."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.model.robot import Robot
from massid.typing import FloatArray
from massid.view.shapes import body_mesh, shown_geoms
from massid.view.stage import stage
from massid.walk import Walk

FRAME_RATE_HZ = 50.0
LIGHT_CONTACT = 0.02
"""Share of the robot's weight below which a contact has no meaningful centre of pressure."""


@dataclass(frozen=True)
class Motion:
    """Poses and contact forces of n frames.

    Attributes:
        time_s: since the first sample of the walk, shape (n,).
        qpos: in the model's order, shape (n, nq).
        position: of every body, world frame [m], shape (n, n_bodies, 3).
        quaternion: of every body, xyzw, shape (n, n_bodies, 4).
        contact_bodies: the n_c bodies whose wrench was measured.
        force: in the body's frame [N], shape (n, n_c, 3).
        pressure_point: where the force acts, in the body's frame [m], shape (n, n_c, 3).
        vertical_force: in the world [N], shape (n, n_c).
        height_m: of the robot in the first frame, from its lowest body to the top of its head.
    """

    time_s: FloatArray
    qpos: FloatArray
    position: FloatArray
    quaternion: FloatArray
    contact_bodies: tuple[str, ...]
    force: FloatArray
    pressure_point: FloatArray
    vertical_force: FloatArray
    height_m: float

    def __len__(self) -> int:
        return len(self.time_s)

    def nearest(self, time_s: float) -> int:
        """Index of the frame nearest to a time."""
        return int(np.argmin(np.abs(self.time_s - time_s)))


def sample_motion(walk: Walk, robot: Robot, rate_hz: float = FRAME_RATE_HZ) -> Motion:
    """Thin a walk out to about `rate_hz` frames per second and compute where every body was.

    Raises:
        LogError: the log does not match the robot.
    """
    walk = robot.align(walk)
    model = stage(robot)
    stride = max(1, round(1.0 / (rate_hz * walk.timestep_s)))
    rows = np.arange(0, len(walk), stride)
    qpos = robot.layout.to_qpos(walk.qpos[rows])
    contacts = [model.body(name).id for name in walk.contact_bodies]
    position = np.empty((len(rows), model.nbody, 3))
    quaternion = np.empty((len(rows), model.nbody, 4))
    vertical = np.empty((len(rows), len(contacts)))
    data = mujoco.MjData(model)
    force = walk.wrench[rows, :, :3]
    for k, pose in enumerate(qpos):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        position[k] = data.xpos
        quaternion[k] = data.xquat[:, [1, 2, 3, 0]]
        for c, body in enumerate(contacts):
            vertical[k, c] = data.xmat[body, 6:] @ force[k, c]
    points = [_pressure_points(model, body, walk.wrench[rows, c]) for c, body in enumerate(contacts)]
    return Motion(
        time_s=walk.time_s[rows],
        qpos=qpos,
        position=position,
        quaternion=quaternion,
        contact_bodies=walk.contact_bodies,
        force=force,
        pressure_point=np.stack(points, axis=1) if points else np.empty((len(rows), 0, 3)),
        vertical_force=vertical,
        height_m=_height(robot, qpos[0]),
    )


def _height(robot: Robot, qpos: FloatArray) -> float:
    model = stage(robot)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    shown = [geom for body in range(1, model.nbody) for geom in shown_geoms(model, body)]
    tops = data.geom_xpos[shown, 2] + model.geom_rbound[shown]
    return float(max(tops, default=1.0) - data.xpos[1:, 2].min())


def _pressure_points(model: mujoco.MjModel, body: int, wrench: FloatArray) -> FloatArray:
    """Where a measured wrench acts on the sole: the moment about that point is along the sole's normal alone.

    With the sole at height h of the body's frame, m = p x f gives x = (h f_x - m_y) / f_z, y = (h f_y + m_x) / f_z. The
    point is kept inside of the body; without load it is the sole's middle.

    Args:
        model: the robot.
        body: id of the contact body.
        wrench: force and moment about the body's origin, in its frame, shape (n, 6).

    Returns:
        Points in the body's frame [m], shape (n, 3).
    """
    mesh = body_mesh(model, body)
    low, high = (mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)) if mesh else (np.zeros(3), np.zeros(3))
    middle = 0.5 * (low + high)
    points = np.repeat(np.array([[middle[0], middle[1], low[2]]]), len(wrench), axis=0)
    weight_n = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity))
    loaded = wrench[:, 2] > LIGHT_CONTACT * weight_n
    force, moment = wrench[loaded, :3], wrench[loaded, 3:]
    points[loaded, 0] = (low[2] * force[:, 0] - moment[:, 1]) / force[:, 2]
    points[loaded, 1] = (low[2] * force[:, 1] + moment[:, 0]) / force[:, 2]
    return np.asarray(np.clip(points, low, high), dtype=np.float64)
