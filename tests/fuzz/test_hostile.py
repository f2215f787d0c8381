"""Small inputs that claim, or become, very much end in one line; scripts/bench_hostile.py measures them all."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import numpy as np
import pytest

from massid.cli import main
from massid.errors import LogError
from massid.log import read_walk, summarise_log
from massid.log.files import Kind
from massid.log.tables import read_table
from tests.fuzz.hostile import LOGS, MODELS, URDFS, make

HANGS_AFTER_S = 60
SLOW_TO_MAKE = ("GB", "200 MB", "million", "100,000", "16 MB")


@pytest.fixture(autouse=True)
def no_hang() -> Iterator[None]:
    """What never ends ends as a failure."""

    def end(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"more than {HANGS_AFTER_S} s")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(HANGS_AFTER_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def one_line(error: BaseException) -> bool:
    return "\n" not in str(error) and 0 < len(str(error)) < 5000


@pytest.mark.parametrize("name", [name for name in LOGS if not any(word in name for word in SLOW_TO_MAKE)])
def test_a_small_log_that_becomes_much_is_one_line(name: str, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(LOGS[name]())
    with pytest.raises(LogError) as caught:
        read_walk(path)
    assert one_line(caught.value)


def test_a_chunk_is_inflated_no_further_than_the_budget(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(LOGS["zstd chunk, 10 kB, claims 1.9 GB"]())
    warnings = summarise_log(path).warnings
    assert any("it would inflate the file to more than 16777216 bytes" in line for line in warnings)


@pytest.mark.parametrize("name", [name for name in MODELS | URDFS if "name of" not in name])
def test_a_small_model_that_becomes_much_is_one_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / ("robot.urdf" if name in URDFS else "robot.xml")
    path.write_text((MODELS | URDFS)[name]())
    code = main(["links", str(path)])
    said = capsys.readouterr()
    assert code in (0, 2)
    assert (code == 0 and said.err == "") or said.err.count("\n") == 1


@pytest.mark.parametrize("what", ["log", "model", "result", "truth", "topic map", "bag"])
def test_a_pipe_that_nobody_writes_to_is_one_line(
    what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from massid.assets import sample_walk

    ((_, arguments),) = make(tmp_path, f"a pipe as a {what}")
    assert main([str(sample_walk()) if word == "SAMPLE" else word for word in arguments]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "is a pipe or a device, expected a file" in said


def test_a_table_that_inflates_beyond_its_size_is_one_line(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "walk.npz", time=np.zeros(1 << 22))
    with pytest.raises(LogError, match="bytes of numbers, more than"):
        read_table(tmp_path / "walk.npz", Kind.NPZ)
