from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from massid.errors import BadInputError, MassidError
from massid.view import open_viewer, viewer


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "walk.rrd"
    path.write_bytes(b"RRF2 and so on")
    return path


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Commands that would have been run."""
    commands: list[list[str]] = []

    def run(command: list[str], **options: Any) -> subprocess.CompletedProcess[bytes]:
        commands.append(command)
        return subprocess.CompletedProcess(command, returncode=0)

    monkeypatch.setattr(subprocess, "run", run)
    return commands


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"nowhere\.rrd does not exist"):
        open_viewer(tmp_path / "nowhere.rrd")
    with pytest.raises(BadInputError, match="is a folder"):
        open_viewer(tmp_path)


def test_another_kind_of_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "walk.rrd"
    path.write_text("<mujoco/>")
    with pytest.raises(BadInputError, match="not a Rerun recording"):
        open_viewer(path)


def test_without_a_display_it_says_what_to_do(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(MassidError, match=r"no display .*--web-viewer --bind 127\.0\.0\.1") as caught:
        open_viewer(recording)
    assert "\n" not in str(caught.value)


def test_the_viewer_listens_on_this_machine_only(
    recording: Path, started: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    open_viewer(recording)
    (command,) = started
    assert Path(command[0]).is_file()
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert command[-1] == str(recording)


def test_a_viewer_that_fails_is_reported(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewer, "_executable", lambda: "false")
    with pytest.raises(MassidError, match="exit code 1"):
        open_viewer(recording)
