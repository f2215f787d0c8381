"""Work in a process of its own, so that its processor time and its memory are its own."""

from __future__ import annotations

import multiprocessing
import re
import resource
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from massid.errors import MassidError

T = TypeVar("T")
Work = Callable[[], T]
"""What is measured."""


class DiedError(MassidError):
    """A process ended without a word, as one does that the system takes the memory from."""


@dataclass(frozen=True)
class Spent(Generic[T]):
    """What work gave and took.

    Attributes:
        value: what it gave.
        processor_s: user and system time of all its threads [s].
        wall_s: from its beginning to its end [s].
        before_mib: most memory that the process had held when the work began [MiB].
        peak_mib: most memory that it held until the end [MiB].
    """

    value: T
    processor_s: float
    wall_s: float
    before_mib: float
    peak_mib: float


def run_apart(prepare: Callable[[], Work[T]]) -> Spent[T]:
    """Prepare work in a new interpreter, then measure it there.

    Args:
        prepare: returns the work; must be picklable, as must be what the work gives.

    Raises:
        MassidError: whatever the work raises of this kind, or that its process died.
    """
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        try:
            return pool.submit(measured, prepare).result()
        except BrokenProcessPool:
            raise DiedError("its process died; it may have run out of memory") from None


def measured(prepare: Callable[[], Work[T]]) -> Spent[T]:
    """Prepare work and measure it in this process."""
    work = prepare()
    before_mib, started, processor_s = peak_mib(), time.perf_counter(), time.process_time()
    value = work()
    return Spent(
        value=value,
        processor_s=time.process_time() - processor_s,
        wall_s=time.perf_counter() - started,
        before_mib=before_mib,
        peak_mib=peak_mib(),
    )


def peak_mib() -> float:
    """Most memory that this process has held [MiB]."""
    status = Path("/proc/self/status")
    # Linux hands ru_maxrss down to whatever a process starts: a small child of a large parent would look large.
    if status.exists() and (found := re.search(r"VmHWM:\s+(\d+) kB", status.read_text())):
        return int(found[1]) / 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 1024
