"""Inner loops compiled by numba, and kept on disk for the next process where anything can be written."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile a function of scalars and arrays on its first call.

    Numba keeps the result beside the source or in the user's cache folder. On machines where neither can be written it
    refuses to, and the function is compiled anew in every process.
    """
    compiled: Function
    try:
        compiled = njit(cache=True)(function)
    except RuntimeError:
        compiled = njit(function)
    return compiled
