"""The force balance of measured steps: what the robot needed, and what torques and wrenches supplied.

For each step the inverse dynamics of the measured states give the generalised force that must have acted. It is linear
in the link masses, so the part that no masses whatever explain can be told from mass errors: what is left is the fault
of the log or of the model, such as a torque that is not what acted, a contact that was not measured, or a lag.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import mujoco
import numpy as np

from massid.model.inverse import DiscreteInverseDynamics, Steps, applied, closed_directions, recorded_steps
from massid.model.kinematics import body_rotations
from massid.model.robot import Robot
from massid.typing import FloatArray, IntArray
from massid.walk import Segment, Walk
from massid.walk.white_noise import white_level

SMOOTHING_S = 0.02
"""Width of the window by which all terms are smoothed before they are compared: differences of noisy velocities."""
_STRETCH_S = 0.25
_LEAST_STRETCH = 24
_RIDGE = 1e-10
_LEAST_DIRECTION = 1e-9
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
        closed: orthonormal directions in which closed loops and couplings of joints push, padded with zeros, shape (K,
            nv, n); None if their forces are known. Noise of positions through a stiff tie is a force of any size, so
            in a log with noise these directions are left out.
        unread: orthonormal directions, of weighted degrees of freedom, in which wrenches push that no sensor measures,
            shape (K, nv, n); they are left out, too. None for none.
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
    closed: FloatArray | None = None
    unread: FloatArray | None = None

    def smooth(self, terms: FloatArray, *, whole: bool = False) -> FloatArray:
        """Smooth along the steps of each stretch, weight the degrees of freedom and flatten, shape (m, ...).

        Of the smoothed terms, which overlap, four in a window's width are kept.

        Args:
            terms: shape (K, nv, ...).
            whole: also in the directions that are left out elsewhere.
        """
        if self.closed is not None and not whole:
            terms = _without(self.closed, terms)
        if self.unread is not None and not whole:
            weight = self.weight.reshape(-1, *(1,) * (terms.ndim - 2))
            terms = _without(self.unread, terms * weight) / weight
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
        return self.force_of_torques(walk.effort[self.rows + shift], robot)

    def force_of_torques(self, effort: FloatArray, robot: Robot) -> FloatArray:
        """Generalised forces of joint torques, shapes (K, n_j) and (K, nv)."""
        force = np.zeros_like(self.required)
        force[:, robot.layout.joint_dof] = effort
        return force

    def wrench(self, walk: Walk, shift: int = 0) -> FloatArray:
        """Measured contact wrenches, `shift` samples later, as generalised forces, shape (K, nv)."""
        return self.force_of(walk.wrench[self.rows + shift])

    def force_of(self, wrench: FloatArray) -> FloatArray:
        """Generalised forces of wrenches in their bodies' frames, shapes (K, n_c, 6) and (K, nv)."""
        return applied(self.jacobian, wrench)


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
    taken = recorded_steps(walk, robot.layout, rows)
    model = robot.identification_model(walk.contact_bodies)
    model.opt.timestep = walk.timestep_s
    closed = None
    if model.neq and max(white_level(walk.qpos[:, :3]), white_level(walk.qpos[:, 7:])) > 0.0:
        closed = closed_directions(model, taken[0])
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    dynamics = DiscreteInverseDynamics(model, walk.contact_bodies)
    required, jacobian = dynamics.forces(*taken), dynamics.jacobian(taken[0])
    links = tuple(link for link in robot.links if robot.welded_to(link) is None)
    per_link = _per_link(robot, links, taken, walk.timestep_s)
    size = np.sqrt((required**2).mean(axis=0))
    weight = 1.0 / np.maximum(size, 1e-3 * size.max())
    unread = None
    if walk.open_axes:
        pushed = jacobian[:, ~walk.measured].transpose(0, 2, 1)
        pushed = pushed if closed is None else _without(closed, pushed)
        unread = _orthonormal(pushed * weight[:, None])
    smoothing = max(3, min(round(SMOOTHING_S / walk.timestep_s), min(len(s) for s in stretches) // 2))
    segments = tuple(Segment(a, b) for a, b in pairwise(edges))
    return Balance(
        rows=rows,
        stretches=segments,
        required=required,
        per_link=per_link,
        links=links,
        jacobian=jacobian,
        rotation=body_rotations(robot.model, taken[0], walk.contact_bodies),
        weight=weight,
        smoothing=smoothing,
        closed=closed,
        unread=unread,
    )


def _orthonormal(columns: FloatArray) -> FloatArray:
    """Orthonormal bases of columns, zeros where there are fewer directions, shape (n, nv, m)."""
    left, values, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left * (values > _LEAST_DIRECTION * values[:, :1])[:, None])


def _without(directions: FloatArray, terms: FloatArray) -> FloatArray:
    """Terms, shape (n, nv, ...), without their parts along orthonormal directions, shape (n, nv, m)."""
    return np.asarray(
        terms - np.einsum("kvm,km...->kv...", directions, np.einsum("kvm,kv...->km...", directions, terms))
    )


def fitted_model(robot: Robot, walk: Walk, balance: Balance) -> mujoco.MjModel:
    """The identification model with the masses that fit a walk's balance best."""
    relative = balance.fitted_masses(balance.effort(walk, robot) + balance.wrench(walk))
    model = robot.identification_model(walk.contact_bodies)
    model.opt.timestep = walk.timestep_s
    for link, error in zip(balance.links, relative, strict=True):
        _scale_link(model, link, max(LEAST_MASS, 1.0 + float(error)))
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _per_link(robot: Robot, links: tuple[str, ...], steps: Steps, step_s: float) -> FloatArray:
    """Change of the required force when a link's mass doubles: rigid-body terms only, in which it is linear."""
    rigid = robot.identification_model(())
    rigid.opt.timestep = step_s
    rigid.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    nominal = DiscreteInverseDynamics(rigid).forces(*steps)
    out = np.empty((*nominal.shape, len(links)))
    for column, link in enumerate(links):
        heavier = copy.copy(rigid)
        _scale_link(heavier, link, 2.0)
        mujoco.mj_setConst(heavier, mujoco.MjData(heavier))
        out[:, :, column] = DiscreteInverseDynamics(heavier).forces(*steps) - nominal
    return out


def _scale_link(model: mujoco.MjModel, link: str, factor: float) -> None:
    body = model.body(link).id
    model.body_mass[body] *= factor
    model.body_inertia[body] *= factor
