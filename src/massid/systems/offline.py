"""Offline identification of a system (Section IV-A): recorded blocks are replayed as often as it takes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import add

from massid.search.bank import Bank
from massid.search.guided import Iteration, SearchStatus
from massid.search.monitoring import Monitoring
from massid.search.proposal import Proposal
from massid.systems.online import Block, Search, score_block


def score_blocks(bank: Bank[Block], proposal: Proposal, blocks: Sequence[Block], forgetting_rate: float) -> Monitoring:
    """Sum of the scores over recorded blocks; every block begins with a fresh state."""
    return reduce(add, (score_block(bank, proposal, block, forgetting_rate) for block in blocks))


def run_offline(
    blocks: Sequence[Block],
    bank: Bank[Block],
    search: Search,
    passes: int,
    forgetting_rate: float,
) -> list[Iteration]:
    """Minimise the sum of mu over recorded blocks.

    Args:
        blocks: what was measured.
        bank: models of the system.
        search: asks and is told.
        passes: how often the blocks are replayed at most; it ends earlier when the search converges.
        forgetting_rate: lambda of Eq. (6) within each block [1/s].

    Returns:
        What the search made of each pass.

    Raises:
        DivergedBankError: too few models stayed finite.
    """
    iterations: list[Iteration] = []
    for _ in range(passes):
        iteration = search.tell(score_blocks(bank, search.ask(), blocks, forgetting_rate))
        if iteration is not None:
            iterations.append(iteration)
            if iteration.status is SearchStatus.CONVERGED:
                break
    return iterations
