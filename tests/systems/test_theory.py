"""Section IV on models of V-A and V-B."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from massid.paper.estimators import compare_estimators
from massid.paper.recorded import Check, offline_rate
from massid.paper.theory import CHECKS, excited_window


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_papers_statements(check: Callable[[], Check]) -> None:
    outcome = check()
    assert outcome.holds, outcome.measured


def test_the_checks_can_fail() -> None:
    """With twice the largest allowed step the rate of Eq. (14) breaks down."""
    run = offline_rate(excited_window(), 60, 2.1)
    assert run.steepest[-1] > 1.0 or not np.all(np.diff(run.error) <= 0.0)


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
