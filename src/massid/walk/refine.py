"""Put a walk on a finer clock: that of the model's own time step, when the log has only every second or fifth step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massid.typing import AnyArray, FloatArray
from massid.walk import resampling
from massid.walk.conventions import NANOSECONDS
from massid.walk.walk import Segment, Walk


def refined(walk: Walk, factor: int, *, semi_implicit: bool = False) -> Walk:
    """Divide every sample period.

    States between samples follow cubics with the measured velocities as slopes, velocities straight lines; torques and
    wrenches are held. Samples at the old stamps keep their values.

    Args:
        walk: on an even clock.
        factor: new samples for each old one, >= 1.
        semi_implicit: for a factor of 2, take the state in between from how simulators move: every step with the
            velocity at its end. Exact for them, but noise of positions is divided by the step.
    """
    if factor <= 1:
        return walk
    period_ns = walk.timestep_s * NANOSECONDS / factor
    columns: dict[str, list[AnyArray]] = {name: [] for name in ("stamps_ns", "qpos", "qvel", "effort", "wrench")}
    segments, total = [], 0
    for segment in walk.segments:
        if len(segment) < 2:
            continue
        rows = slice(segment.start, segment.stop)
        times = walk.stamps_ns[rows]
        even = times[0] + np.rint(np.arange(len(segment)) * period_ns * factor).astype(np.int64)
        grid = even[0] + np.rint(np.arange((len(segment) - 1) * factor + 1) * period_ns).astype(np.int64)
        qpos, qvel = walk.qpos[rows], walk.qvel[rows]
        columns["stamps_ns"].append(grid)
        finer = np.hstack(
            [
                resampling.cubic(even, qpos[:, :3], qvel[:, :3], grid),
                resampling.attitude(even, qpos[:, 3:7], qvel[:, 3:6], grid),
                resampling.cubic(even, qpos[:, 7:], qvel[:, 6:], grid),
            ]
        )
        rates = resampling.linear(even, qvel, grid)
        if semi_implicit and factor == 2:
            finer[1::2], rates[1::2] = _half_way(qpos, qvel, walk.timestep_s / 2)
        columns["qpos"].append(finer)
        columns["qvel"].append(rates)
        held = np.repeat(np.arange(segment.start, segment.stop), factor)[: len(grid)]
        columns["effort"].append(walk.effort[held])
        columns["wrench"].append(walk.wrench[held])
        segments.append(Segment(total, total + len(grid)))
        total += len(grid)
    if not segments:
        return walk
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    return replace(
        walk,
        stamps_ns=joined["stamps_ns"],
        qpos=joined["qpos"],
        qvel=joined["qvel"],
        effort=joined["effort"],
        wrench=joined["wrench"],
        timestep_s=period_ns / NANOSECONDS,
        segments=tuple(segments),
    )


def _half_way(qpos: FloatArray, qvel: FloatArray, step_s: float) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities after the first of two steps, each made with the velocity at its end."""
    before = np.hstack([qpos[1:, :3] - step_s * qvel[1:, :3], np.zeros((len(qpos) - 1, 4)), qpos[1:, 7:]])
    before[:, 7:] -= step_s * qvel[1:, 6:]
    before[:, 3:7] = resampling.multiply(qpos[1:, 3:7], resampling.from_rotation(-step_s * qvel[1:, 3:6]))
    turned = resampling.rotation_between(qpos[:-1, 3:7], before[:, 3:7])
    moved = np.hstack([before[:, :3] - qpos[:-1, :3], turned, before[:, 7:] - qpos[:-1, 7:]])
    return before, moved / step_s
