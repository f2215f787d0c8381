"""What the search needs from identification models: a bank that is placed, restarted and advanced.

Humanoids, the paper's small systems and a user's own system are all such banks, so one search drives them all.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Generic, TypeVar

from massid.typing import BoolArray, FloatArray, IntArray

Block = TypeVar("Block")


@dataclass(frozen=True)
class Shown:
    """Derivatives of the centre's weighted output errors as its own trajectory shows them.

    Attributes:
        columns: by which coordinates of the points, shape (m,).
        values: shape (m, n_steps, n_y).
    """

    columns: IntArray
    values: FloatArray


@dataclass(frozen=True)
class OutputErrors:
    """Output errors of all models over a block of steps.

    Attributes:
        values: weighted y_hat - y at the end of each step, shape (n_models, n_steps, n_y).
        diverged: models that left the finite numbers, shape (n_models,); their values mean nothing.
        tangents: derivatives of the centre's values by the last coordinates of the points, at least those that no
            models are sampled in, shape (n, n_steps, n_y); None for no such coordinates. Where they are given they
            stand for what the samples show.
        shown: what the centre itself shows where that is not `tangents`, which share no noise with its output errors on
            purpose; None where it is the same for all, or nobody asked.
        explained: how many of the n_y errors of each step say nothing, since inputs that are not known take them up,
            shape (n_steps,); None for none.
    """

    values: FloatArray
    diverged: BoolArray
    tangents: FloatArray | None = None
    shown: Shown | None = None
    explained: IntArray | None = None

    def later(self, first: int) -> OutputErrors:
        """Those of the steps from the first one asked for on, none of them if there are fewer."""
        if first <= 0:
            return self
        return OutputErrors(
            values=self.values[:, first:],
            diverged=self.diverged,
            tangents=None if self.tangents is None else self.tangents[:, first:],
            shown=None if self.shown is None else Shown(self.shown.columns, self.shown.values[:, first:]),
            explained=None if self.explained is None else self.explained[first:],
        )


class Bank(ABC, Generic[Block]):
    """N identification models (Eq. 3) that run side by side on the same measurements.

    Humanoids, the paper's small systems and a user's own all are such a bank, so that one pair of drivers
    (`massid.search.offline`, `massid.search.online`) and any other optimiser can run them. A block is whatever a bank
    takes its measurements from.
    """

    @property
    @abstractmethod
    def n_models(self) -> int:
        """Number of models N."""

    @property
    @abstractmethod
    def timestep_s(self) -> float:
        """Period of the output errors [s]."""

    @property
    def carries_belief(self) -> bool:
        """Whether models go on from window to window (`carry_on`) instead of starting at the measurement again."""
        return False

    @abstractmethod
    def place(self, points: FloatArray) -> None:
        """Give each model its parameter estimate; points has shape (n_models, n_p)."""

    @abstractmethod
    def restart(self, block: Block, *, follows: bool = False) -> None:
        """Set every model's state to the state measured at the beginning of a block (dwell start).

        Args:
            block: what comes next.
            follows: whether it follows the block before without a gap.
        """

    def carry_on(self, samples: IntArray) -> None:
        """Go on from the window before with the points placed since; called only of banks that carry a belief.

        Args:
            samples: rows that were samples around the centre, row 0, and did not diverge.
        """

    @abstractmethod
    def advance(self, block: Block) -> OutputErrors:
        """Run every model through a block of measurements."""
