"""What a search ends with and what is made of it, whatever the sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from massid.result.excitation import Excitation
from massid.result.result import Uncertainty
from massid.search.guided import Iteration
from massid.search.monitoring import Monitoring
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray


@dataclass(frozen=True)
class Findings:
    """What a search ended with.

    Attributes:
        space: what was unknown, nuisances included.
        estimate: shape (n_p,).
        information: sum of what all windows and the prior say.
        last: the last window's quadratic, or that of the last pass over all windows, without the prior.
        windows: each window's own part, if it was kept.
        inflation: how much more the scores of windows that were not kept scatter than noise explains.
        rise: by what share the last pass explains the log worse than the best one did.
    """

    space: ParameterSpace
    estimate: FloatArray
    information: LocalQuadratic
    last: LocalQuadratic
    windows: tuple[LocalQuadratic, ...] = ()
    inflation: float = 1.0
    rise: float = 0.0


@dataclass(frozen=True)
class Assessment:
    """How certain findings are.

    Attributes:
        excitation: what the log reveals of each parameter asked for.
        uncertainty: what noise leaves open; None for readings without error.
        settled: whether the search has come to rest.
        warnings: what speaks against the findings, one line each.
        contradicted: whether that is so much that they must not be relied on, however well the search has settled.
    """

    excitation: Excitation
    uncertainty: Uncertainty | None
    settled: bool
    warnings: tuple[str, ...]
    contradicted: bool = False


class Learning(Protocol):
    """What windows of a stream, each seen once, add up to."""

    @property
    def belief(self) -> LocalQuadratic | None:
        """What is known when a window begins, in units of mu; None where windows are judged on their own."""

    @property
    def information(self) -> LocalQuadratic:
        """Sum of what all windows and the prior say."""

    @property
    def last(self) -> LocalQuadratic:
        """The last window's quadratic."""

    @property
    def starts_anew(self) -> bool:
        """Whether the next window starts at the measurement even if the models could go on."""

    @property
    def converged(self) -> bool:
        """Whether further windows change nothing."""

    @property
    def settled(self) -> bool:
        """Whether the estimate would be called one if the stream ended now."""

    @property
    def inflation(self) -> float:
        """How much more the scores of windows scatter than noise explains."""

    def learn(self, monitoring: Monitoring, iteration: Iteration) -> FloatArray | None:
        """Take in a window; returns the standard deviations of the parameters asked for, None if none are known."""

    def next_walk(self, before: ParameterSpace, space: ParameterSpace) -> bool:
        """Go on with another walk of the same robot; returns whether the search has to start anew."""
