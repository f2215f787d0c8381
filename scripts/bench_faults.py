"""What is left under the final names when a command that writes is ended at a random moment, or its disk is full.

    python scripts/bench_faults.py --moments 20

Each command runs in a folder that is empty, or holds what an earlier run wrote, and is ended by a signal at a moment of
its run that is drawn, half of the times among its calls that open, name or remove a file there; or no file can grow
beyond a size that is drawn. What stands under its final names then is all new, all old, a log that says that it is
short with a truth that says so too, nothing; or BROKEN, and the exit code is 1.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from PIL import Image

from massid.cli import main as massid
from massid.errors import MassidError
from massid.log import read_walk
from massid.model.robot import Robot
from massid.result.sidecar import read_result

FULL_DISK = "full disk"
FAULTS = ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP", FULL_DISK)
LIMIT_S = 120.0
NEW, OLD, MARKED, NOTHING, BROKEN, HANGS = "new", "old", "short, marked", "nothing", "BROKEN", "HANGS"


@dataclass(frozen=True)
class Case:
    """A command, the files that it writes, and what tells a whole one from half of one.

    Attributes:
        name: of the command.
        arguments: of massid.
        groups: names that belong together, and what passes if they are whole; says whether a log is marked as short.
    """

    name: str
    arguments: Sequence[str]
    groups: Sequence[tuple[tuple[str, ...], Callable[[Path], bool]]]


def log_and_truth(folder: Path) -> bool:
    """A log that reads, and a truth that says the same about its end."""
    walk = read_walk(folder / "new.mcap")
    truth = json.loads((folder / "new.truth.json").read_text())
    is_short = walk.metadata.get("end") != "complete"
    if is_short != (truth.get("end") != "complete") or not truth["links"]:
        raise ValueError(f"the log ended {walk.metadata.get('end')}, the truth says {truth.get('end')}")
    return is_short


def log_alone(folder: Path) -> bool:
    """A log that reads without a word on damage."""
    walk = read_walk(folder / "new.mcap")
    if walk.metadata.get("end") != "complete":
        raise ValueError("a copy of a whole log is short")
    return False


def result(folder: Path) -> bool:
    """A result and its own sidecar."""
    if read_result(folder / "r.json").warnings:
        raise ValueError("no sidecar")
    return False


def model(folder: Path) -> bool:
    """A model that loads."""
    Robot.load(folder / "m.xml")
    return False


def picture(folder: Path) -> bool:
    """A picture whose every line is there."""
    with Image.open(folder / "p.png") as image:
        image.load()
    return False


def recording(folder: Path) -> bool:
    """A recording that ends as recordings end."""
    if b"RRF2FOOT" not in (folder / "r.rrd").read_bytes()[-32:]:
        raise ValueError("cut off")
    return False


def page(folder: Path) -> bool:
    """A page that is closed."""
    if not (folder / "p.html").read_text().endswith("</html>\n"):
        raise ValueError("cut off")
    return False


def inspection(folder: Path) -> bool:
    """JSON."""
    json.loads((folder / "i.json").read_text())
    return False


def cases(inputs: Path, seed: int) -> list[Case]:
    """Every command that writes; two seeds write different files."""
    clean, damaged, found = inputs / f"clean{seed}.mcap", inputs / f"cut{seed}.mcap.partial", inputs / f"r{seed}.json"
    pair = (("new.truth.json", "new.mcap"), log_and_truth)
    record = ("record", "new.mcap", "--seconds", "0.6", "--seed", str(seed))
    written = ("--json", "r.json", "--save-model", "m.xml", "--rerun", "r.rrd", "--png", "p.png")
    return [
        Case("record", record, [pair]),
        Case("record --noise", (*record, "--noise", "white"), [pair]),
        Case("corrupt", ("corrupt", str(clean), "new.mcap", "--seed", str(seed)), [pair]),
        Case("repair", ("repair", str(damaged), "new.mcap"), [(("new.mcap",), log_alone)]),
        Case("repair --topics", ("repair", str(damaged), "new.mcap", "--topics", "ros2"), [(("new.mcap",), log_alone)]),
        Case(
            "identify",
            ("identify", str(clean), "--held-out", "0.1", "--dwell-s", "0.2", *written),
            [
                (("r.npz", "r.json"), result),
                (("m.xml",), model),
                (("r.rrd",), recording),
                (("p.png",), picture),
            ],
        ),
        Case(
            "inspect",
            ("inspect", str(clean), "--html", "p.html", "--json", "i.json"),
            [(("p.html",), page), (("i.json",), inspection)],
        ),
        Case("report", ("report", str(found), "-o", "p.html"), [(("p.html",), page)]),
    ]


def run(arguments: Sequence[str], folder: Path, before: Callable[[], None] | None = None) -> tuple[int, str]:
    """Run massid in a process of its own, all of which is loaded already; its status, -1 if it hangs, and its words."""
    said = folder.parent / "said"
    child = os.fork()
    if child == 0:
        code = 99
        try:
            with said.open("w") as out:
                os.dup2(out.fileno(), 1)
                os.dup2(out.fileno(), 2)
            os.chdir(folder)
            if before is not None:
                before()
            code = massid(arguments)
        except BaseException:
            traceback.print_exc()
        finally:
            with contextlib.suppress(BaseException):
                sys.stdout.flush()
            os._exit(code)
    deadline = time.perf_counter() + LIMIT_S
    while time.perf_counter() < deadline:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status), said.read_text()
        time.sleep(0.005)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return -1, said.read_text()


def at_event(number: int, fault: str) -> Callable[[], None]:
    """Send the process a signal as it is about to make its n-th call that opens, names or removes one of its files."""

    def begin() -> None:
        count = 0
        folder = str(Path.cwd())

        def hook(event: str, args: tuple[Any, ...]) -> None:
            nonlocal count
            if event in ("open", "os.rename", "os.remove") and _is_within(args[0], folder):
                if count == number:
                    os.kill(os.getpid(), getattr(signal, fault))
                count += 1

        sys.addaudithook(hook)

    return begin


def after(delay_s: float, fault: str) -> Callable[[], None]:
    """Send the process a signal some time after it has begun."""

    def begin() -> None:
        parent = os.getpid()
        if os.fork() == 0:
            time.sleep(delay_s)
            with contextlib.suppress(ProcessLookupError):
                os.kill(parent, getattr(signal, fault))
            os._exit(0)

    return begin


def full_at(size: int) -> Callable[[], None]:
    """No file of the process grows beyond a size."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def count_events(case: Case, folder: Path) -> tuple[float, int, int]:
    """How long a command takes, how many such calls it makes, and the size of its largest file."""
    counted = folder.parent / "events"

    def begin() -> None:
        total = 0
        here = str(Path.cwd())
        stream = counted.open("w", buffering=1)

        def hook(event: str, args: tuple[Any, ...]) -> None:
            nonlocal total
            if event in ("open", "os.rename", "os.remove") and _is_within(args[0], here):
                total += 1
                stream.write(f"{total}\n")

        sys.addaudithook(hook)

    started = time.perf_counter()
    code, said = run(case.arguments, folder, begin)
    took_s = time.perf_counter() - started
    if code not in (0, 3, 4, 5):
        raise SystemExit(f"{case.name}: {said}")
    return took_s, len(counted.read_text().split()), max(path.stat().st_size for path in folder.iterdir())


