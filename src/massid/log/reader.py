"""Read a walk from an MCAP log: roles, names, units and conventions checked, every loss stated."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from massid.errors import LogError, on_one_line
from massid.log.alignment import Alignment, align
from massid.log.clocks import Stream, settle
from massid.log.columns import TopicColumns
from massid.log.containers import read_messages
from massid.log.files import kind_of
from massid.log.joints import Joints, read_joints
from massid.log.mcap.container import NO_CHECKSUM, Contents, TopicInfo
from massid.log.mcap.schemas import JOINT_STATE as JOINT_STATE_TYPE
from massid.log.mcap.schemas import ODOMETRY, WRENCH_STAMPED
from massid.log.roles import Base, Contact, read_base, read_contact
from massid.log.silence import fill_silence
from massid.log.tables import TABLES, Table, read_table
from massid.log.topics.file import FROM_A_PRESET
from massid.log.topics.kinds import POSES, adapted
from massid.log.topics.map import BASE_STATE, JOINT_STATE, WRENCH, Clock, ContactMap, Frame, Source, TextField, TopicMap
from massid.log.transforms import STATIC, TRANSFORMS, Chain, FrameTree
from massid.log.writer import COMPLETE, METADATA_NAME, UNMEASURED
from massid.memory import give_back
from massid.typing import FloatArray
from massid.walk import Walk
from massid.walk.conventions import LATEST_NS, NANOSECONDS
from massid.walk.white_noise import CLEAN_VELOCITY, white_level

_LIKE_A_SIMULATOR = 0.1
_TYPES = {BASE_STATE: ODOMETRY, JOINT_STATE: JOINT_STATE_TYPE, WRENCH: WRENCH_STAMPED}


def read_walk(path: Path | str, topics: TopicMap | None = None) -> Walk:
    """Read a walk log.

    What is sound in a damaged or unfinished file is used; what was lost stands in `Walk.warnings`.

    Args:
        path: an MCAP file, also a `.partial` one that a killed recorder left; a folder of `ros2 bag record`; a rosbag2
            SQLite file or a ROS 1 bag, with the package rosbags; a table (CSV, NumPy .npz, Parquet) whose columns
            `topics` names.
        topics: which topic plays which role, by default the names that `massid` records; see `load_topics`.

    Raises:
        LogError: the file is no log; a role has no topic; names and arrays of the joints do not match;
            no sample is finite; no stretch of time is covered by all roles.
    """
    walk = _read(Path(path), topics or TopicMap())
    give_back()
    return walk


def _read(path: Path, topics: TopicMap) -> Walk:
    reader = _Reader(str(path), topics)
    kind = None if path.is_dir() else kind_of(path)
    if kind in TABLES:
        return reader.walk(reader.take_table(read_table(path, kind)))
    contents = read_messages(path, reader.uses, reader.receive)
    try:
        reader.follow_transforms(path)
        return reader.walk(contents)
    except LogError as error:
        damage = [line for line in contents.warnings if NO_CHECKSUM not in line]
        if damage:
            raise LogError(f"{error} The file is damaged: {damage[0]}") from error
        raise


class _Reader:
    """The columns of each topic in use, and how they become a walk."""

    def __init__(self, source: str, topics: TopicMap) -> None:
        self.source = source
        self.topics = topics
        self.columns: dict[str, TopicColumns] = {}
        self.warnings: list[str] = []

    def uses(self, topic: str) -> bool:
        return self.topics.uses(topic)

    def receive(self, info: TopicInfo, records: list[bytes]) -> None:
        if info.topic not in self.columns:
            self.topics = adapted(self.topics, info)
            self.columns[info.topic] = TopicColumns(self.source, info, self.topics.fields(info.topic))
        self.columns[info.topic].receive(info, records)

    def follow_transforms(self, path: Path) -> None:
        """Put the base's pose in a frame that nothing moves, if a topic of transforms holds it link by link."""
        base = self.topics.base
        columns = None if base is None else self.columns.get(base.position.topic)
        if (
            base is None
            or columns is None
            or columns.info.message_type != TRANSFORMS
            or isinstance(base.body, TextField)
        ):
            return
        topic, tree = columns.info.topic, FrameTree()
        read_messages(path, lambda name: name in (topic, STATIC), tree.receive)
        try:
            frames = tree.above(base.body)
        except LogError as error:
            raise LogError(f"{columns.where}: {error}") from error
        if len(frames) < 2:
            return
        chain = Chain(self.source, frames)
        read_messages(path, chain.uses, chain.receive)
        keys = {"translation": f"{BASE_STATE} position", "rotation": f"{BASE_STATE} orientation"}
        self.columns[topic] = chain.columns(keys, self.topics.fields(topic))
        self.warnings.append(chain.said)

    def take_table(self, table: Table) -> Contents:
        """Take the rows of a table for the messages of every topic that the map names."""
        times = table.times_ns(self.topics.time)
        infos = {name: replace(table.info, topic=name) for name in self.topics.topics()}
        for name, info in infos.items():
            wanted = self.topics.fields(name)
            self.columns[name] = TopicColumns(self.source, info, wanted, blocks=[table.block(wanted, times)])
        return Contents(infos, {}, ())

    def walk(self, contents: Contents) -> Walk:
        self.warnings += contents.warnings
        base_map, joint_map = self.topics.base, self.topics.joints
        if base_map is None or joint_map is None:
            role = BASE_STATE if base_map is None else JOINT_STATE
            raise LogError(f"{self.source}: no {role}: the topic map has none.{self.advice(role)} {FROM_A_PRESET}")
        for role, quantity, source in self.topics.sources():
            self.check_supply(role, quantity, source, contents)
        wrenches = self.contact_topics(contents)
        body = self.name(base_map.body, base_map.position.topic, "the name of the root body")
        base = read_base(base_map, self.columns, self.warnings)
        joints = read_joints(joint_map, self.columns, self.topics.lag_s)
        lag_s = self.topics.lag_s.get("wrench", 0.0)
        contacts = {
            name: read_contact(layout, key, columns, lag_s) for name, (key, layout, columns) in wrenches.items()
        }
        give_back()
        alignment = self.align(base, joints, contacts.values())
        signals = [*base.signals, *joints.signals, *(contact.signal for contact in contacts.values())]
        for columns in {id(signal.columns): signal.columns for signal in signals}.values():
            self.warnings += columns.warnings()
        self.warnings += alignment.warnings
        metadata = dict(contents.metadata.get(METADATA_NAME, {}))
        self.check_metadata(metadata, alignment)
        for signal in (*base.signals, *joints.signals):
            signal.average(alignment)
        blind = tuple(body for body in self.unmeasured(contents) if body not in contacts)
        wrench = np.zeros((len(alignment.stamps_ns), len(contacts) + len(blind), 6))
        for column, contact in enumerate(contacts.values()):
            wrench[:, column] = contact.signal.on(alignment)
        effort = joints.torques(alignment)
        state = base.on(alignment, ends_with_velocity=_ends_with_velocity(joints, alignment))
        position, velocity = joints.states(alignment)
        qpos, qvel = np.hstack([state[:, :7], position]), np.hstack([state[:, 7:], velocity])
        return Walk(
            root_body=body,
            joint_names=joints.names,
            contact_bodies=(*contacts, *blind),
            stamps_ns=alignment.stamps_ns,
            qpos=_read_only(qpos),
            qvel=_read_only(qvel),
            effort=_read_only(effort),
            wrench=_read_only(wrench),
            timestep_s=alignment.period_ns / NANOSECONDS,
            segments=alignment.segments,
            metadata=metadata,
            warnings=tuple(on_one_line(f"{self.source}: {line}") for line in self.warnings),
            source=self.source,
            world_wrenches=tuple(name for name, c in contacts.items() if c.layout.frame is Frame.WORLD),
            open_axes=tuple(range(6 * len(contacts), 6 * (len(contacts) + len(blind)))),
        )

    def check_supply(self, role: str, quantity: str, source: Source, contents: Contents) -> None:
        """Pass if a topic is in the log and holds messages that can be decoded.

        Raises:
            LogError: it is not, or does not; names what is missing and what could supply it.
        """
        if source.topic in self.columns:
            self.columns[source.topic].check()
            if self.columns[source.topic].blocks:
                return
        found = "is there but holds no sample" if source.topic in contents.topics else "is not in the log"
        alone = all(other.topic == source.topic for r, _, other in self.topics.sources() if r == role)
        what = f"no {role}" if alone else f"no {quantity.replace('_', ' ')} in the {role}"
        raise LogError(
            f"{self.source}: {what}: topic {source.topic} {found}.{self.advice(role)} {self.supply(role, contents)}"
        )

    def advice(self, role: str) -> str:
        """What can supply a role on this kind of robot."""
        said = self.topics.supply.get(role)
        return f" For {self.topics.name}: {said.rstrip('.')}." if said else ""

    def supply(self, role: str, contents: Contents) -> str:
        """Say which topics exist, and which of them could play a role of this message type."""
        message_type = _TYPES[role]
        listed = ", ".join(f"{info.topic} ({info.message_type})" for info in contents.topics.values())
        fitting = [info.topic for info in contents.topics.values() if info.message_type == message_type]
        advice = (
            f"Could supply it: {', '.join(fitting)}."
            if fitting
            else (f"A topic of {message_type} supplies it, or another one whose fields a topic map names.")
        )
        setting = {
            BASE_STATE: "base: {topic: NAME",
            JOINT_STATE: "joints: {topic: NAME",
            WRENCH: "contacts: [{topic: NAME",
        }
        if fitting:
            advice += f" `{setting[role]}{'}]' if role == WRENCH else '}'}` in a topic map takes one."
        poses = [info.topic for info in contents.topics.values() if info.message_type in POSES]
        if role == BASE_STATE and poses and not fitting:
            advice += (
                f" {', '.join(poses)} may hold its pose: `base: {{topic: {poses[0]}, body: NAME}}` in a topic map "
                "takes it and derives the velocities."
            )
        return f"{advice} The log has: {listed or 'no topics'}."

    def contact_topics(self, contents: Contents) -> dict[str, tuple[str, ContactMap, TopicColumns]]:
        """Return each body's key, contact map and columns, in the order of the file's channels."""
        by_body: dict[str, tuple[str, ContactMap, TopicColumns]] = {}
        for topic in contents.topics:
            contacts = self.topics.contacts_of(topic)
            if contacts and topic in self.columns:
                self.columns[topic].check()
            if contacts and (topic not in self.columns or not self.columns[topic].blocks):
                self.warnings.append(f"{topic}: holds no sample; taken as no contact topic.")
                continue
            for key, contact in contacts.items():
                for body, columns in self.bodies(contact, topic).items():
                    if body in by_body:
                        other = by_body[body][2].info.topic
                        both = f"{other} and {topic} both hold" if other != topic else f"{topic} holds twice"
                        raise LogError(
                            f"{self.source}: {both} the wrench of body '{body}'; `body` under contacts in a topic map "
                            "says which body each is of."
                        )
                    by_body[body] = (key, contact, columns)
        if not (by_body or self.unmeasured(contents)):
            named = [contact.topic for contact in self.topics.contacts if contact.topic]
            wanted = ", ".join(named) or "those of the topic map (none)"
            raise LogError(
                f"{self.source}: no contact wrench: no topic like {wanted} holds samples.{self.advice(WRENCH)} "
                f"{self.supply(WRENCH, contents)} For a robot without such sensors, name the bodies that touch the "
                "ground: `contacts: [{body: NAME}, {body: NAME}]` in a topic map."
            )
        return by_body

    def unmeasured(self, contents: Contents) -> tuple[str, ...]:
        """Bodies that touch the ground without a sensor: as the topic map has them, or the recorder."""
        named = [contact.body for contact in self.topics.contacts if not contact.topic]
        said = contents.metadata.get(METADATA_NAME, {}).get(UNMEASURED, "").split("\n")
        return tuple(dict.fromkeys(str(name) for name in (*named, *said) if name))

    def bodies(self, contact: ContactMap, topic: str) -> dict[str, TopicColumns]:
        """The bodies whose wrench a topic holds: the one that the map names, or each that the messages name."""
        columns = self.columns[topic]
        if not isinstance(contact.body, TextField):
            return {contact.body: columns}
        meaning = "the body that the wrench acts on (or name it in a topic map: `body`)"
        parts = columns.parts(contact.body.path)
        found = {(texts[0] if texts else ""): part for texts, part in parts.items()}
        if "" in found:
            raise LogError(f"{columns.where}: {contact.body.path} is empty, expected {meaning}.")
        return found

    def name(self, given: str | TextField, topic: str, meaning: str) -> str:
        """Return a body's name: as given, or from a text field that must be the same in all messages of a topic."""
        if not isinstance(given, TextField):
            return given
        columns = self.columns[topic]
        found = columns.texts(given.path)
        if len(found) > 1:
            listed = ", ".join(f"'{texts[0] if texts else ''}'" for texts in list(found)[:4])
            raise LogError(f"{columns.where}: {given.path} changes within the log ({listed}), expected one name.")
        (texts,) = found
        if not texts or not texts[0]:
            raise LogError(f"{columns.where}: {given.path} is empty, expected {meaning}.")
        return texts[0]

    def align(self, base: Base, joints: Joints, contacts: Collection[Contact]) -> Alignment:
        """Put the clocks of all signals in order and side by side; a signal's lag is taken off its stamps."""
        signals = [*base.signals, *joints.signals]
        pushed = [contact.signal for contact in contacts]
        topics = {signal.columns.name: signal.columns for signal in (*signals, *pushed)}
        by_log = self.times_by_log(topics)
        streams: dict[str, Stream] = {}
        for signal in (*signals, *pushed):
            known = streams.get(signal.stream)
            clock = signal.clock(by_log=by_log)
            streams[signal.stream] = replace(clock, held=clock.held and (known is None or known.held))
        settled = settle(streams, self.source)
        self.warnings += settled.warnings
        for signal in (*signals, *pushed):
            signal.settle(settled.rows[signal.stream], settled.streams[signal.stream].stamps_ns)
        streams = dict(settled.streams)
        running = streams[signals[0].stream].stamps_ns
        for name in {contact.signal.stream: None for contact in contacts}:
            of_topic = [contact for contact in contacts if contact.signal.stream == name]
            if any(signal.stream == name for signal in signals):
                continue
            silence = of_topic[0].layout.silence
            streams[name], values, line = fill_silence([c.signal for c in of_topic], streams[name], running, silence)
            if line:
                self.warnings.append(f"{name}: {line}.")
                for contact, filled in zip(of_topic, values, strict=True):
                    contact.signal.values = filled
        settled = replace(settled, streams=streams)
        noisy = any(white_level(part.signal.values) >= CLEAN_VELOCITY for part in joints.velocity)
        lead = joints.position[0].signal.stream
        others = {part.signal.stream for part in joints.position[1:]} - {lead}  # a gripper's, which come seldom
        return align(settled, self.source, lead, self.topics.rate, followers=others, even=by_log, noisy=noisy)

    def times_by_log(self, topics: Mapping[str, TopicColumns]) -> bool:
        """Whether time is that of recording.

        Raises:
            LogError: the topic map wants header stamps, and a topic has none.
        """
        clock = self.topics.clock
        lacking = [name for name, columns in topics.items() if columns.header_ns() is None]
        if lacking and clock is Clock.HEADER:
            raise LogError(
                f"{self.source}: no header stamps on {', '.join(lacking)}; use `clock: log` in the topic map."
            )
        if lacking and clock is Clock.AUTO:
            self.warnings.append(f"no header stamps on {', '.join(lacking)}, so time is that of recording.")
        by_log = clock is Clock.LOG or bool(lacking)
        if by_log:
            for columns in topics.values():
                late = columns.log_ns() == LATEST_NS
                columns.leave_out(late, "log times of 2^63 ns or more, after the year 2262, are no times")
        return by_log

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


def _ends_with_velocity(joints: Joints, alignment: Alignment) -> bool:
    """Whether the joints move from sample to sample with the velocity at the end, as in simulators."""
    part = joints.position[0]
    place = part.places[0]
    other = next(one for one in joints.velocity if place in one.places)
    times, rates = part.signal.times(alignment), other.signal.rows(alignment)
    if not np.array_equal(times, other.signal.times(alignment)):
        return False
    moved = np.diff(part.signal.rows(alignment)[:, 0]) / (np.diff(times) / NANOSECONDS)
    rate = rates[:, other.places.index(place)]
    by_end = np.median(np.abs(moved - rate[1:]))
    return bool(by_end < _LIKE_A_SIMULATOR * np.median(np.abs(moved - 0.5 * (rate[1:] + rate[:-1]))))


def _read_only(array: FloatArray) -> FloatArray:
    array.flags.writeable = False
    return array
