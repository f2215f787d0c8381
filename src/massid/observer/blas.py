"""One BLAS thread for all that `massid.weigh` does: matrices are small, and the bank's threads use the processors.

On two cores, with a second program running, the Gram update of 154 rows took 136 ms with OpenBLAS's own threads and
4 ms without.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


def single_threaded() -> AbstractContextManager[object]:
    """Limit BLAS to one thread inside a `with` block."""
    limiter: AbstractContextManager[object] = _controller().limit(limits=1, user_api="blas")
    return limiter
