"""Compiled inner loops: fixed-step RK4 of a plant under its controller, and of a whole bank of models.

A right-hand side is scalar code, `rate(x, p, u, dx)`; the loops take it as an argument and are compiled once for each
system (about a second).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import njit

from massid.typing import FloatArray, IntArray

_STAGE = (0.0, 0.5, 0.5, 1.0)
_WEIGHT = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)


@cache
def compiled(function: Callable[..., Any]) -> Any:
    """Compile scalar code once; what is compiled already passes through."""
    return function if hasattr(function, "py_func") else njit(function)


@njit
def advance_models(  # noqa: PLR0912  # one compiled loop
    rate: Any,
    state: FloatArray,
    points: FloatArray,
    control: FloatArray,
    measured: FloatArray,
    columns: IntArray,
    gain: FloatArray,
    step_s: float,
    errors: FloatArray,
) -> None:
    """Run N identification models through a block: x_hat' = f(z, p, u) + K (y - y_hat).

    z is x_hat with the measured states put in place. Where the whole state is measured z does not depend on x_hat, and
    RK4 needs f at the beginning, the middle and the end of the step alone.

    Args:
        rate: compiled f.
        state: x_hat, shape (N, n_x); advanced in place.
        points: p of each model, shape (N, n_p).
        control: u of each step, shape (n, n_u).
        measured: y at the half steps, shape (2 n + 1, n_y).
        columns: which states are measured, shape (n_y,).
        gain: K, shape (n_x, n_y).
        step_s: length of a step [s].
        errors: y_hat - y at the end of each step, shape (N, n, n_y); written.
    """
    n_models, n_x = state.shape
    n_y = columns.shape[0]
    whole = n_y == n_x
    x, z = np.empty(n_x), np.empty(n_x)
    f = np.empty((3, n_x))
    slope, total = np.empty(n_x), np.empty(n_x)
    miss = np.empty(n_y)
    for i in range(n_models):
        p = points[i]
        for k in range(control.shape[0]):
            u = control[k]
            if whole:
                for half in range(3):
                    rate(measured[2 * k + half], p, u, f[half])
            for j in range(n_x):
                total[j] = 0.0
                slope[j] = 0.0
            for stage in range(4):
                half = (stage + 1) // 2
                for j in range(n_x):
                    x[j] = state[i, j] + _STAGE[stage] * step_s * slope[j]
                for m in range(n_y):
                    miss[m] = measured[2 * k + half, m] - x[columns[m]]
                if not whole:
                    for j in range(n_x):
                        z[j] = x[j]
                    for m in range(n_y):
                        z[columns[m]] = measured[2 * k + half, m]
                    rate(z, p, u, f[half])
                for j in range(n_x):
                    pull = f[half, j]
                    for m in range(n_y):
                        pull += gain[j, m] * miss[m]
                    slope[j] = pull
                    total[j] += _WEIGHT[stage] * pull
            for j in range(n_x):
                state[i, j] += step_s * total[j]
            for m in range(n_y):
                errors[i, k, m] = state[i, columns[m]] - measured[2 * k + 2, m]


@njit
def simulate_plant(  # noqa: PLR0912  # one compiled loop
    rate: Any,
    law: Any,
    settings: FloatArray,
    state: FloatArray,
    observed: FloatArray,
    truth: FloatArray,
    estimate: FloatArray,
    disturbance: FloatArray,
    start_s: float,
    step_s: float,
    columns: IntArray,
    observer_gain: FloatArray,
    states: FloatArray,
    control: FloatArray,
) -> None:
    """Run the plant under its controller: u is computed at the beginning of each step and held over it.

    Beside the plant runs an observer, an identification model at the running estimate with a gain of its own, from
    which the controller takes the states that are not measured. Both take two RK4 steps to a step.

    Args:
        rate: compiled f.
        law: compiled controller, law(time, state, estimate, settings, out).
        settings: of the controller.
        state: x, shape (n_x,); advanced in place.
        observed: the observer's state, shape (n_x,); advanced in place.
        truth: p* of each step, shape (n, n_p).
        estimate: the running estimate p, shape (n_p,).
        disturbance: added to dx/dt over each half step, shape (2 n, n_x).
        start_s: time at the beginning [s].
        step_s: length of a step [s].
        columns: which states are measured, shape (n_y,).
        observer_gain: shape (n_x, n_y).
        states: x at the half steps, shape (2 n + 1, n_x); written.
        control: u of each step, shape (n, n_u); written.
    """
    n_x = state.shape[0]
    n_y = columns.shape[0]
    whole = n_y == n_x
    half = 0.5 * step_s
    x, z = np.empty(n_x), np.empty(n_x)
    slope, total = np.zeros(n_x), np.empty(n_x)
    x_hat, slope_hat, total_hat = np.empty(n_x), np.zeros(n_x), np.zeros(n_x)
    states[0] = state
    for k in range(control.shape[0]):
        for j in range(n_y):
            observed[columns[j]] = state[columns[j]]
        law(start_s + k * step_s, observed, estimate, settings, control[k])
        for part in range(2):
            total[:] = 0.0
            total_hat[:] = 0.0
            for stage in range(4):
                for j in range(n_x):
                    x[j] = state[j] + _STAGE[stage] * half * slope[j]
                rate(x, truth[k], control[k], slope)
                for j in range(n_x):
                    slope[j] += disturbance[2 * k + part, j]
                    total[j] += _WEIGHT[stage] * slope[j]
                if not whole:
                    for j in range(n_x):
                        x_hat[j] = observed[j] + _STAGE[stage] * half * slope_hat[j]
                        z[j] = x_hat[j]
                    for m in range(n_y):
                        z[columns[m]] = x[columns[m]]
                    rate(z, estimate, control[k], slope_hat)
                    for j in range(n_x):
                        for m in range(n_y):
                            slope_hat[j] += observer_gain[j, m] * (x[columns[m]] - x_hat[columns[m]])
                        total_hat[j] += _WEIGHT[stage] * slope_hat[j]
            for j in range(n_x):
                state[j] += half * total[j]
                observed[j] += half * total_hat[j]
            states[2 * k + part + 1] = state
    for j in range(n_y):
        observed[columns[j]] = state[columns[j]]
