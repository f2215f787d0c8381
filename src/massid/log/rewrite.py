"""Write a walk that was read, or changed, as massid records it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from massid.errors import LogError
from massid.log.writer import COMPLETE, RESERVED_METADATA, UNMEASURED, WalkWriter
from massid.walk import Walk


def write_walk(
    walk: Walk,
    path: Path | str,
    metadata: Mapping[str, str] | None = None,
    companions: Mapping[Path, bytes] | None = None,
) -> Path:
    """Write a walk to a new log: all of it, or none. Gaps stay gaps, and how the recording ended is kept.

    A body none of whose wrench was measured gets no topic; its name stands in the metadata.

    Args:
        walk: with its wrenches in the bodies' frames.
        path: the log to write, NAME.mcap; replaced if it exists.
        metadata: what to say differently from the walk's own metadata.
        companions: files that belong to the log and appear together with it.

    Raises:
        LogError: wrenches are given in the world, or the log cannot be written.
    """
    if walk.world_wrenches:
        raise LogError(
            f"The wrenches of {', '.join(walk.world_wrenches)} are given in the world; identify takes them, but a log "
            "of massid holds them in their bodies."
        )
    blind = [body for body, axes in zip(walk.contact_bodies, walk.measured, strict=True) if not axes.any()]
    said = {**walk.metadata, **(metadata or {})} | ({UNMEASURED: "\n".join(blind)} if blind else {})
    read = [(c, body) for c, body in enumerate(walk.contact_bodies) if body not in blind]
    writer = WalkWriter(
        path,
        root_body=walk.root_body,
        joint_names=walk.joint_names,
        timestep_s=walk.timestep_s,
        contact_bodies=[body for _, body in read],
        metadata={key: value for key, value in said.items() if key not in RESERVED_METADATA},
        companions=lambda end: companions or {},
    )
    try:
        for segment in walk.segments:
            rows = slice(segment.start, segment.stop)
            wrenches = {body: walk.wrench[rows, c] for c, body in read}
            writer.append_block(walk.stamps_ns[rows], walk.qpos[rows], walk.qvel[rows], walk.effort[rows], wrenches)
        if said.get("end", COMPLETE) != COMPLETE:
            writer.end_because(said["end"])
        writer.close()
    except BaseException:
        writer.discard()  # the walk is still there to be written again
        raise
    return writer.path
