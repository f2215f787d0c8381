"""Search directions: from a local quadratic to the step that the line search begins with (Section III, step 2).

One direction, one file, one interface. A module of this folder that has `MAKERS` offers what is in it by name; nothing
else has to know.
"""

from __future__ import annotations

import copy
from importlib import import_module
from pkgutil import iter_modules

from massid.errors import BadInputError, unknown_name
from massid.search.directions.direction import Direction, Makers

__all__ = ["DIRECTIONS", "Direction", "direction_name", "direction_names", "make_direction"]


def _gather() -> Makers:
    modules = (import_module(f"{__name__}.{found.name}") for found in iter_modules(__path__))
    return {name: maker for module in modules for name, maker in getattr(module, "MAKERS", {}).items()}


DIRECTIONS: Makers = _gather()
"""All directions that have a name."""


def make_direction(direction: str | Direction, step_size: float = 0.0) -> Direction:
    """A direction for one search: a new one by name, or a copy of one that was handed in.

    Raises:
        BadInputError: there is none of this name, or what was handed in has no `step`.
    """
    if isinstance(direction, str):
        if direction not in DIRECTIONS:
            raise BadInputError(unknown_name("direction", direction, direction_names(), "The search"))
        return DIRECTIONS[direction](step_size)
    if not callable(getattr(direction, "step", None)) or not isinstance(getattr(direction, "second_order", None), bool):
        raise BadInputError(
            f"{type(direction).__name__} is no direction: expected a name, or an object with `step` and `second_order`."
        )
    return copy.deepcopy(direction)


def direction_names() -> tuple[str, ...]:
    """Names of all directions, the default first."""
    return tuple(sorted(DIRECTIONS, key=lambda name: (not name.startswith("gauss"), name)))


def direction_name(direction: str | Direction) -> str:
    """What a direction is called: its name, or that of its class."""
    return direction if isinstance(direction, str) else type(direction).__name__
