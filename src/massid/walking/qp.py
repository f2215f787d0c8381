"""Whole-body quadratic programme: joint accelerations and foot wrenches that best serve weighted tasks.

Variables are qacc and one wrench per standing foot (force and moment at the sole's centre, in world axes, divided
by 100). The centre-of-mass task is written on forces and the angular-momentum task on moments, so the cost of
accelerations and that of wrenches are separate blocks; the six rows of the floating base tie them together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import daqp
import numpy as np

from massid.typing import FloatArray
from massid.walking.morphology import Sole
from massid.walking.state import Frame, RobotState

FORCE_SCALE = 100.0
"""Newton (or newton metre) per unit of a wrench variable."""

_GRAVITY = np.array([0.0, 0.0, 9.81])

_UNBOUNDED = 1e30
"""What daqp takes for infinity."""
_EQUALITY = 5
"""daqp's mark of a row that is active and stays so."""
_SETTINGS = {
    # Rows may be off by so much. With daqp's own 1e-6, accelerations are off by as much.
    "primal_tol": 1e-9,
    # Left to itself, daqp eliminates equalities first, or not, depending on the number of joints. That saves no time
    # here, costs digits, and takes a lower bound above the upper one for an equality.
    "eq_reduction": -1,
}
"""Where daqp is not left to itself."""


@dataclass(frozen=True)
class QpOptions:
    """Weights and margins of the programme; weights on forces are divided by the robot's mass squared.

    Attributes:
        com_weight: of the centre of mass's acceleration, shape (3,).
        momentum_weight: of the rate of angular momentum.
        acceleration_weight: regularises accelerations.
        force_weight: regularises forces.
        moment_weight: regularises moments; zero makes the programme singular.
        share_weight: of each foot's planned share of the weight.
        friction: coefficient that the friction pyramid assumes, of each tangential direction.
        twist_m: largest moment about the sole's normal per newton of normal force.
        sole_margin: part of the sole's half extents that the centre of pressure may use.
    """

    com_weight: tuple[float, float, float] = (10.0, 10.0, 2.0)
    momentum_weight: float = 5.0
    acceleration_weight: float = 1e-4
    force_weight: float = 2.5e-3
    moment_weight: float = 2.5e-2
    share_weight: float = 2.5e-2
    friction: float = 0.6
    twist_m: float = 0.05
    sole_margin: float = 0.85


@dataclass(frozen=True)
class Contact:
    """A foot that stands.

    Attributes:
        sole: its rectangle.
        frame: its present frame.
        share: part of the robot's weight it is planned to carry.
    """

    sole: Sole
    frame: Frame
    share: float


@dataclass(frozen=True)
class MotionTask:
    """Wanted acceleration of some linear map of qacc.

    Attributes:
        jacobian: shape (n, nv).
        target: jacobian @ qacc that is wanted, shape (n,).
        weight: of the squared error, > 0.
    """

    jacobian: FloatArray
    target: FloatArray
    weight: float


@dataclass(frozen=True)
class JointTask:
    """Wanted accelerations of single dofs.

    Attributes:
        weight: of the squared error of each dof, zero for none, shape (nv,).
        target: wanted qacc [rad/s^2], shape (nv,).
    """

    weight: FloatArray
    target: FloatArray


@dataclass(frozen=True)
class Solution:
    """What the programme found.

    Attributes:
        qacc: accelerations, shape (nv,).
        wrenches: force [N] and moment [N m] on each standing foot at its sole's centre, shape (n_contacts, 6).
        torques: of the joints [N m], shape (nv - 6,).
    """

    qacc: FloatArray
    wrenches: FloatArray
    torques: FloatArray


