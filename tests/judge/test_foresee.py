"""The verdict before the fit: standing, falling and walking logs get different and true answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.identify import IdentifyOptions
from massid.identify.prepare import prepare_logs
from massid.judge.motion import observe_motion
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.result import Status
from massid.result.combinations import open_combinations
from massid.result.disagreement import disagreement
from massid.result.verdict import Motion, Verdict
from massid.walk import Segment, Walk
from massid.walk.noise import PRESETS, Sensors
from massid.weighing import Weighing
from tests.conftest import Pushed
from tests.pushed_robot import LINKS, fly_about, make_robot, push_about
from tests.weighed import verdict_on, weigh_offline, weigh_online

LEGS = ("l_thigh", "r_thigh", "l_calf", "r_calf", "l_foot", "r_foot")


def _verdict(walk: Walk, robot: Robot, noise: str = "auto") -> Verdict:
    return verdict_on(walk, robot, mass_space(robot, LINKS), IdentifyOptions(noise=noise))  # type: ignore[arg-type]


def _measured(walk: Walk, preset: str) -> Walk:
    rng = np.random.default_rng(0)
    return Sensors(PRESETS[preset], walk.effort.shape[1], walk.contact_bodies, rng).measure(walk)  # type: ignore[index]


@pytest.fixture(scope="module")
def standing() -> Walk:
    robot = make_robot()
    space = mass_space(robot, LINKS)
    return push_about(robot, space, space.nominal, seconds=1.2, amplitude=0.0)


@pytest.mark.parametrize("preset", ["clean", "realistic"])
def test_a_standing_robot_reveals_its_weight_but_not_its_limbs(preset: str, standing: Walk) -> None:
    verdict = _verdict(_measured(standing, preset), make_robot(), preset)
    assert verdict.facts.motion is Motion.STANDING
    assert set(verdict.hidden) >= {"l_calf", "r_calf", "l_foot", "r_foot"}
    assert "torso" not in verdict.hidden
    together = verdict.sums[0]
    assert together.links == LINKS
    assert together.std_kg < 0.03 * together.nominal_kg
    assert any("walk" in line for line in verdict.advice)
    assert any("hip_roll" in line or "knee" in line for line in verdict.advice)


def test_a_robot_that_falls_stiffly_reveals_nothing() -> None:
    robot = make_robot()
    space = mass_space(robot, LINKS)
    walk = fly_about(robot, space, space.nominal, seconds=0.6, amplitude=0.0)
    verdict = _verdict(walk, robot)
    assert verdict.facts.motion is Motion.IN_THE_AIR
    assert verdict.hidden == LINKS
    assert not verdict.sums
    assert "free fall" in verdict.advice[0]


def test_a_robot_that_falls_with_swinging_legs_reveals_inertia_but_less_than_one_that_walks(pushed: Pushed) -> None:
    walk = fly_about(pushed.robot, pushed.space, pushed.truth, seconds=1.0, amplitude=0.08)
    falling, walking = _verdict(walk, pushed.robot), _verdict(pushed.walk, pushed.robot)
    assert falling.facts.motion is Motion.IN_THE_AIR
    assert walking.facts.motion is Motion.MOVING
    assert falling.total_std_kg > 2.0 * walking.total_std_kg
    assert falling.std[0] > 2.0 * walking.std[0]  # the torso


def test_a_walk_reveals_all(pushed: Pushed) -> None:
    verdict = _verdict(pushed.walk, pushed.robot)
    assert not verdict.hidden
    assert not verdict.advice
    assert verdict.lines()[0].startswith("moving on the ground")


def test_a_robot_on_a_gantry_is_told_to_log_it(pushed: Pushed) -> None:
    hanging = replace(pushed.walk, wrench=np.zeros_like(pushed.walk.wrench))
    verdict = _verdict(hanging, pushed.robot)
    assert verdict.facts.motion is Motion.HELD
    assert verdict.hidden == LINKS
    assert "gantry" in verdict.advice[0]


@pytest.mark.parametrize(("preset", "factor"), [("white", 1.3), ("realistic", 1.7)])
def test_what_is_foreseen_is_what_an_identification_reports(preset: str, factor: float, pushed: Pushed) -> None:
    """In 1.6 s of small motions instruments are weak, and say so; 24 sets of sensors scattered in between."""
    walk = _measured(pushed.walk, preset)
    options = IdentifyOptions(noise=preset, dwell_s=0.25, passes=8)  # type: ignore[arg-type]
    result = weigh_offline(walk, pushed.robot, pushed.space, options)
    assert result.uncertainty is not None
    ratio = verdict_on(walk, pushed.robot, pushed.space, options).std / result.uncertainty.std
    assert np.all((ratio > 1 / factor) & (ratio < 1.3)), ratio


def test_a_hidden_link_has_no_estimate(standing: Walk) -> None:
    robot = make_robot()
    space = mass_space(robot, LINKS)
    result = weigh_online(standing, robot, space, IdentifyOptions(dwell_s=0.25))
    result = result.judged(_verdict(standing, robot))
    assert result.status is Status.NOT_IDENTIFIABLE
    links = result.to_json()["links"]
    assert links["l_calf"]["estimate_kg"] is None
    assert links["l_calf"]["verdict"] == "not identifiable"
    assert links["torso"]["verdict"] == "identifiable"
    hidden = ~result.excitation.identifiable
    np.testing.assert_array_equal(result.reported[hidden], space.nominal[hidden])


def test_a_noisy_log_of_a_standing_robot_is_not_replayed_in_vain(standing: Walk) -> None:
    """The search ends when passes gain nothing, and what it says then holds the truth: here the model file's masses."""
    robot = make_robot()
    options = IdentifyOptions(noise="realistic", dwell_s=0.25, bank_size=16)
    result = weigh_offline(_measured(standing, "realistic"), robot, mass_space(robot, LINKS), options)
    assert len(result.windows) < 0.5 * options.passes
    assert result.status is Status.NOT_IDENTIFIABLE
    assert result.uncertainty is not None
    assert np.all(np.abs(result.estimate - result.space.nominal) < 3.0 * result.uncertainty.std)


