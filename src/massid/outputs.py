"""Files that a command writes: checked before any work, and complete under their names or not there at all.

A file is written beside its place under a hidden name, brought to the disk, and then given its name; files that belong
together get theirs together. Whatever ends the work before that leaves what was there as it was.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType, ModuleType
from typing import IO, Any, TypeAlias

from massid.errors import BadInputError

fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # no such locks here: two processes on one name are not kept apart
    fcntl = None

NamedFile: TypeAlias = tuple[str, Path | None]
"""What the user knows a file by, such as "--json", and where it is; None for a file that was not named."""

_DESCRIPTOR = re.compile(r"/dev/(?P<name>stdout|stderr)|/(?:dev|proc/self)/fd/(?P<number>\d+)")
_ENDINGS = [number for name in ("SIGINT", "SIGTERM", "SIGHUP") if (number := getattr(signal, name, None)) is not None]


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
        if str(path) == "-":
            raise BadInputError(f"{name} is '-': name a file; what is one text can be written to /dev/stdout.")
        for other, taken in read:
            if _is_same(path, taken):
                raise BadInputError(f"{path} is {other} itself; give {name} another name.")
        for other, taken in written:
            if _is_same(path, taken):
                raise BadInputError(f"{other} and {name} would both write {path}; give one of them another name.")
        written.append((name, path))
    for _, path in written:
        _check_writable(path)


def check_suffix(name: str, path: Path | None, suffix: str, *, pipes: bool = True) -> None:
    """Pass if a file that is to be written is called what it is; a device or a pipe is called what it likes.

    Args:
        name: what the user knows the file by.
        path: where it is to be; None for nowhere.
        suffix: what its name should end in.
        pipes: whether it may be a device or a pipe.

    Raises:
        BadInputError: its name ends in something else, or it is no file and should be one.
    """
    if path is None or (path.suffix == suffix and (pipes or not is_pipe(path))):
        return
    if is_pipe(path):
        if pipes:
            return
        raise BadInputError(f"{name} {path}: is a pipe or a device, and this is written to files only.")
    raise BadInputError(f"{name} {path}: expected a name that ends in {suffix}.")


def is_pipe(path: Path) -> bool:
    """Whether a path names something that is written straight: a pipe, a device, what a shell calls /dev/stdout."""
    try:
        return _DESCRIPTOR.fullmatch(str(path)) is not None or (
            path.exists() and not path.is_file() and not path.is_dir()
        )
    except OSError:  # not even looked at; writing will tell
        return False


def write_file(path: Path, content: bytes, *, make_folder: bool = False) -> None:
    """Write a file: complete under its name, or not at all.

    Args:
        path: where.
        content: of it.
        make_folder: whether a folder that does not exist is made for it.

    Raises:
        BadInputError: it cannot be written; what was there before is as it was.
    """
    if make_folder:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BadInputError(f"Cannot write {path}: {error.strerror}.") from error
    write_files({path: content})


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write files that belong together: all of them appear under their names, or none.

    Args:
        files: by path; the last one is what the others belong to, and it is never seen without them.

    Raises:
        BadInputError: one cannot be written; what was there before is as it was.
    """
    at = next(iter(files), Path())
    try:
        for at, content in files.items():
            if is_pipe(at):
                _write_pipe(at, content)
        kept = [path for path in files if not is_pipe(path)]
        with drafts(*kept) as places:
            for at, place in zip(kept, places, strict=True):
                place.write_bytes(files[at])
    except OSError as error:
        raise BadInputError(f"Cannot write {at}: {error.strerror or error}.") from error


