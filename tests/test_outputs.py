"""Outputs are complete under their names or not there at all, whatever ends the work, and pairs appear together."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from massid import outputs
from massid.cli.interrupts import EndedError, end_on_signals
from massid.errors import BadInputError
from massid.outputs import drafts, open_alone, publish, uninterrupted, write_file, write_files


@contextmanager
def nearly_full(limit: int) -> Iterator[None]:
    """No file can grow beyond a number of bytes, as on a disk with that much left."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def pair(tmp_path: Path) -> dict[Path, bytes]:
    """Two files that belong together, as they were."""
    files = {tmp_path / "a.npz": b"old a", tmp_path / "a.json": b"old json"}
    write_files(files)
    return files


def on_disk(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.iterdir()}


def test_a_pair_replaces_a_pair_and_nothing_else_is_left(pair: dict[Path, bytes], tmp_path: Path) -> None:
    new = dict.fromkeys(pair, b"new")
    write_files(new)
    assert on_disk(tmp_path) == new


def test_on_a_full_disk_the_old_pair_stays(pair: dict[Path, bytes], tmp_path: Path) -> None:
    first, second = pair
    with nearly_full(1000), pytest.raises(BadInputError, match=r"Cannot write .*a\.json: File too large"):
        write_files({first: b"new", second: bytes(2000)})
    assert on_disk(tmp_path) == pair


@pytest.mark.parametrize("event", range(4, 16))
def test_killed_at_any_call_a_file_never_stands_beside_anothers(
    event: int, pair: dict[Path, bytes], tmp_path: Path
) -> None:
    """The process is killed as it is about to make its n-th call that opens, names or removes a file in the folder."""
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from massid.outputs import write_files\n"
        "folder, count = Path(sys.argv[1]), int(sys.argv[2])\n"
        "def hook(event, args):\n"
        "    global count\n"
        "    if event in ('open', 'os.rename', 'os.remove') and str(folder) in str(args[0]):\n"
        "        count -= 1\n"
        "        if count < 0: os.kill(os.getpid(), signal.SIGKILL)\n"
        "sys.addaudithook(hook)\n"
        "write_files({folder / 'a.npz': b'new', folder / 'a.json': b'new'})\n"
    )
    _, second = pair
    subprocess.run([sys.executable, "-c", code, str(tmp_path), str(event)], check=False, timeout=60)
    found = {path: content for path, content in on_disk(tmp_path).items() if not path.name.startswith(".")}
    assert found.keys() <= pair.keys()
    if second in found:  # what the other belongs to
        assert found in (pair, dict.fromkeys(pair, b"new"))


def test_what_cannot_be_named_leaves_what_was_there(
    pair: dict[Path, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace = Path.replace

    def refuse(self: Path, target: Path) -> Path:
        if target.suffix == ".json" and not self.name.endswith(".old"):
            raise OSError(5, "Input/output error")
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(BadInputError, match="Input/output error"):
        write_files(dict.fromkeys(pair, b"new"))
    assert on_disk(tmp_path) == pair


def test_an_exception_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), drafts(tmp_path / "a.json") as (place,):
        place.write_bytes(b"half of")
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


def test_links_and_permissions_stay(tmp_path: Path) -> None:
    (tmp_path / "real").write_bytes(b"old")
    (tmp_path / "real").chmod(0o640)
    (tmp_path / "link").symlink_to("real")
    write_file(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_bytes() == b"new"
    assert (tmp_path / "real").stat().st_mode & 0o777 == 0o640


def test_a_second_process_on_one_name_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "walk.mcap.partial"
    with open_alone(path) as stream:
        stream.write(b"first")
        stream.flush()
        code = (
            "import sys; from pathlib import Path; from massid.outputs import open_alone; open_alone(Path(sys.argv[1]))"
        )
        second = subprocess.run([sys.executable, "-c", code, str(path)], check=False, capture_output=True, text=True)
        assert "walk.mcap.partial is being written by another process" in second.stderr
        publish([(path, tmp_path / "walk.mcap")])
        with open_alone(path) as other:  # the name is free again, and the finished file is not touched
            other.write(b"second")
    assert (tmp_path / "walk.mcap").read_bytes() == b"first"
    assert path.read_bytes() == b"second"


def test_processes_that_write_one_pair_at_once_leave_one_pair(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from massid.outputs import write_files\n"
        "folder, mark = Path(sys.argv[1]), sys.argv[2].encode()\n"
        "for _ in range(60): write_files({folder / 'a.npz': mark, folder / 'a.json': mark})\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    racers = [subprocess.Popen([*command, mark]) for mark in ("one", "two")]
    assert [racer.wait(60) for racer in racers] == [0, 0]
    found = on_disk(tmp_path)
    assert sorted(path.name for path in found) == ["a.json", "a.npz"]
    assert len(set(found.values())) == 1


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_wait_until_what_must_not_be_cut_is_done(name: str) -> None:
    number, done = getattr(signal, name), False
    with pytest.raises(KeyboardInterrupt) as ended, end_on_signals(), uninterrupted():
        signal.raise_signal(number)
        done = True
    assert done
    assert name == "SIGINT" or (isinstance(ended.value, EndedError) and str(ended.value) == name)
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_what_is_ignored_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with end_on_signals(), uninterrupted():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_pipes_are_written_straight(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    reader = subprocess.Popen(["cat", str(tmp_path / "pipe.json")], stdout=subprocess.PIPE)
    write_file(tmp_path / "pipe.json", b"through it")
    assert reader.communicate(timeout=60)[0] == b"through it"


def test_what_a_shell_made_stdout_is_not_replaced(tmp_path: Path) -> None:
    code = (
        "from pathlib import Path; from massid.outputs import write_file; print('before', end=' ')\n"
        "write_file(Path('/dev/stdout'), b'this '); print('after')"
    )
    with (tmp_path / "out").open("wb") as out:
        subprocess.run([sys.executable, "-c", code], check=True, stdout=out)
    assert (tmp_path / "out").read_text() == "before this after\n"


def test_every_writer_goes_through_this_one_door() -> None:
    """Whoever opens a file to write it by itself leaves half of one when it is stopped."""
    source = Path(outputs.__file__).parent
    forbidden = (".write_text(", ".write_bytes(", 'open("w', 'open("ab', "savefig(path", ".save(path", "to_file(")
    allowed = {"outputs.py", "log/mcap/sink.py", "log/repair.py", "model/file.py"}  # into drafts
    found = {
        str(path.relative_to(source))
        for path in source.rglob("*.py")
        if any(words in path.read_text() for words in forbidden)
    }
    assert found <= allowed
