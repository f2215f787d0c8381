"""The force balance of measured steps: what the robot needed, and what torques and wrenches supplied.

For each step the inverse dynamics of the measured states give the generalised force that must have acted. It is linear
in the link masses, so the part that no masses whatever explain can be told from mass errors: what is left is the fault
of the log or of the model, such as a torque that is not what acted, a contact that was not measured, or a lag.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import mujoco
import numpy as np

from massid.model.robot import Robot
from massid.typing import AnyArray, FloatArray, IntArray
from massid.walk import Segment, Walk

SMOOTHING_S = 0.02
"""Width of the window by which all terms are smoothed before they are compared: differences of noisy velocities."""
_STRETCH_S = 0.25
_LEAST_STRETCH = 24
_RIDGE = 1e-10
LEAST_MASS = 0.05
"""Fitted masses stay above this share of the nominal ones: what the log does not reveal may come out negative."""


@dataclass(frozen=True)
class Balance:
    """Terms of the balance over some stretches of a walk; K is the number of steps.

    Attributes:
        rows: sample at which each step begins, shape (K,).
        stretches: runs of consecutive steps, by position in `rows`.
        required: generalised force that the nominal robot needs for the measured step, shape (K, nv) [N, N m].
        per_link: its change when a link's mass grows by its nominal value, shape (K, nv, n_links).
        links: names of these links.
        jacobian: force and moment in each contact body's frame to generalised force, shape (K, n_c, 6, nv).
        rotation: of each contact body to the world, shape (K, n_c, 3, 3).
        weight: of each degree of freedom in sums of squares, shape (nv,).
        smoothing: number of steps over which terms are smoothed.
    """

    rows: IntArray
    stretches: tuple[Segment, ...]
    required: FloatArray
    per_link: FloatArray
    links: tuple[str, ...]
    jacobian: FloatArray
    rotation: FloatArray
    weight: FloatArray
    smoothing: int

    def smooth(self, terms: FloatArray) -> FloatArray:
        """Smooth along the steps of each stretch, weight the degrees of freedom and flatten, shape (m, ...).

        Of the smoothed terms, which overlap, four in a window's width are kept.
        """
        kernel = np.hanning(self.smoothing + 2)[1:-1]
        kernel /= kernel.sum()
        parts = []
        for stretch in self.stretches:
            part = terms[stretch.start : stretch.stop]
            windows = np.lib.stride_tricks.sliding_window_view(part, self.smoothing, axis=0)
            parts.append(windows[:: max(1, self.smoothing // 4)] @ kernel)
        joined = np.concatenate(parts)
        shape = (1, -1) + (1,) * (joined.ndim - 2)
        weighted = joined * self.weight.reshape(shape)
        return np.asarray(weighted.reshape(-1, *joined.shape[2:]), dtype=np.float64)

    @cached_property
    def basis(self) -> FloatArray:
        """Orthonormal basis of what changes of the link masses can explain, shape (m, r)."""
        columns = self.smooth(self.per_link)
        left, values, _ = np.linalg.svd(columns, full_matrices=False)
        return np.asarray(left[:, values > 1e-9 * values[0]])

    def unexplained(self, terms: FloatArray) -> FloatArray:
        """Take off the part of smoothed terms, shape (m, ...), that link masses can explain."""
        return np.asarray(terms - self.basis @ (self.basis.T @ terms))

    def fitted_masses(self, supplied: FloatArray) -> FloatArray:
        """Relative mass errors that explain the balance best, shape (n_links,)."""
        columns = self.smooth(self.per_link)
        scale = np.linalg.norm(columns, axis=0)
        columns = columns / scale
        normal = columns.T @ columns + _RIDGE * np.eye(len(scale))
        return np.asarray(np.linalg.solve(normal, columns.T @ self.smooth(supplied - self.required)) / scale)

    def effort(self, walk: Walk, robot: Robot, shift: int = 0) -> FloatArray:
        """Measured joint torques, `shift` samples later, as generalised forces, shape (K, nv)."""
        force = np.zeros_like(self.required)
        force[:, robot.layout.joint_dof] = walk.effort[self.rows + shift]
        return force

    def wrench(self, walk: Walk, shift: int = 0) -> FloatArray:
        """Measured contact wrenches, `shift` samples later, as generalised forces, shape (K, nv)."""
        return self.force_of(walk.wrench[self.rows + shift])

    def force_of(self, wrench: FloatArray) -> FloatArray:
        """Generalised forces of wrenches in their bodies' frames, shapes (K, n_c, 6) and (K, nv)."""
        return np.asarray(np.einsum("kci,kciv->kv", wrench, self.jacobian))


