from __future__ import annotations

import ast
import errno
import importlib
import inspect
import json
import math
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massid.assets import sample_walk
from massid.cli import INTERRUPTED, main
from massid.cli.app import COMMANDS
from massid.cli.flags import in_flags
from massid.identify.options import IdentifyOptions, idle_options
from massid.log import WalkWriter, read_walk
from massid.model.robot import Robot
from massid.score import Truth
from massid.walk import Walk
from tests.conftest import Pushed
from tests.pushed_robot import LINKS, XML

ROBOT_LINKS = ",".join(LINKS)
SOURCE = Path(__file__).resolve().parents[2] / "src" / "massid"


def write_walk(path: Path, walk: Walk, contacts: tuple[str, ...] | None = None) -> Path:
    names = walk.contact_bodies if contacts is None else contacts
    with WalkWriter(
        path, root_body=walk.root_body, joint_names=walk.joint_names, timestep_s=walk.timestep_s, contact_bodies=names
    ) as writer:
        wrenches = {name: walk.wrench[:, walk.contact_bodies.index(name)] for name in names}
        writer.append_block(walk.stamps_ns, walk.qpos, walk.qvel, walk.effort, wrenches)
    return path


@pytest.fixture(scope="module")
def folder(pushed: Pushed, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with robot.xml and walk.mcap, as a user would have them."""
    path = tmp_path_factory.mktemp("user")
    (path / "robot.xml").write_text(XML)
    write_walk(path / "walk.mcap", pushed.walk)
    truth = {link: {"true_kg": kg} for link, kg in zip(LINKS, pushed.truth.tolist(), strict=True)}
    (path / "walk.truth.json").write_text(json.dumps({"links": truth}))
    return path


def identify(folder: Path, *arguments: str) -> int:
    return main(["identify", str(folder / "walk.mcap"), "--model", str(folder / "robot.xml"), *arguments])


def test_identify_prints_the_table_and_writes_everything(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = identify(
        folder,
        *("--links", ROBOT_LINKS, "--dwell-s", "0.25", "--truth", str(folder / "walk.truth.json")),
        *("--json", str(tmp_path / "r.json"), "--save-model", str(tmp_path / "m.xml"), "--reference"),
    )
    assert code == 0
    table = capsys.readouterr().out
    assert all(link in table for link in LINKS)
    assert "true [kg]" in table
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["schema"] == 1
    assert result["status"] == "converged"
    assert result["l2_error_kg"] < 1e-6 < result["l2_error_initial_kg"]
    assert result["reference"]["estimate_kg"].keys() == result["links"].keys()
    assert result["iterations"][0].keys() >= {"window", "mu", "estimate_kg", "l2_error_kg"}
    truth = Truth.load(folder / "walk.truth.json").mass_kg
    assert main(["report", str(tmp_path / "r.json")]) == 0
    assert capsys.readouterr().err == ""
    saved = Robot.load(tmp_path / "m.xml")
    np.testing.assert_allclose([saved.nominal_mass_kg(link) for link in LINKS], [truth[link] for link in LINKS])


def test_centre_of_mass_and_payload_have_rows_with_units(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ("--com", "torso", "--payload", "torso@0.1,0.25,0.3", "r_foot")
    options = ("--links", ROBOT_LINKS, "--dwell-s", "0.25", "--json", str(tmp_path / "r.json"))
    assert identify(folder, *options, *asked) == 0
    assert re.search(r"com/torso/z +0\.1000 +0\.10000 +m\b", capsys.readouterr().out)
    quantities = json.loads((tmp_path / "r.json").read_text())["quantities"]
    assert list(quantities) == [
        *(f"com/torso/{axis}" for axis in "xyz"),
        "payload/torso@0.1,0.25,0.3",
        "payload/r_foot@0,0,0",
    ]
    for entry in quantities.values():  # this robot is as the model file says, and carries nothing
        assert entry["estimate"] == pytest.approx(entry["nominal"], abs=1e-6)


def test_any_kind_of_unknown_can_be_asked_for(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ("--friction", "l_knee", "--unknown", "stiffness/r_ankle", "effort_gain/l_knee", "com/torso/x")
    options = ("--links", ROBOT_LINKS, "--dwell-s", "0.25", "--json", str(tmp_path / "r.json"))
    assert identify(folder, *options, *asked) == 0
    quantities = json.loads((tmp_path / "r.json").read_text())["quantities"]
    assert list(quantities) == ["friction/l_knee", "stiffness/r_ankle", "effort_gain/l_knee", "com/torso/x"]
    for entry in quantities.values():
        assert entry["estimate"] == pytest.approx(entry["nominal"], abs=1e-6)
    assert identify(folder, *options, "--unknown", "colour/torso") == 2
    assert "expected KIND/TARGET, with a kind out of mass, com" in capsys.readouterr().err


def test_without_truth_nothing_true_is_printed(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert identify(folder, "--dwell-s", "0.25", "--json", str(tmp_path / "r.json")) == 0
    assert "true" not in capsys.readouterr().out
    assert "true_kg" not in (tmp_path / "r.json").read_text()


def test_same_seed_same_numbers(folder: Path, tmp_path: Path) -> None:
    documents = []
    for name, threads in (("a", "1"), ("b", "2")):
        path = tmp_path / f"{name}.json"
        identify(folder, "--dwell-s", "0.25", "--json", str(path), "--threads", threads, "--seed", "7")
        documents.append(json.loads(path.read_text())["links"])
    assert documents[0] == documents[1]


def test_a_search_that_ends_early_exits_with_4(folder: Path) -> None:
    assert identify(folder, "--direction", "gradient", "--dwell-s", "0.5") == 4


def test_a_walk_that_reveals_nothing_exits_with_3(
    folder: Path, pushed: Pushed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(folder / "robot.xml", tmp_path)
    n, time = 600, 1e-3 * np.arange(600)
    qpos, qvel = np.zeros((n, 15)), np.zeros((n, 14))
    qpos[:, 2], qpos[:, 3], qvel[:, 2] = 9.0 - 0.5 * 9.81 * time * (time + 1e-3), 1.0, -9.81 * time
    flight = replace(
        pushed.walk,
        stamps_ns=pushed.walk.stamps_ns[:n],
        qpos=qpos,
        qvel=qvel,
        effort=np.zeros((n, 8)),
        wrench=np.zeros((n, 2, 6)),
        segments=(),
    )
    write_walk(tmp_path / "walk.mcap", flight)
    assert identify(tmp_path, "--dwell-s", "0.25") == 3
    captured = capsys.readouterr()
    assert "not identifiable" in captured.out
    assert "does not reveal torso" in captured.err


def spoil_missing(path: Path, _: Pushed) -> None:
    path.unlink()


def spoil_text(path: Path, _: Pushed) -> None:
    path.write_text("timestamp,joint,torque\n0.0,knee,12\n")


def spoil_empty(path: Path, _: Pushed) -> None:
    path.write_bytes(b"")


def spoil_no_wrench(path: Path, pushed: Pushed) -> None:
    write_walk(path, pushed.walk, contacts=())


def spoil_short(path: Path, pushed: Pushed) -> None:
    walk = pushed.walk
    rows = {name: getattr(walk, name)[:100] for name in ("stamps_ns", "qpos", "qvel", "effort", "wrench")}
    write_walk(path, replace(walk, segments=(), **rows))


def spoil_joint(path: Path, pushed: Pushed) -> None:
    names = ("l_hip_rol", *pushed.walk.joint_names[1:])
    write_walk(path, replace(pushed.walk, joint_names=names))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (spoil_missing, "walk.mcap"),
        (spoil_text, "walk.mcap"),
        (spoil_empty, "empty"),
        (spoil_no_wrench, "wrench"),
        (spoil_short, "do not fill one dwell window"),
        (spoil_joint, "no joint named 'l_hip_rol'. Did you mean l_hip_roll"),
    ],
)
def test_a_bad_log_is_one_line_and_code_2(
    spoil: object, message: str, folder: Path, pushed: Pushed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    spoil(copy / "walk.mcap", pushed)  # type: ignore[operator]
    assert identify(copy) == 2
    error = capsys.readouterr().err
    assert error.startswith("massid: error: ")
    assert error.count("\n") == 1
    assert message in error


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--links", "torso,l_tigh"), "Did you mean l_thigh"),
        (("--links", "world"), "The world has no mass"),
        (("--links", "torso,torso"), "more than once"),
        (("--com", "l_tigh"), "Did you mean l_thigh"),
        (("--inertia", "hand"), "no link named 'hand'"),
        (("--friction", "l_kne"), "Did you mean l_knee"),
        (("--payload", "torso@0,0"), "expected BODY or BODY@X,Y,Z"),
        (("--payload", "torso@1e9,0,0"), "expected a point on the robot"),
        (("--scan", "nose"), "no parameter named 'nose'"),
        (("--bank-size", "7"), "serves at most 6 unknowns"),
        (("--links", "torso,,l_foot"), "--links 'torso,,l_foot' has an empty name"),
        (("--com", ""), "--com '' has an empty name"),
        (("--dwell-s", "-1"), "--dwell-s is -1.0; it must be a finite number above 0"),
        (("--dwell-s", "nan"), "--dwell-s is nan; it must be a finite number above 0"),
        (("--dwell-s", "10"), "do not fill one dwell window of 10.0 s"),
        (("--other-links", "inf"), "--other-links is inf; it must be a finite number, at least 0"),
        (("--other-links", "nan"), "--other-links is nan; it must be a finite number, at least 0"),
        (("--link-inertia", "inf"), "--link-inertia is inf; it must be a finite number, at least 0"),
        (("--lag-s", "inf"), "--lag-s is inf; it must be a finite number, at least 0"),
        (("--passes", "0"), "--passes is 0; it must be a finite number above 0"),
        (("--radius", "0"), "--radius is 0.0; it must be a finite number above 0"),
        (("--radius", "nan"), "--radius is nan; it must be a finite number above 0"),
        (("--candidates", "-1"), "--candidates is -1; it must be a finite number, at least 0"),
        (("--step-tolerance", "-1"), "--step-tolerance is -1.0; it must be a finite number, at least 0"),
        (("--largest-step", "-1"), "--largest-step is -1.0; it must be above 0"),
        (("--held-out", "nan"), "--held-out is nan; it must be at least 0 and less than 1"),
        (("--dwell-s", "0.001"), "shorter than two samples"),
        (("--truth", "nowhere.json"), "nowhere.json"),
        (("--json", "no/such/folder/r.json"), "no/such/folder does not exist"),
        (("--reference",), "--reference goes into --json, which was not asked for"),
    ],
)
def test_bad_arguments_are_one_line_and_code_2(
    arguments: tuple[str, ...], message: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert identify(folder, *arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("massid: error: ")
    assert error.count("\n") == 1
    assert message in error


@pytest.fixture
def unjudged(monkeypatch: pytest.MonkeyPatch) -> None:
    """The verdict fails the test."""

    def foresee(*_: object) -> None:
        raise AssertionError("judged already")

    monkeypatch.setattr("massid.weighing.foresee", foresee)


@pytest.mark.parametrize("mode", ["online", "offline"])
@pytest.mark.parametrize("arguments", [("--bank-size", "3"), ("--dwell-s", "10"), ("--dwell-s", "0.001")])
def test_what_does_not_fit_the_log_is_said_before_the_verdict(
    arguments: tuple[str, str], mode: str, folder: Path, unjudged: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert identify(folder, "--mode", mode, *arguments) == 2
    assert capsys.readouterr().err.startswith("massid: error: ")


def truth_of(kg: float, nominal_kg: float) -> str:
    return json.dumps({"links": {link: {"true_kg": kg, "nominal_kg": nominal_kg} for link in LINKS}})


def test_the_truth_of_another_robot_is_warned_of(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.truth.json"
    other.write_text(truth_of(70.0, 66.0))
    options = ("--links", ROBOT_LINKS, "--dwell-s", "0.25")
    assert identify(folder, *options, "--truth", str(other)) == 0
    assert "other.truth.json is of a robot with other nominal masses (torso 66 kg, here" in capsys.readouterr().err
    assert identify(folder, *options, "--truth", str(folder / "walk.truth.json")) == 0
    assert "other nominal masses" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"links": {"pelvis": {"true_kg": 1.0}}}', "has no link named 'torso'"),
        (truth_of(math.nan, 1.0), "is nan and not finite"),
    ],
)
def test_a_truth_that_cannot_be_used_is_said_before_the_verdict(
    text: str,
    message: str,
    folder: Path,
    tmp_path: Path,
    unjudged: None,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "other.truth.json").write_text(text)
    assert identify(folder, "--links", ROBOT_LINKS, "--truth", str(tmp_path / "other.truth.json")) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("name", ["robot", "nowhere.xml"])
def test_an_unknown_model_is_named(name: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["links", name]) == 2
    assert name in capsys.readouterr().err


@pytest.mark.parametrize(
    ("argument", "message"),
    [("torso", "expected LINK=+KG"), ("torso=x", "expected LINK=+KG"), ("tors=1", "Did you mean torso")],
)
def test_bad_hidden_masses(argument: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["record", str(tmp_path / "w.mcap"), "--seconds", "0.1", "--mass", argument]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("command", "option"),
    [("record w.mcap", "--seconds"), ("demo --out d", "--seconds"), ("paper --only A --out p", "--walk-s")],
)
@pytest.mark.parametrize("value", ["inf", "nan"])
def test_times_are_finite(
    command: str,
    option: str,
    value: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*command.split(), option, value]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"massid: error: {option} is {value}; it must be a finite number")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--seed", "-1", "--seed is -1; it must be a finite number, at least 0"),
        ("--seconds", "1e12", "--seconds is 1000000000000.0; it must be at most 3600"),
        ("--mass-error-kg", "nan", "is nan kg; it must be a finite number, at least 0"),
    ],
)
def test_record_refuses_absurd_numbers(
    option: str, value: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["record", str(tmp_path / "w.mcap"), option, value]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_one_line(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("massid.cli.console.say", full)
    out = os.dup(1)
    try:
        assert main(["links", "atlas"]) == 2
    finally:
        os.dup2(out, 1)
        os.close(out)
    assert capfd.readouterr().err == "massid: error: writing: No space left on device\n"


def test_an_interrupt_while_loading_is_one_line() -> None:
    code = (
        "import sys, builtins; from massid.cli import main; load = builtins.__import__\n"
        "def interrupted(name, *rest):\n"
        "    if name == 'tyro': raise KeyboardInterrupt\n"
        "    return load(name, *rest)\n"
        "builtins.__import__ = interrupted; sys.exit(main(['links', 'atlas']))"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (INTERRUPTED, "massid: interrupted\n")


def test_options_that_a_log_has_no_use_for_are_named() -> None:
    options = IdentifyOptions(bandwidth_rad_s=30.0, lag_s=0.0)
    assert idle_options(options, noisy=True) == ("`bandwidth_rad_s` has no effect on a noisy log.",)
    assert idle_options(options, noisy=False) == ("`lag_s` has no effect on a clean log.",)
    assert idle_options(IdentifyOptions(), noisy=True) == ()


def test_every_command_is_listed_with_the_first_line_of_its_own_help() -> None:
    for name, summary in COMMANDS.items():
        command = getattr(importlib.import_module(f"massid.cli.{name}"), name.capitalize())
        assert inspect.cleandoc(command.__doc__).splitlines()[0] == summary


def test_what_the_library_says_of_its_options_is_printed_as_flags() -> None:
    said = "use a shorter `dwell_s`, `mode=offline` or `noise`; `locked` is a word of topic maps"
    assert in_flags(said) == "use a shorter --dwell-s, --mode offline or --noise; `locked` is a word of topic maps"


def test_the_library_names_no_flags() -> None:
    """What it says reads well in Python, too: only the command line, and what runs it, write dashes."""
    rooms = ("audit", "compare", "identify", "judge", "log", "model", "observer", "search", "walk")
    paths = [path for room in rooms for path in (SOURCE / room).rglob("*.py")] + [SOURCE / "weighing.py"]
    strings = [
        node.value
        for path in paths
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    assert not [text for text in strings if re.search(r"(^|[\s(])--[a-z]", text)]


@pytest.mark.parametrize("command", ["demo", "record", "identify", "report", "view", "links"])
def test_every_command_has_help_with_examples(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main([command, "--help"])
    assert stop.value.code == 0
    assert f"massid {command}" in capsys.readouterr().out.split("Examples:")[1]


def test_unknown_command_exits_with_2(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["weigh"])
    assert stop.value.code == 2
    assert "weigh" in capsys.readouterr().err


def test_links_lists_masses(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["links", "atlas"]) == 0
    assert "torso" in capsys.readouterr().out


def test_the_shipped_walk_is_identified_with_nothing_but_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    log = sample_walk()
    assert main(["identify", str(log), "--truth", str(log.with_suffix(".truth.json"))]) == 0
    assert "converged" in capsys.readouterr().out
    assert read_walk(log).duration_s == pytest.approx(5.0, abs=0.01)


def test_links_names_the_body_that_a_welded_link_moves_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = tmp_path / "robot.xml"
    model.write_text(
        '<mujoco><worldbody><body name="trunk"><freejoint name="root"/><geom size="0.1" mass="9"/><body name="pack">'
        '<geom size="0.1" mass="2"/></body><body name="leg"><joint name="hip"/><geom size="0.1" mass="3"/></body>'
        "</body></worldbody></mujoco>"
    )
    assert main(["links", str(model)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if "moves with trunk" in line] == [line for line in lines if line.startswith("pack")]
