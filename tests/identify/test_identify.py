from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massid.errors import BadInputError, LogError
from massid.identify import IdentifyOptions, OnlineIdentifier
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.result import Result, Status
from massid.result.excitation import assess_excitation
from massid.result.file import plain
from massid.score import Truth, score, with_score
from massid.search.guided import SearchOptions
from massid.walk import Segment, Walk
from tests.conftest import Pushed
from tests.pushed_robot import LINKS, draw_truth, fly_about, make_robot, push_about
from tests.weighed import weigh_offline, weigh_online

SHORT = IdentifyOptions(dwell_s=0.25)


@pytest.mark.parametrize("seed", range(3))
def test_online_finds_seven_masses_in_six_windows(seed: int) -> None:
    robot = make_robot()
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed, relative_error=0.25)
    walk = push_about(robot, space, truth, seconds=1.6, seed=seed)
    result = weigh_online(walk, robot, space, replace(SHORT, seed=seed))
    assert result.status is Status.CONVERGED
    assert np.linalg.norm(result.estimate - truth) < 1e-6  # kg, from 5.8 kg on noise-free data


def test_offline_finds_them_in_one_window_of_data(pushed: Pushed) -> None:
    result = weigh_offline(_cut(pushed.walk, 510), pushed.robot, pushed.space, replace(SHORT, dwell_s=0.5))
    assert result.status is Status.CONVERGED
    assert np.linalg.norm(result.estimate - pushed.truth) < 1e-6


@pytest.mark.parametrize("weigh", [weigh_online, weigh_offline])
def test_a_log_that_is_solved_to_its_own_floor_has_converged(weigh: Callable[..., Result], pushed: Pushed) -> None:
    """Torques off by a millionth, as an engine's tolerance leaves them: no step gets below what that does to masses."""
    rng = np.random.default_rng(0)
    walk = replace(pushed.walk, effort=pushed.walk.effort + 1e-4 * rng.normal(size=pushed.walk.effort.shape))
    result = weigh(walk, pushed.robot, pushed.space, SHORT)
    assert result.status is Status.CONVERGED
    error = np.linalg.norm(result.estimate - pushed.truth)
    assert 1e-6 < error < 0.01  # kg


def test_a_stream_goes_on_until_it_has_shown_every_link(pushed: Pushed) -> None:
    """A robot that falls stiffly is explained by any masses; the walk after it shows them."""
    falling = fly_about(pushed.robot, pushed.space, pushed.truth, seconds=0.6, amplitude=0.0)
    fell = weigh_online(falling, pushed.robot, pushed.space, SHORT)
    assert fell.status is Status.NOT_IDENTIFIABLE
    walked = weigh_online([falling, pushed.walk], pushed.robot, pushed.space, SHORT)
    assert walked.status is Status.CONVERGED
    assert len(walked.windows) > len(fell.windows)
    assert np.linalg.norm(walked.estimate - pushed.truth) < 1e-6


def test_the_papers_direction_gets_closer_in_every_few_windows(pushed: Pushed) -> None:
    options = replace(SHORT, search=SearchOptions(direction="gradient"))
    result = weigh_online(pushed.walk, pushed.robot, pushed.space, options)
    errors = [np.linalg.norm(window.estimate - pushed.truth) for window in result.windows]
    assert errors[-1] < np.linalg.norm(pushed.space.nominal - pushed.truth)
    assert result.status is Status.NOT_CONVERGED


def test_streaming_and_log_agree_and_threads_do_not_matter(pushed: Pushed) -> None:
    streamed = OnlineIdentifier(
        pushed.robot, pushed.space, pushed.walk.contact_bodies, pushed.walk.timestep_s, replace(SHORT, threads=1)
    )
    for sample in pushed.walk.samples():
        streamed.push(sample)
    from_log = weigh_online(pushed.walk, pushed.robot, pushed.space, replace(SHORT, threads=2))
    np.testing.assert_array_equal(streamed.estimate, from_log.estimate)


def test_no_window_crosses_a_gap(pushed: Pushed) -> None:
    """Samples 400..599 are lost: what is left gives the same masses, from windows on either side."""
    keep = np.r_[0:400, 600:1600]
    walk = replace(
        pushed.walk,
        stamps_ns=pushed.walk.stamps_ns[keep],
        qpos=pushed.walk.qpos[keep],
        qvel=pushed.walk.qvel[keep],
        effort=pushed.walk.effort[keep],
        wrench=pushed.walk.wrench[keep],
        segments=(Segment(0, 400), Segment(400, 1400)),
    )
    for identify in (weigh_online, weigh_offline):
        result = identify(walk, pushed.robot, pushed.space, SHORT)
        assert np.linalg.norm(result.estimate - pushed.truth) < 1e-6


