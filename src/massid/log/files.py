"""Tell the kinds of logs from everything else that a user may name by mistake."""

from __future__ import annotations

import enum
from pathlib import Path

from massid.errors import LogError
from massid.inputs import problem_of

MAGIC = b"\x89MCAP0\r\n"


class Kind(enum.StrEnum):
    """What a log is kept in."""

    MCAP = "an MCAP file"
    SQLITE = "a rosbag2 SQLite file"
    ROS1 = "a ROS 1 bag"
    CSV = "a CSV file"
    NPZ = "a NumPy .npz archive"
    PARQUET = "a Parquet file"


_KINDS = {b"SQLite format 3": Kind.SQLITE, b"#ROSBAG V2.0": Kind.ROS1, b"PAR1": Kind.PARQUET}
_TEXTS = (".csv", ".tsv")
_OTHER_FORMATS = {
    b"\x28\xb5\x2f\xfd": "a zstd-compressed file; decompress it first",
    b"\x1f\x8b": "a gzip-compressed file; decompress it first",
    b"PK\x03\x04": "a zip or NumPy .npz archive",
}
_LISTED = 8


def kind_of(path: Path) -> Kind:
    """Tell by its beginning what a file is.

    Raises:
        LogError: it is no log; the message names what was found instead.
    """
    if path.is_dir():
        raise LogError(f"{path}: is a folder, expected an MCAP file; it has {_mcap_files(path)}.")
    if not path.exists():
        raise LogError(f"{path}: does not exist; the folder {path.parent} has {_mcap_files(path.parent)}.")
    start = _start_of(path)
    if start.startswith(MAGIC):
        return Kind.MCAP
    for magic, kind in _KINDS.items():
        if start.startswith(magic):
            return kind
    if start.startswith(b"PK\x03\x04") and path.suffix == ".npz":
        return Kind.NPZ
    if not start:
        raise LogError(f"{path}: is empty, expected an MCAP file.")
    if MAGIC.startswith(start):
        raise LogError(f"{path}: is cut off after {len(start)} bytes, within the first mark of an MCAP file.")
    for magic, name in _OTHER_FORMATS.items():
        if start.startswith(magic):
            raise LogError(f"{path}: is not MCAP but {name}.")
    if path.suffix.lower() in _TEXTS:
        return Kind.CSV
    line = start.decode("latin-1").splitlines()[0]
    shown = f"the text '{line[:40]}'" if line.isprintable() and line else f"the bytes {start[:8].hex(' ')}"
    raise LogError(f"{path}: is not an MCAP file; it begins with {shown}.")


def _start_of(path: Path) -> bytes:
    if problem := problem_of(path):
        raise LogError(f"{path}: {problem}.")
    try:
        with path.open("rb") as stream:
            return stream.read(64)
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}.") from error


def _mcap_files(folder: Path) -> str:
    names = sorted(entry.name for entry in folder.glob("[!.]*.mcap*")) if folder.is_dir() else []
    if not names:
        return "no MCAP file"
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more
