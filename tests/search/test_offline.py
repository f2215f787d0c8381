"""Passes over recordings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from massid.search.guided import GuidedSearch
from massid.search.monitoring import Monitoring
from massid.search.offline import MOST_PARTS, run_offline
from massid.search.proposal import Proposal
from tests.search.quadratic_bank import QuadraticBank, make_space, score


@dataclass(frozen=True)
class Windows:
    """Many windows of one bank."""

    n_windows: int

    def run(self, proposal: Proposal, in_use: int) -> Iterator[Monitoring]:
        for index in range(in_use):
            bank = QuadraticBank(np.random.default_rng(index).normal(size=(4, 2, 3)), np.ones(3), len(proposal.points))
            yield score(bank, proposal)


@pytest.mark.parametrize("n_windows", [3, MOST_PARTS, 5 * MOST_PARTS + 3])
def test_long_recordings_are_summed_up_in_few_parts(n_windows: int) -> None:
    search = GuidedSearch(make_space(), 9)
    replay, proposal = Windows(n_windows), search.ask()
    run = run_offline([replay], search, passes=1)
    assert min(n_windows, MOST_PARTS // 2) <= len(run.scores) <= MOST_PARTS
    whole = sum(one.mu for one in replay.run(proposal, n_windows))
    np.testing.assert_allclose(sum(part.mu for part in run.scores), whole, rtol=1e-12)
