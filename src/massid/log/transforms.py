"""The pose of a frame that transforms give link by link: odom to base_footprint, and that to the base.

A topic of transforms may hold the base's pose in a frame that moves itself. Then the frames above it are followed to
one that nothing moves, and their transforms are multiplied, at the times of the link that comes most often.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from massid.errors import LogError
from massid.log.columns import TopicColumns
from massid.log.mcap.container import TopicInfo
from massid.log.messages.decoding import Block, DecodingError, make_decoder
from massid.typing import FloatArray, IntArray
from massid.walk import resampling
from massid.walk.conventions import to_world, wxyz_to_xyzw, xyzw_to_wxyz

TRANSFORMS = "tf2_msgs/msg/TFMessage"
STATIC = "/tf_static"
_CHILD = re.compile(r"transforms\[(\d+)\]\.child_frame_id")
_LONGEST = 32
_ODOM = "odom"


@dataclass
class FrameTree:
    """Which frame each frame is given in, and on which topic."""

    parents: dict[str, tuple[str, str]] = field(default_factory=dict)

    def receive(self, info: TopicInfo, records: list[bytes]) -> None:
        """Learn from a batch of messages; what cannot be decoded is told by whoever needs it."""
        if info.message_type != TRANSFORMS:
            return
        try:
            for block in make_decoder(info, {}).decode(records):
                if isinstance(block, Block):
                    for path, (child,) in ((p, t) for p, t in block.texts.items() if _CHILD.fullmatch(p)):
                        parent = block.texts.get(path.replace("child_frame_id", "header.frame_id"), ("",))[0]
                        self.parents.setdefault(_plain(child), (_plain(parent), info.topic))
        except DecodingError:
            return

    def above(self, body: str) -> tuple[tuple[str, str], ...]:
        """Frames from a body up, each with the topic of its transform, to `odom` or as far as transforms are given.

        By convention `odom` does not move, and what is above it jumps where a map is corrected.

        Raises:
            LogError: the frames go round in a circle.
        """
        found: list[tuple[str, str]] = []
        frame = _plain(body)
        while frame in self.parents and frame.split("/")[-1] != _ODOM and len(found) < _LONGEST:
            parent, topic = self.parents[frame]
            found.append((frame, topic))
            frame = parent
        if len(found) == _LONGEST:
            raise LogError(f"the transforms above '{body}' go round in a circle: {', '.join(f for f, _ in found[:6])}.")
        return tuple(found)


class Chain:
    """Transforms of the frames from a body up to one that nothing moves.

    Args:
        source: name of the file, for messages.
        frames: see `FrameTree.above`; two at least.
    """

    def __init__(self, source: str, frames: tuple[tuple[str, str], ...]) -> None:
        self._source, self._frames = source, frames
        self._links: dict[str, TopicColumns] = {}

    def uses(self, topic: str) -> bool:
        """Whether a topic holds one of the transforms."""
        return any(topic == own for _, own in self._frames)

    def receive(self, info: TopicInfo, records: list[bytes]) -> None:
        """Take a batch of messages."""
        for frame, topic in self._frames:
            if topic == info.topic:
                if frame not in self._links:
                    at = f"transforms[child_frame_id={frame}].transform"
                    wanted = {"translation": (f"{at}.translation",), "rotation": (f"{at}.rotation",)}
                    self._links[frame] = TopicColumns(self._source, info, wanted, f"{topic} ({frame})")
                self._links[frame].receive(info, records)

    def columns(self, keys: Mapping[str, str], wanted: Mapping[str, tuple[str, ...]]) -> TopicColumns:
        """The poses of the body as one topic.

        Args:
            keys: under which key the `translation` and the `rotation` (xyzw) are asked for.
            wanted: fields by key, as of any topic.

        Raises:
            LogError: a transform is given too rarely to be followed.
        """
        links = [self._links[frame] for frame, _ in self._frames]
        counts = [len(link) for link in links]
        lead = links[int(np.argmax(counts))]
        stamps, log_ns = _times(lead), lead.log_ns()
        position, attitude = np.zeros((len(stamps), 3)), np.tile([1.0, 0.0, 0.0, 0.0], (len(stamps), 1))
        for link in links:  # from the body up: what is below is turned and moved by what is above
            offset, turn = _at(link, stamps)
            position = offset + to_world(turn, position)
            attitude = resampling.multiply(turn, attitude)
        columns = {keys["translation"]: position, keys["rotation"]: wxyz_to_xyzw(attitude)}
        rest = {key: values for key, values in columns.items() if key in wanted}
        return TopicColumns(self._source, lead.info, wanted, blocks=[Block(log_ns, lead.header_ns(), rest, {})])

    @property
    def said(self) -> str:
        """What was done."""
        names = ", ".join(frame for frame, _ in self._frames)
        return f"{self._frames[0][1]}: the pose of {self._frames[0][0]} was followed through the transforms of {names}."


def _times(link: TopicColumns) -> IntArray:
    header = link.header_ns()
    return link.log_ns() if header is None else header


def _at(link: TopicColumns, stamps: IntArray) -> tuple[FloatArray, FloatArray]:
    """A link's translation and attitude (wxyz) at some times: as they are, between two of them, or all along."""
    times = _times(link)
    offset, turn = link.values("translation", 3), xyzw_to_wxyz(link.values("rotation", 4))
    if len(times) == len(stamps) and np.array_equal(times, stamps):
        return offset, turn
    order = np.unique(times, return_index=True)[1]
    times, offset, turn = times[order], offset[order], turn[order]
    if len(times) == 1:
        return np.repeat(offset, len(stamps), axis=0), np.repeat(turn, len(stamps), axis=0)
    at = resampling.Bracket.find(times, stamps)
    between = resampling.rotation_between(turn[at.index], turn[at.index + 1])
    return resampling.linear(times, offset, stamps), resampling.multiply(
        turn[at.index], resampling.from_rotation(at.share * between)
    )


def _plain(frame: str) -> str:
    return frame.removeprefix("/")
