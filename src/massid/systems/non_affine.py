"""Section V-B: a disturbed system whose unknown parameters are not affine (Eq. 19-20), and its controller (Eq. 21).

    x1' = x2
    x2' = u + p1 (x1 + sin x1) + 14 sin(p2 x2) + exp(p3 x1) + Delta

The paper gives neither k1, k2, lambda, Theta, the controller's gains, its robust term nor how long Delta is held.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from massid.errors import BadInputError
from massid.search.parameters import ParameterSpace
from massid.systems.plant import Controller, Disturbance, Plant
from massid.systems.system import System, coefficient
from massid.typing import FloatArray

TRUTH = np.array([12.0, 2.0, 1.0])
START = np.array([8.5, 2.7, 3.0])
THETA = ((0.0, 20.0), (0.0, 4.0), (0.0, 4.0))
MIRROR_THETA = ((0.0, 20.0), (0.0, 4.0), (-4.0, 4.0))
"""Admits p3 < 0, where mu has a second minimum."""
MIRROR = np.array([13.19, 2.0005, -0.988])
"""That minimum."""
DWELL_S = 4.0
NOISE, HOLD_S = 0.1, 1e-3
GAIN = 50.0
"""k1 = k2 of Eq. (20) [1/s]: fast, so that the output error is white where Delta is."""
FORGETTING_RATE = 0.1
"""lambda of Eq. (6) [1/s]."""
OBSERVER_BANDWIDTH = 500.0
"""Double pole of the observer that recovers x2 from x1 [rad/s]."""
OUTPUT_BANDWIDTH = 30.0
"""Double pole of the identification models where only x1 is measured [rad/s]."""


@dataclass(frozen=True)
class Tracking:
    """Gains of Eq. (21). The robust term is -rho sat(s / phi) with s = e' + (kp / kd) e, the error e = x1 - x_des.

    Attributes:
        kp: proportional gain [1/s^2].
        kd: derivative gain [1/s].
        rho: largest robust term.
        phi: boundary layer, in the unit of s.
        limit: largest compensation term, 20 (x1 + sin x1) + 14 + exp(4 x1) near x1 = 1: more can only come of a state
            far off the desired one, where exp(p3 x1) with a wrong p3 would drive it further.
        compensate: whether the running estimate is used; without, u has no compensation term.
    """

    kp: float = 100.0
    kd: float = 20.0
    rho: float = 10.0
    phi: float = 0.5
    limit: float = 120.0
    compensate: bool = True

    def controller(self) -> Controller:
        """The controller, to be put into a plant."""
        gains = (self.kp, self.kd, self.rho, self.phi, self.limit if self.compensate else 0.0)
        return Controller(track_sine, np.array(gains))


def non_affine_rate(x: Any, p: Any, u: Any, dx: Any) -> None:
    """Right-hand side of Eq. (19) without Delta."""
    dx[0] = x[1]
    dx[1] = u[0] + p[0] * (x[0] + math.sin(x[0])) + 14.0 * math.sin(p[1] * x[1]) + math.exp(p[2] * x[0])


def track_sine(time: float, x: Any, p: Any, settings: Any, u: Any) -> None:
    """Eq. (21) for x_des = sin(2 t)."""
    kp, kd, rho, phi, limit = settings
    position, velocity = math.sin(2.0 * time) - x[0], 2.0 * math.cos(2.0 * time) - x[1]
    surface = velocity + kp / kd * position
    robust = rho * min(1.0, max(-1.0, surface / phi))
    model = p[0] * (x[0] + math.sin(x[0])) + 14.0 * math.sin(p[1] * x[1]) + math.exp(p[2] * x[0])
    u[0] = -4.0 * math.sin(2.0 * time) + kp * position + kd * velocity + robust - min(limit, max(-limit, model))


def desired(time_s: FloatArray) -> FloatArray:
    """x_des at times [s]."""
    return np.sin(2.0 * time_s)


def non_affine_space(
    start: FloatArray = START, theta: tuple[tuple[float, float], ...] = THETA, copies: int = 1
) -> ParameterSpace:
    """The unknowns, from an initial guess; those of further copies are called p4, p5 and so on."""
    values = np.tile(start, copies)
    return ParameterSpace(
        tuple(coefficient(f"p{i + 1}", float(value), *theta[i % 3]) for i, value in enumerate(values))
    )


def non_affine_system(
    start: FloatArray = START, theta: tuple[tuple[float, float], ...] = THETA, gain: float = GAIN
) -> System:
    """Eq. (19) with the identification model of Eq. (20)."""
    return System("V-B", non_affine_rate, n_x=2, n_u=1, space=non_affine_space(start, theta), gain=gain * np.eye(2))


def output_system(start: FloatArray = START, bandwidth: float = OUTPUT_BANDWIDTH) -> System:
    """The same with x1 alone measured (Section II-B): the model estimates x2 as well."""
    space = non_affine_space(start)
    return System("V-B, x1 only", non_affine_rate, 2, 1, space, gain=observer_gain(bandwidth), measured=(0,))


def observer_gain(bandwidth: float) -> FloatArray:
    """Gain of a model of Eq. (19) that sees x1 alone: a double pole, shape (2, 1)."""
    return np.array([[2.0 * bandwidth], [bandwidth**2]])


def disturbance(noise: float = NOISE, hold_s: float = HOLD_S) -> Disturbance:
    """Delta of Eq. (19)."""
    return Disturbance(np.array([0.0, noise]), hold_s)


def non_affine_plant(
    system: System,
    rng: np.random.Generator,
    noise: float = NOISE,
    hold_s: float = HOLD_S,
    tracking: Tracking | None = None,
    timestep_s: float = 1e-3,
) -> Plant:
    """The true system under the tracking controller, at rest in the origin at the beginning."""
    return Plant(
        system,
        TRUTH,
        (tracking or Tracking()).controller(),
        np.zeros(2),
        timestep_s,
        disturbance(noise, hold_s) if noise > 0.0 else None,
        None if system.whole_state else observer_gain(OBSERVER_BANDWIDTH),
        rng,
    )


def copied_system(copies: int) -> System:
    """Independent copies of Eq. (19) side by side: 2 states, 1 input and 3 unknowns more with each.

    Raises:
        BadInputError: fewer than one copy.
    """
    if copies < 1:
        raise BadInputError(f"{copies} copies of V-B; at least one is needed.")

    def rate(x: Any, p: Any, u: Any, dx: Any) -> None:
        for i in range(copies):
            a, b, c = 2 * i, 2 * i + 1, 3 * i
            dx[a] = x[b]
            dx[b] = u[i] + p[c] * (x[a] + math.sin(x[a])) + 14.0 * math.sin(p[c + 1] * x[b]) + math.exp(p[c + 2] * x[a])

    n_x = 2 * copies
    return System(f"V-B x {copies}", rate, n_x, copies, non_affine_space(copies=copies), GAIN * np.eye(n_x))


def copied_controller(copies: int) -> Controller:
    """Eq. (21) for each copy, with sines of different phase."""
    gains = Tracking().controller().settings

    def law(time: float, x: Any, p: Any, settings: Any, u: Any) -> None:
        kp, kd, rho, phi, limit = settings
        for i in range(copies):
            phase = 2.0 * time + 0.5 * i
            position, velocity = math.sin(phase) - x[2 * i], 2.0 * math.cos(phase) - x[2 * i + 1]
            robust = rho * min(1.0, max(-1.0, (velocity + kp / kd * position) / phi))
            p1, p2, p3 = p[3 * i], p[3 * i + 1], p[3 * i + 2]
            y1, y2 = x[2 * i], x[2 * i + 1]
            model = p1 * (y1 + math.sin(y1)) + 14.0 * math.sin(p2 * y2) + math.exp(p3 * y1)
            u[i] = -4.0 * math.sin(phase) + kp * position + kd * velocity + robust - min(limit, max(-limit, model))

    return Controller(law, gains)
