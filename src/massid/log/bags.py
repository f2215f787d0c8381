"""SQLite files of rosbag2 and ROS 1 bags, as message records like those of MCAP. The only door to `rosbags`."""

from __future__ import annotations

import struct
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from massid.errors import LogError
from massid.log.files import Kind
from massid.log.mcap.container import Contents, TopicInfo

_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_BATCH = 1024
_READERS = {Kind.SQLITE: "rosbags.rosbag2", Kind.ROS1: "rosbags.rosbag1"}
_NO_TIME = (1 << 64) - 1


def read_bag(
    path: Path, kind: Kind, uses: Callable[[str], bool], receive: Callable[[TopicInfo, list[bytes]], None]
) -> Contents:
    """Hand over the messages of the topics in use; see `massid.log.containers.read_messages`.

    Raises:
        LogError: the library that reads such files is not installed, or the file cannot be read.
    """
    try:
        module: Any = import_module(_READERS[kind])
    except ImportError as error:
        raise LogError(
            f"{path}: is {kind}; reading it takes the package rosbags (pip install 'massid[bags]'), or convert it "
            f"({'`ros2 bag convert`' if kind is Kind.SQLITE else '`rosbags-convert`'})."
        ) from error
    if kind is Kind.SQLITE and path.suffix != ".db3":  # the library goes by the name
        raise LogError(f"{path}: is {kind}, but not named so: expected NAME.db3.")
    topics: dict[str, TopicInfo] = {}
    warnings: list[str] = []
    pending: dict[str, tuple[TopicInfo, list[bytes]]] = {}

    def hand_over(topic: str) -> None:
        info, records = pending.pop(topic)
        receive(info, records)

    count = 0
    try:
        with module.Reader(path) as reader:
            infos = {connection.id: _info(connection, kind) for connection in reader.connections}
            for info in infos.values():
                topics.setdefault(info.topic, info)
            wanted = [connection for connection in reader.connections if uses(connection.topic)]
            for connection, time_ns, data in reader.messages(wanted) if wanted else ():
                info = infos[connection.id]
                if info.topic in pending and pending[info.topic][0] != info:
                    hand_over(info.topic)
                records = pending.setdefault(info.topic, (info, []))[1]
                stamp = time_ns if 0 <= time_ns <= _NO_TIME else _NO_TIME
                records.append(_HEAD.pack(0, count & 0xFFFFFFFF, stamp, stamp) + bytes(data))
                count += 1
                if len(records) >= _BATCH:
                    hand_over(info.topic)
    except LogError:
        raise
    except Exception as error:  # whatever a damaged file makes of a library that trusts it
        said = " ".join(str(error).split())[:200] or type(error).__name__
        if not count:
            raise LogError(f"{path}: {kind} that cannot be read: {said}.") from error
        warnings.append(f"cannot be read to its end ({said}); what follows after {count} messages is lost.")
    for topic in list(pending):
        hand_over(topic)
    return Contents(topics, {}, tuple(warnings))


def _info(connection: Any, kind: Kind) -> TopicInfo:
    definition = connection.msgdef.data.encode()
    if kind is Kind.ROS1:
        return TopicInfo(connection.topic, connection.msgtype, "ros1", "ros1msg", definition)
    encoding = "ros2idl" if definition.startswith(b"=" * 80 + b"\nIDL: ") else "ros2msg"
    return TopicInfo(connection.topic, connection.msgtype, "cdr", encoding, definition)
