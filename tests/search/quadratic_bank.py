"""A bank without dynamics: its output error is affine in the parameters (Remark 3), or bent on request."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from massid.search.bank import OutputErrors
from massid.search.guided import GuidedSearch, Iteration
from massid.search.monitoring import Monitoring, MonitoringFilter
from massid.search.parameters import Parameter, ParameterSpace
from massid.search.proposal import Proposal
from massid.typing import FloatArray

TIMESTEP_S = 0.01


def make_space(n_p: int = 3, bound: float = 10.0) -> ParameterSpace:
    own = [Parameter(f"p{i}", nominal=0.0, lower=-bound, upper=bound, scale=1.0) for i in range(n_p)]
    return ParameterSpace(tuple(own))


@dataclass
class QuadraticBank:
    """y~_k(p) = J_k (p - p*) + bend (p - p*)^2, the same in every window."""

    jacobian: FloatArray  # (n_steps, n_y, n_p)
    truth: FloatArray
    n_models: int
    bend: float = 0.0
    diverging: tuple[int, ...] = ()
    timestep_s: float = TIMESTEP_S
    points: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def place(self, points: FloatArray) -> None:
        self.points = points

    def restart(self, block: object) -> None: ...

    def advance(self, block: object) -> OutputErrors:
        offset = self.points - self.truth
        values = np.einsum("kyp,np->nky", self.jacobian, offset + self.bend * offset**2)
        diverged = np.zeros(len(offset), dtype=np.bool_)
        diverged[list(self.diverging)] = True
        values[diverged] = np.nan
        return OutputErrors(values, diverged)


def score(bank: QuadraticBank, proposal: Proposal, forgetting_rate: float = 0.0) -> Monitoring:
    bank.place(proposal.points)
    scores = MonitoringFilter(bank.n_models, bank.timestep_s, forgetting_rate)
    scores.update(bank.advance(None))
    return scores.result(proposal)


def drive(search: GuidedSearch, bank: QuadraticBank, windows: int) -> list[Iteration]:
    return [search.tell(score(bank, search.ask())) for _ in range(windows)]
