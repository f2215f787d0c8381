"""The trunk as one call: what the command line gets, whoever calls gets."""

from __future__ import annotations

import pickle
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

import massid
from massid.errors import BadInputError, LogError, ModelError, StoppedError
from massid.identify import IdentifyOptions
from massid.result import Status
from massid.result.verdict import Verdict
from massid.walk import Walk
from massid.walk.noise import PRESETS, Sensors
from massid.weighing import Weighing
from tests.conftest import Pushed
from tests.pushed_robot import FEET, LINKS, XML

SHORT = IdentifyOptions(dwell_s=0.25)


def test_one_call_reads_judges_weighs_and_checks(pushed: Pushed, tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text(XML)
    log = massid.write_walk(pushed.walk, tmp_path / "walk.mcap")
    told: list[Weighing | str | Verdict] = []
    fractions: list[float] = []
    result = massid.weigh(
        log,
        tmp_path / "robot.xml",
        LINKS,
        options=SHORT,
        progress=lambda fraction, _: fractions.append(fraction),
        tell=told.append,
    )
    assert result.status is Status.CONVERGED
    assert np.linalg.norm(result.estimate - pushed.truth) < 1e-6
    assert result.verdict is not None
    assert result.validation is not None
    assert isinstance(told[0], Weighing)
    assert [type(one) for one in told[1:]] == [Verdict]  # nothing to warn of
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0.0, 1.0)
    result.save_model(tmp_path / "weighed.xml")
    weighed = massid.Robot.load(tmp_path / "weighed.xml")
    np.testing.assert_allclose([weighed.nominal_mass_kg(link) for link in LINKS], pushed.truth, rtol=1e-4)


def test_a_file_and_the_walk_in_it_give_the_same_masses(pushed: Pushed, tmp_path: Path) -> None:
    log = massid.write_walk(pushed.walk, tmp_path / "walk.mcap")
    one, other = (massid.weigh(each, pushed.robot, LINKS, options=SHORT) for each in (log, pushed.walk))
    np.testing.assert_allclose(one.estimate, other.estimate, atol=1e-12)  # the file has the base's twist in its body


def test_noise_decides_how_windows_are_seen_unless_the_caller_does(pushed: Pushed) -> None:
    noisy = Sensors(PRESETS["white"], 8, FEET, np.random.default_rng(0)).measure(pushed.walk)
    for walk, mode, offline in (
        (pushed.walk, "auto", False),
        (noisy, "auto", True),
        (noisy, "online", False),
        (pushed.walk, "offline", True),
    ):
        job = Weighing.prepare(walk, pushed.robot, LINKS, mode=mode, options=SHORT)  # type: ignore[arg-type]
        assert job.is_offline is offline


def _stretch(walk: Walk, first: int, windows: int) -> Walk:
    """So many dwell windows of `SHORT`, from a sample on."""
    names = ("stamps_ns", "qpos", "qvel", "effort", "wrench")
    rows = slice(first, first + 250 * windows + 1)
    return replace(walk, segments=(), **{name: getattr(walk, name)[rows] for name in names})


def test_a_clean_log_that_ends_before_one_pass_has_settled_is_replayed(pushed: Pushed) -> None:
    short = _stretch(pushed.walk, 600, windows=2)
    fractions: list[float] = []
    once = massid.weigh(short, pushed.robot, LINKS, options=SHORT, mode="online")
    again = massid.weigh(
        short, pushed.robot, LINKS, options=SHORT, progress=lambda fraction, _: fractions.append(fraction)
    )
    assert (once.status, once.mode) == (Status.NOT_CONVERGED, "online")
    assert (again.status, again.mode) == (Status.CONVERGED, "offline")
    assert np.linalg.norm(again.estimate - pushed.truth) < 1e-9
    assert fractions == sorted(fractions)


def test_a_log_that_ends_as_steps_have_become_tiny_has_been_solved(pushed: Pushed) -> None:
    """Whether or not there is one more window that shows a step below the tolerance."""
    result = massid.weigh(_stretch(pushed.walk, 600, 3), pushed.robot, LINKS, options=SHORT, mode="online")
    assert 1e-8 < np.max(np.abs(result.windows[-1].newton_step) / pushed.truth) < 1e-5
    assert np.linalg.norm(result.estimate - pushed.truth) < 1e-9
    assert result.status is Status.CONVERGED