def test_a_robot_at_rest_in_the_air_reveals_nothing() -> None:
    """Falling freely with locked joints, no link's mass acts on any joint."""
    robot = make_robot()
    space = mass_space(robot, LINKS)
    n = 600
    time = 0.001 * np.arange(n)
    qpos = np.zeros((n, robot.model.nq))
    qpos[:, 3] = 1.0
    qpos[:, 2] = 10.0 - 0.5 * 9.81 * time * (time + 0.001)
    qvel = np.zeros((n, robot.model.nv))
    qvel[:, 2] = -9.81 * time
    walk = Walk(
        root_body="torso",
        joint_names=robot.joint_names,
        contact_bodies=("l_foot", "r_foot"),
        stamps_ns=np.arange(n, dtype=np.int64) * 1_000_000,
        qpos=qpos,
        qvel=qvel,
        effort=np.zeros((n, len(robot.joint_names))),
        wrench=np.zeros((n, 2, 6)),
        timestep_s=0.001,
    )
    result = weigh_online(walk, robot, space, SHORT)
    assert result.status is Status.NOT_IDENTIFIABLE
    assert not result.excitation.identifiable.any()


def test_excitation_names_the_combination_that_cannot_be_told_apart(pushed: Pushed) -> None:
    space = mass_space(pushed.robot, ["l_thigh", "r_thigh", "torso"])
    only_the_sum = np.outer([1.0, 1.0, 0.0], [1.0, 1.0, 0.0]) + np.diag([0.0, 0.0, 1.0])
    excitation = assess_excitation(space, 1e3 * only_the_sum, 0.001)
    assert excitation.identifiable.tolist() == [False, False, True]


def test_a_log_shorter_than_a_window_is_refused(pushed: Pushed) -> None:
    for identify in (weigh_online, weigh_offline):
        with pytest.raises(LogError, match=r"do not fill one dwell window of 0\.25 s"):
            identify(_cut(pushed.walk, 200), pushed.robot, pushed.space, SHORT)


def test_too_many_unknowns_for_the_bank(pushed: Pushed) -> None:
    with pytest.raises(BadInputError, match="A bank of 7 models serves at most 6 unknowns"):
        weigh_online(pushed.walk, pushed.robot, pushed.space, replace(SHORT, bank_size=7))


@pytest.mark.parametrize("field", ["bank_size", "dwell_s", "bandwidth_rad_s"])
def test_options_must_be_positive(field: str) -> None:
    with pytest.raises(BadInputError, match=f"{field} is 0; it must be a finite number above 0"):
        IdentifyOptions(**{field: 0})  # type: ignore[arg-type]


def test_json_has_truth_only_when_scored(pushed: Pushed, tmp_path: Path) -> None:
    result = weigh_online(pushed.walk, pushed.robot, pushed.space, SHORT)
    assert "true_kg" not in json.dumps(result.to_json())
    truth = Truth(dict(zip(LINKS, pushed.truth.tolist(), strict=True)))
    scored = plain(with_score(result.document(), score(result, truth)))
    assert scored["l2_error_kg"] == scored["iterations"][-1]["l2_error_kg"] < 1e-6
    assert scored["l2_error_initial_kg"] == pytest.approx(np.linalg.norm(pushed.space.nominal - pushed.truth))
    expected = {"nominal_kg", "estimate_kg", "true_kg", "error_kg", "identifiable", "verdict"}
    assert set(scored["links"]["torso"]) == expected
    json.dumps(scored, allow_nan=False)


def test_a_truth_file_without_the_link_is_named(pushed: Pushed) -> None:
    result = weigh_online(pushed.walk, pushed.robot, pushed.space, SHORT)
    with pytest.raises(BadInputError, match="no link named 'torso'"):
        score(result, Truth({"pelvis": 1.0}, source="walk.truth.json"))


def test_identification_imports_neither_plant_nor_truth() -> None:
    code = (
        "import sys, massid.identify\n"
        "rooms = ('massid.plant', 'massid.score', 'massid.walking', 'dm_control')\n"
        "bad = [name for name in sys.modules if name.startswith(rooms)]\n"
        "sys.exit(', '.join(bad) or 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_identified_model_explains_the_log(pushed: Pushed, tmp_path: Path) -> None:
    result = weigh_online(pushed.walk, pushed.robot, pushed.space, SHORT)
    pushed.robot.write_model(pushed.space, result.estimate, tmp_path / "identified.xml")
    identified = Robot.load(tmp_path / "identified.xml")
    saved = [identified.nominal_mass_kg(link) for link in LINKS]
    np.testing.assert_allclose(saved, pushed.truth, rtol=1e-6)


def _cut(walk: Walk, n: int) -> Walk:
    return replace(
        walk,
        stamps_ns=walk.stamps_ns[:n],
        qpos=walk.qpos[:n],
        qvel=walk.qvel[:n],
        effort=walk.effort[:n],
        wrench=walk.wrench[:n],
        segments=(),
    )


@pytest.mark.parametrize("identify", [weigh_online, weigh_offline])
def test_links_that_were_not_named_but_are_wrong_are_told(identify, pushed: Pushed) -> None:
    some = mass_space(pushed.robot, LINKS[:-1])
    assert any(
        "Links that were not named" in line for line in identify(pushed.walk, pushed.robot, some, SHORT).warnings
    )
    assert not identify(pushed.walk, pushed.robot, pushed.space, SHORT).warnings


def test_a_search_that_is_still_far_off_accuses_no_link(pushed: Pushed) -> None:
    assert not weigh_online(_cut(pushed.walk, 260), pushed.robot, pushed.space, SHORT).warnings
