"""Signals that end the program: nothing is left half done, and Ctrl-C during a search keeps what it has found."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType

_ENDINGS = ("SIGTERM", "SIGHUP")
_AGAIN_S = 0.02


class EndedError(KeyboardInterrupt):
    """Somebody ended the program by a signal other than Ctrl-C.

    Args:
        number: of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


@contextlib.contextmanager
def end_on_signals() -> Iterator[None]:
    """Let whatever runs be wound up as after Ctrl-C when the process is to end, instead of stopping where it is.

    What is ignored, as under nohup, stays ignored. Where Python can pass no exception on, as within a library's call
    back, the signal comes again a little later.
    """

    def end(number: int, frame: FrameType | None) -> None:
        raise EndedError(number)

    def unraisable(lost: sys.UnraisableHookArgs) -> None:
        if isinstance(lost.exc_value, KeyboardInterrupt):
            number = getattr(lost.exc_value, "number", signal.SIGINT)
            threading.Timer(_AGAIN_S, os.kill, (os.getpid(), number)).start()
        else:
            hook_before(lost)

    before = {}
    hook_before, sys.unraisablehook = sys.unraisablehook, unraisable
    if threading.current_thread() is threading.main_thread():
        for number in (getattr(signal, name) for name in _ENDINGS if hasattr(signal, name)):
            if signal.getsignal(number) == signal.SIG_DFL:
                before[number] = signal.signal(number, end)
    try:
        yield
    finally:
        sys.unraisablehook = hook_before
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def stop_on_interrupt() -> Iterator[Callable[[], bool]]:
    """Yield what says whether the user has asked to stop; outside the main thread nobody can.

    The first Ctrl-C ends a search with what it has found so far, the second one ends the program.
    """
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield asked.is_set
        return

    def note(number: int, frame: FrameType | None) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()
        sys.stderr.write("\nmassid: stopping with what is found so far; Ctrl-C once more ends at once and loses it\n")

    before = signal.signal(signal.SIGINT, note)
    try:
        yield asked.is_set
    finally:
        signal.signal(signal.SIGINT, before)
