"""Kill a recorder with SIGKILL at random times: samples lost, and whether each file can be read.

python scripts/bench_kill.py --kills 20
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from massid.log import WalkWriter, read_walk, repair_log

JOINTS = 28


@dataclass(frozen=True)
class Kill:
    """Measure what a kill costs."""

    kills: int = 20
    """How many recorders to kill."""
    seed: int = 0
    """Seeds the times."""
    child: tuple[str, ...] = ()
    """Internal: where the child records and counts."""


def record(log: Path, counter: Path) -> None:
    """Append samples for ever; how many is kept where a kill cannot lose it."""
    count = np.memmap(counter, dtype=np.int64, mode="r+", shape=(1,))
    rng = np.random.default_rng(0)
    names = [f"joint_{k}" for k in range(JOINTS)]
    qpos = np.concatenate([[0, 0, 1, 1, 0, 0, 0], np.zeros(JOINTS)])
    with WalkWriter(log, root_body="base", joint_names=names, timestep_s=1e-3) as writer:
        while True:
            k = int(count[0])
            qpos[7:] = rng.standard_normal(JOINTS)
            wrenches = {"l_foot": rng.standard_normal(6), "r_foot": rng.standard_normal(6)}
            writer.append(10**18 + k * 1_000_000, qpos, np.zeros(6 + JOINTS), rng.standard_normal(JOINTS), wrenches)
            count[0] = k + 1


def main(kill: Kill) -> int:
    """Kill, read, repair, print."""
    if kill.child:
        record(Path(kill.child[0]), Path(kill.child[1]))
        return 0
    rng, losses = np.random.default_rng(kill.seed), []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for index in range(kill.kills):
            log, counter = folder / f"{index}.mcap", folder / f"{index}.count"
            counter.write_bytes(bytes(8))
            child = subprocess.Popen([sys.executable, __file__, "--child", str(log), str(counter)])
            count = np.memmap(counter, dtype=np.int64, mode="r", shape=(1,))
            while int(count[0]) == 0:
                time.sleep(0.01)
            time.sleep(float(rng.uniform(0.2, 2.0)))
            os.kill(child.pid, signal.SIGKILL)
            child.wait()
            partial = log.with_name(f"{log.name}.partial")
            walk = read_walk(partial)
            repaired = read_walk(repair_log(partial, folder / "clean.mcap").path)
            losses.append(int(count[0]) - len(walk))

            sys.stdout.write(
                f"{index}: {int(count[0])} recorded, {len(walk)} read, {losses[-1]} lost; repaired {len(repaired)}, "
                f"warnings {len(repaired.warnings)}\n"
            )
            if len(repaired) != len(walk) or repaired.warnings:
                return 1
    sys.stdout.write(
        f"{kill.kills} kills, all readable; lost at most {max(losses)}, on average {np.mean(losses):.0f}\n"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Kill, description=__doc__)))
