"""massid inspect and repair, and topic maps of massid identify, as a user calls them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from massid.assets import sample_walk
from massid.cli import CONTRADICTED, NOT_IDENTIFIABLE, main
from massid.cli.inspect import _lag
from massid.log import WalkWriter, read_walk, write_walk
from massid.model.robot import Robot
from tests.conftest import Pushed
from tests.pushed_robot import LINKS

ARRAYS = ("stamps_ns", "qpos", "qvel", "effort", "wrench")


@pytest.fixture
def log(pushed: Pushed, tmp_path: Path) -> Path:
    """The small biped's log and model beside each other."""
    walk, path = pushed.walk, tmp_path / "walk.mcap"
    pushed.robot.write_model(pushed.space, pushed.space.nominal, tmp_path / "robot.xml")
    names = {"root_body": walk.root_body, "joint_names": walk.joint_names, "contact_bodies": walk.contact_bodies}
    with WalkWriter(path, timestep_s=1e-3, **names) as writer:
        wrenches = {body: walk.wrench[:, c] for c, body in enumerate(walk.contact_bodies)}
        writer.append_block(walk.stamps_ns, walk.qpos, walk.qvel, walk.effort, wrenches)
    return path


def test_inspect_tells_topics_physics_and_verdict(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["inspect", str(log), "--model", str(tmp_path / "robot.xml"), "--html", str(tmp_path / "page.html")]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    for words in ("/joint_states", "1600 samples at 1000 Hz", "the ground carries", "lag against the state", "torso"):
        assert words in said
    page = (tmp_path / "page.html").read_text()
    assert page.count("<svg") == 4
    assert "the ground carries" in page


def test_inspect_refuses_an_unknown_link_before_it_prints(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect", str(log), "--model", str(tmp_path / "robot.xml"), "--links", "nose"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "has no link named 'nose'" in said.err


def test_inspect_calls_nothing_measured_that_is_not(log: Path, tmp_path: Path) -> None:
    walk = read_walk(log)
    assert _lag(0.0012, walk) == "+1.20 ms"
    assert _lag(-0.02458, walk) == "not measurable"


def test_inspect_gathers_several_logs_for_a_program(log: Path, tmp_path: Path) -> None:
    walk, logs = read_walk(log), [str(tmp_path / "first.mcap"), str(tmp_path / "second.mcap")]
    for k, path in enumerate(logs):
        write_walk(
            replace(walk, **{name: getattr(walk, name)[700 * k : 700 * k + 700] for name in ARRAYS}, segments=()), path
        )
    arguments = [
        *logs,
        "--model",
        str(tmp_path / "robot.xml"),
        "--links",
        "torso",
        "--json",
        str(tmp_path / "found.json"),
    ]
    code = main(["inspect", *arguments])
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["exit_code"] == code == 0
    assert [one["walk"]["samples"] for one in found["logs"]] == [700, 700]
    assert {topic["topic"] for topic in found["logs"][1]["topics"]} >= {"/odom", "/joint_states"}
    assert all(link["identifiable"] for link in found["links"])
    assert found["doubts"] == []


def test_a_log_that_contradicts_how_it_is_read_is_not_called_identifiable(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    turned = tmp_path / "turned.yaml"
    turned.write_text("preset: massid\njoints: {effort: {field: effort, scale: -1}}\n")
    arguments = [str(log), "--model", str(tmp_path / "robot.xml"), "--topics", str(turned)]
    assert main(["inspect", *arguments]) == CONTRADICTED
    said = capsys.readouterr().out
    assert "identifiable" not in said
    assert "no mass found from this log means anything before these are settled" in said
    assert "(effort: scale: -1)" in " ".join(said.split())
    assert main(["identify", *arguments, "--dwell-s", "0.1"]) == CONTRADICTED
    assert "verdict, if what the warnings say were settled:" in capsys.readouterr().out


def test_inspect_ends_as_identify_would(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    walk = read_walk(log)
    short = tmp_path / "short.mcap"
    write_walk(replace(walk, **{name: getattr(walk, name)[:300] for name in ARRAYS}, segments=()), short)
    arguments = [str(short), "--model", str(tmp_path / "robot.xml")]
    assert main(["inspect", *arguments]) == main(["identify", *arguments]) == 2
    assert "do not fill one dwell window" in capsys.readouterr().err
    assert main(["inspect", str(log), "--links", "torso"]) == 2
    assert "--links are those of a robot: name it (--model)" in capsys.readouterr().err


def test_inspect_judges_the_links_that_identify_weighs_and_shows_the_others_below(
    pushed: Pushed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A hand that hardly weighs anything is not identifiable, but nobody asked for it."""
    robot, log = tmp_path / "robot.xml", tmp_path / "walk.mcap"
    spec = pushed.robot.spec.copy()
    hand = spec.body("torso").add_body(name="hand", pos=[0.0, 0.3, 0.0])
    hand.add_joint(name="wrist", type=mujoco.mjtJoint.mjJNT_HINGE)
    hand.add_geom(size=[0.01, 0.01, 0.01], mass=1e-3, contype=0, conaffinity=0)
    spec.compile()
    robot.write_text(spec.to_xml())
    held = np.zeros((len(pushed.walk), 1))
    walk = pushed.walk
    walk = replace(
        walk,
        joint_names=(*walk.joint_names, "wrist"),
        qpos=np.hstack([walk.qpos, held]),
        qvel=np.hstack([walk.qvel, held]),
        effort=np.hstack([walk.effort, held]),
    )
    write_walk(walk, log)
    model = ["--model", str(robot)]
    assert main(["inspect", str(log), *model, "--json", str(tmp_path / "found.json")]) == 0
    assert main(["identify", str(log), *model, "--dwell-s", "0.2"]) != NOT_IDENTIFIABLE
    found = json.loads((tmp_path / "found.json").read_text())
    assert {one["link"] for one in found["links"]} == set(LINKS)
    assert [one["link"] for one in found["all_links"] if not one["identifiable"]] == ["hand"]
    said = capsys.readouterr().out
    assert said.index("If all links were asked for (--links)") > said.index("Verdict")
    assert main(["inspect", str(log), *model, "--links", "torso,hand"]) == NOT_IDENTIFIABLE
    assert main(["identify", str(log), *model, "--links", "torso,hand"]) == NOT_IDENTIFIABLE


def test_a_robot_whose_links_nobody_can_name_is_refused_by_both(
    pushed: Pushed, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def no_legs(self: Robot) -> tuple[str, ...]:
        return ()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Robot, "default_links", no_legs)
        arguments = [str(log), "--model", str(tmp_path / "robot.xml")]
        assert main(["inspect", *arguments]) == main(["identify", *arguments]) == 2
    said = capsys.readouterr()
    assert "massid identify wants --links" in said.out
    assert "torso" in said.out
    assert "name the links to weigh (--links)" in said.err


def test_inspect_without_a_model_still_tells_what_is_in_the_file(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(log)]) == 0
    assert "no model given" in capsys.readouterr().out


def test_inspect_finds_the_shipped_model_of_a_log(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(sample_walk()), "--links", "torso,l_foot"]) == 0
    assert "one-step residual" in capsys.readouterr().out


def test_repair_makes_a_clean_file_of_a_cut_one(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: log.stat().st_size * 2 // 3])
    assert main(["repair", str(cut), str(tmp_path / "clean.mcap")]) == 0
    assert "not closed or cut off" in capsys.readouterr().err
    assert read_walk(tmp_path / "clean.mcap").warnings == ()
    assert main(["repair", str(cut), str(cut)]) == 2
    assert "is the damaged file itself" in capsys.readouterr().err


def test_identify_and_repair_take_a_topic_map(
    log: Path, pushed: Pushed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "turned.yaml").write_text("preset: massid\ncontacts: [{topic: /contact/*, on: ground}]\n")
    model = ["--model", str(tmp_path / "robot.xml"), "--links", "torso,l_thigh,r_thigh"]
    main(["identify", str(log), *model, "--topics", str(tmp_path / "turned.yaml")])
    assert "contacts: on: ground" in capsys.readouterr().err.replace("\n", " ")  # the audit suspects the setting
    assert main(["repair", str(log), str(tmp_path / "turned.mcap"), "--topics", str(tmp_path / "turned.yaml")]) == 0
    np.testing.assert_array_equal(read_walk(tmp_path / "turned.mcap").wrench, -pushed.walk.wrench)
    assert main(["identify", str(log), *model, "--topics", "ros3"]) == 2
    assert "Did you mean ros2" in capsys.readouterr().err


def test_locked_joints_are_left_to_the_map(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "locked.yaml").write_text("preset: massid\njoints: {ignore: [l_ankle], locked: {l_ankle: 0.0}}\n")
    arguments = ["identify", str(log), "--model", str(tmp_path / "robot.xml"), "--links", "torso"]
    out = tmp_path / "result.json"
    assert main([*arguments, "--topics", str(tmp_path / "locked.yaml"), "--json", str(out)]) in (0, 3, 4, 5)
    assert "torso" in json.loads(out.read_text())["links"]
    (tmp_path / "ignored.yaml").write_text("preset: massid\njoints: {ignore: [l_ankle]}\n")
    assert main([*arguments, "--topics", str(tmp_path / "ignored.yaml")]) == 2
    assert "`locked` in a topic map says where it was held" in capsys.readouterr().err.replace("\n", " ")


def test_links_of_a_log_are_refused_by_name(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["links", str(log)]) == 2
    assert "is a log, expected a robot's MJCF file" in capsys.readouterr().err
