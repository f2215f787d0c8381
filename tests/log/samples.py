"""Samples of a made-up walk, and logs as other recorders write them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.testing import assert_allclose, assert_array_equal
from rosbags.typesys import Stores, get_typestore

from massid.log import WalkWriter
from massid.walk import Segment, Walk

START_NS = 1_760_000_000_123_456_789
STEP_NS = 1_000_000
ROTATION_ROUNDING_M_S = 1e-14  # the base velocity is rotated into the body and back: a few roundings
ROOT = "pelvis"
JOINTS = ("l_hip", "l_knee", "r_hip", "r_knee")
FEET = ("l_foot", "r_foot")
TYPES = {
    "/odom": "nav_msgs/msg/Odometry",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/contact/l_foot": "geometry_msgs/msg/WrenchStamped",
    "/contact/r_foot": "geometry_msgs/msg/WrenchStamped",
}


@dataclass(frozen=True)
class Samples:
    stamps: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    effort: np.ndarray
    wrenches: dict[str, np.ndarray]

    def __len__(self) -> int:
        return len(self.stamps)

    def block(self, start: int, stop: int) -> tuple[Any, ...]:
        part = slice(start, stop)
        wrenches = {body: wrench[part] for body, wrench in self.wrenches.items()}
        return self.stamps[part], self.qpos[part], self.qvel[part], self.effort[part], wrenches


def make_samples(n: int, n_joints: int = len(JOINTS), seed: int = 0) -> Samples:
    rng = np.random.default_rng(seed)
    qpos = rng.standard_normal((n, 7 + n_joints))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    return Samples(
        stamps=START_NS + STEP_NS * np.arange(n),
        qpos=qpos,
        qvel=rng.standard_normal((n, 6 + n_joints)),
        effort=50.0 * rng.standard_normal((n, n_joints)),
        wrenches={body: 300.0 * rng.standard_normal((n, 6)) for body in FEET},
    )


def assert_same(walk: Walk, samples: Samples, rows: slice | np.ndarray = slice(None)) -> None:
    """The walk holds exactly these rows of the samples."""
    assert_array_equal(walk.stamps_ns, samples.stamps[rows])
    assert_array_equal(walk.qpos, samples.qpos[rows])
    assert_array_equal(walk.effort, samples.effort[rows])
    assert_array_equal(walk.qvel[:, 3:], samples.qvel[rows, 3:])
    assert_allclose(walk.qvel[:, :3], samples.qvel[rows, :3], rtol=0, atol=ROTATION_ROUNDING_M_S)
    for column, body in enumerate(walk.contact_bodies):
        assert_array_equal(walk.wrench[:, column], samples.wrenches[body][rows])


def assert_bridged(walk: Walk, samples: Samples, lost: Sequence[int]) -> None:
    """The walk has all stamps in one piece, and exactly these samples but for those that were lost."""
    assert_array_equal(walk.stamps_ns, samples.stamps)
    assert walk.segments == (Segment(0, len(samples)),)
    rows = np.delete(np.arange(len(samples)), lost)
    kept = {name: getattr(walk, name)[rows] for name in ("stamps_ns", "qpos", "qvel", "effort", "wrench")}
    assert_same(replace(walk, segments=(), **kept), samples, rows)


def smooth_samples(n: int) -> Samples:
    """A motion whose velocities are those of its positions, at 10 rad/s."""
    time_s = 1e-3 * np.arange(n)[:, None]
    phase = np.arange(7 + len(JOINTS))
    wave, slope = np.sin(10.0 * time_s + phase), 10.0 * np.cos(10.0 * time_s + phase)
    qpos, qvel = wave.copy(), np.hstack([slope[:, :3], np.zeros((n, 3)), slope[:, 7:]])
    angle = 0.3 * wave[:, 3]
    qpos[:, 3:7] = np.column_stack([np.cos(angle / 2), np.zeros((n, 2)), np.sin(angle / 2)])
    qvel[:, 5] = 0.3 * slope[:, 3]
    return Samples(
        stamps=START_NS + STEP_NS * np.arange(n),
        qpos=qpos,
        qvel=qvel,
        effort=50.0 * wave[:, 7:],
        wrenches={body: 300.0 * wave[:, :6] + 400.0 for body in FEET},
    )


def rotation(wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrix from the body to the world."""
    w, x, y, z = wxyz
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * skew + 2 * skew @ skew


def write_samples(path: Path, samples: Samples, block: int = 100, **options: Any) -> Path:
    settings = {"root_body": ROOT, "joint_names": JOINTS, "timestep_s": 1e-3, **options}
    with WalkWriter(path, **settings) as writer:
        for start in range(0, len(samples), block):
            writer.append_block(*samples.block(start, start + block))
    return path


