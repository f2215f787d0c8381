"""Lines through neighbours: blind to noise, not to what jumps."""

from __future__ import annotations

import numpy as np
import pytest

from massid.observer.neighbours import level, slope
from massid.observer.spans import Spans

TIMESTEP_S = 1e-3
SPANS = Spans.at(TIMESTEP_S)
STD = np.array([0.02, 2.0])
ALL = slice(0, 400)


def test_noise_alone_is_never_taken_for_a_jump() -> None:
    rows = STD * np.random.default_rng(0).normal(size=(20000, 2))
    whole = slice(0, len(rows))
    np.testing.assert_array_equal(slope(rows, whole, SPANS, STD), slope(rows, whole, SPANS))
    np.testing.assert_array_equal(level(rows, whole, SPANS, STD), level(rows, whole, SPANS))


@pytest.mark.parametrize("ms", [2, 4, 8])
def test_an_impact_is_seen_in_the_place_where_it_is(ms: int) -> None:
    """A velocity that changes by 100 deviations of its noise within milliseconds: wide lines see nothing of it there."""
    time = np.arange(400)
    change = np.clip((time - 200) / ms, 0.0, 1.0)[:, None] * 100.0 * STD
    rows = change + STD * np.random.default_rng(1).normal(size=(400, 2))
    true = np.gradient(change, axis=0)
    narrow, wide = slope(rows, ALL, SPANS, STD), slope(rows, ALL, SPANS)
    middle = 200 + ms // 2
    assert np.all(np.abs(wide[middle]) < 0.3 * true[middle])
    assert np.all(narrow[middle] > 0.5 * true[middle].min(initial=np.inf) * 0.5)
    for channel in range(2):
        assert np.linalg.norm((narrow - true)[:, channel]) < 0.7 * np.linalg.norm((wide - true)[:, channel])


def test_levels_follow_a_step_closer_than_a_reach() -> None:
    step = np.repeat([[0.0, 0.0], [1.0, 1.0]], 200, axis=0) * 100.0 * STD
    rows = step + STD * np.random.default_rng(2).normal(size=(400, 2))
    off = np.abs(level(rows, ALL, SPANS, STD) - step).max(axis=1)
    assert np.all(off[np.abs(np.arange(400) - 199.5) > 7.0] < 50.0 * STD.max())
    assert np.all(off[np.abs(np.arange(400) - 199.5) > SPANS.reach] < 3.0 * STD.max())


def test_a_straight_line_keeps_its_slope_and_its_level() -> None:
    rows = np.arange(400.0)[:, None] * np.array([0.5, 40.0])
    inside = slice(30, 370)
    np.testing.assert_allclose(slope(rows, inside, SPANS, STD), np.tile([0.5, 40.0], (340, 1)), rtol=1e-9)
    np.testing.assert_allclose(level(rows, inside, SPANS, STD), rows[inside], rtol=1e-9)
