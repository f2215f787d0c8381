"""Unknowns that the package does not know, handed in by a user, weighed from logs without and with noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from massid import IdentifyOptions, weigh
from massid.compare import fit_masses
from massid.errors import BadInputError
from massid.model.unknowns.spaces import parameter_space
from massid.model.unknowns.unknown import Unknown, nuisance
from massid.result import Status
from massid.result.quantities import describe
from massid.search.guided import enough_models
from massid.typing import FloatArray
from massid.walk import Walk
from massid.walk.noise import PRESETS, Sensors
from tests.conftest import Pushed
from tests.pushed_robot import LINKS, draw_truth, push_about
from tests.unknown_examples import COMMON_GAIN, TWIN_CALVES, YAW_BIAS, CommonGain

GAIN, BIAS, CALF_KG = 0.04, 0.03, 2.8
WITHOUT_CALVES = tuple(link for link in LINKS if not link.endswith("calf"))


def _torques_too_large(walk: Walk) -> Walk:
    return replace(walk, effort=(1.0 + GAIN) * walk.effort)


def _gyroscope_off(walk: Walk) -> Walk:
    qvel = walk.qvel.copy()
    qvel[:, 5] += BIAS
    return replace(walk, qvel=qvel)


def _as_it_is(walk: Walk) -> Walk:
    return walk


@pytest.fixture(scope="module")
def log(pushed: Pushed) -> tuple[Walk, FloatArray]:
    """A walk of a robot with calves that are alike, and its masses."""
    truth = draw_truth(pushed.space, seed=3)
    truth[[LINKS.index("l_calf"), LINKS.index("r_calf")]] = CALF_KG
    return push_about(pushed.robot, pushed.space, truth, seconds=1.2), truth


CASES = [
    (COMMON_GAIN, _torques_too_large, LINKS, GAIN),
    (YAW_BIAS, _gyroscope_off, LINKS, BIAS),
    (TWIN_CALVES, _as_it_is, WITHOUT_CALVES, CALF_KG),
]


@pytest.mark.parametrize(("unknown", "spoil", "links", "value"), CASES, ids=lambda case: getattr(case, "kind", ""))
def test_it_is_found_in_a_log_without_noise(
    unknown: Unknown,
    spoil: Callable[[Walk], Walk],
    links: tuple[str, ...],
    value: float,
    pushed: Pushed,
    log: tuple[Walk, FloatArray],
) -> None:
    walk, truth = log
    options = IdentifyOptions(dwell_s=0.2, noise="clean")
    result = weigh(spoil(walk), pushed.robot, links, unknowns=[unknown], options=options, mode="offline")
    assert result.status is Status.CONVERGED
    expected = [*(truth[LINKS.index(link)] for link in links), value]
    np.testing.assert_allclose(result.estimate, expected, atol=1e-6)  # kg, and the unit of the unknown
    assert [(one.name, one.unit) for one in result.quantities] == [(unknown.name, unknown.unit)]


@pytest.mark.parametrize(("unknown", "spoil", "links", "value"), CASES, ids=lambda case: getattr(case, "kind", ""))
def test_it_is_found_in_a_log_with_noise(
    unknown: Unknown,
    spoil: Callable[[Walk], Walk],
    links: tuple[str, ...],
    value: float,
    pushed: Pushed,
    log: tuple[Walk, FloatArray],
) -> None:
    walk, truth = log
    measured = spoil(Sensors(PRESETS["white"], 8, walk.contact_bodies, np.random.default_rng(1)).measure(walk))
    options = IdentifyOptions(dwell_s=0.2, noise="white", other_links=0.0, lag_s=0.0)
    result = weigh(measured, pushed.robot, links, unknowns=[unknown], options=options, held_out=0.0)
    assert result.uncertainty is not None
    expected = np.array([*(truth[LINKS.index(link)] for link in links), value])
    error = result.estimate - expected
    assert np.all(np.abs(error) < 4.0 * result.uncertainty.std)
    assert abs(error[-1]) < 0.1 * abs(value - unknown.nominal)
    assert result.quantities[-1].identifiable


def test_it_is_a_nuisance_beside_the_others(pushed: Pushed, log: tuple[Walk, FloatArray]) -> None:
    walk, truth = log
    measured = Sensors(PRESETS["white"], 8, walk.contact_bodies, np.random.default_rng(2)).measure(walk)
    measured = _torques_too_large(measured)
    gain = CommonGain(**nuisance(0.05))
    options = IdentifyOptions(dwell_s=0.2, noise="white", other_links=0.0, lag_s=0.0)
    result = weigh(measured, pushed.robot, LINKS, unknowns=[gain], options=options, held_out=0.0)
    found = result.uncertainty
    assert found is not None
    assert np.all(np.abs(result.estimate - truth) < 4.0 * found.std)
    names = [unknown.name for unknown in found.nuisances]
    assert names == ["shared_gain/all", *(f"inertia_scale/{link}" for link in LINKS)]
    assert found.nuisance_estimate[0] == pytest.approx(GAIN, abs=min(4.0 * found.nuisance_std[0], 0.2 * GAIN))
    entry = result.to_json()["uncertainty"]["nuisances"]["shared_gain/all"]
    assert (entry["title"], entry["label"], entry.get("log")) == (CommonGain.title, "all", None)


def test_what_follows_from_it_is_reported(pushed: Pushed) -> None:
    """Moments of inertia belong to the mass that the body has, whoever gave it."""
    space = parameter_space(pushed.robot, ["torso"], [TWIN_CALVES, "inertia/l_calf"])
    point = space.nominal * np.where(np.array(space.names) == TWIN_CALVES.name, 2.0, 1.0)
    found = describe(pushed.robot, space, point, None, np.ones(len(space), dtype=np.bool_))
    moments = [one for one in found if one.name.startswith("inertia/")]
    np.testing.assert_allclose([one.estimate for one in moments], [2.0 * one.nominal for one in moments])


def test_least_squares_have_a_row_of_it(pushed: Pushed, log: tuple[Walk, FloatArray]) -> None:
    walk, truth = log
    space = parameter_space(pushed.robot, LINKS, [COMMON_GAIN])
    fit = fit_masses(_torques_too_large(walk), pushed.robot, space, None)
    # To first order in the gain, which is found as GAIN / (1 + GAIN).
    np.testing.assert_allclose(fit.estimate, [*truth, GAIN / (1.0 + GAIN)], rtol=1e-6)


def test_several_walks_have_errors_of_their_own(pushed: Pushed, log: tuple[Walk, FloatArray]) -> None:
    walk, _ = log
    options = IdentifyOptions(noise="clean", bank_size=enough_models(8))
    with pytest.raises(BadInputError, match="shared_gain/all: a sensor's error is another one in every walk"):
        weigh([walk, _torques_too_large(walk)], pushed.robot, LINKS, unknowns=[COMMON_GAIN], options=options)
    measured = Sensors(PRESETS["white"], 8, walk.contact_bodies, np.random.default_rng(2)).measure(walk)
    pair = [_torques_too_large(measured), measured]
    options = IdentifyOptions(dwell_s=0.2, noise="white", other_links=0.0, link_inertia=0.0, lag_s=0.0)
    gain = CommonGain(**nuisance(0.05))
    found = weigh(pair, pushed.robot, LINKS, unknowns=[gain], options=options, held_out=0.0, mode="offline").uncertainty
    assert found is not None
    assert [unknown.name for unknown in found.nuisances] == ["shared_gain/all@1", "shared_gain/all@2"]
    np.testing.assert_allclose(found.nuisance_estimate, [GAIN, 0.0], atol=0.01)
