"""Files that are read: regular ones, and none larger than somebody can have meant."""

from __future__ import annotations

import os
import stat
from pathlib import Path

LARGEST_TEXT = 1 << 28
"""Bytes of a file that is read as a whole."""


def problem_of(path: Path, largest: int | None = None) -> str:
    """Why a path cannot be read as a file, as the end of a sentence; "" if it can.

    A pipe without a writer would be waited for, and most files are read more than once.

    Args:
        path: of the file.
        largest: bytes that it may have; None for any number.
    """
    try:
        status = path.stat()
    except FileNotFoundError:
        return "does not exist"
    except (OSError, ValueError) as error:
        return f"cannot be read: {getattr(error, 'strerror', None) or error}"
    if not stat.S_ISREG(status.st_mode):
        return f"is a {'folder' if stat.S_ISDIR(status.st_mode) else 'pipe or a device'}, expected a file"
    if not os.access(path, os.R_OK):
        return "cannot be read: Permission denied"
    if largest is not None and status.st_size > largest:
        return f"has {status.st_size} bytes, more than {largest}"
    return ""
