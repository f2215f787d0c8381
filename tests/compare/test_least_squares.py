from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.compare import fit_masses, scan_cutoffs, self_chosen
from massid.errors import BadInputError
from massid.model.unknowns.bodies import Mass
from massid.model.unknowns.lags import EffortLag, WrenchLag
from massid.model.unknowns.sensors import EffortGain, EffortOffset, EncoderOffset, WrenchGain, WrenchOffset
from massid.model.unknowns.spaces import mass_space
from massid.model.unknowns.unknown import nuisance
from massid.search.parameters import ParameterSpace
from massid.walk import Segment, Walk
from massid.walk.noise import PRESETS, SensorNoise, Sensors
from tests.conftest import Pushed
from tests.pushed_robot import FEET, LINKS, draw_truth, make_robot, push_about, stamped_late

SLOW = SensorNoise(effort_gain=0.02, effort_offset=0.4, wrench_gain=0.01, force_offset=4.0)


def _measured(walk: Walk, noise: SensorNoise, seed: int = 0) -> Walk:
    return Sensors(noise, len(walk.joint_names), walk.contact_bodies, np.random.default_rng(seed)).measure(walk)


def test_a_clean_log_is_solved_exactly(pushed: Pushed) -> None:
    fit = fit_masses(pushed.walk, pushed.robot, pushed.space, None)
    np.testing.assert_allclose(fit.estimate, pushed.truth, atol=1e-6)  # kg
    assert fit.held_out < 1e-9


def test_a_gap_costs_nothing_but_its_samples(pushed: Pushed) -> None:
    rows = np.r_[0:700, 900:1600]
    fields = {name: getattr(pushed.walk, name)[rows] for name in ("stamps_ns", "qpos", "qvel", "effort", "wrench")}
    gap = replace(pushed.walk, segments=(Segment(0, 700), Segment(700, 1400)), **fields)
    np.testing.assert_allclose(fit_masses(gap, pushed.robot, pushed.space, None).estimate, pushed.truth, atol=1e-6)


def test_friction_of_the_model_is_accounted_for() -> None:
    robot = make_robot(friction_loss=1.0)
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed=1)
    walk = push_about(robot, space, truth, seconds=0.5)
    errors = [np.abs(fit_masses(walk, model, space, None).estimate - truth).max() for model in (robot, make_robot())]
    assert errors[0] < 0.02 * errors[1]  # not zero: how soft the engine's friction is depends on the masses


def test_the_nominal_masses_do_not_matter(pushed: Pushed) -> None:
    """Without a prior the solution is that of a linear system, wherever it is linearised."""
    heavier = ParameterSpace(
        tuple(replace(p, nominal=1.3 * p.nominal) if isinstance(p, Mass) else p for p in pushed.space.parameters)
    )
    noisy = _measured(pushed.walk, PRESETS["white"])
    first, second = (fit_masses(noisy, pushed.robot, space, 10.0).estimate for space in (pushed.space, heavier))
    np.testing.assert_allclose(first, second, rtol=1e-6)


def test_offsets_and_gains_are_found_beside_the_masses(pushed: Pushed) -> None:
    joints, axes = pushed.robot.joint_names, [(foot, axis) for foot in FEET for axis in range(6)]
    slow = (
        *(EffortOffset(name, **nuisance(SLOW.effort_offset)) for name in joints),
        *(EffortGain(name, **nuisance(SLOW.effort_gain)) for name in joints),
        *(WrenchOffset(foot, axis, **nuisance(SLOW.force_offset)) for foot, axis in axes if axis < 3),
        *(WrenchGain(foot, axis, **nuisance(SLOW.wrench_gain)) for foot, axis in axes),
    )
    walk = _measured(pushed.walk, SLOW, seed=3)
    blind = fit_masses(walk, pushed.robot, pushed.space, None).estimate
    seeing = fit_masses(walk, pushed.robot, ParameterSpace((*pushed.space.parameters, *slow)), None)
    errors = [np.linalg.norm(found[: len(pushed.space)] - pushed.truth) for found in (blind, seeing.estimate)]
    # Products of gain and offset are left out, and the scale of all forces is known by its prior alone.
    assert errors[1] < 0.5 * errors[0]
    assert np.all(np.abs(seeing.estimate[7:]) < 6.0 * np.array([p.prior_std for p in slow]))