@contextlib.contextmanager
def drafts(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Yield an empty file beside each path to write to; when the block ends they get their names, all or none.

    A link stays one: what it points to is replaced. An exception leaves what was there.

    Args:
        paths: the last one is what the others belong to, and it is never seen without them.

    Raises:
        OSError: one cannot be written.
    """
    with places_beside(*paths) as places:
        yield places
        publish(list(zip(places, paths, strict=True)))


@contextlib.contextmanager
def places_beside(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Yield an empty file beside each path, with its permissions; what is still there at the end of the block goes.

    Raises:
        OSError: one cannot be made.
    """
    places: list[Path] = []
    try:
        for path in paths:
            place = beside(path, f".partial{path.suffix}")
            places.append(place)
            place.touch(exist_ok=False)
            with contextlib.suppress(FileNotFoundError):  # nothing is there, or another process is just replacing it
                shutil.copymode(path, place)
        yield tuple(places)
    finally:
        with uninterrupted():
            for place in places:
                place.unlink(missing_ok=True)


def beside(path: Path, ending: str) -> Path:
    """A hidden name in the folder of a file, or of what it links to, that nothing has."""
    return path.resolve().parent / f".massid-{secrets.token_hex(6)}{ending}"


def publish(files: Sequence[tuple[Path, Path]]) -> None:
    """Give complete files their names, all of them or, if one cannot have it, none.

    They are brought to the disk first. While they change places nothing stands under the last one's name: whoever
    looks, or is left with what a power cut makes of it, finds files that belong together or none.

    Args:
        files: what each is called now and is to be called; the last one is what the others belong to.

    Raises:
        OSError: one cannot have its name; all that was there is there again.
    """
    targets = [path.resolve() for _, path in files]
    for place, _ in files:
        _sync(place)
    replaced: list[tuple[Path, Path]] = []
    placed: list[Path] = []
    with uninterrupted(), _alone_in({target.parent for target in targets} if len(targets) > 1 else set()):
        try:
            for target in reversed(targets) if len(targets) > 1 else ():
                if target.exists():
                    replaced.append((beside(target, ".old"), target))
                    target.rename(replaced[-1][0])
            for (place, _), target in zip(files, targets, strict=True):
                place.replace(target)
                placed.append(target)
        except OSError:
            for target in placed:
                target.unlink(missing_ok=True)
            for old, target in reversed(replaced):
                if old.exists():
                    old.replace(target)
            raise
        for old, _ in replaced:
            old.unlink(missing_ok=True)
        for folder in {target.parent for target in targets}:
            _sync(folder)


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Let Ctrl-C and the signals that end a program wait until the block is done.

    Blocking them would not do: any thread of the process may be given a signal, and Python handles it in the main one.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # no handler runs here
        return
    waiting: list[int] = []
    before: dict[int, Any] = {}
    done = False

    def note(number: int, frame: FrameType | None) -> None:
        if not done:
            waiting.append(number)
        elif callable(before[number]):
            before[number](number, frame)

    try:
        for number in _ENDINGS:
            handler = signal.getsignal(number)
            if handler not in (None, signal.SIG_IGN):
                before[number] = handler
                signal.signal(number, note)
        yield
    finally:
        done = True
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in waiting:
            signal.raise_signal(number)


def open_alone(path: Path) -> IO[bytes]:
    """Open a file to write it from its beginning, unless another process is writing it.

    Raises:
        BadInputError: another process is.
        OSError: it cannot be opened.
    """
    while True:
        stream = os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT, 0o666), "r+b")
        try:
            if fcntl is not None:
                try:
                    fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError as error:
                    raise BadInputError(
                        f"{path} is being written by another process; wait for its end, or choose another name."
                    ) from error
                except OSError:  # a file system without locks
                    pass
            if path.exists() and os.path.samestat(os.fstat(stream.fileno()), path.stat()):
                stream.truncate()
                return stream
        except BaseException:
            stream.close()
            raise
        stream.close()  # whoever wrote it has given it its final name in the meantime


@contextlib.contextmanager
def _alone_in(folders: set[Path]) -> Iterator[None]:
    """Wait until no other process gives files that belong together their names in these folders."""
    with contextlib.ExitStack() as locks:
        for folder in sorted(folders):
            if fcntl is not None:
                with contextlib.suppress(OSError):  # a file system without locks
                    number = os.open(folder, os.O_RDONLY)
                    locks.callback(os.close, number)
                    fcntl.flock(number, fcntl.LOCK_EX)
        yield


def _sync(path: Path) -> None:
    """Bring a file, or the names in a folder, to the disk."""
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    except OSError:
        if not path.is_dir():  # some file systems refuse it for folders
            raise
    finally:
        os.close(number)


def _write_pipe(path: Path, content: bytes) -> None:
    match = _DESCRIPTOR.fullmatch(str(path))
    if match is None:
        path.write_bytes(content)
        return
    sys.stdout.flush()
    number = {"stdout": 1, "stderr": 2}.get(match["name"] or "") or int(match["number"] or 0)
    with os.fdopen(os.dup(number), "wb") as stream:  # opened by its name, a file would be written from its beginning
        stream.write(content)


def _is_same(path: Path, other: Path) -> bool:
    try:
        return path.resolve() == other.resolve() or (path.exists() and other.exists() and path.samefile(other))
    except (OSError, RuntimeError):  # a folder that may not be entered, links in a circle: reading or writing will tell
        return False


def _check_writable(path: Path) -> None:
    try:
        if is_pipe(path):
            return  # opening a pipe would wait for its reader
        target = path.resolve()
        if not target.parent.is_dir():
            raise BadInputError(f"Cannot write {path}: the folder {path.parent} does not exist.")
        if target.is_dir():
            raise BadInputError(f"Cannot write {path}: it is a folder.")
        if target.exists() and not os.access(target, os.W_OK):
            raise BadInputError(f"Cannot write {path}: Permission denied.")
        with tempfile.TemporaryFile(dir=target.parent):
            pass
        (target.parent / f"{target.name}.partial").exists()  # a name that is too long
    except OSError as error:
        raise BadInputError(f"Cannot write {path}: {error.strerror}.") from error
    except RuntimeError as error:
        raise BadInputError(f"Cannot write {path}: its links go in a circle.") from error
