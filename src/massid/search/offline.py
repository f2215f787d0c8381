"""Offline search (Section IV-A): recordings are replayed as often as it takes, and mu is summed over all of them."""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from operator import add
from typing import Generic, Protocol

from massid.errors import StoppedError
from massid.search.bank import Bank, Block
from massid.search.guided import GuidedSearch, Iteration, SearchStatus
from massid.search.monitoring import Monitoring
from massid.search.online import WindowScorer
from massid.search.proposal import Proposal
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

MOST_PARTS = 64
"""Parts that a long recording's windows are kept in: enough to see how much their scores scatter."""


class Replay(Protocol):
    """One recording and the bank that is run through it."""

    @property
    def n_windows(self) -> int:
        """Dwell windows of the recording."""

    def run(self, proposal: Proposal, in_use: int) -> Iterator[Monitoring]:
        """Score a proposal in the first windows."""


class Outlook(enum.Enum):
    """What a pass leaves to be done."""

    GO_ON = enum.auto()
    NEAR = enum.auto()
    """Go on with the slope that was seen: so near the root that the centre's own score tells the rest."""
    WIDEN = enum.auto()
    """The first windows have taught what they can: look at all of them from now on."""
    SETTLED = enum.auto()
    STALLED = enum.auto()
    """Further passes gain nothing, although the search has not settled."""


class PassRule(Protocol):
    """When passes over a recording have taught what there is to learn."""

    @property
    def first_windows(self) -> int | None:
        """How many windows the first passes look at; None for all."""

    def judge(self, iteration: Iteration, sees_all: bool) -> Outlook:
        """What to do after a pass that looked at all windows, or at the first ones only."""


class UntilConverged:
    """The search's own termination condition, over all windows."""

    first_windows: int | None = None

    def judge(self, iteration: Iteration, sees_all: bool) -> Outlook:
        """End when the search has converged."""
        return Outlook.SETTLED if iteration.status is SearchStatus.CONVERGED else Outlook.GO_ON


@dataclass(frozen=True)
class OfflineRun:
    """How passes went.

    Attributes:
        estimate: where the search ended, shape (n_p,).
        iterations: what it made of each pass.
        scores: of the windows in the last pass, without the prior; neighbours together where they are many.
        converged: whether it settled.
        stopped: whether it was stopped from outside.
        rise: by what share mu of the last pass exceeds the lowest of all passes over the whole recordings.
    """

    estimate: FloatArray
    iterations: tuple[Iteration, ...]
    scores: tuple[Monitoring, ...]
    converged: bool
    stopped: bool = False
    rise: float = 0.0


def run_offline(
    replays: Sequence[Replay],
    search: GuidedSearch,
    passes: int,
    rule: PassRule | None = None,
    prior: LocalQuadratic | None = None,
    progress: Callable[[int, float], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> OfflineRun:
    """Minimise the sum of mu over recorded windows.

    Args:
        replays: recordings, each with its bank.
        search: asks and is told.
        passes: how often the recordings are replayed at most.
        rule: when it ends earlier; default when the search has converged.
        prior: what is believed of the unknowns before, in units of mu.
        progress: told the number of the pass, from 0, and the fraction of it done.
        stop: asked after every window; once it says so, the passes completed by then are all there are.

    Raises:
        DivergedBankError: too few models stayed finite.
        StoppedError: stopped in the first pass.
    """
    rule = rule or UntilConverged()
    n_windows = max(replay.n_windows for replay in replays)
    in_use = min(rule.first_windows or n_windows, n_windows)
    iterations: list[Iteration] = []
    scores: list[Monitoring] = []
    outlook, stopped = Outlook.GO_ON, False
    whole: list[float] = []
    slopes: list[FloatArray | None] = []
    for index in range(passes):
        proposal = search.ask(alone=bool(slopes))
        found = _score(replays, proposal, in_use, partial(progress, index) if progress else None, stop)
        if found is None:
            stopped = True
            break
        scores = [replace(one, slope=slope) for one, slope in zip(found, slopes, strict=True)] if slopes else found
        iteration = search.tell(replace(reduce(add, scores), prior=prior), again=bool(iterations))
        iterations.append(iteration)
        if in_use >= n_windows:
            whole.append(iteration.mu)
        outlook = rule.judge(iteration, in_use >= n_windows)
        if outlook is Outlook.NEAR:
            slopes = slopes or [one.window_quadratic().slope for one in scores]
            slopes = slopes if all(slope is not None for slope in slopes) else []
            continue
        slopes = []
        if outlook is Outlook.WIDEN:
            in_use, search = n_windows, search.restarted()
        elif outlook is not Outlook.GO_ON:
            break
    if not iterations:
        raise StoppedError("Stopped in the first pass over the log: nothing was found yet.")
    rise = whole[-1] / min(whole) - 1.0 if whole and min(whole) > 0.0 else 0.0
    return OfflineRun(search.estimate, tuple(iterations), tuple(scores), outlook is Outlook.SETTLED, stopped, rise)


def _score(
    replays: Sequence[Replay],
    proposal: Proposal,
    in_use: int,
    progress: Callable[[float], None] | None,
    stop: Callable[[], bool] | None,
) -> list[Monitoring] | None:
    """Score a proposal in the first windows of every recording; None if it was stopped.

    However long the recordings are, no more than `MOST_PARTS` scores are kept: then neighbours are added up.
    """
    n_windows, done, together = sum(min(replay.n_windows, in_use) for replay in replays), 0, 1
    scores: list[Monitoring] = []
    for one in replays:
        for score in one.run(proposal, in_use):
            if done % together == 0:
                scores.append(score)
            else:
                scores[-1] = scores[-1] + score
            done += 1
            if len(scores) == MOST_PARTS and done % together == 0:
                scores = [before + after for before, after in zip(scores[::2], scores[1::2], strict=True)]
                together *= 2
            if progress is not None:
                progress(done / n_windows)
            if stop is not None and stop():
                return None
    return scores


@dataclass(frozen=True)
class BlockReplay(Generic[Block]):
    """Recorded blocks, each a dwell window of its own that begins with a fresh state.

    Attributes:
        bank: the models.
        blocks: what was measured.
        forgetting_rate: lambda of Eq. (6) within each block [1/s].
    """

    bank: Bank[Block]
    blocks: Sequence[Block]
    forgetting_rate: float

    @property
    def n_windows(self) -> int:
        """Number of blocks."""
        return len(self.blocks)

    def run(self, proposal: Proposal, in_use: int) -> Iterator[Monitoring]:
        """Score a proposal in the first blocks."""
        scorer = WindowScorer(self.bank, self.forgetting_rate)
        for block in self.blocks[:in_use]:
            yield scorer.score(proposal, block)

    def total(self, proposal: Proposal) -> Monitoring:
        """Sum of the scores over all blocks."""
        return reduce(add, self.run(proposal, self.n_windows))
