"""Section V-A: a nonlinear system with affine unknown parameters (Eq. 16-17).

    x' = A x + B u + g(x, u) p,    g = [(0, sin(x1 + x2)), (0, exp(x1 + u)), (0, x1^2 + x2)],    B = (0, 1)

The paper gives neither A, u, k nor the initial state. Here A = [[0, 1], [-STIFFNESS, -DAMPING]] holds the state
wherever p is, so u is an open-loop sum of two sines, with the properties that Section IV asks for: x and u bounded.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from massid.search.parameters import ParameterSpace
from massid.systems.plant import Controller, Plant
from massid.systems.system import System, coefficient
from massid.typing import FloatArray

TRUTH = np.array([12.0, 2.0, 5.0])
START = np.array([-5.0, -5.0, -7.0])
DWELL_S = 4.0
TERMINATION = 0.3
"""c_terminate of Eq. (18)."""

STIFFNESS, DAMPING = 15.0, 15.0
THETA = 20.0
"""Theta is the cube |p_i| <= THETA; the paper names none."""
GAIN = 1.0
"""k of Eq. (17) [1/s], for both states. It sets the scale of mu, and so when Eq. (18) ends the search: between 0.5 and
1 the paper's direction needs about as many iterations as in the paper (see docs/paper.md)."""
INPUT = np.array([-6.0, 6.0, math.pi / 2.0, 4.0, 3.0 * math.pi / 2.0])
"""Mean of u, then amplitude and angular frequency [rad/s] of its two sines; they repeat with the dwell time."""
FORGETTING_RATE = 0.1
"""lambda of Eq. (6) [1/s]."""


def affine_rate(x: Any, p: Any, u: Any, dx: Any) -> None:
    """Right-hand side of Eq. (16)."""
    dx[0] = x[1]
    dx[1] = (
        -STIFFNESS * x[0]
        - DAMPING * x[1]
        + u[0]
        + p[0] * math.sin(x[0] + x[1])
        + p[1] * math.exp(x[0] + u[0])
        + p[2] * (x[0] * x[0] + x[1])
    )


def two_sines(time: float, x: Any, p: Any, settings: Any, u: Any) -> None:
    """u(t), whatever the state and the estimate are."""
    u[0] = settings[0] + settings[1] * math.sin(settings[2] * time) + settings[3] * math.sin(settings[4] * time)


def affine_space(start: FloatArray = START, theta: float = THETA) -> ParameterSpace:
    """The three unknowns, from the paper's initial guess."""
    return ParameterSpace(tuple(coefficient(f"p{i + 1}", float(value), -theta, theta) for i, value in enumerate(start)))


def affine_system(start: FloatArray = START, gain: float = GAIN) -> System:
    """Eq. (16) with the identification model of Eq. (17)."""
    return System("V-A", affine_rate, n_x=2, n_u=1, space=affine_space(start), gain=gain * np.eye(2))


def affine_plant(system: System, control: FloatArray = INPUT, timestep_s: float = 1e-3) -> Plant:
    """The true system, at rest at the beginning."""
    return Plant(system, TRUTH, Controller(two_sines, control), np.zeros(2), timestep_s)
