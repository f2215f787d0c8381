"""What both outputs show of a result: errors, estimates and scores over the updates, with or without the truth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from massid.identify.result import Result, WindowResult
from massid.parameters import Kind
from massid.score import Score
from massid.search.proposal import Role
from massid.typing import BoolArray, FloatArray, IntArray

FLOOR_KG = 1e-12
"""Errors below this are rounding; the logarithmic axes end here."""
LINE_FRACTIONS = (0.0, 0.5, 2.0)
"""Where the candidates of a window lie on the step of the window before, from p_best to the estimate."""
FLOOR_MU = 1e-30
"""Scores below this are rounding."""


@dataclass(frozen=True)
class Trace:
    """A result as curves. Row 0 is the model file; row k + 1 is the estimate after update k.

    Attributes:
        links: the identified links.
        estimate_kg: shape (1 + n_updates, n_links).
        reference_kg: the true masses, or the final estimates when there is no truth, shape (n_links,).
        has_truth: which of the two.
        newton_step_kg: norm of the step that each window predicts, shape (n_updates,).
        updates: the windows behind the rows.
        identifiable: whether the log reveals each link, shape (n_links,).
        mode: "online" or "offline".
        update_time_s: time of each row in the log; offline all updates come at its end, shape (1 + n_updates,).
    """

    links: tuple[str, ...]
    estimate_kg: FloatArray
    reference_kg: FloatArray
    has_truth: bool
    newton_step_kg: FloatArray
    identifiable: BoolArray
    updates: tuple[WindowResult, ...]
    mode: str
    update_time_s: FloatArray

    @classmethod
    def of(cls, result: Result, score: Score | None) -> Trace:
        """Collect the curves of a result; `score` brings the truth."""
        space = result.space
        masses = [i for i, parameter in enumerate(space.parameters) if parameter.kind is Kind.MASS]
        links = tuple(space.parameters[i].target for i in masses)
        points = np.vstack([space.nominal, *(window.estimate for window in result.windows)])
        steps = np.array([window.newton_step[masses] for window in result.windows]).reshape(-1, len(masses))
        final = result.estimate[masses]
        return cls(
            links=links,
            estimate_kg=points[:, masses],
            reference_kg=final if score is None else np.array([score.true_kg[link] for link in links]),
            has_truth=score is not None,
            newton_step_kg=np.linalg.norm(steps, axis=1),
            identifiable=result.excitation.identifiable[masses],
            updates=result.windows,
            mode=result.mode,
            update_time_s=np.array([0.0, *(window.time_s for window in result.windows)]),
        )

    @property
    def online(self) -> bool:
        """Whether each update belongs to a moment of the walk."""
        return self.mode == "online"

    @property
    def nominal_kg(self) -> FloatArray:
        """Masses of the model file, shape (n_links,)."""
        return np.asarray(self.estimate_kg[0], dtype=np.float64)

    @cached_property
    def error_kg(self) -> FloatArray:
        """Estimate minus truth, or minus the final estimate without truth, shape (1 + n_updates, n_links)."""
        return self.estimate_kg - self.reference_kg

    @cached_property
    def l2_error_kg(self) -> FloatArray:
        """L2 norm of `error_kg`, shape (1 + n_updates,)."""
        return np.asarray(np.linalg.norm(self.error_kg, axis=1), dtype=np.float64)

    @cached_property
    def relative_error(self) -> FloatArray:
        """|error| as a fraction of the link's mass, shape (1 + n_updates, n_links): what colours the links."""
        return np.asarray(np.abs(self.error_kg) / self.reference_kg, dtype=np.float64)

    @cached_property
    def roles(self) -> tuple[tuple[Role, ...], ...]:
        """What each model of each window was for."""
        return tuple(_roles(window, self.updates[k - 1] if k else None) for k, window in enumerate(self.updates))

    def rows_of(self, update: int, role: Role) -> IntArray:
        """Models of one window that had a role."""
        return np.array([row for row, found in enumerate(self.roles[update]) if found is role], dtype=np.int64)

    def mu(self, update: int, role: Role) -> FloatArray:
        """Finite scores of the models of one window that had a role."""
        scores = self.updates[update].mu[self.rows_of(update, role)]
        return np.maximum(scores[np.isfinite(scores)], FLOOR_MU)


def _roles(window: WindowResult, before: WindowResult | None) -> tuple[Role, ...]:
    """Tell the line search's candidates from samples: they lie at known fractions of the step that was taken."""
    points = window.points
    roles = [Role.CENTRE] + [Role.SAMPLE] * (len(points) - 1)
    if before is not None:
        start = before.points[before.best]
        step = points[0] - start
        near = 1e-6 * float(np.max(np.linalg.norm(points - start, axis=1)))
        for row, fraction in enumerate(LINE_FRACTIONS[: len(points) - 1], start=1):
            if np.linalg.norm(points[row] - start - fraction * step) > near:
                break
            roles[row] = Role.CANDIDATE
    return tuple(roles)
