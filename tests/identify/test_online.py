"""A noisy stream: samples wait for those that follow them, and windows are believed as far as they are affine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.errors import BadInputError
from massid.identify import IdentifyOptions
from massid.identify.online import OnlineIdentifier
from massid.observer.bank import RobotBank
from massid.observer.replay import ReplayBlock
from massid.observer.sensors import NoisySensors
from massid.search.guided import SearchOptions
from massid.search.parameters import ParameterSpace
from massid.walk import Walk
from massid.walk.noise import PRESETS, Sensors
from tests.conftest import Pushed
from tests.pushed_robot import FEET, cut

NOISE = PRESETS["white"]
SENSORS = NoisySensors(NOISE)


def _measured(walk: Walk) -> Walk:
    return Sensors(NOISE, 8, FEET, np.random.default_rng(0)).measure(walk)


def _stream(walk: Walk, pushed: Pushed, space: ParameterSpace | None = None, bank_size: int = 24) -> OnlineIdentifier:
    """Windows of 0.1 s."""
    options = IdentifyOptions(dwell_s=0.1, other_links=0.0, bank_size=bank_size)
    return OnlineIdentifier(pushed.robot, space or pushed.space, FEET, walk.timestep_s, options, SENSORS)


def test_the_last_window_of_a_stream_is_used_although_nothing_follows_it(pushed: Pushed) -> None:
    walk = cut(_measured(pushed.walk), slice(500, 701))
    identifier = _stream(walk, pushed, bank_size=8)
    pushed_windows = [window for sample in walk.samples() for window in identifier.push(sample)]
    (last,) = identifier.finish()
    assert [window.index for window in pushed_windows] == [0]
    assert (last.index, last.time_s) == (1, pytest.approx(0.2))
    assert not identifier.finish()
    np.testing.assert_array_equal(identifier.estimate, last.estimate)


def test_samples_after_an_early_end_go_on_as_if_there_had_been_none(pushed: Pushed) -> None:
    walk = cut(_measured(pushed.walk), slice(500, 731))
    one, other = _stream(walk, pushed, bank_size=8), _stream(walk, pushed, bank_size=8)
    for k, sample in enumerate(walk.samples()):
        one.push(sample)
        other.push(sample)
        if k == 130:  # fewer than a block are waiting
            assert not other.finish()
    assert len(one.result().windows) == 2
    np.testing.assert_allclose(other.estimate, one.estimate, rtol=1e-12)


def test_every_window_is_handed_out_once_although_several_end_together(pushed: Pushed) -> None:
    """Windows of 8 ms: three wait for the 27 ms that bear upon them when a gap, or the end, closes them at once."""
    measured = _measured(pushed.walk)
    walk = cut(measured, slice(300, 341), slice(700, 733))
    options = IdentifyOptions(dwell_s=0.008, other_links=0.0, bank_size=8)
    identifier = OnlineIdentifier(pushed.robot, pushed.space, FEET, walk.timestep_s, options, SENSORS)
    counts, windows = [], []
    for sample in walk.samples():
        closed = identifier.push(sample)
        counts.append(len(closed))
        windows += closed
    windows += identifier.finish()
    assert max(counts) > 1
    assert [window.index for window in windows] == list(range(5 + 4))
    assert [window.index for window in identifier.result().windows] == list(range(5 + 4))


def test_a_rough_window_starts_the_next_anew_but_not_as_after_a_gap(
    pushed: Pushed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Models far away start again at the measurement; the samples before it are still its neighbours."""
    starts: list[bool] = []
    restart = RobotBank.restart

    def noticed(self: RobotBank, block: ReplayBlock, *, follows: bool = False) -> None:
        starts.append(follows)
        restart(self, block, follows=follows)

    monkeypatch.setattr(RobotBank, "restart", noticed)
    far = tuple(replace(p, nominal=1.6 * true) for p, true in zip(pushed.space.parameters, pushed.truth, strict=True))
    walk = cut(_measured(pushed.walk), slice(300, 501), slice(600, 731))
    identifier = _stream(walk, pushed, ParameterSpace(far), bank_size=12)
    for sample in walk.samples():
        identifier.push(sample)
    assert starts[:2] == [False, True]
    assert starts.count(False) == 2  # the start, and the gap


def test_a_gap_closes_the_window_before_it_and_does_not_reach_into_the_next(pushed: Pushed) -> None:
    measured = _measured(pushed.walk)
    walk = cut(measured, slice(300, 401), slice(700, 871))  # one window; one window and a rest
    identifier = _stream(walk, pushed, bank_size=8)
    closed = {k: window for k, sample in enumerate(walk.samples()) for window in identifier.push(sample)}
    assert min(closed) == 101  # the first sample behind the gap
    assert closed[101].time_s == pytest.approx(0.1)
    assert not identifier.finish()
    result = identifier.result()
    assert [window.index for window in result.windows] == [0, 1]
    assert result.windows[1].time_s == pytest.approx(0.5)
    assert np.abs((result.estimate - pushed.truth) / pushed.truth).max() < 0.2


def test_an_interrupted_window_teaches_nothing(pushed: Pushed) -> None:
    """What comes after a gap is identified as if the walk began there."""
    measured = _measured(pushed.walk)
    torn, whole = cut(measured, slice(300, 380), slice(700, 801)), cut(measured, slice(700, 801))
    estimates = []
    for walk in (torn, whole):
        identifier = _stream(walk, pushed, bank_size=8)
        for sample in walk.samples():
            identifier.push(sample)
        identifier.finish()
        assert len(identifier.result().windows) == 1
        estimates.append(identifier.estimate)
    np.testing.assert_allclose(estimates[0], estimates[1], rtol=1e-12)


def test_a_window_that_was_far_from_the_estimate_counts_little(pushed: Pushed) -> None:
    """The same window, seen by models at the true masses and by models that are far off.

    From afar it tells where to look next, but derivatives were those of another robot: deviations stay wide. Once the
    estimate is near, further windows make them as narrow as they are for who began there.
    """
    walk = cut(_measured(pushed.walk), slice(500, 1001))
    stds, errors = [], []
    for start in (pushed.truth, 1.6 * pushed.truth):
        given = zip(pushed.space.parameters, start.tolist(), strict=True)
        space = ParameterSpace(tuple(replace(parameter, nominal=nominal) for parameter, nominal in given))
        identifier = _stream(walk, pushed, space, bank_size=12)
        for sample in walk.samples():
            identifier.push(sample)
        identifier.finish()
        windows = identifier.result().windows
        stds.append([window.std for window in windows])
        errors.append([(window.estimate - pushed.truth) / window.std for window in windows])
    near, far = np.array(stds)
    assert len(near) == 5
    assert np.all(far[0] > 5.0 * near[0])
    assert np.all(far[-1] < 3.0 * near[-1])
    assert np.abs(errors).max() < 4.0


def test_a_direction_that_one_pass_cannot_follow_to_the_minimum_is_refused(pushed: Pushed) -> None:
    options = IdentifyOptions(search=SearchOptions(direction="gradient"))
    with pytest.raises(BadInputError, match=r"gradient .* gauss-newton, levenberg-marquardt, or offline"):
        OnlineIdentifier(pushed.robot, pushed.space, FEET, 1e-3, options, SENSORS)