def test_an_offset_that_is_already_known_is_taken_off(pushed: Pushed) -> None:
    """As of a foot in the air; its prior is so narrow that the fit cannot find it once more."""
    wrench = pushed.walk.wrench.copy()
    wrench[:, 0, 2] += 4.0
    effort = pushed.walk.effort.copy()
    effort[:, 2] -= 0.5
    known = (
        WrenchOffset(FEET[0], 2, **nuisance(1e-4, 4.0)),
        EffortOffset(pushed.robot.joint_names[2], **nuisance(1e-4, -0.5)),
    )
    space = ParameterSpace((*pushed.space.parameters, *known))
    walk = replace(pushed.walk, effort=effort, wrench=wrench)
    np.testing.assert_allclose(fit_masses(walk, pushed.robot, space, None).estimate[:7], pushed.truth, rtol=1e-6)


def test_lags_are_found(pushed: Pushed) -> None:
    late = stamped_late(pushed.walk, 4e-4, 2e-4)
    lags = (EffortLag(**nuisance(5e-4)), WrenchLag(**nuisance(5e-4)))
    space = ParameterSpace((*pushed.space.parameters, *lags))
    found = fit_masses(late, pushed.robot, space, 20.0).estimate
    np.testing.assert_allclose(found[-2:], [4e-4, 2e-4], atol=2e-5)  # s


def test_an_encoder_offset_is_found(pushed: Pushed) -> None:
    column = pushed.robot.joint_names.index("l_knee")
    qpos = pushed.walk.qpos.copy()
    qpos[:, 7 + column] += 2e-3
    space = ParameterSpace((*pushed.space.parameters, EncoderOffset("l_knee", **nuisance(5e-3))))
    found = fit_masses(replace(pushed.walk, qpos=qpos), pushed.robot, space, None).estimate
    assert found[-1] == pytest.approx(2e-3, abs=1e-4)  # rad; quadratic terms are left out
    np.testing.assert_allclose(found[:-1], pushed.truth, rtol=2e-3)


def test_the_cutoff_matters_and_a_user_can_choose_a_fair_one(pushed: Pushed) -> None:
    noisy = _measured(pushed.walk, PRESETS["white"])
    fits = scan_cutoffs(noisy, pushed.robot, pushed.space, (0.05, 5.0, 10.0, 20.0, 100.0))
    assert [fit.cutoff_hz for fit in fits] == [5.0, 10.0, 20.0, 100.0]  # 1.6 s have no 20 s periods
    errors = [float(np.linalg.norm(fit.estimate - pushed.truth)) for fit in fits]
    chosen = errors[fits.index(self_chosen(fits))]
    assert chosen < 3.0 * min(errors)
    assert max(errors) > 3.0 * min(errors)


@pytest.mark.parametrize(
    ("cutoff_hz", "message"),
    [
        (0.0, "A cut-off of 0 Hz does not lie between 0 and 500 Hz"),
        (600.0, "A cut-off of 600 Hz does not lie between 0 and 500 Hz"),
        (0.1, "no segment is long enough for a cut-off of 0.1 Hz; choose a higher one"),
    ],
)
def test_impossible_cutoffs_are_refused(cutoff_hz: float, message: str, pushed: Pushed) -> None:
    with pytest.raises(BadInputError, match=message):
        fit_masses(pushed.walk, pushed.robot, pushed.space, cutoff_hz)


def test_one_instant_is_too_few_to_judge_a_cutoff(pushed: Pushed) -> None:
    short = replace(pushed.walk, segments=(Segment(0, 600),))  # at 3 Hz four instants, the last held out
    with pytest.raises(BadInputError, match="4 instants are too few for 7 unknowns; choose a higher cut-off"):
        fit_masses(short, pushed.robot, pushed.space, 3.0)
