"""Contact forces of physics steps, read where they acted and summed into one wrench per body.

All reading happens right after a step that evaluated the forces (`mj_step`, or `mj_forward`): contacts, constraint
forces and body frames then belong to the state before the step. Later they do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.plant.parts import RobotParts
from massid.typing import AnyArray, BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class BlockWrenches:
    """What acted on the robot over a block of n steps.

    Attributes:
        wrench: by body, force [N] and moment [N m] about the body frame's origin that the environment exerts on it,
            both in the body frame, each of shape (n, 6); only bodies that were touched.
        self_contact: steps in which the robot's links pressed on each other, shape (n,).
    """

    wrench: dict[str, FloatArray]
    self_contact: BoolArray


class ContactRecorder:
    """Collects the contacts of a block of physics steps; the sums are made once per block."""

    def __init__(self, model: mujoco.MjModel, parts: RobotParts, capacity: int) -> None:
        self._model = model
        self._parts = parts
        self._body_of_geom = np.asarray(model.geom_bodyid, dtype=np.int64)
        self._in_robot = np.zeros(model.nbody, dtype=bool)
        self._in_robot[parts.body_ids] = True
        self._origins = np.zeros((capacity, model.nbody, 3))
        self._axes = np.zeros((capacity, model.nbody, 9))
        self._clear()

    def take(self, step: int, data: mujoco.MjData) -> None:
        """Keep the contacts of one step of the block, by index into it."""
        n = data.ncon
        if n == 0:
            return
        self._origins[step] = data.xpos
        self._axes[step] = data.xmat
        contact = data.contact
        self._steps.append(np.full(n, step))
        self._geoms.append(contact.geom.copy())
        self._points.append(contact.pos.copy())
        self._frames.append(contact.frame.copy())
        self._forces.append(contact_forces(self._model, data))

    def finish(self, n: int) -> BlockWrenches:
        """Sum up the n steps of the block and begin the next one."""
        if not self._steps:
            return BlockWrenches({}, np.zeros(n, dtype=bool))
        steps, geoms = np.concatenate(self._steps), np.concatenate(self._geoms)
        points, frames = np.concatenate(self._points), np.concatenate(self._frames).reshape(-1, 3, 3)
        forces = np.concatenate(self._forces)
        self._clear()
        pressed = forces.any(axis=1)
        bodies = np.where(geoms >= 0, self._body_of_geom[geoms], 0)
        ours = self._in_robot[bodies]
        self_contact = np.zeros(n, dtype=bool)
        self_contact[steps[pressed & ours.all(axis=1)]] = True
        one_sided = np.flatnonzero(pressed & (ours[:, 0] != ours[:, 1]))
        second = ours[one_sided, 1]
        body = np.where(second, bodies[one_sided, 1], bodies[one_sided, 0])
        # A contact's normal points from its first geom to its second, on which the force acts as it stands.
        sign = np.where(second, 1.0, -1.0)[:, None]
        to_world = frames[one_sided]
        force = sign * np.einsum("nji,nj->ni", to_world, forces[one_sided, :3])
        moment = sign * np.einsum("nji,nj->ni", to_world, forces[one_sided, 3:])
        step = steps[one_sided]
        moment += np.cross(points[one_sided] - self._origins[step, body], force)
        axes = self._axes[step, body].reshape(-1, 3, 3)
        local = np.hstack([np.einsum("nji,nj->ni", axes, force), np.einsum("nji,nj->ni", axes, moment)])
        return BlockWrenches(self._sum(n, step, body, local), self_contact)

    def _sum(self, n: int, step: IntArray, body: IntArray, local: FloatArray) -> dict[str, FloatArray]:
        names = dict(zip(self._parts.body_ids.tolist(), self._parts.body_names, strict=True))
        wrenches = {}
        for touched in np.unique(body).tolist():
            mine = body == touched
            total = np.zeros((n, 6))
            np.add.at(total, step[mine], local[mine])
            wrenches[names[touched]] = total
        return wrenches

    def _clear(self) -> None:
        self._steps: list[AnyArray] = []
        self._geoms: list[AnyArray] = []
        self._points: list[FloatArray] = []
        self._frames: list[FloatArray] = []
        self._forces: list[FloatArray] = []


def contact_forces(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    """Force and moment of every contact in its own frame, on the second geom, shape (n_contacts, 6)."""
    forces = np.empty((data.ncon, 6))
    for i in range(len(forces)):
        mujoco.mj_contactForce(model, data, i, forces[i])
    return forces


class LoadCells:
    """Measures the upward force on some bodies, such as feet, and what is welded to them, such as toes."""

    def __init__(self, model: mujoco.MjModel, bodies: IntArray) -> None:
        self._model = model
        self._count = len(bodies)
        self._cell_of_geom = np.full(model.ngeom + 1, self._count)  # the last cell takes what is none of ours
        for cell, body in enumerate(bodies):
            self._cell_of_geom[:-1][model.body_weldid[model.geom_bodyid] == model.body_weldid[body]] = cell

    def read(self, data: mujoco.MjData) -> FloatArray:
        """Upward force on each body over the step that was made last [N], shape (n_bodies,)."""
        if data.ncon == 0:
            return np.zeros(self._count)
        contact = data.contact
        forces = contact_forces(self._model, data)
        upward = (contact.frame[:, 2::3] * forces[:, :3]).sum(axis=1)
        cells = self._cell_of_geom[contact.geom]
        loads = np.bincount(cells[:, 1], upward, self._count + 1) - np.bincount(cells[:, 0], upward, self._count + 1)
        return np.asarray(loads[:-1], dtype=np.float64)
