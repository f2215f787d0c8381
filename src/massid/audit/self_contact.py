"""Samples in which the robot's own links press on each other: no wrench topic shows that, so they are left out."""

from __future__ import annotations

import copy
from collections import Counter
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from massid.model.robot import Robot
from massid.typing import BoolArray
from massid.walk import Segment, Walk

ALWAYS = 0.5
"""Links that overlap in more than this share of the samples do so in the model's geometry, whatever the robot does."""
_SHOWN = 3


@dataclass(frozen=True)
class SelfContact:
    """Contact between the robot's own links.

    Attributes:
        samples: which samples have it, pairs that always overlap left aside, shape (n,).
        pairs: by pair of bodies, in how many samples it touches.
        overlapping: pairs of bodies that overlap in most samples.
    """

    samples: BoolArray
    pairs: dict[tuple[str, str], int]
    overlapping: tuple[tuple[str, str], ...]


def find_self_contact(robot: Robot, walk: Walk) -> SelfContact:
    """Look for contact between links by the model's own geometry and contact rules, at every sample.

    Args:
        robot: any masses.
        walk: aligned with the robot.
    """
    model = copy.copy(robot.model)
    disabled = mujoco.mjtDisableBit
    model.opt.disableflags &= ~int(disabled.mjDSBL_CONTACT | disabled.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    ours = model.body_rootid == model.body_rootid[model.body(robot.root_body).id]
    body_of = model.geom_bodyid
    # Nothing but the robot takes part: the floor would cost time, and its contacts are what the log measures.
    for geom in range(model.ngeom):
        if not ours[body_of[geom]]:
            model.geom_contype[geom] = model.geom_conaffinity[geom] = 0
    qpos = robot.layout.to_qpos(walk.qpos)
    touched: dict[tuple[int, int], list[int]] = {}
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        if not data.ncon:
            continue
        contact = data.contact
        pressed = (contact.dist < contact.includemargin) & (contact.geom >= 0).all(axis=1)
        for first, second in contact.geom[pressed]:
            a, b = int(body_of[first]), int(body_of[second])
            if ours[a] and ours[b]:
                samples = touched.setdefault((min(a, b), max(a, b)), [])
                if not samples or samples[-1] != k:
                    samples.append(k)
    names = {pair: (str(model.body(pair[0]).name), str(model.body(pair[1]).name)) for pair in touched}
    always = [pair for pair, samples in touched.items() if len(samples) > ALWAYS * len(walk)]
    marked = np.zeros(len(walk), dtype=bool)
    counts: Counter[tuple[str, str]] = Counter()
    for pair, samples in touched.items():
        counts[names[pair]] = len(samples)
        if pair not in always:
            marked[samples] = True
    return SelfContact(marked, dict(counts), tuple(names[pair] for pair in always))


def no_self_contact(walk: Walk) -> SelfContact:
    """What is found where nobody looked."""
    return SelfContact(np.zeros(len(walk), dtype=bool), {}, ())


def without_samples(walk: Walk, left_out: BoolArray) -> Walk:
    """Cut a walk's segments where samples are left out; what remains of a segment has at least two samples."""
    segments = []
    for segment in walk.segments:
        good = ~left_out[segment.start : segment.stop]
        edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
        pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        segments += [Segment(segment.start + a, segment.start + b) for a, b in pairs if b - a >= 2]
    return replace(walk, segments=tuple(segments))


def self_contact_warnings(found: SelfContact) -> list[str]:
    """State what was found, one line each."""
    lines = []
    count = int(found.samples.sum())
    if count:
        pairs = sorted(
            (item for item in found.pairs.items() if item[0] not in found.overlapping), key=lambda item: -item[1]
        )
        listed = ", ".join(f"{a} and {b} ({samples})" for (a, b), samples in pairs[:_SHOWN])
        more = f" and {len(pairs) - _SHOWN} more pairs" if len(pairs) > _SHOWN else ""
        lines.append(f"links touch each other in {count} of {len(found.samples)} samples, left out: {listed}{more}.")
    if found.overlapping:
        listed = ", ".join(f"{a} and {b}" for a, b in found.overlapping[:_SHOWN])
        lines.append(
            f"in the model {listed} overlap nearly all the time, taken as a fault of its geometry: <exclude> them."
        )
    return lines
