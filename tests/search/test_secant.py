"""Steps over the same measurements that do not converge by themselves."""

from __future__ import annotations

import numpy as np
import pytest

from massid.search.quadratic import LocalQuadratic
from massid.search.secant import Step, mixed
from massid.typing import FloatArray

ROOT = np.array([1.0, -2.0])


def _run(factor: float, passes: int) -> FloatArray:
    """Distance to the root after passes whose own steps leave that factor of the distance."""
    quadratic = LocalQuadratic.belief(ROOT, np.array([1.0, 100.0]))
    point, last = np.zeros(2), None
    for _ in range(passes):
        step = Step(point, (1.0 - factor) * (ROOT - point))
        point = point + (step.offset if last is None else mixed(last, step, quadratic))
        last = step
    return np.abs(point - ROOT)


@pytest.mark.parametrize("factor", [-1.0, -2.0, -0.7, 0.7])
def test_steps_that_swing_or_creep_meet_the_root(factor: float) -> None:
    assert np.all(_run(factor, 2) < 1e-9)


@pytest.mark.parametrize("factor", [-0.2, 0.0, 0.3])
def test_steps_that_converge_are_left_alone(factor: float) -> None:
    np.testing.assert_allclose(_run(factor, 2), factor**2 * np.abs(ROOT), atol=1e-12)
