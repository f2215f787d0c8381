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
LEAST_SEEN = {4: 0.1, 8: 0.5, 12: 0.6}
"""Share of an acceleration that lasts so many milliseconds."""


def test_noise_alone_is_never_taken_for_a_jump() -> None:
    rows = STD * np.random.default_rng(0).normal(size=(20000, 2))
    whole = slice(0, len(rows))
    np.testing.assert_array_equal(slope(rows, whole, SPANS, STD), slope(rows, whole, SPANS))


@pytest.mark.parametrize("ms", LEAST_SEEN)
def test_an_impact_is_seen_in_the_place_where_it_is(ms: int) -> None:
    """A velocity that changes by 300 deviations of its noise in milliseconds: wide lines see nothing of it there."""
    time = np.arange(400)
    change = np.clip((time - 200) / ms, 0.0, 1.0)[:, None] * 300.0 * STD
    rows = change + STD * np.random.default_rng(1).normal(size=(400, 2))
    true = np.gradient(change, axis=0)
    narrow, wide = slope(rows, ALL, SPANS, STD), slope(rows, ALL, SPANS)
    near = slice(190, 212)
    seen, missed = ((found * true)[near].sum(axis=0) / (true[near] ** 2).sum(axis=0) for found in (narrow, wide))
    assert np.all(missed < 0.1)
    assert np.all(seen > LEAST_SEEN[ms])


def test_a_straight_line_keeps_its_slope_and_its_level() -> None:
    rows = np.arange(400.0)[:, None] * np.array([0.5, 40.0])
    inside = slice(30, 370)
    np.testing.assert_allclose(slope(rows, inside, SPANS, STD), np.tile([0.5, 40.0], (340, 1)), rtol=1e-9)
    np.testing.assert_allclose(level(rows, inside, SPANS), rows[inside], rtol=1e-9)