def pick_stretches(walk: Walk, margin: int, steps: int) -> list[Segment]:
    """Choose runs of samples spread over a walk, about `steps` in all, that keep `margin` samples to segment ends."""
    length = max(_LEAST_STRETCH, round(_STRETCH_S / walk.timestep_s))
    slots = []
    for segment in walk.segments:
        start, stop = segment.start + margin, segment.stop - 1 - margin
        slots += [Segment(a, min(a + length, stop)) for a in range(start, stop, length)]
    slots = [slot for slot in slots if len(slot) >= _LEAST_STRETCH]
    wanted = max(1, steps // length)
    if len(slots) > wanted:
        slots = [slots[k] for k in np.linspace(0, len(slots) - 1, wanted).round().astype(int)]
    return slots


def measure_balance(robot: Robot, walk: Walk, margin: int = 0, steps: int = 1500) -> Balance | None:
    """Evaluate the balance on some stretches of a walk.

    Args:
        robot: with nominal masses.
        walk: aligned with the robot (`Robot.align`).
        margin: samples to keep to the ends of segments.
        steps: about how many steps to look at.

    Returns:
        None if no segment of the walk is long enough.
    """
    stretches = pick_stretches(walk, margin, steps)
    if not stretches:
        return None
    rows = np.concatenate([np.arange(s.start, s.stop) for s in stretches])
    edges = np.cumsum([0, *(len(s) for s in stretches)]).tolist()
    model = robot.identification_model(walk.contact_bodies)
    model.opt.timestep = walk.timestep_s
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    if int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4):
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    qpos, qvel = robot.layout.to_qpos(walk.qpos), robot.layout.to_qvel(walk.qvel)
    required = np.empty((len(rows), model.nv))
    jacobian = np.empty((len(rows), len(walk.contact_bodies), 6, model.nv))
    rotation = np.empty((len(rows), len(walk.contact_bodies), 3, 3))
    bodies = [model.body(name).id for name in walk.contact_bodies]
    data = mujoco.MjData(model)
    full = np.empty((6, model.nv))
    for k, row in enumerate(rows):
        _set(data, qpos, qvel, row, walk.timestep_s)
        mujoco.mj_inverse(model, data)
        required[k] = data.qfrc_inverse
        for c, body in enumerate(bodies):
            mujoco.mj_jacBody(model, data, full[:3], full[3:], body)
            to_body = data.xmat[body].reshape(3, 3).T
            rotation[k, c] = to_body.T
            jacobian[k, c, :3], jacobian[k, c, 3:] = to_body @ full[:3], to_body @ full[3:]
    links = tuple(link for link in robot.links if robot.welded_to(link) is None)
    per_link = _per_link(model, links, qpos, qvel, rows, walk.timestep_s)
    size = np.sqrt((required**2).mean(axis=0))
    weight = 1.0 / np.maximum(size, 1e-3 * size.max())
    smoothing = max(3, min(round(SMOOTHING_S / walk.timestep_s), min(len(s) for s in stretches) // 2))
    segments = tuple(Segment(a, b) for a, b in pairwise(edges))
    return Balance(rows, segments, required, per_link, links, jacobian, rotation, weight, smoothing)


def fitted_model(robot: Robot, walk: Walk, balance: Balance) -> mujoco.MjModel:
    """The identification model with the masses that fit a walk's balance best."""
    relative = balance.fitted_masses(balance.effort(walk, robot) + balance.wrench(walk))
    model = robot.identification_model(walk.contact_bodies)
    model.opt.timestep = walk.timestep_s
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    for link, error in zip(balance.links, relative, strict=True):
        body = model.body(link).id
        factor = max(LEAST_MASS, 1.0 + float(error))
        model.body_mass[body] *= factor
        model.body_inertia[body] *= factor
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _per_link(
    model: mujoco.MjModel, links: tuple[str, ...], qpos: FloatArray, qvel: FloatArray, rows: IntArray, step_s: float
) -> FloatArray:
    """Change of the required force when a link's mass doubles: rigid-body terms only, in which it is linear."""
    plain = _copy(model)
    plain.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    plain.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    models = [plain]
    for link in links:
        heavier = _copy(plain)
        body = heavier.body(link).id
        heavier.body_mass[body] *= 2.0
        heavier.body_inertia[body] *= 2.0
        mujoco.mj_setConst(heavier, mujoco.MjData(heavier))
        models.append(heavier)
    out = np.empty((len(rows), model.nv, len(models)))
    for column, changed in enumerate(models):
        data = mujoco.MjData(changed)
        for k, row in enumerate(rows):
            _set(data, qpos, qvel, row, step_s)
            mujoco.mj_inverse(changed, data)
            out[k, :, column] = data.qfrc_inverse
    return np.asarray(out[:, :, 1:] - out[:, :, :1])


def _set(data: mujoco.MjData, qpos: FloatArray, qvel: FloatArray, row: int, step_s: float) -> None:
    data.qpos[:], data.qvel[:] = qpos[row], qvel[row]
    data.qacc[:] = (qvel[row + 1] - qvel[row]) / step_s


def _copy(model: AnyArray | mujoco.MjModel) -> mujoco.MjModel:
    return model.__copy__()
