"""Read a walk from an MCAP log: roles, names, units and conventions checked, every loss stated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from massid.errors import LogError
from massid.log.alignment import Alignment, align
from massid.log.columns import TopicColumns
from massid.log.container import Contents, TopicInfo, read_messages
from massid.log.conventions import NANOSECONDS, to_world, xyzw_to_wxyz
from massid.log.schemas import JOINT_STATE, ODOMETRY, WRENCH_STAMPED
from massid.log.topics import TopicMap
from massid.log.walk import Walk
from massid.log.writer import COMPLETE, METADATA_NAME
from massid.typing import FloatArray

_XYZ = ("x", "y", "z")
_ODOMETRY_GROUPS = {
    "position": [f"pose.pose.position.{axis}" for axis in _XYZ],
    "orientation": [f"pose.pose.orientation.{axis}" for axis in (*_XYZ, "w")],
    "linear velocity": [f"twist.twist.linear.{axis}" for axis in _XYZ],
    "angular velocity": [f"twist.twist.angular.{axis}" for axis in _XYZ],
}
_JOINT_GROUPS = {name: [name] for name in ("position", "velocity", "effort")}
_CONTACT_GROUPS = {"wrench": [f"wrench.{kind}.{axis}" for kind in ("force", "torque") for axis in _XYZ]}
_EXACT_NORM = 1e-6  # farther from 1 than a float32 quaternion gets: normalised, and said
_SOUND_NORM = 1e-3  # farther off than this it is no attitude


def read_walk(path: Path | str, topics: TopicMap | None = None) -> Walk:
    """Read a walk log.

    What is sound in a damaged or unfinished file is used; what was lost stands in `Walk.warnings`.

    Args:
        path: an MCAP file of ROS 2 messages; a `.partial` file that a killed recorder left is fine.
        topics: which topic plays which role, by default the names that `massid` records.

    Raises:
        LogError: the file is not MCAP; a role has no topic; names and arrays of the joints do not match;
            a value is not finite or a quaternion is no attitude; rates or stamps of the topics differ.
    """
    path = Path(path)
    reader = _Reader(str(path), topics or TopicMap())
    contents = read_messages(path, reader.topics.uses, reader.receive)
    return reader.walk(contents)


class _Reader:
    """The columns of each topic in use, and how they become a walk."""

    def __init__(self, source: str, topics: TopicMap) -> None:
        self.source = source
        self.topics = topics
        self.columns: dict[str, TopicColumns] = {}
        self.warnings: list[str] = []

    def receive(self, info: TopicInfo, messages: list[bytes]) -> None:
        if info.topic not in self.columns:
            groups: Mapping[str, Sequence[str]] = _CONTACT_GROUPS
            if info.topic == self.topics.odometry.topic:
                groups = _ODOMETRY_GROUPS
            elif info.topic == self.topics.joint_states.topic:
                groups = _JOINT_GROUPS
            self.columns[info.topic] = TopicColumns(self.source, info, groups)
        self.columns[info.topic].receive(messages)

    def walk(self, contents: Contents) -> Walk:
        self.warnings += contents.warnings
        odometry = self.required("base state", self.topics.odometry.topic, ODOMETRY, contents)
        joints = self.required("joint state", self.topics.joint_states.topic, JOINT_STATE, contents)
        contacts = self.contacts(contents)
        root_body = self.root_body(odometry)
        joint_names = self.joint_names(joints)
        position, velocity, effort = self.joint_values(joints, joint_names)
        base = self.base(odometry)
        wrenches = {topic.info.topic: self.finite(topic, "wrench") for topic in contacts.values()}
        used = [odometry, joints, *contacts.values()]
        alignment = align({topic.info.topic: topic.stamps_ns for topic in used}, self.source)
        self.warnings += alignment.warnings
        metadata = dict(contents.metadata.get(METADATA_NAME, {}))
        self.check_metadata(metadata, alignment)
        at_base = alignment.rows[odometry.info.topic]
        at_joints = alignment.rows[joints.info.topic]
        picked = [wrenches[topic.info.topic][alignment.rows[topic.info.topic]] for topic in contacts.values()]
        return Walk(
            root_body=root_body,
            joint_names=joint_names,
            contact_bodies=tuple(contacts),
            stamps_ns=alignment.stamps_ns,
            qpos=_read_only(np.hstack([base[at_base, :7], position[at_joints]])),
            qvel=_read_only(np.hstack([base[at_base, 7:], velocity[at_joints]])),
            effort=_read_only(effort[at_joints]),
            wrench=_read_only(np.stack(picked, axis=1)),
            timestep_s=alignment.period_ns / NANOSECONDS,
            segments=alignment.segments,
            metadata=metadata,
            warnings=tuple(f"{self.source}: {line}" for line in self.warnings),
            source=self.source,
        )

    def required(self, role: str, topic: str, message_type: str, contents: Contents) -> TopicColumns:
        """Return the columns of a topic that identification cannot do without."""
        if topic in self.columns:
            return self.columns[topic]
        found = "is there but holds no sample" if topic in contents.topics else "is not in the log"
        raise LogError(
            f"{self.source}: no {role}: topic {topic} {found}. {self.supply(message_type, contents)}{self.damage()}"
        )

    def contacts(self, contents: Contents) -> dict[str, TopicColumns]:
        """Return the columns of each contact topic by body, in the order of the file's channels."""
        prefix = self.topics.contacts.prefix
        by_body: dict[str, TopicColumns] = {}
        for topic in filter(self.topics.is_contact, contents.topics):
            if topic not in self.columns:
                self.warnings.append(f"{topic}: holds no sample; taken as no contact topic.")
                continue
            columns = self.columns[topic]
            body = self.single_text(columns, "header.frame_id", "the body that the wrench acts on")
            if body in by_body:
                other = by_body[body].info.topic
                raise LogError(f"{self.source}: {other} and {topic} both hold the wrench of body '{body}'.")
            by_body[body] = columns
        if not by_body:
            raise LogError(
                f"{self.source}: no contact wrench: no topic below {prefix} holds samples. "
                f"{self.supply(WRENCH_STAMPED, contents)}{self.damage()}"
            )
        return by_body

    def supply(self, message_type: str, contents: Contents) -> str:
        """Say which topics exist, and which of them could play a role of this message type."""
        listed = ", ".join(f"{info.topic} ({info.message_type})" for info in contents.topics.values())
        fitting = [info.topic for info in contents.topics.values() if info.message_type == message_type]
        advice = f"Could supply it: {', '.join(fitting)}." if fitting else f"A topic of {message_type} supplies it."
        return f"{advice} The log has: {listed or 'no topics'}."

    def damage(self) -> str:
        return f" The file is damaged: {self.warnings[0]}" if self.warnings else ""

    def single_text(self, columns: TopicColumns, path: str, meaning: str) -> str:
        """Return a text field that must be the same in all messages of a topic."""
        where = f"{self.source}: {columns.info.topic}"
        found = list(dict.fromkeys(block.layout.strings.get(path, ("",)) for block in columns.blocks))
        if len(found) > 1:
            texts = ", ".join(f"'{texts[0]}'" for texts in found)
            raise LogError(f"{where}: {path} changes within the log ({texts}), expected one name.")
        if not found[0][0]:
            raise LogError(f"{where}: {path} is empty, expected {meaning}.")
        return found[0][0]

    def root_body(self, odometry: TopicColumns) -> str:
        return self.single_text(odometry, "child_frame_id", "the name of the root body")

    def joint_names(self, joints: TopicColumns) -> tuple[str, ...]:
        names = joints.blocks[0].layout.strings.get("name", ())
        where = f"{self.source}: {joints.info.topic}: sample 0"
        if not names:
            raise LogError(f"{where}: no joint names.")
        for name in names:
            if names.count(name) > 1:
                raise LogError(f"{where}: joint '{name}' occurs {names.count(name)} times, expected once.")
        return names

    def joint_values(self, joints: TopicColumns, names: tuple[str, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return position, velocity and effort in the order of `names`, each of shape (n, n_j)."""
        where = f"{self.source}: {joints.info.topic}"
        parts: dict[str, list[FloatArray]] = {name: [] for name in _JOINT_GROUPS}
        sample = 0
        for block in joints.blocks:
            here = block.layout.strings.get("name", ())
            if sorted(here) != sorted(names):
                missing, extra = sorted(set(names) - set(here)), sorted(set(here) - set(names))
                raise LogError(
                    f"{where}: sample {sample}: the joints differ from those of sample 0 "
                    f"(missing: {', '.join(missing) or 'none'}; new: {', '.join(extra) or 'none'})."
                )
            order = None if here == names else [here.index(name) for name in names]
            for group, values in block.groups.items():
                if values.shape[1] != len(names):
                    raise LogError(
                        f"{where}: sample {sample}: {group} has {values.shape[1]} values, "
                        f"expected one for each of the {len(names)} joints."
                    )
                parts[group].append(values if order is None else values[:, order])
            sample += len(block)
        columns = {group: np.concatenate(values) for group, values in parts.items()}
        for group, values in columns.items():
            self.check_finite(joints, values, [f"{group} of joint '{name}'" for name in names])
        return columns["position"], columns["velocity"], columns["effort"]

    def base(self, odometry: TopicColumns) -> FloatArray:
        """Return position, wxyz quaternion, world velocity and body angular velocity, shape (n, 13)."""
        position, xyzw, linear, angular = (self.finite(odometry, group) for group in _ODOMETRY_GROUPS)
        quaternion = xyzw_to_wxyz(xyzw)
        norm = np.linalg.norm(quaternion, axis=1)
        off = np.abs(norm - 1.0)
        if off.max() > _SOUND_NORM:
            row = int(np.argmax(off > _SOUND_NORM))
            raise LogError(
                f"{self.source}: {odometry.info.topic}: sample {row}: orientation has norm {norm[row]:.6g}, "
                f"expected 1 within {_SOUND_NORM}."
            )
        if off.max() > _EXACT_NORM:
            self.warnings.append(
                f"{odometry.info.topic}: {int((off > _EXACT_NORM).sum())} quaternions are off unit norm "
                f"by up to {off.max():.2g}; normalised."
            )
            quaternion = np.where((off > _EXACT_NORM)[:, None], quaternion / norm[:, None], quaternion)
        return np.hstack([position, quaternion, to_world(quaternion, linear), angular])

    def finite(self, columns: TopicColumns, group: str) -> FloatArray:
        values = columns.group(group)
        self.check_finite(columns, values, columns.groups[group])
        return values

    def check_finite(self, columns: TopicColumns, values: FloatArray, fields: Sequence[str]) -> None:
        bad = ~np.isfinite(values)
        if bad.any():
            row, column = np.argwhere(bad)[0]
            raise LogError(
                f"{self.source}: {columns.info.topic}: sample {row}: {fields[column]} is "
                f"{values[row, column]}, expected a finite number ({int(bad.sum())} such values on this topic)."
            )

    def check_metadata(self, metadata: Mapping[str, str], alignment: Alignment) -> None:
        """Warn where the recorder's own words and the stamps disagree, or the recording ended early."""
        period_s = alignment.period_ns / NANOSECONDS
        said = metadata.get("timestep_s", repr(period_s))
        try:
            agrees = math.isclose(float(said), period_s, rel_tol=1e-6, abs_tol=2.0 / NANOSECONDS)
        except ValueError:
            agrees = False
        if not agrees:
            self.warnings.append(f"the recorder states a timestep of {said} s, the stamps give {period_s} s.")
        end = metadata.get("end", COMPLETE)
        if end != COMPLETE:
            self.warnings.append(f"the recording ended early: {end}.")


def _read_only(array: FloatArray) -> FloatArray:
    array.flags.writeable = False
    return array
