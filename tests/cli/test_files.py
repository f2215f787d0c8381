"""Files that the commands write: none is an input or another output, and what cannot be written is said at once."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from massid.assets import sample_walk
from massid.cli import main
from massid.errors import BadInputError
from massid.outputs import check_outputs


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where a user stands: a log, its truth, a model, a damaged log, a result with its sidecar."""
    monkeypatch.chdir(tmp_path)
    log = sample_walk()
    (tmp_path / "walk.mcap").write_bytes(log.read_bytes())
    (tmp_path / "walk.truth.json").write_bytes(log.with_suffix(".truth.json").read_bytes())
    (tmp_path / "walk.mcap.partial").write_bytes(log.read_bytes()[:-1000])
    (tmp_path / "robot.xml").write_text("<mujoco/>")
    (tmp_path / "link.json").symlink_to("walk.mcap")
    (tmp_path / "circle").symlink_to("circle")
    for name in ("result.json", "result.npz"):
        (tmp_path / name).write_text("{}")
    (tmp_path / "folder").mkdir()
    return tmp_path


def contents(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("identify walk.mcap --save-model walk.mcap", "walk.mcap is the log itself; give --save-model another name"),
        ("identify walk.mcap --json ./folder/../walk.mcap", "is the log itself; give --json another name"),
        ("identify walk.mcap --json link.json", "link.json is the log itself; give --json another name"),
        ("identify walk.mcap --json other.mcap", "--json other.mcap: expected a name that ends in .json"),
        ("inspect walk.mcap --json other.mcap", "--json other.mcap: expected a name that ends in .json"),
        (
            "identify walk.mcap --rerun /dev/null",
            "--rerun /dev/null: is a pipe or a device, and",
        ),
        ("identify walk.mcap --rerun walk.mcap", "is the log itself; give --rerun another name"),
        ("identify result.json walk.mcap --png walk.mcap", "is the log itself; give --png another name"),
        (
            "identify walk.mcap --truth walk.truth.json --json walk.truth.json",
            "walk.truth.json is the truth file (--truth) itself; give --json another name",
        ),
        ("identify walk.mcap --model robot.xml --save-model robot.xml", "is the model (--model) itself"),
        ("identify walk.mcap --json same --save-model same", "--json and --save-model would both write same"),
        ("identify walk.mcap --json a.npz", "--json and the sidecar of --json would both write a.npz"),
        ("identify walk.mcap --json a.json --rerun a.npz", "the sidecar of --json and --rerun would both write a.npz"),
        ("identify walk.mcap --json folder", "Cannot write folder: it is a folder."),
        ("identify walk.mcap --save-model folder", "Cannot write folder: it is a folder."),
        ("identify walk.mcap --json /proc/x.json", "Cannot write /proc/x.json: "),
        ("identify walk.mcap --png no/a.png", "the folder no does not exist"),
        ("identify walk.mcap --png a.jpg", "--png a.jpg: expected a name that ends in .png"),
        ("identify walk.mcap --rerun a.mp4", "--rerun a.mp4: expected a name that ends in .rrd"),
        ("record walk.txt --seconds 1", "the log walk.txt: expected a name that ends in .mcap"),
        ("corrupt walk.mcap new.mcap --noise clean", "--noise clean changes nothing"),
        ("identify walk.mcap --json circle", "Cannot write circle: "),
        ("inspect walk.mcap --html walk.mcap", "walk.mcap is the log itself; give --html another name"),
        ("inspect walk.mcap --html folder", "Cannot write folder: it is a folder."),
        ("report result.json -o result.json", "result.json is the result itself; give the page (-o) another name"),
        ("report result.json -o result.npz", "result.npz is the result's sidecar itself"),
        ("record robot.xml --robot robot.xml", "robot.xml is the model (--robot) itself; give the log another name"),
        ("report result.json -o -", "the page (-o) is '-': name a file"),
        ("repair walk.mcap.partial -", "the repaired file is '-': name a file"),
        ("record /dev/null --seconds 1", "the log /dev/null: is a pipe or a device"),
        ("corrupt walk.mcap /dev/stdout", "the log /dev/stdout: is a pipe or a device"),
        ("identify walk.mcap --save-model /dev/stdout", "models are saved to files"),
        ("record folder --seconds 1", "Cannot write folder: it is a folder."),
        ("repair walk.mcap walk.mcap", "walk.mcap is the damaged file itself"),
        ("repair walk.mcap.partial walk.mcap --topics ros2", "walk.mcap.partial is the damaged file itself"),
        ("corrupt walk.mcap.partial walk.mcap", "walk.mcap.partial is the clean log itself"),
        ("corrupt walk.mcap walk.log", "the log walk.log: expected a name that ends in .mcap"),
    ],
)
def test_no_command_writes_over_what_it_reads_or_writes(
    command: str, message: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(folder)
    assert main(command.split()) == 2
    said = capsys.readouterr()
    assert said.err.startswith("massid: error: ")
    assert said.err.count("\n") == 1
    assert message in said.err
    assert said.out == ""  # before any work
    assert contents(folder) == before


def test_the_shipped_model_that_made_a_log_is_not_overwritten(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("massid.cli.identify.shipped_models", lambda: {"robot": folder / "robot.xml"})
    monkeypatch.setattr("massid.weighing.find_model_by_hash", lambda _: folder / "robot.xml")
    assert main(["identify", "walk.mcap", "--save-model", "robot.xml"]) == 2
    assert "robot.xml is a shipped model itself" in capsys.readouterr().err


def test_checking_changes_nothing(folder: Path) -> None:
    (folder / "old.json").write_text("old")
    (folder / "dangling").symlink_to("nowhere")
    outputs = [("a", folder / "old.json"), ("b", folder / "new.json"), ("c", folder / "dangling"), ("d", None)]
    check_outputs([("log", folder / "walk.mcap")], outputs)
    assert (folder / "old.json").read_text() == "old"
    assert not (folder / "new.json").exists()
    assert (folder / "dangling").is_symlink()
    assert not (folder / "nowhere").exists()


def test_hard_links_to_an_input_are_seen(folder: Path) -> None:
    (folder / "other.mcap").hardlink_to(folder / "walk.mcap")
    with pytest.raises(BadInputError, match=r"other\.mcap is the log itself; give --json another name"):
        check_outputs([("the log", folder / "walk.mcap")], [("--json", folder / "other.mcap")])
