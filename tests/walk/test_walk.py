"""What may call itself a walk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.errors import LogError
from massid.walk import Segment
from tests.conftest import Pushed


@pytest.mark.parametrize("name", ["qpos", "qvel", "effort", "wrench"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_number_that_is_not_finite_is_refused_where_it_would_be_used(name: str, value: float, pushed: Pushed) -> None:
    broken = np.array(getattr(pushed.walk, name))
    broken[7].flat[0] = value
    with pytest.raises(LogError, match=f"sample 7 has a {name} that is not finite"):
        replace(pushed.walk, **{name: broken})
    beside = (Segment(0, 7), Segment(8, len(pushed.walk)))
    assert replace(pushed.walk, **{name: broken}, segments=beside).segments == beside


@pytest.mark.parametrize(
    "segments",
    [(Segment(0, 10**9),), (Segment(5, 5),), (Segment(-3, 5),), (Segment(0, 20), Segment(10, 30))],
)
def test_segments_lie_in_the_walk_and_do_not_overlap(segments: tuple[Segment, ...], pushed: Pushed) -> None:
    with pytest.raises(LogError, match="expected segments in order that do not overlap"):
        replace(pushed.walk, segments=segments)


@pytest.mark.parametrize("timestep_s", [0.0, -1e-3, np.nan, np.inf])
def test_a_sample_period_is_a_time(timestep_s: float, pushed: Pushed) -> None:
    with pytest.raises(LogError, match="expected a finite time above 0"):
        replace(pushed.walk, timestep_s=timestep_s)


def test_nothing_is_not_a_walk(pushed: Pushed) -> None:
    parts = ("stamps_ns", "qpos", "qvel", "effort", "wrench")
    with pytest.raises(LogError, match="there is no sample"):
        replace(pushed.walk, **{name: getattr(pushed.walk, name)[:0] for name in parts}, segments=())


def test_a_longer_walk_is_asked_for_only_where_the_log_is_too_short(pushed: Pushed) -> None:
    """Samples that would fill a window but for gaps are not too few."""
    cut = replace(pushed.walk, segments=(Segment(0, 150), Segment(200, 350)))
    with pytest.raises(LogError, match=r"1 gaps cut 0.3 s of samples .* mend what cuts the log") as error:
        cut.filled_windows(0.25)
    assert "longer" not in str(error.value)
    with pytest.raises(LogError, match="record a longer walk"):
        replace(pushed.walk, segments=(Segment(0, 150),)).filled_windows(0.25)


def test_a_part_of_a_walk_keeps_what_is_in_use(pushed: Pushed) -> None:
    walk = replace(pushed.walk, segments=(Segment(0, 100), Segment(120, 300), Segment(400, 500)))
    part = walk.between(110, 450)
    assert part.segments == (Segment(10, 190), Segment(290, 340))
    np.testing.assert_array_equal(part.qvel, walk.qvel[110:450])
    assert np.shares_memory(part.wrench, walk.wrench)
