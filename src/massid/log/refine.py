"""Put a walk on a finer clock: that of the model's own time step, when the log has only every second or fifth step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massid.log import resampling
from massid.log.conventions import NANOSECONDS
from massid.log.walk import Segment, Walk
from massid.typing import AnyArray


def refined(walk: Walk, factor: int) -> Walk:
    """Divide every sample period.

    States between samples follow cubics with the measured velocities as slopes, velocities straight lines; torques and
    wrenches are held. Samples at the old stamps keep their values.

    Args:
        walk: on an even clock.
        factor: new samples for each old one, >= 1.
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
        columns["qpos"].append(
            np.hstack(
                [
                    resampling.cubic(even, qpos[:, :3], qvel[:, :3], grid),
                    resampling.attitude(even, qpos[:, 3:7], qvel[:, 3:6], grid),
                    resampling.cubic(even, qpos[:, 7:], qvel[:, 6:], grid),
                ]
            )
        )
        columns["qvel"].append(resampling.linear(even, qvel, grid))
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
