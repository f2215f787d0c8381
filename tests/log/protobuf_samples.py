"""A log of protobuf messages, with the descriptors that foreign recorders embed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import Writer

from tests.log.samples import JOINTS, ROOT, Samples, rotation

_DOUBLE, _INT, _TEXT, _MESSAGE = (
    descriptor_pb2.FieldDescriptorProto.TYPE_DOUBLE,
    descriptor_pb2.FieldDescriptorProto.TYPE_INT64,
    descriptor_pb2.FieldDescriptorProto.TYPE_STRING,
    descriptor_pb2.FieldDescriptorProto.TYPE_MESSAGE,
)
_TYPES: dict[str, list[tuple[str, Any, bool]]] = {
    "Time": [("sec", _INT, False), ("nanosec", _INT, False)],
    "Header": [("stamp", "Time", False), ("frame_id", _TEXT, False)],
    "Vector": [(axis, _DOUBLE, False) for axis in "xyz"],
    "Quaternion": [(axis, _DOUBLE, False) for axis in "xyzw"],
    "Pose": [("position", "Vector", False), ("orientation", "Quaternion", False)],
    "PoseBox": [("pose", "Pose", False)],
    "Twist": [("linear", "Vector", False), ("angular", "Vector", False)],
    "TwistBox": [("twist", "Twist", False)],
    "Odometry": [
        ("header", "Header", False),
        ("child_frame_id", _TEXT, False),
        ("pose", "PoseBox", False),
        ("twist", "TwistBox", False),
    ],
    "JointState": [
        ("header", "Header", False),
        ("name", _TEXT, True),
        ("position", _DOUBLE, True),
        ("velocity", _DOUBLE, True),
        ("effort", _DOUBLE, True),
    ],
    "Wrench": [("force", "Vector", False), ("torque", "Vector", False)],
    "WrenchStamped": [("header", "Header", False), ("wrench", "Wrench", False)],
}


def descriptors() -> descriptor_pb2.FileDescriptorSet:
    """The message types, as a compiler of .proto files would describe them."""
    file = descriptor_pb2.FileDescriptorProto(name="robot.proto", package="robot", syntax="proto3")
    for name, fields in _TYPES.items():
        message = file.message_type.add(name=name)
        for number, (field, kind, repeated) in enumerate(fields, start=1):
            label = 3 if repeated else 1
            if isinstance(kind, str):
                message.field.add(name=field, number=number, label=label, type=_MESSAGE, type_name=f".robot.{kind}")
            else:
                message.field.add(name=field, number=number, label=label, type=kind)
    return descriptor_pb2.FileDescriptorSet(file=[file])


def write_protobuf(path: Path, samples: Samples) -> Path:
    """Write samples as protobuf channels."""
    described = descriptors()
    pool = descriptor_pool.DescriptorPool()
    pool.Add(described.file[0])
    make = {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"robot.{name}")) for name in _TYPES}

    def vector(values: Any) -> Any:
        return make["Vector"](**dict(zip("xyz", map(float, values), strict=True)))

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channels = {}
        for topic, kind in (
            ("/odom", "Odometry"),
            ("/joint_states", "JointState"),
            ("/contact/l_foot", "WrenchStamped"),
        ):
            schema = writer.register_schema(f"robot.{kind}", "protobuf", described.SerializeToString())
            channels[topic] = writer.register_channel(topic, "protobuf", schema)
        for k in range(len(samples)):
            stamp = int(samples.stamps[k])
            time = make["Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
            w, x, y, z = samples.qpos[k, 3:7].tolist()
            pose = make["Pose"](
                position=vector(samples.qpos[k, :3]), orientation=make["Quaternion"](x=x, y=y, z=z, w=w)
            )
            twist = make["Twist"](
                linear=vector(rotation(samples.qpos[k, 3:7]).T @ samples.qvel[k, :3]),
                angular=vector(samples.qvel[k, 3:6]),
            )
            wrench = samples.wrenches["l_foot"][k]
            messages = {
                "/odom": make["Odometry"](
                    header=make["Header"](stamp=time),
                    child_frame_id=ROOT,
                    pose=make["PoseBox"](pose=pose),
                    twist=make["TwistBox"](twist=twist),
                ),
                "/joint_states": make["JointState"](
                    header=make["Header"](stamp=time),
                    name=JOINTS,
                    position=samples.qpos[k, 7:],
                    velocity=samples.qvel[k, 6:],
                    effort=samples.effort[k],
                ),
                "/contact/l_foot": make["WrenchStamped"](
                    header=make["Header"](stamp=time, frame_id="l_foot"),
                    wrench=make["Wrench"](force=vector(wrench[:3]), torque=vector(wrench[3:])),
                ),
            }
            for topic, message in messages.items():
                writer.add_message(channels[topic], stamp, message.SerializeToString(), stamp)
        writer.finish()
    return path