@pytest.mark.parametrize("mode", ["online", "offline"])
def test_a_search_that_is_stopped_keeps_what_it_has_found(mode: str, pushed: Pushed) -> None:
    calls = count(1)
    after = 1 if mode == "online" else 9  # windows: one online; offline the second pass over six of them
    result = massid.weigh(
        pushed.walk,
        pushed.robot,
        LINKS,
        mode=mode,  # type: ignore[arg-type]
        held_out=0.0,
        checks=False,
        options=SHORT,
        stop=lambda: next(calls) >= after,
    )
    assert result.stopped
    assert result.status is not Status.CONVERGED
    assert result.to_json()["stopped"] is True
    assert result.unsettled is not None
    assert "stopped before" in result.unsettled
    assert len(result.windows) == 1
    assert np.linalg.norm(result.estimate - pushed.truth) < np.linalg.norm(pushed.space.nominal - pushed.truth)


def test_a_search_that_is_stopped_at_once_has_found_nothing(pushed: Pushed) -> None:
    with pytest.raises(StoppedError, match="nothing was found yet"):
        massid.weigh(pushed.walk, pushed.robot, LINKS, mode="offline", checks=False, options=SHORT, stop=lambda: True)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"links": ["torso", "l_tigh"]}, ModelError, "no link named 'l_tigh'. Did you mean l_thigh"),
        ({"links": LINKS, "unknowns": ["spring/l_knee"]}, BadInputError, "Unknown 'spring/l_knee': expected"),
        ({"links": LINKS, "held_out": 1.0}, BadInputError, "`held_out` is 1.0"),
        ({"links": LINKS, "options": IdentifyOptions(dwell_s=10.0)}, LogError, "use a shorter `dwell_s`"),
        ({"links": LINKS, "options": IdentifyOptions(bank_size=5)}, BadInputError, "serves at most 4 unknowns"),
        ({"links": LINKS, "mode": "offlin"}, BadInputError, "`mode` is 'offlin'; expected one of auto, online"),
        ({"links": LINKS, "options": {"passes": 3}}, BadInputError, "options is a dict; expected IdentifyOptions"),
        ({"robot": "no_such_robot"}, ModelError, "no robot named 'no_such_robot'"),
    ],
)
def test_what_cannot_be_done_is_said_before_the_work(
    arguments: dict[str, object], error: type[Exception], message: str, pushed: Pushed
) -> None:
    with pytest.raises(error, match=message):
        massid.weigh(pushed.walk, **{"robot": pushed.robot} | arguments)  # type: ignore[arg-type]


def test_one_link_may_be_asked_for_by_its_name_alone(pushed: Pushed) -> None:
    job = Weighing.prepare(pushed.walk, pushed.robot, "torso", options=SHORT)
    assert job.asked == Weighing.prepare(pushed.walk, pushed.robot, ["torso"], options=SHORT).asked


def test_one_log_does_not_count_twice(pushed: Pushed) -> None:
    with pytest.raises(BadInputError, match="are one log: its information would count twice"):
        massid.weigh([pushed.walk, replace(pushed.walk, source="copy")], pushed.robot, LINKS, options=SHORT)


def test_a_result_comes_back_from_another_process_without_the_logs(pushed: Pushed) -> None:
    result = massid.weigh(pushed.walk, pushed.robot, LINKS, checks=False, options=SHORT)
    back = pickle.loads(pickle.dumps(result))
    assert back.evidence is None
    assert back.table() == result.table()


def test_a_stream_is_weighed_like_its_log_and_a_broken_sample_counts_as_lost(pushed: Pushed) -> None:
    job = Weighing.prepare(pushed.walk, pushed.robot, LINKS, mode="online", options=SHORT)
    identifier = job.identifier()
    for k, sample in enumerate(pushed.walk.samples()):
        identifier.push(replace(sample, effort=np.full_like(sample.effort, np.nan)) if k == 300 else sample)
    np.testing.assert_allclose(identifier.estimate[: len(LINKS)], pushed.truth, atol=1e-6)


def test_no_log_is_refused() -> None:
    with pytest.raises(BadInputError, match="No log given"):
        massid.weigh([], "atlas")


def test_a_log_of_an_unknown_model_asks_for_it(pushed: Pushed) -> None:
    with pytest.raises(LogError, match="name the robot's `model`"):
        massid.weigh(pushed.walk)


def test_the_face_has_all_that_it_promises() -> None:
    assert all(getattr(massid, name) is not None for name in massid.__all__)
    assert set(massid.__all__) == set(dir(massid))
    with pytest.raises(AttributeError, match="no attribute 'weight'"):
        _ = massid.weight
