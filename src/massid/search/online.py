"""Online search (Section IV-B): dwell windows follow each other, each is seen once, and nothing of it is stored."""

from __future__ import annotations

from typing import Generic, Protocol

from massid.search.bank import Bank, Block
from massid.search.guided import Iteration
from massid.search.monitoring import Monitoring, MonitoringFilter
from massid.search.proposal import Proposal
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray, IntArray


class Searcher(Protocol):
    """What drives a bank from window to window: points to simulate, scores back, an estimate."""

    @property
    def estimate(self) -> FloatArray:
        """The current estimate, shape (n_p,)."""

    def ask(self) -> Proposal:
        """Points to simulate in the next window."""

    def tell(self, monitoring: Monitoring) -> Iteration | None:
        """Learn from one window; None where there is nothing to say about it."""


class WindowScorer(Generic[Block]):
    """Runs a bank through one dwell window after another, block by block as measurements arrive.

    Args:
        bank: the models.
        forgetting_rate: lambda of Eq. (6) within a window [1/s].
    """

    def __init__(self, bank: Bank[Block], forgetting_rate: float = 0.0) -> None:
        self._bank, self._forgetting_rate = bank, forgetting_rate
        self._samples: IntArray | None = None
        self._follows = False

    def open(self, proposal: Proposal, *, anew: bool = True) -> None:
        """Begin a window with the points of a proposal.

        Args:
            proposal: what the models are placed at.
            anew: whether they start at the measurement, even if they could go on from the window before.
        """
        self._bank.place(proposal.points)
        self._proposal, self._anew = proposal, anew
        self._filter = MonitoringFilter(self._bank.n_models, self._bank.timestep_s, self._forgetting_rate)
        self._at_start = True

    def interrupt(self) -> None:
        """There is a gap: the next block does not follow the one before."""
        self._follows, self._samples = False, None

    def advance(self, block: Block) -> None:
        """Take the next block of the window."""
        if self._at_start:
            if self._anew or self._samples is None or not self._bank.carries_belief:
                self._bank.restart(block, follows=self._follows)
            else:
                self._bank.carry_on(self._samples)
            self._at_start, self._follows = False, True
        self._filter.update(self._bank.advance(block))

    def close(self, prior: LocalQuadratic | None = None) -> Monitoring:
        """What the models scored in the window, on top of what was known before."""
        monitoring = self._filter.result(self._proposal, prior)
        samples = self._proposal.samples
        self._samples = samples[~monitoring.diverged[samples]]
        return monitoring

    def score(self, proposal: Proposal, block: Block) -> Monitoring:
        """A window that is one block, on its own."""
        self.open(proposal)
        self.advance(block)
        return self.close()


def score_block(bank: Bank[Block], proposal: Proposal, block: Block, forgetting_rate: float) -> Monitoring:
    """Simulate all points of a proposal over one block, from its beginning."""
    return WindowScorer(bank, forgetting_rate).score(proposal, block)