def _is_within(name: Any, folder: str) -> bool:
    if not isinstance(name, str | os.PathLike):
        return False
    text = os.fspath(name)
    return isinstance(text, str) and (text.startswith(folder) or "/" not in text)


def judge(case: Case, folder: Path, old: dict[str, bytes], log: io.TextIOBase) -> list[str]:
    """What stands under each group of final names."""
    found = []
    for names, check in case.groups:
        here = {name: (folder / name).read_bytes() for name in names if (folder / name).exists()}
        if names[-1] not in here:  # a truth or a sidecar alone belongs to nothing, and nothing reads it
            found.append(NOTHING)
        elif old and here == {name: old[name] for name in names}:
            found.append(OLD)
        elif any(here.get(name) == content for name, content in old.items()):
            log.write(f"{case.name}: {[name for name in here if here[name] == old.get(name)]} beside new ones\n")
            found.append(BROKEN)
        else:
            try:
                found.append(MARKED if check(folder) else NEW)
            except (MassidError, OSError, ValueError, KeyError) as error:
                log.write(f"{case.name}: {error}\n")
                found.append(BROKEN)
    return found


@dataclass(frozen=True)
class Bench:
    """End commands that write, and look at what they leave."""

    moments: int = 20
    """For each command and fault."""
    seed: int = 0
    """Seeds the moments."""
    only: str | None = None
    """One command alone."""


def main(bench: Bench) -> int:
    """Run, count, print."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever a shell made of them
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    rng = np.random.default_rng(bench.seed)
    totals: Counter[str] = Counter()
    print("| command | fault | " + " | ".join((NEW, OLD, MARKED, NOTHING, BROKEN, HANGS)) + " | left beside |")
    print("|" + " --- |" * 9)
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        inputs = root / "inputs"
        inputs.mkdir()
        for seed in (1, 2):
            clean = inputs / f"clean{seed}.mcap"
            run(("record", str(clean), "--seconds", "1.2", "--seed", str(seed)), inputs)
            (inputs / f"cut{seed}.mcap.partial").write_bytes(clean.read_bytes()[:-5000])
            run(("identify", str(clean), "--json", f"r{seed}.json"), inputs)
        for old_case, case in zip(cases(inputs, 1), cases(inputs, 2), strict=True):
            if bench.only not in (None, case.name):
                continue
            folder = root / "work"
            folder.mkdir()
            run(old_case.arguments, folder)
            old = {path.name: path.read_bytes() for path in folder.iterdir()}
            shutil.rmtree(folder)
            folder.mkdir()
            took_s, events, largest = count_events(case, folder)
            for fault in FAULTS:
                counts: Counter[str] = Counter()
                litter = 0
                for moment in range(bench.moments):
                    shutil.rmtree(folder)
                    folder.mkdir()
                    there = old if moment % 4 < 2 else {}
                    for file, content in there.items():
                        (folder / file).write_bytes(content)
                    if fault == FULL_DISK:
                        begin = full_at(int(rng.integers(0, largest)))
                    elif moment % 2:
                        begin = at_event(int(rng.integers(events)), fault)
                    else:
                        begin = after(float(rng.uniform(0.0, took_s)), fault)
                    code, said = run(case.arguments, folder, begin)
                    if code == -1:
                        counts[HANGS] += 1
                    if "Traceback" in said:
                        sys.stderr.write(f"{case.name}, {fault}: {said}\n")
                        counts[BROKEN] += 1
                    counts.update(judge(case, folder, there, sys.stderr))
                    litter += sum(path.name not in old for path in folder.iterdir())
                totals += counts
                cells = " | ".join(str(counts[kind]) for kind in (NEW, OLD, MARKED, NOTHING, BROKEN, HANGS))
                print(f"| {case.name} | {fault} | {cells} | {litter} |", flush=True)
            shutil.rmtree(folder)
    return 1 if totals[BROKEN] or totals[HANGS] else 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Bench, description=__doc__)))