def test_a_sum_is_stated_as_found_and_not_as_the_model_file_has_it(standing: Walk) -> None:
    robot = make_robot()
    space = mass_space(robot, LINKS)
    verdict = _verdict(standing, robot)
    foreseen = " ".join(verdict.lines())
    assert "known all the same: torso" in foreseen
    assert f"{verdict.sums[0].nominal_kg:.1f}" not in foreseen
    found = weigh_online(standing, robot, space, IdentifyOptions(dwell_s=0.25)).judged(verdict).verdict
    assert found is not None
    for one in found.sums:
        assert f"together, {one.estimate_kg:.2f} +-" in one.text


def test_windows_that_contradict_each_other_are_not_blamed_on_the_motion(pushed: Pushed) -> None:
    """What exploded intervals leave is neither stated nor said to be the motion's fault."""
    walk = _measured(pushed.walk, "white")
    options = IdentifyOptions(noise="white", dwell_s=0.25, passes=4)
    verdict = verdict_on(walk, pushed.robot, pushed.space, options)
    result = weigh_offline(walk, pushed.robot, pushed.space, options)
    assert result.uncertainty is not None
    assert result.judged(verdict).together is not None
    hidden = replace(result.excitation, identifiable=np.zeros(len(pushed.space), dtype=bool))
    weak = replace(result, excitation=hidden).judged(verdict)
    assert any("was foreseen to be known to" in line for line in weak.warnings)
    wide = replace(result.uncertainty, inflation=1e3)
    wrong = replace(result, uncertainty=wide, excitation=hidden).judged(verdict)
    assert wrong.unforeseen == LINKS
    assert wrong.together is None
    assert wrong.to_json()["together"] is None
    assert any("not the motion" in line for line in wrong.warnings)


