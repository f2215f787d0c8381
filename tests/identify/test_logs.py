"""Several logs of one robot in one identification."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from massid.errors import BadInputError
from massid.identify import IdentifyOptions
from massid.identify.logs import hand_over, join_spaces
from massid.identify.prepare import prepare_logs
from massid.model.unknowns.unknown import unknowns_of
from massid.result import Status
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.walk import Segment, Walk
from massid.walk.noise import PRESETS, Sensors
from tests.conftest import Pushed
from tests.pushed_robot import FEET
from tests.weighed import weigh_offline, weigh_online

CLEAN = IdentifyOptions(dwell_s=0.1, noise="clean")
NOISY = IdentifyOptions(dwell_s=0.1, noise="realistic", passes=4)


def _part(walk: Walk, start: int, stop: int, source: str) -> Walk:
    return replace(walk.between(start, stop), source=source)


def _measured(walk: Walk, seed: int) -> Walk:
    return Sensors(PRESETS["realistic"], walk.effort.shape[1], FEET, np.random.default_rng(seed)).measure(walk)


@pytest.mark.parametrize("identify", [weigh_online, weigh_offline])
def test_two_clean_halves_equal_the_whole_with_a_gap_at_the_border(identify, pushed: Pushed) -> None:
    # A border is a gap and nothing else: no parameter of a log without noise belongs to one of its walks.
    options = replace(CLEAN, search=replace(CLEAN.search, step_tolerance=0.0), passes=3)
    halves = [_part(pushed.walk, 0, 350, "a"), _part(pushed.walk, 350, 700, "b")]
    cut = replace(_part(pushed.walk, 0, 700, "whole"), segments=(Segment(0, 350), Segment(350, 700)))
    apart = identify(halves, pushed.robot, pushed.space, options)
    stamps_ns = np.where(np.arange(700) < 350, cut.stamps_ns, cut.stamps_ns + 10**9)
    whole = identify(replace(cut, stamps_ns=stamps_ns), pushed.robot, pushed.space, options)
    assert apart.sources == ("a", "b")
    assert len(apart.windows) == len(whole.windows)
    assert_allclose(apart.estimate, whole.estimate, rtol=1e-9)
    assert_allclose(apart.windows[0].estimate, whole.windows[0].estimate, rtol=1e-12)


def test_logs_that_reveal_too_little_alone_are_enough_together(pushed: Pushed) -> None:
    options = replace(CLEAN, dwell_s=0.02, passes=5)
    short = [_part(pushed.walk, start, start + 25, str(start)) for start in (300, 700)]
    alone = [weigh_offline(walk, pushed.robot, pushed.space, options) for walk in short]
    both = weigh_offline(short, pushed.robot, pushed.space, options)
    assert all(result.status is Status.NOT_IDENTIFIABLE for result in alone)
    assert both.status is Status.CONVERGED
    assert_allclose(both.estimate, pushed.truth, atol=1e-6)


def test_sensor_errors_are_estimated_for_each_log(pushed: Pushed) -> None:
    logs = prepare_logs(
        [_part(_measured(pushed.walk, seed), 0, 400, str(seed)) for seed in (1, 2)], pushed.robot, pushed.space, NOISY
    )
    joint = join_spaces(logs)
    numbers = [unknown.log for unknown in unknowns_of(joint.space) if unknown.per_walk]
    per_log = sum(unknown.per_walk for unknown in unknowns_of(logs[0].space))
    assert numbers == [1] * per_log + [2] * per_log
    for number, (log, columns) in enumerate(zip(logs, joint.columns, strict=True), start=1):
        own = [unknown.name + (f"@{number}" if unknown.per_walk else "") for unknown in unknowns_of(log.space)]
        assert [joint.space.names[k] for k in columns] == own
        assert_allclose(joint.space.nominal[columns], log.space.nominal)


def test_a_handed_over_belief_keeps_the_masses_marginal_and_forgets_the_sensors(pushed: Pushed) -> None:
    walk = _measured(pushed.walk, 1)
    space = prepare_logs([walk], pushed.robot, pushed.space, NOISY)[0].space
    rng = np.random.default_rng(0)
    jacobian = rng.normal(size=(2 * len(space), len(space))) / space.scale
    learnt = LocalQuadratic(space.nominal, 1.0, rng.normal(size=len(space)), 2 * jacobian.T @ jacobian, 0.0, 0.0, 9)
    belief = LocalQuadratic.belief(space.nominal, space.prior_precision) + learnt
    smaller = ParameterSpace(tuple(p for p in space.parameters if not p.target.startswith("l_foot/")))
    after = hand_over(belief, space, smaller)
    kept = np.array([not p.per_walk for p in unknowns_of(space)])
    still = np.array([not p.per_walk for p in unknowns_of(smaller)])
    covariance, covariance_after = np.linalg.inv(belief.curvature / 2), np.linalg.inv(after.curvature / 2)
    assert_allclose(covariance_after[np.ix_(still, still)], covariance[np.ix_(kept, kept)], rtol=1e-6, atol=1e-12)
    best = belief.centre - np.linalg.solve(belief.curvature, belief.gradient)
    best_after = after.centre - np.linalg.solve(after.curvature, after.gradient)
    assert_allclose(best_after[still], best[kept], rtol=1e-9)
    assert_allclose(np.diagonal(covariance_after)[~still], 1 / smaller.prior_precision[~still], rtol=1e-6)
    assert_allclose(best_after[~still], 0.0, atol=1e-9)


def test_online_belief_about_masses_survives_the_border(pushed: Pushed) -> None:
    walks = [_part(_measured(pushed.walk, seed), 0, 800, str(seed)) for seed in (1, 2)]
    first = weigh_online(walks[0], pushed.robot, pushed.space, NOISY)
    both = weigh_online(walks, pushed.robot, pushed.space, NOISY)
    assert [window.index for window in both.windows] == list(range(len(both.windows)))
    assert np.all(both.windows[len(first.windows)].std < first.windows[-1].std)


def test_clean_and_noisy_logs_do_not_mix(pushed: Pushed) -> None:
    walks = [pushed.walk, _measured(pushed.walk, 1)]
    with pytest.raises(BadInputError, match="one at a time"):
        weigh_online(walks, pushed.robot, pushed.space, replace(NOISY, noise="auto"))
    with pytest.raises(BadInputError, match="at least one"):
        weigh_online([], pushed.robot, pushed.space, NOISY)


def test_sample_periods_and_contact_bodies_may_differ(pushed: Pushed) -> None:
    whole = _part(pushed.walk, 0, 500, "both feet")
    later = _part(pushed.walk, 500, 1000, "other order")
    air = np.zeros((500, 1, 6))
    turned = replace(
        later,
        contact_bodies=(*reversed(pushed.walk.contact_bodies), "torso"),
        wrench=np.concatenate([later.wrench[:, ::-1], air], axis=1),
    )
    result = weigh_offline([whole, turned], pushed.robot, pushed.space, replace(CLEAN, passes=6))
    assert_allclose(result.estimate, pushed.truth, atol=1e-6)
