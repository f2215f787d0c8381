"""An MCAP file being written: topics, messages made from record arrays, metadata, and its final name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

from massid.errors import LogError
from massid.log.mcap.rosbag2 import TopicCount, channel_metadata, file_metadata
from massid.log.mcap.schemas import definition_text
from massid.log.messages.cdr import Layout, encode, parse_schema, trace
from massid.outputs import is_pipe, open_alone, places_beside, publish
from massid.typing import AnyArray, IntArray
from massid.walk.conventions import NANOSECONDS

CHUNK_BYTES = 256 * 1024
_NEVER = 1 << 62  # no chunk ends by its size: it ends where `write` ends
_RECORD_BYTES = 31  # what MCAP adds to each message
_SECONDS, _NANOSECONDS = "header.stamp.sec", "header.stamp.nanosec"


def partial_path(path: Path) -> Path:
    """What a file is called until it is complete."""
    return path.with_name(f"{path.name}.partial")


@dataclass
class Topic:
    """A topic being written.

    Attributes:
        name: the topic.
        message_type: full name of its message type.
        channel: MCAP channel.
        layout: where the fields of its messages lie.
        record: record type over one message, with the stamp and the fields that change.
        messages: number of messages written so far.
    """

    name: str
    message_type: str
    channel: int
    layout: Layout
    record: np.dtype[np.void]
    messages: int = 0

    @property
    def message_bytes(self) -> int:
        """Bytes that one message takes in a chunk."""
        return self.layout.size + _RECORD_BYTES

    def fill(self, stamps_ns: IntArray, columns: Mapping[str, AnyArray]) -> bytes:
        """Return one message per stamp, concatenated; a field without a column stays as in the example."""
        rows = np.frombuffer(bytearray(self.layout.example) * len(stamps_ns), dtype=self.record)
        rows[_SECONDS], rows[_NANOSECONDS] = np.divmod(stamps_ns, NANOSECONDS)
        for path, values in columns.items():
            rows[path] = values
        return rows.tobytes()


class McapSink:
    """Writes to `PATH.partial`, chunk by chunk; `finish` adds the index and renames it to PATH.

    The messages of one `write` are one chunk, which reaches the operating system before `write` returns.
    """

    def __init__(self, path: Path) -> None:
        """Open the partial file.

        Raises:
            LogError: it cannot be opened, or is no file but a pipe.
            BadInputError: another process is writing it.
        """
        if is_pipe(path):
            raise LogError(f"{path}: is a pipe or a device; a log is written to a file.")
        self.path = path
        self.partial_path = partial_path(path)
        self.topics: dict[str, Topic] = {}
        self._schemas: dict[str, int] = {}
        with self._file_errors():
            self._stream = open_alone(self.partial_path)
            self._writer = Writer(
                self._stream, chunk_size=_NEVER, compression=CompressionType.ZSTD, enable_data_crcs=True
            )
            self._writer.start(profile="ros2", library="massid")

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write a metadata record."""
        with self._file_errors():
            self._writer.add_metadata(name, dict(content))
            self._stream.flush()

    def add_topic(self, name: str, message_type: str, example: Mapping[str, object], fields: Sequence[str]) -> Topic:
        """Create a topic.

        Args:
            name: the topic.
            message_type: full name of its message type.
            example: values of one message by dotted path, which all messages share: names, array lengths.
            fields: dotted paths of the numbers that each message sets, besides its stamp.
        """
        text = definition_text(message_type)
        if message_type not in self._schemas:
            self._schemas[message_type] = self._writer.register_schema(message_type, "ros2msg", text.encode())
        channel = self._writer.register_channel(
            name, "cdr", self._schemas[message_type], channel_metadata(message_type)
        )
        schema = parse_schema(message_type, text)
        layout = trace(schema, encode(schema, example))
        record = layout.record_dtype([_SECONDS, _NANOSECONDS, *fields])
        self.topics[name] = Topic(name, message_type, channel, layout, record)
        return self.topics[name]

    def write(self, stamps_ns: IntArray, messages: Sequence[tuple[Topic, bytes]]) -> None:
        """Write a chunk: for each stamp one message of each topic, as `Topic.fill` made them.

        Raises:
            LogError: the file cannot be written.
        """
        add = self._writer.add_message
        parts = [(topic.channel, data, topic.layout.size, topic.messages) for topic, data in messages]
        with self._file_errors():
            for row, stamp in enumerate(stamps_ns.tolist()):
                for channel, data, size, before in parts:
                    add(channel, stamp, data[row * size : (row + 1) * size], stamp, before + row)
            self._writer.flush()
        for topic, _ in messages:
            topic.messages += len(stamps_ns)

    def finish(self, first_ns: int, last_ns: int, companions: Mapping[Path, bytes]) -> None:
        """Write rosbag2's metadata and the index, and give the file its name.

        Args:
            first_ns: stamp of the first sample [ns].
            last_ns: stamp of the last sample [ns].
            companions: files that belong to this one: it is never seen without them.

        Raises:
            LogError: the file cannot be written; what was written stays in the partial file.
        """
        counts = [TopicCount(t.name, t.message_type, t.messages) for t in self.topics.values()]
        with self._file_errors():
            try:
                self._writer.add_metadata(
                    "rosbag2", file_metadata(self.path.name, first_ns, last_ns - first_ns, counts)
                )
                self._writer.finish()
                self._stream.flush()
                with places_beside(*companions) as places:
                    for place, content in zip(places, companions.values(), strict=True):
                        place.write_bytes(content)
                    publish([*zip(places, companions, strict=True), (self.partial_path, self.path)])
            finally:
                self._stream.close()  # only now may another process take the partial file's name

    def discard(self) -> None:
        """Close and remove the partial file."""
        self._stream.close()
        self.partial_path.unlink(missing_ok=True)

    @contextmanager
    def _file_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            kept = " What was written until then is in it; `massid repair` makes a log of that."
            raise LogError(f"{self.partial_path}: cannot be written: {error.strerror}.{kept}") from error
