"""A log on disk, whatever it is kept in: an MCAP file, a folder of `ros2 bag record`, SQLite or a ROS 1 bag."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from massid.errors import LogError
from massid.log.bags import read_bag
from massid.log.files import Kind, kind_of
from massid.log.mcap.container import Contents, TopicInfo, read_mcap
from massid.log.tables import TABLES

_METADATA = "metadata.yaml"
_LARGEST_METADATA = 1 << 22
_SPLIT = re.compile(r"^(?P<stem>.*)_(?P<number>\d+)$")

Receive = Callable[[TopicInfo, list[bytes]], None]


def read_messages(path: Path, uses: Callable[[str], bool], receive: Receive) -> Contents:
    """Hand over the messages of the topics in use, in the order of the file, or of the files of a folder.

    Args:
        path: a file, finished or cut off, or a folder as `ros2 bag record` makes it.
        uses: tells whether a topic is of interest.
        receive: takes a batch of messages of one topic: for each its record, `MESSAGE_HEAD` bytes and the message.

    Returns:
        What else was found, with a line for each loss.

    Raises:
        LogError: there is no such log, or it is of a kind that is not read; says what it is instead.
    """
    if not path.is_dir():
        return _read_file(path, uses, receive)
    files, warnings = _files_of(path)
    topics: dict[str, TopicInfo] = {}
    metadata: dict[str, dict[str, str]] = {}
    for file in files:
        found = _read_file(file, uses, receive)
        topics |= {name: info for name, info in found.topics.items() if name not in topics}
        for name, content in found.metadata.items():
            metadata.setdefault(name, {}).update(content)
        warnings += [f"{file.name}: {line}" for line in found.warnings]
    return Contents(topics, metadata, tuple(warnings))


def _read_file(path: Path, uses: Callable[[str], bool], receive: Receive) -> Contents:
    kind = kind_of(path)
    if kind in TABLES:
        raise LogError(f"{path}: is {kind}, which holds no messages.")
    return read_mcap(path, uses, receive) if kind is Kind.MCAP else read_bag(path, kind, uses, receive)


def _files_of(folder: Path) -> tuple[list[Path], list[str]]:
    """The files of a bag in order: those that its metadata lists, or those that are numbered like a bag's.

    Raises:
        LogError: the folder is no bag.
    """
    named = _listed(folder / _METADATA)
    if named:
        files = [folder / name for name in named]
        there = [file for file in files if file.is_file()]
        if not there:
            raise LogError(f"{folder}: none of the files that its {_METADATA} lists is there ({', '.join(named)}).")
        lost = [f"{file.name} is listed in {_METADATA}, but is not there." for file in files if file not in there]
        return there, lost
    found = sorted(file for pattern in ("[!.]*.mcap", "[!.]*.db3") for file in folder.glob(pattern))
    numbered = {file: match for file in found if (match := _SPLIT.match(file.stem)) is not None}
    if found and len(numbered) == len(found) and len({match["stem"] for match in numbered.values()}) == 1:
        files = sorted(found, key=lambda file: int(numbered[file]["number"]))
        return files, [f"no {_METADATA}: the files were taken in the order of their numbers."]
    listed = ", ".join(file.name for file in found[:8]) or "no MCAP file"
    raise LogError(
        f"{folder}: is a folder, expected a log or a folder of `ros2 bag record` with its {_METADATA}; it has {listed}."
    )


def _listed(metadata: Path) -> list[str]:
    """Names of the files that the metadata of a bag lists; none if there is no metadata.

    Raises:
        LogError: it cannot be understood.
    """
    if not metadata.is_file():
        return []
    try:
        if metadata.stat().st_size > _LARGEST_METADATA:
            raise ValueError(f"{metadata.stat().st_size} bytes are too many")
        content = YAML(typ="safe", pure=True).load(metadata.read_text(encoding="utf-8"))
        names = content["rosbag2_bagfile_information"]["relative_file_paths"]
        return [Path(str(name)).name for name in names]  # older versions put the folder before the name
    except (YAMLError, OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise LogError(f"{metadata}: is not the metadata of a bag: {' '.join(str(error).split())[:200]}") from error
