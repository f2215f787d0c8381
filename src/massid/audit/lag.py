"""A constant lag between state, torque and wrench streams, from the force balance.

At the right shift of both inputs nothing is left that link masses cannot explain. The squared rest is a quadratic form
in the shifted streams, so it is evaluated for all pairs of shifts from one matrix of inner products; between samples a
held input is the mean of two neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from massid.audit.balance import Balance, measure_balance
from massid.model.inverse import takes_stages
from massid.model.robot import Robot
from massid.typing import FloatArray
from massid.walk import Walk

LARGEST_LAG_S = 0.025
"""Lags up to this are looked for."""
LEAST_GAIN = 0.5
"""A lag is believed if it takes away this share of the squared rest."""
LEAST_LAG_SAMPLES = 0.1


@dataclass(frozen=True)
class Lag:
    """How much later than the state the inputs are stamped.

    Attributes:
        effort_s: of the joint torques [s].
        wrench_s: of the contact wrenches [s].
        rest_before: share of the required force that neither inputs nor link masses explain, as stamped.
        rest_after: the same with both lags taken off.
        believed: whether the lags are large and clear enough to be compensated.
    """

    effort_s: float
    wrench_s: float
    rest_before: float
    rest_after: float
    believed: bool


def lag_margin(walk: Walk) -> int:
    """Samples that a lag can shift an input."""
    return max(2, min(round(LARGEST_LAG_S / walk.timestep_s), 40))


def estimate_lag(robot: Robot, walk: Walk, balance: Balance | None = None) -> Lag | None:
    """Estimate both lags; None if the walk is too short.

    Args:
        robot: with nominal masses.
        walk: aligned with the robot.
        balance: of this walk, measured with at least `lag_margin` samples of margin; measured here if None.
    """
    margin = lag_margin(walk)
    balance = balance or measure_balance(robot, walk, margin)
    if balance is None:
        return None
    shifts = range(-margin, margin + 1)
    terms = [balance.required]
    terms += [balance.effort(walk, robot, shift) for shift in shifts]
    terms += [balance.wrench(walk, shift) for shift in shifts]
    rest = balance.unexplained(np.stack([balance.smooth(term) for term in terms], axis=1))
    gram = rest.T @ rest
    count = len(shifts)

    def squared_rest(lags: FloatArray) -> float:
        coefficients = np.zeros(len(gram))
        coefficients[0] = 1.0
        for offset, lag in ((1, lags[0]), (1 + count, lags[1])):
            below = int(np.clip(np.floor(lag), -margin, margin - 1))
            share = float(lag) - below
            coefficients[offset + margin + below] -= 1.0 - share
            coefficients[offset + margin + below + 1] -= share
        return float(coefficients @ gram @ coefficients)

    has_wrench = bool(walk.measured.any())
    pairs = [(a, b) for a in shifts for b in (shifts if has_wrench else (0,))]
    start = min(pairs, key=lambda pair: squared_rest(np.array(pair, dtype=float)))
    widest = float(margin)
    bounds = [(-widest, widest), (-widest, widest) if has_wrench else (0.0, 0.0)]
    best, least = np.array(start, dtype=float), squared_rest(np.array(start, dtype=float))
    for first in (-0.5, 0.0, 0.5):
        for second in (-0.5, 0.0, 0.5) if has_wrench else (0.0,):
            guess = np.clip(best + np.array([first, second]), -margin, margin)
            found = minimize(squared_rest, guess, method="Nelder-Mead", bounds=bounds, options={"xatol": 1e-4})
            if found.fun < least:
                best, least = found.x, float(found.fun)
    size = float((balance.smooth(balance.required) ** 2).sum())
    before = squared_rest(np.zeros(2))
    # A step of RK4 has no single torque and wrench: their mean acts half a step late.
    least_lag = 1.0 if takes_stages(robot.model) else LEAST_LAG_SAMPLES
    is_large = float(np.abs(best).max()) > least_lag
    believed = is_large and before - least > LEAST_GAIN * before and before > 1e-12 * size
    effort, wrench = (float(value) * walk.timestep_s for value in best)
    return Lag(
        effort, wrench, float(np.sqrt(max(before, 0.0) / size)), float(np.sqrt(max(least, 0.0) / size)), believed
    )
