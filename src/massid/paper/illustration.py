"""Fig. 1: one sampling and update step, taken from a run, over contours of mu (V-B with p2 known)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from massid.paper.setting import TIMESTEP_S
from massid.search.guided import GuidedSearch, Iteration, SearchOptions
from massid.search.online import score_block
from massid.search.parameters import ParameterSpace
from massid.search.proposal import Proposal, Role
from massid.systems import non_affine
from massid.systems.bank import SystemBank
from massid.systems.plant import Controller, Plant
from massid.systems.system import System, coefficient
from massid.typing import FloatArray

N_MODELS = 9
START = np.array([8.5, 2.0])
TRUTH = non_affine.TRUTH[[0, 2]]
GRID = 41
STEPS_SHOWN = 4
RADIUS = 0.25
"""Larger than by default, so that the samples can be seen."""


@dataclass(frozen=True)
class Illustration:
    """What Fig. 1 shows.

    Attributes:
        p1: grid of the contours, shape (GRID,).
        p3: shape (GRID,).
        mu: over the window of the step that is shown, shape (GRID, GRID): rows p3, columns p1.
        points: all models of the window, shape (N_MODELS, 2).
        gradient: at the centre, shape (2,).
        estimate: after the update, shape (2,).
        path: estimates of this and the next windows, shape (1 + STEPS_SHOWN, 2).
    """

    p1: FloatArray
    p3: FloatArray
    mu: FloatArray
    points: FloatArray
    gradient: FloatArray
    estimate: FloatArray
    path: FloatArray


def illustrate() -> Illustration:
    """Run the paper's direction for a few windows and score a grid over the first."""
    space = ParameterSpace(
        (coefficient("p1", START[0], 0.0, 20.0, scale=5.0), coefficient("p3", START[1], 0.0, 4.0, scale=1.0))
    )
    system = System("V-B, p2 known", _rate, 2, 1, space, non_affine.GAIN * np.eye(2))
    plant = Plant(
        system,
        TRUTH,
        Controller(_track, np.append(non_affine.Tracking().controller().settings, 2.0)),
        np.zeros(2),
        TIMESTEP_S,
    )
    options = SearchOptions(direction="gradient", gradient="least-squares", radius=RADIUS, candidates=2)
    search = GuidedSearch(space, N_MODELS, options, np.random.default_rng(0))
    bank = SystemBank(system, N_MODELS, TIMESTEP_S)
    iterations: list[Iteration] = []
    grid: FloatArray = np.zeros(0)
    p1, p3 = np.linspace(6.0, 14.0, GRID), np.linspace(0.0, 3.0, GRID)
    for _ in range(STEPS_SHOWN):
        block = plant.run(non_affine.DWELL_S, search.estimate).block
        if not iterations:
            points = np.stack(np.meshgrid(p1, p3), axis=-1).reshape(-1, 2)
            roles = (Role.CENTRE, *[Role.SAMPLE] * (len(points) - 1))
            mus = [
                score_block(
                    SystemBank(system, len(part), TIMESTEP_S), Proposal(part, roles[: len(part)]), block, 0.0
                ).mu
                for part in np.split(points, GRID)
            ]
            grid = np.array(mus)
        iterations.append(search.tell(score_block(bank, search.ask(), block, non_affine.FORGETTING_RATE)))
    first = iterations[0]
    return Illustration(
        p1=p1,
        p3=p3,
        mu=grid,
        points=first.monitoring.proposal.points,
        gradient=first.quadratic.gradient,
        estimate=first.estimate,
        path=np.vstack([START, [iteration.estimate for iteration in iterations]]),
    )


def _rate(x: Any, p: Any, u: Any, dx: Any) -> None:
    dx[0] = x[1]
    dx[1] = u[0] + p[0] * (x[0] + math.sin(x[0])) + 14.0 * math.sin(2.0 * x[1]) + math.exp(p[1] * x[0])


def _track(time: float, x: Any, p: Any, settings: Any, u: Any) -> None:
    kp, kd, rho, phi, limit, p2 = settings
    position, velocity = math.sin(2.0 * time) - x[0], 2.0 * math.cos(2.0 * time) - x[1]
    robust = rho * min(1.0, max(-1.0, (velocity + kp / kd * position) / phi))
    model = p[0] * (x[0] + math.sin(x[0])) + 14.0 * math.sin(p2 * x[1]) + math.exp(p[1] * x[0])
    u[0] = -4.0 * math.sin(2.0 * time) + kp * position + kd * velocity + robust - min(limit, max(-limit, model))
