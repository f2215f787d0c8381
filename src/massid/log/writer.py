"""Record a walk into an MCAP file that any ROS 2 tool opens as it is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import ArrayLike

from massid.errors import LogError
from massid.log.cdr import Layout, encode, parse_schema, trace
from massid.log.conventions import NANOSECONDS, to_body, wxyz_to_xyzw
from massid.log.rosbag2 import TopicCount, channel_metadata, file_metadata
from massid.log.schemas import JOINT_STATE, ODOMETRY, WRENCH_STAMPED, definition_text
from massid.log.topics import TopicMap, contact_topic
from massid.typing import AnyArray, FloatArray, IntArray

METADATA_NAME = "massid"
COMPLETE = "complete"
_CHUNK_BYTES = 256 * 1024
_NEVER = 1 << 62  # chunks end where this module says so: between two samples
_RECORD_BYTES = 31  # what MCAP adds to each message
_RESERVED = ("root_body", "timestep_s", "end")
_XYZ = ("x", "y", "z")
_STAMP = ("header.stamp.sec", "header.stamp.nanosec")


@dataclass
class _Topic:
    """A topic being written: its channel, and the record array that makes messages of it."""

    name: str
    message_type: str
    channel: int
    layout: Layout
    record: np.dtype[np.void]
    messages: int = 0

    def fill(self, stamps_ns: IntArray, columns: Mapping[str, AnyArray]) -> bytes:
        """Return one message per stamp, concatenated."""
        rows = np.frombuffer(bytearray(self.layout.example) * len(stamps_ns), dtype=self.record)
        rows["header.stamp.sec"], rows["header.stamp.nanosec"] = np.divmod(stamps_ns, NANOSECONDS)
        for path, values in columns.items():
            rows[path] = values
        return rows.tobytes()


class WalkWriter:
    """Writes samples of a walk, in MuJoCo's conventions, to `PATH.partial` and renames it to PATH when closed.

    Every chunk of 256 KiB holds whole samples and reaches the operating system at once, so a killed recorder loses
    less than one chunk. An exception inside the `with` block still ends in a readable log, and the metadata key
    `end` says why it is short.

    Attributes:
        path: the finished log; replaced if it exists.
        partial_path: where the log lies until it is closed.
        samples: number of samples appended so far.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        root_body: str,
        joint_names: Sequence[str],
        timestep_s: float,
        contact_bodies: Sequence[str] = (),
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        """Open the log.

        Args:
            path: where to write, `NAME.mcap`.
            root_body: name of the floating base body.
            joint_names: the n_j joints in the order of the columns.
            timestep_s: sample period [s].
            contact_bodies: bodies that have a wrench topic from the start; others get one when they first touch.
            metadata: what made the log, as text; `root_body`, `timestep_s` and `end` are added.

        Raises:
            LogError: the file cannot be opened, a name occurs twice, or metadata is not text.
        """
        self.path = Path(path)
        self.partial_path = self.path.with_name(self.path.name + ".partial")
        self.samples = 0
        self._metadata = _checked_metadata(metadata or {}, root_body, timestep_s, self.path)
        self._end: str | None = None
        self._closed = False
        joint_names = tuple(joint_names)
        for kind, names in (("joint", joint_names), ("contact body", tuple(contact_bodies))):
            repeated = sorted({name for name in names if list(names).count(name) > 1})
            if repeated:
                raise LogError(f"{self.path}: the {kind} name '{repeated[0]}' occurs more than once.")
        with self._file_errors():
            self._stream = self.partial_path.open("wb")
        self._writer = Writer(
            self._stream, chunk_size=_NEVER, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._topics: dict[str, _Topic] = {}
        self._schemas: dict[str, int] = {}
        self._stamps: list[IntArray] = []  # of the samples already handed to the writer, for back-filling
        self._last_stamp = -1
        n_j = len(joint_names)
        with self._file_errors():
            self._writer.start(profile="ros2", library="massid")
            self._writer.add_metadata(METADATA_NAME, self._metadata)
            self._stream.flush()
        topics = TopicMap()
        self._odometry = self._add_topic(
            topics.odometry.topic,
            ODOMETRY,
            {"header.frame_id": "world", "child_frame_id": root_body},
            [f"pose.pose.position.{axis}" for axis in _XYZ]
            + [f"pose.pose.orientation.{axis}" for axis in (*_XYZ, "w")]
            + [f"twist.twist.{kind}.{axis}" for kind in ("linear", "angular") for axis in _XYZ],
        )
        zeros = np.zeros(n_j)
        self._joints = self._add_topic(
            topics.joint_states.topic,
            JOINT_STATE,
            {"name": joint_names, "position": zeros, "velocity": zeros, "effort": zeros},
            ["position", "velocity", "effort"],
        )
        self._contacts: dict[str, _Topic] = {}
        self._capacity = self._samples_per_chunk()
        self._staged = 0
        self._stage = {
            "stamps": np.zeros(self._capacity, dtype=np.int64),
            "qpos": np.zeros((self._capacity, 7 + n_j)),
            "qvel": np.zeros((self._capacity, 6 + n_j)),
            "effort": np.zeros((self._capacity, n_j)),
        }
        self._staged_wrenches: dict[str, FloatArray] = {}
        for body in contact_bodies:
            self._add_contact(body)

    def append(
        self,
        stamp_ns: int,
        qpos: ArrayLike,
        qvel: ArrayLike,
        effort: ArrayLike,
        wrenches: Mapping[str, ArrayLike],
    ) -> None:
        """Write one sample; see `append_block`, which is faster, for shapes without the leading axis."""
        self.append_block(
            np.array([stamp_ns], dtype=np.int64),
            np.asarray(qpos)[None],
            np.asarray(qvel)[None],
            np.asarray(effort)[None],
            {body: np.asarray(wrench)[None] for body, wrench in wrenches.items()},
        )

    def append_block(
        self,
        stamps_ns: ArrayLike,
        qpos: ArrayLike,
        qvel: ArrayLike,
        effort: ArrayLike,
        wrenches: Mapping[str, ArrayLike],
    ) -> None:
        """Write n samples.

        Args:
            stamps_ns: since the Unix epoch [ns], shape (n,), increasing from sample to sample and block to block.
            qpos: base position [m], base quaternion (wxyz, unit), joint positions [rad or m], shape (n, 7 + n_j).
            qvel: base linear velocity in the world [m/s], base angular velocity in the base frame [rad/s], joint
                velocities [rad/s or m/s], shape (n, 6 + n_j).
            effort: torque that each joint's actuator exerts from this sample to the next [N m or N], shape (n, n_j).
            wrenches: by body, force [N] and moment [N m] about the body frame's origin that the environment exerts
                on the body, in the body frame, each of shape (n, 6). A body left out has no contact: zeros.

        Raises:
            LogError: the log is closed, a shape is wrong, a value is not finite, a quaternion is not of unit norm,
                stamps do not increase, or the file cannot be written.
        """
        if self._closed:
            raise LogError(f"{self.path}: the log is closed; no sample can be added.")
        block = {
            "stamps": np.atleast_1d(np.asarray(stamps_ns)).astype(np.int64),
            "qpos": np.asarray(qpos, dtype=np.float64),
            "qvel": np.asarray(qvel, dtype=np.float64),
            "effort": np.asarray(effort, dtype=np.float64),
        }
        forces = {body: np.asarray(wrench, dtype=np.float64) for body, wrench in wrenches.items()}
        self._check(block, forces)
        n = len(block["stamps"])
        if n == 0:
            return
        for body, wrench in forces.items():
            if body not in self._contacts and wrench.any():
                self._add_contact(body)
        position = 0
        while position < n:
            taken = min(self._capacity - self._staged, n - position)
            target = slice(self._staged, self._staged + taken)
            source = slice(position, position + taken)
            for name, values in block.items():
                self._stage[name][target] = values[source]
            for body, staged in self._staged_wrenches.items():
                staged[target] = forces[body][source] if body in forces else 0.0
            self._staged += taken
            position += taken
            if self._staged >= self._capacity:
                self._write_chunk()
        self.samples += n
        self._last_stamp = int(block["stamps"][-1])

    def end_because(self, reason: str) -> None:
        """Say why the recording ends early, such as "fell"; stored as metadata key `end` instead of "complete"."""
        self._end = reason

    def close(self) -> None:
        """Write what is left, the index and the metadata, and give the log its name; again is harmless.

        Raises:
            LogError: no sample was written (the partial file is removed), or the file cannot be written.
        """
        if self._closed:
            return
        self._closed = True
        if self.samples == 0:
            self._discard()
            raise LogError(f"{self.path}: no sample was recorded, so no log was written.")
        with self._file_errors():
            try:
                self._write_chunk()
                self._writer.add_metadata(METADATA_NAME, {**self._metadata, "end": self._end or COMPLETE})
                self._writer.add_metadata("rosbag2", self._rosbag2_metadata())
                self._writer.finish()
            finally:
                self._stream.close()
            self.partial_path.replace(self.path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is not None:
            if self.samples == 0:
                self._closed = True
                self._discard()
                return
            if self._end is None:
                lines = str(error).splitlines()
                self._end = f"{kind.__name__}: {lines[0]}" if lines else kind.__name__
        self.close()

    def _check(self, block: Mapping[str, AnyArray], forces: Mapping[str, FloatArray]) -> None:
        n = len(block["stamps"])
        expected = {name: (n, *stage.shape[1:]) for name, stage in self._stage.items()}
        arrays = {**block, **{f"the wrench of '{body}'": wrench for body, wrench in forces.items()}}
        for name, values in arrays.items():
            shape = expected.get(name, (n, 6))
            if values.shape != shape:
                raise LogError(f"{self.path}: {name} has shape {values.shape}, expected {shape}.")
            if not np.isfinite(values).all():
                row, column = np.argwhere(~np.isfinite(values))[0]
                raise LogError(
                    f"{self.path}: {name} is {values[row, column]} at sample {self.samples + row}, column {column}."
                )
        steps = np.diff(block["stamps"], prepend=self._last_stamp)
        if n and steps.min() <= 0:
            row = int(np.argmin(steps > 0))
            raise LogError(
                f"{self.path}: the stamp {block['stamps'][row]} ns of sample {self.samples + row} is not later than "
                f"{block['stamps'][row] - steps[row]} ns before it."
            )
        norm = np.linalg.norm(block["qpos"][:, 3:7], axis=1)
        if n and np.abs(norm - 1.0).max() > 1e-6:
            row = int(np.argmax(np.abs(norm - 1.0)))
            raise LogError(
                f"{self.path}: the base quaternion of sample {self.samples + row} has norm {norm[row]:.9g}, expected 1."
            )

    def _add_topic(self, name: str, message_type: str, example: Mapping[str, object], paths: Sequence[str]) -> _Topic:
        text = definition_text(message_type)
        if message_type not in self._schemas:
            self._schemas[message_type] = self._writer.register_schema(message_type, "ros2msg", text.encode())
        channel = self._writer.register_channel(
            name, "cdr", self._schemas[message_type], channel_metadata(message_type)
        )
        schema = parse_schema(message_type, text)
        layout = trace(schema, encode(schema, example))
        topic = _Topic(name, message_type, channel, layout, layout.record_dtype([*_STAMP, *paths]))
        self._topics[name] = topic
        return topic

    def _add_contact(self, body: str) -> None:
        """Give a body its topic, with a zero wrench for each sample that is already in the file."""
        name = contact_topic(TopicMap().contacts.prefix, body, self._topics)
        paths = [f"wrench.{kind}.{axis}" for kind in ("force", "torque") for axis in _XYZ]
        topic = self._add_topic(name, WRENCH_STAMPED, {"header.frame_id": body}, paths)
        self._contacts[body] = topic
        self._staged_wrenches[body] = np.zeros((len(self._stage["stamps"]), 6))
        self._capacity = min(self._capacity, self._samples_per_chunk())
        per_chunk = max(1, _CHUNK_BYTES // (topic.layout.size + _RECORD_BYTES))
        written = np.concatenate(self._stamps) if self._stamps else np.zeros(0, dtype=np.int64)
        for start in range(0, len(written), per_chunk):
            stamps = written[start : start + per_chunk]
            self._feed(stamps, [(topic, topic.fill(stamps, {}))])

    def _samples_per_chunk(self) -> int:
        sample_bytes = sum(topic.layout.size + _RECORD_BYTES for topic in self._topics.values())
        return max(1, _CHUNK_BYTES // sample_bytes)

    def _write_chunk(self) -> None:
        """Turn the staged samples into one chunk and hand it to the operating system."""
        n = self._staged
        if n == 0:
            return
        self._staged = 0
        stamps, qpos, qvel, effort = (self._stage[name][:n] for name in ("stamps", "qpos", "qvel", "effort"))
        attitude = qpos[:, 3:7]
        pose = np.hstack([qpos[:, :3], wxyz_to_xyzw(attitude)])
        twist = np.hstack([to_body(attitude, qvel[:, :3]), qvel[:, 3:6]])
        odometry = dict(zip(self._odometry.record.names or (), [*_STAMP, *pose.T, *twist.T], strict=True))
        batch = [
            (self._odometry, self._odometry.fill(stamps, {k: v for k, v in odometry.items() if k not in _STAMP})),
            (
                self._joints,
                self._joints.fill(
                    stamps, {"position": qpos[:, 7:], "velocity": qvel[:, 6:], "effort": effort}
                ),
            ),
        ]
        for body, topic in self._contacts.items():
            names = (topic.record.names or ())[len(_STAMP) :]
            wrench = self._staged_wrenches[body][:n]
            batch.append((topic, topic.fill(stamps, dict(zip(names, wrench.T, strict=True)))))
        self._feed(stamps, batch)
        self._stamps.append(stamps.copy())

    def _feed(self, stamps: IntArray, batch: Sequence[tuple[_Topic, bytes]]) -> None:
        add = self._writer.add_message
        parts = [(topic, topic.channel, data, topic.layout.size) for topic, data in batch]
        with self._file_errors():
            for k, stamp in enumerate(stamps.tolist()):
                for topic, channel, data, size in parts:
                    add(channel, stamp, data[k * size : (k + 1) * size], stamp, topic.messages)
                    topic.messages += 1
            self._writer.flush()

    def _rosbag2_metadata(self) -> dict[str, str]:
        start = int(self._stamps[0][0])
        counts = [TopicCount(topic.name, topic.message_type, topic.messages) for topic in self._topics.values()]
        return file_metadata(self.path.name, start, self._last_stamp - start, counts)

    def _discard(self) -> None:
        self._stream.close()
        self.partial_path.unlink(missing_ok=True)

    @contextmanager
    def _file_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise LogError(f"{error.filename or self.partial_path}: cannot be written: {error.strerror}.") from error


def _checked_metadata(metadata: Mapping[str, str], root_body: str, timestep_s: float, path: Path) -> dict[str, str]:
    for key, value in metadata.items():
        if not (isinstance(key, str) and isinstance(value, str)):
            raise LogError(f"{path}: metadata must be text, but {key!r} is {value!r}.")
        if key in _RESERVED:
            raise LogError(f"{path}: the metadata key '{key}' is written by the recorder itself.")
    if not timestep_s > 0.0:
        raise LogError(f"{path}: the timestep is {timestep_s} s, expected more than 0.")
    return {**metadata, "root_body": root_body, "timestep_s": repr(float(timestep_s))}
