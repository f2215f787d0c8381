"""What the search needs from identification models: a bank that is placed, restarted and advanced.

Humanoids, the paper's small systems and a user's own system all implement the same protocol, so one search drives
them all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

from massid.typing import BoolArray, FloatArray

Block_contra = TypeVar("Block_contra", contravariant=True)


@dataclass(frozen=True)
class OutputErrors:
    """Output errors of all models over a block of steps.

    Attributes:
        values: weighted y_hat - y at the end of each step, shape (n_models, n_steps, n_y).
        diverged: models that left the finite numbers, shape (n_models,); their values mean nothing.
        tangents: derivatives of the centre's values by the last coordinates of the points, at least those that no
            models are sampled in, shape (n, n_steps, n_y); None for no such coordinates. Where they are given they
            stand for what the samples show.
    """

    values: FloatArray
    diverged: BoolArray
    tangents: FloatArray | None = None


class Bank(Protocol[Block_contra]):
    """N identification models (Eq. 3) that run side by side on the same measurements."""

    @property
    def n_models(self) -> int:
        """Number of models N."""

    @property
    def timestep_s(self) -> float:
        """Period of the output errors [s]."""

    def place(self, points: FloatArray) -> None:
        """Give each model its parameter estimate; points has shape (n_models, n_p)."""

    def restart(self, block: Block_contra) -> None:
        """Set every model's state to the state measured at the beginning of a block (dwell start)."""

    def advance(self, block: Block_contra) -> OutputErrors:
        """Run every model through a block of measurements."""
