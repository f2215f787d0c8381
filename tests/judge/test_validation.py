"""Checks of a result against its own log: held-out torques, the weight, and what they say about a wrong result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.identify import IdentifyOptions
from massid.identify.prepare import prepare_logs
from massid.judge.residuals import channel_residuals
from massid.judge.validation import hold_out, validate
from massid.model.unknowns.sensors import WrenchOffset
from massid.model.unknowns.unknown import nuisance
from massid.result import Result
from massid.result.result import Uncertainty
from massid.walk import Segment
from massid.walk.noise import PRESETS, Sensors
from tests.conftest import Pushed
from tests.weighed import weigh_online

SHORT = IdentifyOptions(dwell_s=0.25)
HELD = 0.65


@pytest.fixture(scope="module")
def found(pushed: Pushed) -> Result:
    return weigh_online(hold_out(pushed.walk, HELD).fitted, pushed.robot, pushed.space, SHORT)


def test_what_is_held_out_is_the_end_of_the_log(pushed: Pushed) -> None:
    walk = replace(pushed.walk, segments=(Segment(0, 300), Segment(350, 1600)))
    split = hold_out(walk, HELD)
    assert split.held is not None
    assert split.fitted.segments == (Segment(0, 300), Segment(350, 592))
    assert split.held.segments == (Segment(592, 1600),)
    assert hold_out(walk, 0.2).held is None  # 0.3 s would say nothing


def test_true_masses_predict_held_out_torques_and_carry_the_weight(pushed: Pushed, found: Result) -> None:
    validation = validate(found, [pushed.walk], [hold_out(pushed.walk, HELD).held], pushed.robot)
    assert validation.torques is not None
    before, after = validation.torques.rms
    assert after < 1e-6 * before
    assert validation.weight is not None
    assert validation.weight.carried_kg == pytest.approx(pushed.truth.sum(), rel=1e-3)
    assert not validation.warnings()
    assert found.checked(validation).to_json()["validation"]["weight"]["agrees"]


def test_hidden_links_do_not_upset_the_weight(pushed: Pushed, found: Result) -> None:
    hidden = replace(found.excitation, identifiable=np.arange(len(pushed.space)) > 2)
    weight = validate(replace(found, excitation=hidden), [pushed.walk], [None], pushed.robot).weight
    assert weight is not None
    assert weight.agrees


def test_a_scale_that_reads_too_much_is_noticed(pushed: Pushed, found: Result) -> None:
    walk = replace(pushed.walk, wrench=1.02 * pushed.walk.wrench)
    (warning,) = validate(found, [walk], [None], pushed.robot).warnings()
    assert "the ground carried" in warning


def test_masses_that_predict_worse_than_the_model_file_are_not_recommended(pushed: Pushed, found: Result) -> None:
    wrong = replace(found, estimate=2.0 * pushed.space.nominal - pushed.truth)
    validation = validate(wrong, [pushed.walk], [hold_out(pushed.walk, HELD).held], pushed.robot)
    assert any("do not use them" in warning for warning in validation.warnings())


def test_noise_of_the_sensors_is_in_the_error_of_the_weight(pushed: Pushed) -> None:
    rng = np.random.default_rng(0)
    walk = Sensors(PRESETS["realistic"], 8, pushed.walk.contact_bodies, rng).measure(pushed.walk)
    options = replace(SHORT, noise="realistic")
    result = weigh_online(walk, pushed.robot, pushed.space, options)
    weight = validate(result, [walk], [None], pushed.robot).weight
    assert weight is not None
    assert 0.3 < weight.carried_std_kg < 1.5  # two feet with offsets of 4 N, and 1 % of the load
    assert abs(weight.carried_kg - pushed.truth.sum()) < 3.0 * weight.carried_std_kg
    (log,) = prepare_logs([walk], pushed.robot, pushed.space, options)
    residuals = channel_residuals(result, log, pushed.robot)
    assert residuals is not None
    assert np.median(residuals.identified) == pytest.approx(1.0, abs=0.1)
    assert residuals.nominal.sum() > residuals.identified.sum()


def test_a_force_offset_seen_in_the_air_upsets_neither_weight_nor_torques(pushed: Pushed, found: Result) -> None:
    offset_n = 20.0
    wrench = pushed.walk.wrench.copy()
    wrench[:, 0, 2] += offset_n
    walk = replace(pushed.walk, wrench=wrench)
    seen = WrenchOffset(walk.contact_bodies[0], 2, **nuisance(0.1, offset_n))
    uncertainty = Uncertainty(
        PRESETS["realistic"], np.eye(7), 1.0, 1.0, 0.1, (seen,), np.array([offset_n]), np.array([0.1])
    )
    held = hold_out(walk, HELD).held
    validation = validate(replace(found, uncertainty=uncertainty), [walk], [held], pushed.robot)
    assert validation.weight is not None
    assert validation.torques is not None
    assert validation.weight.carried_kg == pytest.approx(pushed.truth.sum(), rel=0.01)
    assert validation.torques.rms[1] < 0.4 * validation.torques.rms[0]


@pytest.mark.parametrize("preset", ["white", "realistic", "harsh"])
def test_true_masses_beat_the_model_file_under_any_noise(preset: str, pushed: Pushed, found: Result) -> None:
    sensors = Sensors(PRESETS[preset], 8, pushed.walk.contact_bodies, np.random.default_rng(3))  # type: ignore[index]
    torques = validate(found, [pushed.walk], [sensors.measure(pushed.walk)], pushed.robot).torques
    assert torques is not None
    before, after = torques.rms
    assert after < before
