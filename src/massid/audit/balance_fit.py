"""The force balance solved for the masses of all links, for what sensors' offsets and gains may be, and for more."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massid.audit.balance import Balance
from massid.audit.forces import slow_errors
from massid.model.robot import Robot
from massid.typing import FloatArray
from massid.walk import Walk

_CORRELATED = 3.0
"""Smoothed terms overlap: so many of them tell as much as one."""
_SMOOTHING_S = 0.1
"""Over which noise of the velocities leaves the forces of a walk clear."""
_ROUNDS = 4
_LEAST_NOISE = 1e-9  # of the force that a degree of freedom takes
_VAGUE = 10.0
_VAGUE_FORCE = 1e3
"""Of a coefficient in newtons, newton metres or such times seconds: nothing is known of it."""


@dataclass(frozen=True)
class Fit:
    """What a balance says.

    Attributes:
        links: names.
        errors: relative error of each link's mass, shape (n_links,).
        covariance: theirs, shape (n_links, n_links).
        more: coefficients of what else was asked for, shape (n,).
        more_std: their standard deviations, shape (n,).
    """

    links: tuple[str, ...]
    errors: FloatArray
    covariance: FloatArray
    more: FloatArray
    more_std: FloatArray


def fit_balance(robot: Robot, walk: Walk, balance: Balance, more: FloatArray | None = None) -> Fit:
    """Solve a balance by least squares, errors of sensors with their priors.

    Args:
        robot: with nominal masses.
        walk: aligned with the robot.
        balance: of this walk.
        more: generalised forces per unit of what else may act, shape (K, nv, n).
    """
    width = min(round(_SMOOTHING_S / walk.timestep_s), *(len(stretch) // 2 for stretch in balance.stretches))
    balance = replace(balance, smoothing=max(1, width))
    effort, wrench = walk.effort[balance.rows], walk.wrench[balance.rows]
    masses = balance.smooth(balance.per_link)
    others = np.zeros((len(masses), 0)) if more is None else balance.smooth(more)
    slow = np.stack(list(slow_errors(robot, walk, balance, effort, wrench)), axis=1)
    columns = np.hstack([masses, others, slow])
    supplied = balance.force_of_torques(effort, robot) + balance.force_of(wrench)
    target = balance.smooth(supplied - balance.required)
    dofs = balance.required.shape[1]
    links, known = masses.shape[1], masses.shape[1] + others.shape[1]
    vague = np.full(others.shape[1], _VAGUE_FORCE**-2)
    prior = np.diag(np.concatenate([np.full(links, _VAGUE**-2), vague, np.ones(slow.shape[1])]))
    noise = np.full(dofs, float(np.sqrt(np.mean(target**2))))
    for _ in range(_ROUNDS):  # the noise of each degree of freedom, and how far the priors hold against it
        weight = np.tile(1.0 / np.maximum(noise, _LEAST_NOISE), len(target) // dofs)
        weighted = columns * weight[:, None]
        precision = weighted.T @ weighted / _CORRELATED + prior
        solution = np.linalg.solve(precision, weighted.T @ (target * weight) / _CORRELATED)
        noise = np.sqrt(np.mean((target - columns @ solution).reshape(-1, dofs) ** 2, axis=0))
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
    return Fit(
        balance.links,
        np.asarray(solution[:links]),
        covariance[:links, :links],
        np.asarray(solution[links:known]),
        np.asarray(np.sqrt(np.diagonal(covariance)[links:known])),
    )
