"""Filtered inverse-dynamics least squares: the method that everyone else weighs robots with.

All channels go through one low-pass filter; accelerations are differences of the filtered velocities; what the
robot's equation of motion leaves unexplained is linear in the masses. Rows are weighted by the covariance of their
residuals, found by repeating the fit. The result depends on the cut-off of the filter, which somebody has to choose.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from massid.compare.inverse_dynamics import InverseDynamics
from massid.compare.motion import smooth_motion
from massid.errors import BadInputError
from massid.model.robot import Robot
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Walk

CUTOFFS_HZ = (2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0)
"""What a user would try."""
HELD_OUT = 0.25
"""Share of a log, at its end, that judges a cut-off."""
REWEIGHTINGS = 30
SETTLED = 1e-9
"""Relative change of the estimate at which reweighting ends."""
VARIANCE_FLOOR = 1e-12
"""Of a row's residuals, relative to the largest row's: a row that fits exactly must not get all the weight."""


@dataclass(frozen=True)
class Fit:
    """One least-squares solution.

    Attributes:
        cutoff_hz: of the filter; None for none.
        estimate: of all parameters, shape (n_p,).
        std: as the fit itself believes, residuals taken to be white, shape (n_p,).
        held_out: squared error of the joint torques predicted for the held-out part of the log, as a share of those
            torques' variance.
    """

    cutoff_hz: float | None
    estimate: FloatArray
    std: FloatArray
    held_out: float


def fit_masses(walk: Walk, robot: Robot, space: ParameterSpace, cutoff_hz: float | None) -> Fit:
    """Weigh a robot by filtered inverse dynamics.

    The last quarter of the log judges the fit and is then used for it like the rest.

    Args:
        walk: the log.
        robot: with nominal masses.
        space: masses, and slow errors of sensors with their priors.
        cutoff_hz: of the filter; None takes every sample as it is, for a log without noise.

    Raises:
        BadInputError: an impossible cut-off, or a walk too short for it.
        LogError: the walk does not match the robot.
    """
    walk = robot.align(walk)
    dynamics = InverseDynamics(robot, space, walk.contact_bodies, walk.timestep_s)
    motion = smooth_motion(walk, robot.layout, cutoff_hz)
    known, regressor = dynamics.residual(motion), dynamics.regressor(motion)
    n_train = round((1.0 - HELD_OUT) * len(motion))
    if n_train * known.shape[1] < len(space) or n_train > len(motion) - 2:  # one instant has no variance
        raise BadInputError(
            f"{walk.source}: {len(motion)} instants are too few for {len(space)} unknowns; choose a higher cut-off."
        )
    trained = _solve(known[:n_train], regressor[:n_train], space)
    joints = robot.layout.joint_dof
    rest = _explain(known[n_train:], regressor[n_train:], trained.estimate - space.nominal)[:, joints]
    torque = motion.effort[n_train:, joints] - motion.effort[n_train:, joints].mean(axis=0)
    solved = _solve(known, regressor, space)
    return Fit(cutoff_hz, solved.estimate, solved.std, float(np.sum(rest**2) / np.sum(torque**2)))


def scan_cutoffs(
    walk: Walk,
    robot: Robot,
    space: ParameterSpace,
    cutoffs_hz: Sequence[float] = CUTOFFS_HZ,
    progress: Callable[[float, str], None] | None = None,
) -> tuple[Fit, ...]:
    """Fit with every cut-off; those for which the walk is too short are left out.

    Raises:
        BadInputError: the walk is too short for all of them.
        LogError: the walk does not match the robot.
    """
    fits, refusal = [], None
    for k, cutoff_hz in enumerate(cutoffs_hz):
        if progress is not None:
            progress(k / len(cutoffs_hz), f"{cutoff_hz:g} Hz")
        try:
            fits.append(fit_masses(walk, robot, space, cutoff_hz))
        except BadInputError as error:
            refusal = error
    if refusal is not None and not fits:
        raise refusal
    return tuple(fits)


def self_chosen(fits: Sequence[Fit]) -> Fit:
    """What a user can choose: the fit that predicts the held-out joint torques best."""
    return min(fits, key=lambda fit: fit.held_out)


def _explain(known: FloatArray, regressor: FloatArray, change: FloatArray) -> FloatArray:
    """Forces that are left, shape (n, nv)."""
    return np.asarray(known + regressor @ change)


@dataclass(frozen=True)
class _Solution:
    estimate: FloatArray
    std: FloatArray


def _solve(known: FloatArray, regressor: FloatArray, space: ParameterSpace) -> _Solution:
    """Least squares with priors, weighted by the covariance of the residuals, which is estimated with it."""
    variance = np.mean(known**2, axis=0)
    weight = np.diag(1.0 / np.sqrt(variance + VARIANCE_FLOOR * variance.max()))
    change = np.zeros(len(space))
    for _ in range(1 + REWEIGHTINGS):
        rows = (weight.T @ regressor).reshape(-1, len(space))
        information = rows.T @ rows + np.diag(space.prior_precision)
        scale = np.sqrt(np.diagonal(information))
        inverse = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
        before, change = change, -inverse @ (rows.T @ (known @ weight).ravel())
        if np.all(np.abs(change - before) <= SETTLED * space.scale):
            break
        left = _explain(known, regressor, change)
        covariance = left.T @ left / len(left)
        floor = VARIANCE_FLOOR * max(np.diagonal(covariance).max(), variance.max() * VARIANCE_FLOOR)
        covariance[np.diag_indices_from(covariance)] += floor
        weight = np.linalg.inv(np.linalg.cholesky(covariance)).T
    return _Solution(space.nominal + change, np.sqrt(np.diagonal(inverse)))