def test_a_verdict_says_whose_noise_it_takes(pushed: Pushed) -> None:
    noisy = _measured(pushed.walk, "white")
    space = mass_space(pushed.robot, LINKS)
    said = {
        asked: verdict_on(walk, pushed.robot, space, IdentifyOptions(noise=asked)).sensors  # type: ignore[arg-type]
        for walk, asked in ((noisy, "auto"), (noisy, "clean"), (pushed.walk, "white"))
    }
    assert said["auto"] == "the log's own noise"
    assert said["clean"].endswith("as `noise=clean` was asked for")
    assert said["white"] == "`noise=white`"


def test_a_noisy_log_that_is_called_clean_is_contradicted(pushed: Pushed) -> None:
    noisy = _measured(pushed.walk, "realistic")
    (doubtful,) = prepare_logs([noisy], pushed.robot, pushed.space, IdentifyOptions(noise="clean"))
    assert "shows noise of" in doubtful.doubts[-1]
    (clean,) = prepare_logs([pushed.walk], pushed.robot, pushed.space, IdentifyOptions(noise="clean"))
    assert not clean.doubts


def test_a_search_that_a_short_log_ends_says_so(pushed: Pushed) -> None:
    short = replace(pushed.walk, segments=(Segment(0, 260),))
    result = weigh_online(short, pushed.robot, pushed.space, IdentifyOptions(dwell_s=0.25))
    assert result.status is not Status.CONVERGED
    said = replace(result, status=Status.NOT_CONVERGED).unsettled
    assert said is not None
    assert "kg in " in said
    assert "replay it (`mode=offline`)" in said
    in_vain = replace(result, status=Status.NOT_CONVERGED, replayed=True).unsettled
    assert in_vain is not None
    assert "mode=offline" not in in_vain  # that was tried
    assert "longer" not in said + in_vain  # the motion shows everything


@pytest.mark.parametrize(("too_wide", "remedy"), [(1.5, " s of the same motion would do"), (50.0, "would hardly help")])
def test_more_of_the_same_motion_is_advised_where_it_would_do(pushed: Pushed, too_wide: float, remedy: str) -> None:
    """Deviations fall as the root of the time: half as much again takes 2.25 times as long."""
    verdict = verdict_on(pushed.walk, pushed.robot, pushed.space)
    limit = dict(zip(LINKS, (0.25 * pushed.space.scale).tolist(), strict=True))
    std = {link: too_wide * kg for link, kg in limit.items()}
    (line,) = disagreement(verdict, ["l_calf"], std, contradicted=False, log_s=4.0)
    assert remedy in line
    if too_wide < 2.0:
        assert f"{4.0 * too_wide**2:.2g} s of" in line
    still = replace(verdict, facts=replace(verdict.facts, motion=Motion.STANDING))
    (line,) = disagreement(still, ["l_calf"], std, contradicted=False, log_s=4.0)
    assert line.endswith("more motion is needed.")


def test_no_motion_is_advised_for_a_log_that_was_misread(pushed: Pushed) -> None:
    """A robot that stands is told to walk, unless its torques have the wrong sign."""
    standing = push_about(pushed.robot, pushed.space, pushed.truth, seconds=0.8, amplitude=0.0)
    options = IdentifyOptions(dwell_s=0.2)
    sound = Weighing.prepare(standing, pushed.robot, LINKS, options=options)
    assert sound.foresee().advice
    turned = Weighing.prepare(replace(standing, effort=-standing.effort), pushed.robot, LINKS, options=options)
    assert turned.denied
    assert not turned.foresee().advice


def test_noise_does_not_make_a_standing_robot_move(standing: Walk) -> None:
    assert observe_motion(make_robot(), _measured(standing, "realistic")).motion is Motion.STANDING


def test_combinations_are_named_by_few_links() -> None:
    """Left and right trades of the same width: any rotation of them is an eigenvector, the sparse one is named."""
    trades = np.zeros((4, 2))
    trades[:2, 0] = trades[2:, 1] = np.array([1.0, -1.0]) / np.sqrt(2.0)
    mixed = trades @ np.array([[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]])
    covariance = mixed @ mixed.T + 1e-4 * np.eye(4)
    found = open_combinations(["a", "b", "c", "d"], covariance, limit=0.25)
    assert sorted(one.text for one in found) == ["a against b", "c against d"]
