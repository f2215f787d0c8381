"""Inputs that are small and claim, or become, very much: seconds, peak memory and the last line of each.

    python scripts/bench_hostile.py

One that takes longer than --seconds, more memory than --megabytes, ends in a traceback or says nothing fails, and the
exit code is 1.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import tyro

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.fuzz.hostile import make

from massid.assets import sample_walk

ADDRESS_SPACE = 24 << 30
SHOWN = 110


@dataclass(frozen=True)
class Bench:
    """Feed massid with inputs that are small and become large."""

    only: str = ""
    """Those whose name holds this."""
    skip: str = "nothing"
    """But not those whose name holds this."""
    seconds: float = 30.0
    """That each may take."""
    megabytes: float = 800.0
    """That each may take."""


def made_apart(folder: Path, only: str) -> list[tuple[str, list[str]]]:
    """Make the inputs in a process of its own: whatever this one ever took would be counted as its children's."""
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as pool:
        return pool.submit(make, folder, only).result()


def run(arguments: list[str], folder: Path, seconds: float) -> tuple[float, float, int, str]:
    """Seconds, megabytes at most, exit code and words of one command."""
    started = time.perf_counter()
    with (folder / "said").open("w+") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "massid", *arguments],
            cwd=folder,
            stdout=said,
            stderr=said,
        )
        while True:
            done, status, used = os.wait4(process.pid, os.WNOHANG)
            if done:
                break
            if time.perf_counter() - started > 3.0 * seconds:
                process.kill()
            time.sleep(0.01)
        process.returncode = os.waitstatus_to_exitcode(status)
        took_s = time.perf_counter() - started
        said.seek(0)
        return took_s, used.ru_maxrss / 1024.0, process.returncode, said.read()


def main(bench: Bench) -> int:
    """Run, print."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    failures = 0
    print("| input | s | MB | exit code | last line |\n| --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for what, arguments in made_apart(folder, bench.only):
            if bench.skip in what:
                continue
            words = [str(sample_walk()) if word == "SAMPLE" else word for word in arguments]
            took_s, megabytes, code, said = run(words, folder, bench.seconds)
            lines = said.strip().splitlines() or [""]
            bad = took_s > bench.seconds or megabytes > bench.megabytes or code not in (0, 2, 3, 5) or not lines[-1]
            bad = bad or "Traceback" in said
            failures += bad
            last = lines[-1].replace(f"{folder}/", "").replace("|", "\\|")
            mark = "**fails** " if bad else ""
            print(f"| {mark}{what} | {took_s:.1f} | {megabytes:.0f} | {code} | {last[:SHOWN]} |", flush=True)
    print(f"\n{failures} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Bench, description=__doc__)))
