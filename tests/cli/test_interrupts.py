"""Ctrl-C while a search runs."""

from __future__ import annotations

import signal
import time

import pytest

from massid.cli.interrupts import EndedError, end_on_signals, stop_on_interrupt


def test_the_first_interrupt_asks_and_the_second_ends(capsys: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), stop_on_interrupt() as asked:
        assert not asked()
        signal.raise_signal(signal.SIGINT)
        assert asked()
        assert "Ctrl-C once more" in capsys.readouterr().err
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


class Dying:
    """Raises what no caller can catch."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGTERM)


def test_a_signal_that_nobody_could_be_told_of_comes_again() -> None:
    with pytest.raises(EndedError, match="SIGTERM"), end_on_signals():
        one: Dying | None = Dying()
        assert one is not None
        one = None
        time.sleep(10.0)
