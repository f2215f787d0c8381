"""Memory that was freed goes back to the system."""

from __future__ import annotations

import ctypes
import sys


def give_back() -> None:
    """Hand back what was freed: of decoding ten minutes of a robot, or compiling its meshes, half of what was taken.

    The GNU C library keeps it, for it lies in pieces between what is still in use; other libraries have no such call.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)
