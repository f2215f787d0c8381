"""Files that a command is about to write: that it can, and that none is one of its inputs or of its other outputs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from massid.errors import BadInputError

NamedFile: TypeAlias = tuple[str, Path | None]
"""What the user knows a file by, such as "--json", and where it is; None for a file that was not named."""


def check_outputs(inputs: Sequence[NamedFile], outputs: Sequence[NamedFile]) -> None:
    """Pass if every output can be written without destroying an input or another output.

    What exists is not changed, what does not exist is not left behind. Links are followed.

    Args:
        inputs: what is read.
        outputs: what is written.

    Raises:
        BadInputError: an output is an input or another output, is a folder, or cannot be written where it should be.
    """
    read = [(name, path) for name, path in inputs if path is not None]
    written: list[tuple[str, Path]] = []
    for name, path in outputs:
        if path is None:
            continue
        for other, taken in read:
            if _is_same(path, taken):
                raise BadInputError(f"{path} is {other} itself; give {name} another name.")
        for other, taken in written:
            if _is_same(path, taken):
                raise BadInputError(f"{other} and {name} would both write {path}; give one of them another name.")
        written.append((name, path))
    for _, path in written:
        _check_writable(path)


def check_suffix(name: str, path: Path | None, suffix: str) -> None:
    """Pass if a file that is to be written is called what it is; a device or a pipe is called what it likes.

    Raises:
        BadInputError: its name ends in something else.
    """
    if path is None or path.suffix == suffix or (path.exists() and not path.is_file()):
        return
    raise BadInputError(f"{name} {path}: expected a name that ends in {suffix}.")


def _is_same(path: Path, other: Path) -> bool:
    try:
        return path.resolve() == other.resolve() or (path.exists() and other.exists() and path.samefile(other))
    except (OSError, RuntimeError):  # a folder that may not be entered, links in a circle: reading or writing will tell
        return False


def _check_writable(path: Path) -> None:
    try:
        target = path.resolve()
        if not target.parent.is_dir():
            raise BadInputError(f"Cannot write {path}: the folder {path.parent} does not exist.")
        if target.is_dir():
            raise BadInputError(f"Cannot write {path}: it is a folder.")
        existed = target.exists()
        if existed and not target.is_file():
            return  # opening a pipe would wait for its reader
        target.open("ab").close()
        if not existed:
            target.unlink()
    except OSError as error:
        raise BadInputError(f"Cannot write {path}: {error.strerror}.") from error
    except RuntimeError as error:
        raise BadInputError(f"Cannot write {path}: its links go in a circle.") from error
