"""What an identification found: a frozen trace that knows nothing of the truth."""

from __future__ import annotations

import enum
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from massid.errors import BadInputError
from massid.identify.excitation import Excitation
from massid.parameters import Kind, ParameterSpace
from massid.search.guided import Iteration
from massid.search.proposal import Role
from massid.typing import FloatArray, IntArray

SCHEMA = 1


class Status(enum.StrEnum):
    """How an identification ended."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not converged"
    NOT_IDENTIFIABLE = "not identifiable"


@dataclass(frozen=True)
class WindowResult:
    """One update of the estimate.

    Attributes:
        index: number of the update, from 0: the dwell window online, the pass over the log offline.
        time_s: time in the log at which the update was made, since its first sample [s].
        estimate: shape (n_p,).
        mu: scores of all models, shape (n_models,); inf for diverged ones.
        best: row of p_best.
        points: parameters of all models, shape (n_models, n_p).
        roles: what each model was for.
        newton_step: distance to the predicted minimum, shape (n_p,).
        diverged: rows of the models that diverged.
    """

    index: int
    time_s: float
    estimate: FloatArray
    mu: FloatArray
    best: int
    points: FloatArray
    roles: tuple[Role, ...]
    newton_step: FloatArray
    diverged: IntArray

    @classmethod
    def from_iteration(cls, iteration: Iteration, time_s: float) -> WindowResult:
        """Keep what is worth keeping of a search iteration."""
        monitoring = iteration.monitoring
        return cls(
            index=iteration.index,
            time_s=time_s,
            estimate=iteration.estimate,
            mu=monitoring.mu,
            best=iteration.best,
            points=monitoring.proposal.points,
            roles=monitoring.proposal.roles,
            newton_step=iteration.newton_step,
            diverged=monitoring.diverged.nonzero()[0],
        )


@dataclass(frozen=True)
class Result:
    """What an identification found.

    Attributes:
        space: what was unknown.
        estimate: the final estimate, shape (n_p,).
        status: how it ended.
        windows: every update.
        excitation: what the log reveals of each parameter.
        mode: "online" or "offline".
        log_s: time covered by the log [s].
        wall_s: time it took [s].
        warnings: what the user should know, one line each.
        source: the log.
    """

    space: ParameterSpace
    estimate: FloatArray
    status: Status
    windows: tuple[WindowResult, ...]
    excitation: Excitation
    mode: str
    log_s: float
    wall_s: float
    warnings: tuple[str, ...] = ()
    source: str = "walk"

    @property
    def estimate_kg(self) -> dict[str, float]:
        """Estimated mass of each link [kg]."""
        return self.masses_kg(self.estimate)

    @property
    def nominal_kg(self) -> dict[str, float]:
        """Nominal mass of each link [kg]."""
        return self.masses_kg(self.space.nominal)

    def masses_kg(self, point: FloatArray) -> dict[str, float]:
        """The masses among the coordinates of a point, by link [kg]."""
        return {
            parameter.target: float(value)
            for parameter, value in zip(self.space.parameters, point, strict=True)
            if parameter.kind is Kind.MASS
        }

    def to_json(self) -> dict[str, Any]:
        """The result as plain JSON values (schema 1), without any truth."""
        nominal = self.nominal_kg
        identifiable = dict(zip((p.target for p in self.space.parameters), self.excitation.identifiable, strict=True))
        return {
            "schema": SCHEMA,
            "links": {
                link: {"nominal_kg": nominal[link], "estimate_kg": value, "identifiable": bool(identifiable[link])}
                for link, value in self.estimate_kg.items()
            },
            "iterations": [
                {
                    "window": window.index,
                    "time_s": window.time_s,
                    "mu": float(window.mu[window.best]),
                    "estimate_kg": self.masses_kg(window.estimate),
                }
                for window in self.windows
            ],
            "status": str(self.status),
            "mode": self.mode,
            "warnings": list(self.warnings),
            "wall_s": self.wall_s,
            "log_s": self.log_s,
        }


def write_json(document: dict[str, Any], path: Path) -> None:
    """Write a result document.

    Raises:
        BadInputError: the file cannot be written.
    """
    try:
        path.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n")
    except OSError as error:
        raise BadInputError(f"Cannot write {path}: {error.strerror}.") from error
