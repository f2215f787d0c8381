"""What a slower logger costs: mass errors and the deviations said, at 1000, 500, 200 and 100 Hz.

    python scripts/bench_rate.py walk0.mcap walk1.mcap ...

The walks are clean, at 1 kHz, with NAME.truth.json beside them (`massid record`). Of their first 10 s every second or
so many states are kept; torques and wrenches are means over the period. White noise is drawn after that, or none; then
the same as `noise=clean` takes it stands beside it.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from accuracy.walks import cut
from massid import IdentifyOptions, weigh
from massid.assets import resolve_model
from massid.log import read_walk
from massid.model.robot import Robot
from massid.plant import sensors_of, truth_path
from massid.score import Truth, score
from massid.typing import FloatArray
from massid.walk import Walk

SECONDS = 10.0
STRIDES = (1, 2, 5, 10)


def decimated(walk: Walk, stride: int) -> Walk:
    """Every so many states, and the means of what acted."""
    n = len(walk) // stride * stride

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(values[:n].reshape(n // stride, stride, *values.shape[1:]).mean(axis=1))

    return replace(
        walk,
        stamps_ns=walk.stamps_ns[:n:stride],
        qpos=walk.qpos[:n:stride],
        qvel=walk.qvel[:n:stride],
        effort=mean(walk.effort),
        wrench=mean(walk.wrench),
        timestep_s=walk.timestep_s * stride,
        segments=(),
    )


def main(paths: list[Path]) -> None:
    """Print a line for each rate and kind of log."""
    robot = Robot.load(resolve_model("atlas"))
    kinds = {"white": "white", "none": "auto", "none, as noise=clean": "clean"}
    for stride in STRIDES:
        for kind, noise in kinds.items():
            found: list[tuple[float, float]] = []
            for seed, path in enumerate(paths):
                walk = decimated(robot.align(cut(read_walk(path), 0.0, SECONDS)), stride)
                walk = sensors_of(walk, "white", seed).measure(walk) if kind == "white" else walk
                options = IdentifyOptions(noise=noise, other_links=0.0)
                mode = "offline" if kind == "white" else "auto"
                result = weigh(walk, robot, mode=mode, held_out=0.0, checks=False, options=options)
                said = float(np.linalg.norm(list((result.std_kg or {}).values())))
                found.append((float(score(result, Truth.load(truth_path(path))).l2_error_kg[-1]), said))
            error, deviation = np.sqrt(np.mean(np.square(np.array(found)), axis=0))
            rate = f"{1000 // stride} Hz, noise {kind}"
            sys.stdout.write(f"{rate}: L2 error {error:.2g} kg, {deviation:.3f} kg said, {len(paths)} walks\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main([Path(argument) for argument in sys.argv[1:]])
