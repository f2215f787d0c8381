"""Section IV on models of V-A and V-B, and on models of a recorded walk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from massid.identify import IdentifyOptions, identify_online
from massid.paper.estimators import compare_estimators
from massid.paper.theory import CHECKS, SAFE, Check, offline_rate
from tests.conftest import Pushed

WALK = replace(IdentifyOptions(dwell_s=0.25, noise="clean"), search=SAFE)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_papers_statements(check: Callable[[], Check]) -> None:
    outcome = check()
    assert outcome.holds, outcome.measured


def test_the_checks_can_fail() -> None:
    """With twice the largest allowed step the rate of Eq. (14) breaks down."""
    run = offline_rate(2.1)
    assert run.steepest[-1] > 1.0 or not np.all(np.diff(run.error) <= 0.0)


def test_theorem_1_on_a_walk(pushed: Pushed) -> None:
    """alpha_i = 1/L_i in kilograms: the L2 mass error falls in every window, with models sampled on the walk."""
    result = identify_online(pushed.walk, pushed.robot, pushed.space, WALK)
    points = np.vstack([pushed.space.nominal, *(window.estimate for window in result.windows)])
    errors = np.linalg.norm(points - pushed.truth, axis=1)
    assert len(errors) > 4
    assert np.all(errors[1:] <= errors[:-1] * (1.0 + 1e-6))
    assert errors[-1] < errors[0]


def test_proposition_1_on_a_walk(pushed: Pushed) -> None:
    """Models at p* score nothing, all others something: the walk excites every mass that is asked for."""
    space = replace(
        pushed.space,
        parameters=tuple(
            replace(p, nominal=float(value)) for p, value in zip(pushed.space.parameters, pushed.truth, strict=True)
        ),
    )
    result = identify_online(pushed.walk, pushed.robot, space, WALK)
    first = result.windows[0]
    others = np.delete(first.mu, first.best)
    assert first.mu[0] < 1e-9 * others.min()
    assert np.linalg.norm(first.estimate - pushed.truth) < 1e-6


def test_estimators() -> None:
    """Antithetic pairs beat one-sided samples; under noise common to all models RANSAC gains nothing; with corrupted
    scores it alone holds."""
    outcome = {entry.method: entry.error for entry in compare_estimators()}
    clean, noisy, corrupted, diverged = range(4)
    assert outcome["antithetic pairs, least squares"][noisy] < 0.3 * outcome["least squares"][noisy]
    assert outcome["RANSAC"][noisy] >= outcome["least squares"][noisy]
    assert outcome["RANSAC"][corrupted] < 0.2
    assert outcome["least squares"][corrupted] > 1.0
    assert outcome["antithetic pairs, Gram matrix"][clean] < 0.01
    assert all(errors[diverged] < 0.3 for errors in outcome.values())
