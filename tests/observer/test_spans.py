"""Spans are times: a log of half the rate is looked at as far around a sample, with half the samples."""

from __future__ import annotations

import pytest

from massid.observer.spans import GAP_S, HALF_WIDTH_S, REACH_S, SETTLING_S, Spans


@pytest.mark.parametrize("period_s", [2.5e-4, 5e-4, 1e-3, 2e-3])
def test_spans_are_the_same_times_at_any_rate(period_s: float) -> None:
    spans = Spans.at(period_s)
    for count, span_s in zip(
        (spans.gap, spans.reach, spans.half_width, spans.settling),
        (GAP_S, REACH_S, HALF_WIDTH_S, SETTLING_S),
        strict=True,
    ):
        assert abs(count * period_s - span_s) <= 0.5 * period_s


@pytest.mark.parametrize("period_s", [5e-3, 1e-2, 0.1])
def test_slow_logs_keep_a_gap_and_enough_neighbours_for_a_straight_line(period_s: float) -> None:
    spans = Spans.at(period_s)
    assert spans.gap >= 1
    assert spans.reach - spans.gap >= 3
    assert spans.half_width >= 1
    assert spans.settling >= 1
