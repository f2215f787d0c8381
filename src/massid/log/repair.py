"""Copy what is sound of a damaged MCAP file into a new one that any reader opens."""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.writer import CompressionType, Writer

from massid.errors import LogError
from massid.log.containers import read_messages
from massid.log.mcap.container import MESSAGE_HEAD, TopicInfo
from massid.log.mcap.sink import CHUNK_BYTES
from massid.outputs import check_outputs, drafts, is_pipe

_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time


@dataclass(frozen=True)
class Repair:
    """What was copied and what was lost.

    Attributes:
        path: the new file.
        messages: copied messages by topic.
        losses: what was lost, one line each; empty for a file without damage.
    """

    path: Path
    messages: dict[str, int]
    losses: tuple[str, ...]


def repair_log(source: Path | str, path: Path | str) -> Repair:
    """Write a new file with every message, schema and metadata record that can be read.

    The new file is closed, indexed and protected by checksums. Messages are copied byte by byte, whatever they are
    encoded in; their log times and sequence numbers stay.

    Args:
        source: the damaged file.
        path: the new file; replaced if it exists.

    Raises:
        BadInputError: the new file is the source, or cannot be written.
        LogError: the source is not MCAP or holds no readable message.
    """
    source, path = Path(source), Path(path)
    check_outputs([("the damaged file", source)], [("the repaired file", path)])
    if is_pipe(path):
        raise LogError(f"{path}: is a pipe or a device; a log is written to a file.")
    try:
        with drafts(path) as (draft,), draft.open("wb") as stream:
            writer = Writer(stream, CHUNK_BYTES, CompressionType.ZSTD, enable_data_crcs=True)
            writer.start(profile="ros2", library="massid repair")
            copier = _Copier(writer)
            contents = read_messages(source, lambda _: True, copier.receive)
            if not copier.counts:
                said = f" {contents.warnings[0]}" if contents.warnings else ""
                raise LogError(f"{source}: holds no message that can be read.{said}")
            for name, content in contents.metadata.items():
                writer.add_metadata(name, dict(content))
            writer.finish()
    except OSError as error:
        raise LogError(f"{path}: cannot be written: {error.strerror}.") from error
    return Repair(path, dict(copier.counts), contents.warnings)


class _Copier:
    """Writes messages as they come, and their schemas and channels when they are first needed."""

    def __init__(self, writer: Writer) -> None:
        self.writer = writer
        self.counts: Counter[str] = Counter()
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[TopicInfo, int] = {}

    def receive(self, info: TopicInfo, records: list[bytes]) -> None:
        if info not in self._channels:
            key = (info.message_type, info.schema_encoding, info.schema_data)
            if key not in self._schemas:
                self._schemas[key] = self.writer.register_schema(*key)
            metadata = dict(info.metadata)
            schema = self._schemas[key]
            self._channels[info] = self.writer.register_channel(info.topic, info.message_encoding, schema, metadata)
        channel = self._channels[info]
        for record in records:
            _, sequence, log_time, publish_time = _HEAD.unpack_from(record)
            try:
                self.writer.add_message(channel, log_time, record[MESSAGE_HEAD:], publish_time, sequence)
            except (struct.error, McapError, OverflowError) as error:  # pragma: no cover  # numbers fit: they were read
                raise LogError(f"{info.topic}: a message cannot be copied: {error}.") from error
            self.counts[info.topic] += 1