class WholeBodyQp:
    """Builds and solves the programme.

    Args:
        torque_limits_nm: limit of each joint dof, shape (nv - 6,); a dof with limit zero gets no torque.
        options: weights and margins.
    """

    def __init__(self, torque_limits_nm: FloatArray, options: QpOptions | None = None) -> None:
        self._limits = torque_limits_nm
        self._options = options or QpOptions()
        self._passive = np.flatnonzero(torque_limits_nm == 0.0)
        self._limited = np.flatnonzero((torque_limits_nm > 0.0) & np.isfinite(torque_limits_nm))

    def solve(
        self,
        state: RobotState,
        contacts: Sequence[Contact],
        com_acceleration: FloatArray,
        momentum_rate: FloatArray,
        motions: Sequence[MotionTask],
        joints: JointTask,
    ) -> Solution | None:
        """Find accelerations, wrenches and torques.

        Args:
            state: the robot now.
            contacts: standing feet, at least one.
            com_acceleration: wanted [m/s^2], shape (3,).
            momentum_rate: wanted rate of the angular momentum [N m], shape (3,).
            motions: tasks on accelerations.
            joints: tasks on single dofs.

        Returns:
            The solution, or None when the solver finds none: the state is no number, or rounding made it give up.
        """
        hessian, linear = self._cost(state, contacts, com_acceleration, momentum_rate, motions, joints)
        rows, lower, upper, equalities, stacked = self._constraints(state, contacts)
        x = minimise(hessian, linear, rows, lower, upper, equalities)
        if x is None:
            return None
        nv = len(state.bias)
        qacc, forces = x[:nv], FORCE_SCALE * x[nv:]
        torques = state.inertia[6:] @ qacc + state.bias[6:] - stacked[:, 6:].T @ forces
        if not np.isfinite(torques).all():
            return None
        limits = self._limits
        return Solution(qacc=qacc, wrenches=forces.reshape(-1, 6), torques=np.clip(torques, -limits, limits))

    def _cost(
        self,
        state: RobotState,
        contacts: Sequence[Contact],
        com_acceleration: FloatArray,
        momentum_rate: FloatArray,
        motions: Sequence[MotionTask],
        joints: JointTask,
    ) -> tuple[FloatArray, FloatArray]:
        nv, count = len(state.bias), 6 * len(contacts)
        hessian = np.zeros((nv + count, nv + count))
        linear = np.zeros(nv + count)
        roots = [np.sqrt(task.weight) for task in motions]
        a = np.concatenate([root * task.jacobian for root, task in zip(roots, motions, strict=True)])
        b = np.concatenate([root * task.target for root, task in zip(roots, motions, strict=True)])
        hessian[:nv, :nv] = a.T @ a
        linear[:nv] = a.T @ b + joints.weight * joints.target
        diagonal = np.einsum("ii->i", hessian)
        diagonal[:nv] += joints.weight + self._options.acceleration_weight
        force_cost, force_linear = self._force_cost(state, contacts, com_acceleration, momentum_rate)
        hessian[nv:, nv:] = force_cost
        linear[nv:] = force_linear
        return hessian, linear

    def _force_cost(
        self,
        state: RobotState,
        contacts: Sequence[Contact],
        com_acceleration: FloatArray,
        momentum_rate: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Cost of the wrench variables: their sum about the centre of mass, and regularisers."""
        options, count = self._options, len(contacts)
        scale = FORCE_SCALE / state.mass_kg
        summed = np.zeros((6, 6 * count))
        identity = np.eye(3)
        for i, contact in enumerate(contacts):
            summed[:3, 6 * i : 6 * i + 3] = identity
            summed[3:, 6 * i : 6 * i + 3] = skew(contact.frame.position - state.com)
            summed[3:, 6 * i + 3 : 6 * i + 6] = identity
        summed *= scale
        weight = np.array([*options.com_weight, *[options.momentum_weight] * 3])
        target = np.concatenate([com_acceleration + _GRAVITY, momentum_rate / state.mass_kg])
        cost = (summed.T * weight) @ summed
        linear = summed.T @ (weight * target)
        diagonal = np.einsum("ii->i", cost)
        for i, contact in enumerate(contacts):
            diagonal[6 * i : 6 * i + 3] += options.force_weight * scale**2
            diagonal[6 * i + 3 : 6 * i + 6] += options.moment_weight * scale**2
            diagonal[6 * i + 2] += options.share_weight * scale**2
            linear[6 * i + 2] += options.share_weight * scale * contact.share * _GRAVITY[2]
        return cost, linear

    def _constraints(
        self, state: RobotState, contacts: Sequence[Contact]
    ) -> tuple[FloatArray, FloatArray, FloatArray, int, FloatArray]:
        """Rows and their bounds, the number of leading equalities, and the feet's stacked Jacobian."""
        nv = len(state.bias)
        stacked = np.concatenate([contact.frame.jacobian for contact in contacts])
        dynamics = np.concatenate([state.inertia, -FORCE_SCALE * stacked.T], axis=1)
        torque_rows, torque_bias = dynamics[6:], state.bias[6:]
        passive, limited = self._passive, self._limited
        cones = [self._cone(contact) for contact in contacts]
        cone_rows = np.zeros((sum(len(c) for c in cones), nv + 6 * len(contacts)))
        start = 0
        for i, cone in enumerate(cones):
            cone_rows[start : start + len(cone), nv + 6 * i : nv + 6 * i + 6] = cone
            start += len(cone)
        rows = np.concatenate([dynamics[:6], torque_rows[passive], torque_rows[limited], cone_rows])
        fixed = np.concatenate([-state.bias[:6], -torque_bias[passive]])
        bias, limit, zeros = torque_bias[limited], self._limits[limited], np.zeros(len(cone_rows))
        lower = np.concatenate([fixed, -limit - bias, zeros])
        upper = np.concatenate([fixed, limit - bias, zeros + _UNBOUNDED])
        return rows, lower, upper, len(fixed), stacked

    def _cone(self, contact: Contact) -> FloatArray:
        """Rows on one scaled wrench in world axes: normal force, friction, centre of pressure, twist; shape (11, 6)."""
        options, sole = self._options, contact.sole
        x, y = options.sole_margin * sole.half_length_m, options.sole_margin * sole.half_width_m
        mu, twist = options.friction, options.twist_m
        local = np.array(
            [
                [0, 0, 1, 0, 0, 0],
                [1, 0, mu, 0, 0, 0],
                [-1, 0, mu, 0, 0, 0],
                [0, 1, mu, 0, 0, 0],
                [0, -1, mu, 0, 0, 0],
                [0, 0, y, 1, 0, 0],
                [0, 0, y, -1, 0, 0],
                [0, 0, x, 0, 1, 0],
                [0, 0, x, 0, -1, 0],
                [0, 0, twist, 0, 0, 1],
                [0, 0, twist, 0, 0, -1],
            ],
            dtype=np.float64,
        )
        turned = np.empty_like(local)
        to_sole = contact.frame.rotation.T
        turned[:, :3], turned[:, 3:] = local[:, :3] @ to_sole, local[:, 3:] @ to_sole
        return turned


def minimise(
    hessian: FloatArray, linear: FloatArray, rows: FloatArray, lower: FloatArray, upper: FloatArray, equalities: int
) -> FloatArray | None:
    """Minimise x' hessian x / 2 - linear' x with lower <= rows x <= upper.

    The same problem has the same solution to the last bit, whatever was solved before and in whatever thread: daqp is
    given no guess and no limit of time, and keeps nothing from one call to the next.

    Args:
        hessian: symmetric, positive definite, shape (n, n).
        linear: shape (n,).
        rows: shape (m, n).
        lower: shape (m,).
        upper: 1e30 for no bound, shape (m,).
        equalities: so many leading rows have equal bounds.

    Returns:
        The solution, shape (n,); None if there is none, if the solver gave up, or if a number is not finite.
    """
    if not all(np.isfinite(part).all() for part in (hessian, linear, rows, lower, upper)):
        return None  # daqp passes over a row with NaN and calls optimal what it finds
    hessian, lower, upper = map(np.ascontiguousarray, (hessian, lower, upper))  # daqp takes for granted that they are
    sense = np.zeros(len(rows), np.intc)
    sense[:equalities] = _EQUALITY
    x: FloatArray
    x, _, flag, _ = daqp.solve(hessian, -linear, rows, upper, lower, sense, **_SETTINGS)
    return x if flag > 0 else None  # 1, or 4 where rounding exceeds the tolerance; below zero x may be anything


def skew(vector: FloatArray) -> FloatArray:
    """Matrix S of the cross product with a vector v, S b = v x b, shape (3, 3)."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
