"""What rosbag2 adds to an MCAP file, so that `ros2 bag info` and `ros2 bag play` take a walk log as theirs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

from massid.log.mcap.schemas import TYPE_HASHES

# Reliable, volatile, default deadlines: what rosbag2 stores for a plain publisher. The numbers are those of
# metadata version 8; later versions read them too, while version 9's words stop older ones.
_VERSION = 8
_FOREVER = "sec: 9223372036\n    nsec: 854775807"
OFFERED_QOS = (
    "- history: 3\n  depth: 0\n  reliability: 1\n  durability: 2\n"
    f"  deadline:\n    {_FOREVER}\n  lifespan:\n    {_FOREVER}\n  liveliness: 1\n"
    f"  liveliness_lease_duration:\n    {_FOREVER}\n  avoid_ros_namespace_conventions: false"
)


@dataclass(frozen=True)
class TopicCount:
    """A topic of the log, its message type, and how many messages it holds."""

    topic: str
    message_type: str
    messages: int


def channel_metadata(message_type: str) -> dict[str, str]:
    """Return the metadata that rosbag2 gives the channel of a topic."""
    return {"offered_qos_profiles": OFFERED_QOS, "topic_type_hash": TYPE_HASHES[message_type]}


def file_metadata(file_name: str, start_ns: int, duration_ns: int, topics: Sequence[TopicCount]) -> dict[str, str]:
    """Return the content of the `rosbag2` metadata record.

    Args:
        file_name: name of the log, without folders.
        start_ns: first stamp since the Unix epoch [ns].
        duration_ns: last stamp less the first [ns].
        topics: the topics in the order of their channels.
    """
    total = sum(topic.messages for topic in topics)
    lines = [
        f"version: {_VERSION}",
        "storage_identifier: mcap",
        f"duration:\n  nanoseconds: {duration_ns}",
        f"starting_time:\n  nanoseconds_since_epoch: {start_ns}",
        f"message_count: {total}",
        "topics_with_message_count:" if topics else "topics_with_message_count: []",
    ]
    for topic in topics:
        lines += [
            "  - topic_metadata:",
            f"      name: {topic.topic}",
            f"      type: {topic.message_type}",
            "      serialization_format: cdr",
            f"      offered_qos_profiles: {json.dumps(OFFERED_QOS)}",
            f"      type_description_hash: {TYPE_HASHES[topic.message_type]}",
            f"    message_count: {topic.messages}",
        ]
    quoted = json.dumps(file_name, ensure_ascii=False)
    lines += [
        'compression_format: ""',
        'compression_mode: ""',
        f"relative_file_paths:\n  - {quoted}",
        "files:",
        f"  - path: {quoted}",
        f"    starting_time:\n      nanoseconds_since_epoch: {start_ns}",
        f"    duration:\n      nanoseconds: {duration_ns}",
        f"    message_count: {total}",
        "custom_data: ~",
        'ros_distro: ""',
    ]
    return {"serialized_metadata": "\n".join(lines)}
