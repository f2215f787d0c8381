"""Which numbers an option may have."""

from __future__ import annotations

import math
from collections.abc import Mapping

from massid.errors import BadInputError


class OptionError(BadInputError):
    """An option has a number that it must not have.

    Attributes:
        option: its name in Python; the command line writes it with dashes.
        problem: what was found and what was expected, to be said after the name.
    """

    def __init__(self, option: str, value: float, expected: str) -> None:
        self.option, self.problem = option, f"is {value}; it must be {expected}."
        super().__init__(f"{option} {self.problem}")


def require_positive(options: Mapping[str, float]) -> None:
    """Pass if all numbers are finite and above zero.

    Raises:
        OptionError: one is not.
    """
    for name, value in options.items():
        if not (math.isfinite(value) and value > 0):
            raise OptionError(name, value, "a finite number above 0")


def require_at_most(most: float, options: Mapping[str, float]) -> None:
    """Pass if no number is larger.

    Raises:
        OptionError: one is.
    """
    for name, value in options.items():
        if value > most:
            raise OptionError(name, value, f"at most {most:g}")


def require_not_negative(options: Mapping[str, float]) -> None:
    """Pass if all numbers are finite and at least zero.

    Raises:
        OptionError: one is not.
    """
    for name, value in options.items():
        if not (math.isfinite(value) and value >= 0):
            raise OptionError(name, value, "a finite number, at least 0")