class Foreign:
    """Messages made by another ROS 2 library, to be changed by a test and written by mcap's own writer."""

    def __init__(self, path: Path, samples: Samples) -> None:
        self.path = path
        self.store = get_typestore(Stores.ROS2_JAZZY)
        self.types = dict(TYPES)
        self.names: dict[str, str] = {}  # what a topic calls its messages in the file
        self.definitions: dict[str, bytes] = {}
        self.encode: Callable[[bytes], bytes] = lambda data: data
        self.serialize: Callable[[Any, str], bytes] | None = None
        self.stamp_of: Callable[[Any], Any] = lambda message: message.header.stamp
        self.channel: Callable[[str, int], int] = lambda topic, row: 0
        self.messages: dict[str, list[Any]] = {topic: [] for topic in TYPES}
        for row in range(len(samples)):
            self._add(samples, row)

    def make(self, message_type: str, /, **fields: Any) -> Any:
        return self.store.types[message_type](**fields)

    def _header(self, stamp: int, frame: str) -> Any:
        time = self.make("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame)

    def _vector(self, values: Sequence[float]) -> Any:
        return self.make("geometry_msgs/msg/Vector3", **dict(zip("xyz", map(float, values), strict=True)))

    def _add(self, samples: Samples, row: int) -> None:
        stamp, q, v = int(samples.stamps[row]), samples.qpos[row], samples.qvel[row]
        body_velocity = rotation(q[3:7]).T @ v[:3]
        pose = self.make(
            "geometry_msgs/msg/Pose",
            position=self.make("geometry_msgs/msg/Point", x=float(q[0]), y=float(q[1]), z=float(q[2])),
            orientation=self.make(
                "geometry_msgs/msg/Quaternion", w=float(q[3]), x=float(q[4]), y=float(q[5]), z=float(q[6])
            ),
        )
        twist = self.make("geometry_msgs/msg/Twist", linear=self._vector(body_velocity), angular=self._vector(v[3:6]))
        covariance = np.zeros(36)
        self.messages["/odom"].append(
            self.make(
                "nav_msgs/msg/Odometry",
                header=self._header(stamp, "world"),
                child_frame_id=ROOT,
                pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance),
                twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=covariance),
            )
        )
        self.messages["/joint_states"].append(
            self.make(
                "sensor_msgs/msg/JointState",
                header=self._header(stamp, ""),
                name=list(JOINTS),
                position=q[7:].copy(),
                velocity=v[6:].copy(),
                effort=samples.effort[row].copy(),
            )
        )
        for body, wrench in samples.wrenches.items():
            self.messages[f"/contact/{body}"].append(
                self.make(
                    "geometry_msgs/msg/WrenchStamped",
                    header=self._header(stamp, body),
                    wrench=self.make(
                        "geometry_msgs/msg/Wrench",
                        force=self._vector(wrench[row, :3]),
                        torque=self._vector(wrench[row, 3:]),
                    ),
                )
            )

    def set_stamp(self, topic: str, row: int, stamp: int) -> None:
        time = self.messages[topic][row].header.stamp
        time.sec, time.nanosec = stamp // 10**9, stamp % 10**9

    def drop(self, topic: str, rows: Iterable[int]) -> None:
        gone = set(rows)
        self.messages[topic] = [m for row, m in enumerate(self.messages[topic]) if row not in gone]

    def write(
        self,
        *,
        little_endian: bool = True,
        schema_encoding: str = "ros2msg",
        message_encoding: str = "cdr",
        order: Sequence[tuple[str, int]] | None = None,
        log_times: Mapping[int, int] | None = None,
        **options: Any,
    ) -> Path:
        """Write topic after topic, or in an order of topics and rows.

        `log_times` by row differ from the stamps, `options` are those of mcap's writer.
        """
        settings: dict[str, Any] = {"chunk_size": 4096, "compression": CompressionType.LZ4, **options}
        with self.path.open("wb") as stream:
            writer = Writer(stream, **settings)
            writer.start(profile="ros2", library="another recorder")
            channels: dict[tuple[str, int], int] = {}
            places = [(topic, row) for topic, messages in self.messages.items() for row in range(len(messages))]
            for topic in self.messages:
                self._channel(writer, channels, (topic, 0), schema_encoding, message_encoding)
            for topic, row in places if order is None else order:
                name, message = self.types[topic], self.messages[topic][row]
                key = (topic, self.channel(topic, row))
                channel = self._channel(writer, channels, key, schema_encoding, message_encoding)
                data = (
                    self.serialize(message, name)
                    if self.serialize
                    else bytes(self.store.serialize_cdr(message, name, little_endian=little_endian))
                )
                time = self.stamp_of(message)
                stamp = time.sec * 10**9 + time.nanosec
                writer.add_message(channel, (log_times or {}).get(row, stamp), self.encode(data), stamp)
            writer.finish()
        return self.path

    def _channel(
        self,
        writer: Writer,
        channels: dict[tuple[str, int], int],
        key: tuple[str, int],
        schema_encoding: str,
        message_encoding: str,
    ) -> int:
        if key not in channels:
            name = self.types[key[0]]
            text = self.definitions.get(name, self.store.generate_msgdef(name, ros_version=2)[0].encode())
            schema = writer.register_schema(self.names.get(key[0], name), schema_encoding, text)
            channels[key] = writer.register_channel(key[0], message_encoding, schema, {"number": str(key[1])})
        return channels[key]


@cache
def _ros1() -> Any:
    return get_typestore(Stores.ROS1_NOETIC)


def as_ros1(message: Any, name: str) -> bytes:
    """A message as ROS 1 serialises it."""
    store = _ros1()
    header = store.types["std_msgs/msg/Header"](seq=3, stamp=message.header.stamp, frame_id=message.header.frame_id)
    fields = {key: getattr(message, key) for key in message.__dataclass_fields__ if not key.startswith("__")}
    return bytes(store.serialize_ros1(store.types[name](**{**fields, "header": header}), name))
