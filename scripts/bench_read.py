"""Time and peak memory of reading a 30 s log of a 30-joint robot at 1 kHz.

    python scripts/bench_read.py

Memory is what reading adds to the process at its peak, as the operating system tells it.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from massid.log import WalkWriter, read_walk

SAMPLES, JOINTS, FEET, REPEATS = 30_000, 30, 2, 5


def write_log(path: Path) -> None:
    """Write random samples."""
    rng = np.random.default_rng(0)
    names = [f"joint_{k}" for k in range(JOINTS)]
    with WalkWriter(path, root_body="base", joint_names=names, timestep_s=1e-3) as writer:
        for start in range(0, SAMPLES, 1000):
            qpos = rng.standard_normal((1000, 7 + JOINTS))
            qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
            stamps = 1_767_225_600_000_000_000 + (start + np.arange(1000)) * 1_000_000
            wrenches = {f"foot_{k}": rng.standard_normal((1000, 6)) for k in range(FEET)}
            velocity, effort = rng.standard_normal((1000, 6 + JOINTS)), rng.standard_normal((1000, JOINTS))
            writer.append_block(stamps, qpos, velocity, effort, wrenches)


def measure(path: Path) -> str:
    """Read in this process; returns one line of figures."""
    read_walk(path)  # imports and first-use costs
    times = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        walk = read_walk(path)
        times.append(time.perf_counter() - started)
    arrays = sum(a.nbytes for a in (walk.stamps_ns, walk.qpos, walk.qvel, walk.effort, walk.wrench)) / 2**20
    return f"read {min(times):.3f} s (best of {REPEATS}), arrays {arrays:.1f} MiB"


def peak_mib() -> float:
    """Largest resident size of this process [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Write a log, read it in processes of their own, print the figures."""
    if len(sys.argv) > 2:
        mode, path = sys.argv[1], Path(sys.argv[2])
        if mode == "time":
            sys.stdout.write(measure(path) + "\n")
            return
        before = peak_mib()
        walk = read_walk(path)
        arrays = sum(a.nbytes for a in (walk.stamps_ns, walk.qpos, walk.qvel, walk.effort, walk.wrench)) / 2**20
        added = peak_mib() - before
        sys.stdout.write(f"peak memory {added:.0f} MiB above the start, {added / arrays:.2f} times the arrays\n")
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "walk.mcap"
        write_log(path)
        sys.stdout.write(f"{path.stat().st_size / 2**20:.0f} MiB, {SAMPLES} samples, {JOINTS} joints, {FEET} feet\n")
        for mode in ("time", "memory"):
            done = subprocess.run(
                [sys.executable, __file__, mode, str(path)], capture_output=True, text=True, check=True
            )
            sys.stdout.write(done.stdout)


if __name__ == "__main__":
    main()
