"""Record a walk, in MuJoCo's conventions, into an MCAP file that any ROS 2 tool opens as it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from massid.errors import LogError
from massid.log.mcap.schemas import JOINT_STATE, ODOMETRY, WRENCH_STAMPED
from massid.log.mcap.sink import CHUNK_BYTES, McapSink, Topic
from massid.log.topics.map import contact_topic
from massid.outputs import uninterrupted
from massid.typing import AnyArray, FloatArray, IntArray
from massid.walk.conventions import NANOSECONDS, to_body, wxyz_to_xyzw

METADATA_NAME = "massid"
COMPLETE = "complete"
ODOMETRY_TOPIC, JOINT_STATES_TOPIC, CONTACT_PREFIX = "/odom", "/joint_states", "/contact/"
RESERVED_METADATA = ("root_body", "timestep_s", "end")
"""Keys that the recorder writes itself."""
UNMEASURED = "unmeasured_wrenches"
"""Key of the metadata that names bodies which touch the ground and have no sensor, one a line."""
_NORM_TOLERANCE = 1e-6
_LAST_STAMP = (1 << 31) * NANOSECONDS  # ROS counts seconds in an int32
_XYZ = ("x", "y", "z")
_POSE = [f"pose.pose.position.{a}" for a in _XYZ] + [f"pose.pose.orientation.{a}" for a in (*_XYZ, "w")]
_TWIST = [f"twist.twist.{kind}.{a}" for kind in ("linear", "angular") for a in _XYZ]
_WRENCH = [f"wrench.{kind}.{a}" for kind in ("force", "torque") for a in _XYZ]


class WalkWriter:
    """Writes samples of a walk to `PATH.partial`, which becomes PATH when closed.

    Every chunk of 256 KiB holds whole samples and reaches the operating system at once, so a killed recorder
    loses less than one chunk. An exception inside the `with` block still ends in a readable log, whose
    metadata key `end` says why it is short.

    Attributes:
        path: the finished log; replaced if it exists.
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
        companions: Callable[[str], Mapping[Path, bytes]] | None = None,
    ) -> None:
        """Open the log.

        Args:
            path: where to write, `NAME.mcap`.
            root_body: name of the floating base body.
            joint_names: the n_j joints in the order of the columns.
            timestep_s: sample period [s].
            contact_bodies: bodies with a wrench topic from the start; others get one when they first touch.
            metadata: what made the log, as text; `root_body`, `timestep_s` and `end` are added.
            companions: asked at the end, and told what `end` says: files that belong to the log, such as its truth.
                They appear together with it.

        Raises:
            LogError: the file cannot be opened, a name occurs twice, or metadata is not text.
            BadInputError: another process is writing this log.
        """
        self.path = Path(path)
        self.samples = 0
        self._metadata = _checked_metadata(metadata or {}, root_body, timestep_s, self.path)
        self._companions = companions
        self._end: str | None = None
        self._closed = False
        joint_names, contact_bodies = tuple(joint_names), tuple(contact_bodies)
        for kind, names in (("joint", joint_names), ("contact body", contact_bodies)):
            for name in names:
                if names.count(name) > 1:
                    raise LogError(f"{self.path}: the {kind} name '{name}' occurs more than once.")
        self._sink = McapSink(self.path)
        self._sink.add_metadata(METADATA_NAME, self._metadata)
        n_j = len(joint_names)
        self._odometry = self._sink.add_topic(
            ODOMETRY_TOPIC,
            ODOMETRY,
            {"header.frame_id": "world", "child_frame_id": root_body},
            [*_POSE, *_TWIST],
        )
        self._joints = self._sink.add_topic(
            JOINT_STATES_TOPIC,
            JOINT_STATE,
            {"name": joint_names, "position": [0] * n_j, "velocity": [0] * n_j, "effort": [0] * n_j},
            ["position", "velocity", "effort"],
        )
        self._contacts: dict[str, Topic] = {}
        self._capacity = self._samples_per_chunk()
        self._staged = 0
        self._stamps = np.zeros(self._capacity, dtype=np.int64)
        self._stage: dict[str, FloatArray] = {
            "qpos": np.zeros((self._capacity, 7 + n_j)),
            "qvel": np.zeros((self._capacity, 6 + n_j)),
            "effort": np.zeros((self._capacity, n_j)),
        }
        self._wrenches: dict[str, FloatArray] = {}
        self._written: list[IntArray] = []  # stamps of the samples in the file, for back-filling
        self._last_stamp = -1
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
        """Write one sample; shapes as in `append_block`, which is faster, without the leading axis."""
        self.append_block(
            [stamp_ns],
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
            stamps_ns: integers since the Unix epoch [ns], shape (n,), increasing within and between blocks.
            qpos: base position [m], base quaternion (wxyz, unit), joint positions [rad or m],
                shape (n, 7 + n_j).
            qvel: base linear velocity in the world [m/s], base angular velocity in the base frame [rad/s],
                joint velocities [rad/s or m/s], shape (n, 6 + n_j).
            effort: torque that each joint's actuator exerts until the next sample [N m or N], shape (n, n_j).
            wrenches: by body, force [N] and moment [N m] about the body frame's origin that the environment
                exerts on the body, in the body frame, each of shape (n, 6). A body left out has no contact.

        Raises:
            LogError: the log is closed, a shape is wrong, a value is not finite, a quaternion is not of unit
                norm, stamps do not increase, or the file cannot be written. Nothing of the block is kept.
        """
        if self._closed:
            raise LogError(f"{self.path}: the log is closed; no sample can be added.")
        stamps = self._checked_stamps(np.asarray(stamps_ns))
        n = len(stamps)
        block: dict[str, FloatArray] = {}
        for name, values in (("qpos", qpos), ("qvel", qvel), ("effort", effort)):
            block[name] = self._checked(name, values, (n, self._stage[name].shape[1]))
        forces = {body: self._checked(f"wrench of '{body}'", w, (n, 6)) for body, w in wrenches.items()}
        self._check_attitude(block["qpos"][:, 3:7])
        with uninterrupted():  # half a sample would be left
            self._take(stamps, block, forces)

    def _take(self, stamps: IntArray, block: Mapping[str, FloatArray], forces: Mapping[str, FloatArray]) -> None:
        """Stage samples that were checked, and write the chunks that they fill."""
        n = len(stamps)
        for body, wrench in forces.items():
            if body not in self._contacts and wrench.any():
                self._add_contact(body)
        if self._staged >= self._capacity:  # a new topic makes samples larger, and fewer fit into a chunk
            self._write_chunk()
        position = 0
        while position < n:
            taken = min(self._capacity - self._staged, n - position)
            target = slice(self._staged, self._staged + taken)
            source = slice(position, position + taken)
            self._stamps[target] = stamps[source]
            for name, values in block.items():
                self._stage[name][target] = values[source]
            for body, staged in self._wrenches.items():
                staged[target] = forces[body][source] if body in forces else 0.0
            self._staged += taken
            self.samples += taken
            position += taken
            self._last_stamp = int(stamps[position - 1])
            if self._staged >= self._capacity:
                self._write_chunk()

    def annotate(self, key: str, value: str) -> None:
        """Add metadata that is known only at the end."""
        self._metadata = {**self._metadata, key: value}

    def end_because(self, reason: str) -> None:
        """Say why the recording ends early, such as "fell"; stored as metadata `end`, else "complete"."""
        self._end = reason

    def close(self) -> None:
        """Write what is left, the metadata and the index, and give the log its name; again is harmless.

        Raises:
            LogError: no sample was written (the partial file is removed), or the file cannot be written.
        """
        if self._closed:
            return
        if self.samples == 0:
            self.discard()
            raise LogError(f"{self.path}: no sample was recorded, so no log was written.")
        with uninterrupted():
            self._closed = True
            self._write_chunk()
            end = self._end or COMPLETE
            self._sink.add_metadata(METADATA_NAME, {**self._metadata, "end": end})
            companions = {} if self._companions is None else self._companions(end)
            self._sink.finish(int(self._written[0][0]), self._last_stamp, companions)

    def discard(self) -> None:
        """Leave nothing of what was written; what stood under the log's name stays."""
        if not self._closed:
            with uninterrupted():
                self._closed = True
                self._sink.discard()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is not None and self.samples == 0:
            self.discard()
            return
        if kind is not None and self._end is None:
            self._end = " ".join(f"{kind.__name__}: {error}".split())
        self.close()

    def _checked_stamps(self, stamps: AnyArray) -> IntArray:
        if stamps.ndim != 1 or not (np.issubdtype(stamps.dtype, np.integer) or stamps.size == 0):
            raise LogError(
                f"{self.path}: stamps have shape {stamps.shape} and type {stamps.dtype}, expected (n,) integers."
            )
        stamps = stamps.astype(np.int64)
        if (stamps >= _LAST_STAMP).any():
            raise LogError(f"{self.path}: the stamp {stamps.max()} ns is past {_LAST_STAMP} ns, the end of ROS time.")
        before = np.concatenate([[self._last_stamp], stamps[:-1]])
        if (stamps <= before).any():
            row = int(np.argmax(stamps <= before))
            raise LogError(
                f"{self.path}: sample {self.samples + row} has the stamp {stamps[row]} ns, "
                f"expected more than {before[row]} ns."
            )
        return stamps

    def _checked(self, name: str, values: ArrayLike, shape: tuple[int, int]) -> FloatArray:
        array = np.asarray(values, dtype=np.float64)
        if array.shape != shape:
            raise LogError(f"{self.path}: {name} has shape {array.shape}, expected {shape}.")
        if not np.isfinite(array).all():
            row, column = np.argwhere(~np.isfinite(array))[0]
            raise LogError(
                f"{self.path}: {name} is {array[row, column]} at sample {self.samples + row}, column {column}."
            )
        return array

    def _check_attitude(self, quaternion: FloatArray) -> None:
        off = np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) > _NORM_TOLERANCE
        if off.any():
            row = int(np.argmax(off))
            raise LogError(
                f"{self.path}: the base quaternion of sample {self.samples + row} is {quaternion[row]}, "
                "expected unit norm."
            )

    def _add_contact(self, body: str) -> None:
        """Give a body its topic, with a zero wrench for each sample that is already in the file."""
        name = contact_topic(CONTACT_PREFIX, body, self._sink.topics)
        topic = self._sink.add_topic(name, WRENCH_STAMPED, {"header.frame_id": body}, _WRENCH)
        self._contacts[body] = topic
        self._wrenches[body] = np.zeros((len(self._stamps), 6))
        self._capacity = self._samples_per_chunk()
        written = np.concatenate([np.zeros(0, dtype=np.int64), *self._written])
        per_chunk = CHUNK_BYTES // topic.message_bytes
        for start in range(0, len(written), per_chunk):
            stamps = written[start : start + per_chunk]
            self._sink.write(stamps, [(topic, topic.fill(stamps, {}))])

    def _samples_per_chunk(self) -> int:
        return max(1, CHUNK_BYTES // sum(topic.message_bytes for topic in self._sink.topics.values()))

    def _write_chunk(self) -> None:
        """Turn the staged samples into one chunk."""
        n = self._staged
        if n == 0:
            return
        self._staged = 0
        stamps = self._stamps[:n].copy()
        qpos, qvel, effort = (self._stage[name][:n] for name in ("qpos", "qvel", "effort"))
        attitude = qpos[:, 3:7]
        pose = np.hstack([qpos[:, :3], wxyz_to_xyzw(attitude)])
        twist = np.hstack([to_body(attitude, qvel[:, :3]), qvel[:, 3:6]])
        columns: list[tuple[Topic, dict[str, AnyArray]]] = [
            (self._odometry, {**_by_field(_POSE, pose), **_by_field(_TWIST, twist)}),
            (self._joints, {"position": qpos[:, 7:], "velocity": qvel[:, 6:], "effort": effort}),
        ]
        for body, topic in self._contacts.items():
            columns.append((topic, dict(_by_field(_WRENCH, self._wrenches[body][:n]))))
        self._sink.write(stamps, [(topic, topic.fill(stamps, fields)) for topic, fields in columns])
        self._written.append(stamps)


def _by_field(fields: Sequence[str], values: FloatArray) -> dict[str, FloatArray]:
    return dict(zip(fields, values.T, strict=True))


def _checked_metadata(metadata: Mapping[str, str], root_body: str, timestep_s: float, path: Path) -> dict[str, str]:
    for key, value in metadata.items():
        if not (isinstance(key, str) and isinstance(value, str)):
            raise LogError(f"{path}: metadata must be text, but {key!r} is {value!r}.")
        if key in RESERVED_METADATA:
            raise LogError(f"{path}: the metadata key '{key}' is written by the recorder itself.")
    if not timestep_s > 0.0:
        raise LogError(f"{path}: the timestep is {timestep_s} s, expected more than 0.")
    return {**metadata, "root_body": root_body, "timestep_s": repr(float(timestep_s))}
