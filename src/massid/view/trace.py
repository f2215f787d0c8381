"""What both outputs show of a result: errors, estimates and scores over the updates, with or without the truth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from massid.model.unknowns.bodies import Mass
from massid.result.posterior import INTERVAL_95
from massid.result.result import Result, WindowResult
from massid.score import Score
from massid.search.proposal import Role
from massid.typing import BoolArray, FloatArray, IntArray

FLOOR_KG = 1e-12
"""Errors below this are rounding; the logarithmic axes end here."""
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
        newton_step_kg: step that each window predicts, shape (n_updates, n_links).
        updates: the windows behind the rows.
        identifiable: whether the log reveals each link, shape (n_links,).
        mode: "online" or "offline".
        update_time_s: time of each row in the log; offline all updates come at its end, shape (1 + n_updates,).
        std_kg: standard deviation of each row's estimate, shape (1 + n_updates, n_links); NaN where none is known.
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
    std_kg: FloatArray

    @classmethod
    def of(cls, result: Result, score: Score | None) -> Trace:
        """Collect the curves of a result; `score` brings the truth."""
        space = result.space
        masses = [i for i, parameter in enumerate(space.parameters) if isinstance(parameter, Mass)]
        links = tuple(space.parameters[i].target for i in masses)
        points = np.vstack([space.nominal, *(window.estimate for window in result.windows)])
        steps = np.array([window.newton_step[masses] for window in result.windows]).reshape(-1, len(masses))
        final = result.estimate[masses]
        return cls(
            links=links,
            estimate_kg=points[:, masses],
            reference_kg=final if score is None else np.array([score.true_kg[link] for link in links]),
            has_truth=score is not None,
            newton_step_kg=steps,
            identifiable=result.excitation.identifiable[masses],
            updates=result.windows,
            mode=result.mode,
            update_time_s=np.array([0.0, *(window.time_s for window in result.windows)]),
            std_kg=_deviations(result)[:, masses],
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
    def half_width_kg(self) -> FloatArray:
        """Half the width of each row's 95 % interval, NaN where it is unknown, shape (1 + n_updates, n_links)."""
        return INTERVAL_95 * self.std_kg

    @cached_property
    def together_half_width_kg(self) -> FloatArray:
        """L2 norm of each row's 95 % intervals, NaN where a link has none, shape (1 + n_updates,).

        The L2 error of all masses is seldom larger, and a step much smaller is hardly worth another pass.
        """
        return np.asarray(np.linalg.norm(self.half_width_kg, axis=1), dtype=np.float64)

    @cached_property
    def has_intervals(self) -> bool:
        """Whether any row has a 95 % interval."""
        return bool(np.isfinite(self.std_kg).any())

    @cached_property
    def drawn_half_width_kg(self) -> FloatArray:
        """The same, without earlier intervals so wide that a plot which held them would show nothing else."""
        change, final = np.abs(self.estimate_kg - self.nominal_kg), np.nan_to_num(self.half_width_kg[-1])
        widest = 1.5 * max(float(change.max()), float(final.max()))
        return np.where(self.half_width_kg < widest, self.half_width_kg, np.nan)

    @cached_property
    def error_kg(self) -> FloatArray:
        """Estimate minus truth, or minus the final estimate without truth, shape (1 + n_updates, n_links)."""
        return self.estimate_kg - self.reference_kg

    @cached_property
    def l2_error_kg(self) -> FloatArray:
        """L2 norm of `error_kg`, shape (1 + n_updates,)."""
        return np.asarray(np.linalg.norm(self.error_kg, axis=1), dtype=np.float64)

    @cached_property
    def step_norm_kg(self) -> FloatArray:
        """L2 norm of the step that each window predicts, shape (n_updates,)."""
        return np.asarray(np.linalg.norm(self.newton_step_kg, axis=1), dtype=np.float64)

    @cached_property
    def relative_error(self) -> FloatArray:
        """|error| as a fraction of the link's mass, shape (1 + n_updates, n_links): what colours the links.

        Without truth the final estimate is no better than the last step that led to it, nor than its 95 % interval, so
        that a search which still jumps about, or a mass that noise hides, never ends in the colour of a good estimate.
        A link that the log does not reveal stays as bad as can be.
        """
        error = np.abs(self.error_kg)
        if not self.has_truth:
            error = np.maximum(error, np.fmax(np.abs(self.newton_step_kg[-1]), self.half_width_kg[-1]))
            error[:, ~self.identifiable] = np.inf
        return np.asarray(error / self.reference_kg, dtype=np.float64)

    @property
    def colour_meaning(self) -> str:
        """What `relative_error` is, in words."""
        if self.has_truth:
            return "mass error"
        return "distance to the final estimate" + (", at least its 95 % interval" if self.has_intervals else "")

    @cached_property
    def roles(self) -> tuple[tuple[Role, ...], ...]:
        """What each model of each window was for."""
        return tuple(window.roles for window in self.updates)

    def rows_of(self, update: int, role: Role) -> IntArray:
        """Models of one window that had a role."""
        return np.array([row for row, found in enumerate(self.roles[update]) if found is role], dtype=np.int64)

    def mu(self, update: int, role: Role) -> FloatArray:
        """Finite scores of the models of one window that had a role; offline, per output error if that is known."""
        scores = self.updates[update].mu[self.rows_of(update, role)]
        if self.errors_scored is not None:
            scores = scores / self.errors_scored[update]
        return np.maximum(scores[np.isfinite(scores)], FLOOR_MU)

    @cached_property
    def errors_scored(self) -> FloatArray | None:
        """How many scalar output errors the scores of each pass sum up, shape (n_updates,).

        The first passes over a noisy log end after a part of it: only scores per output error can be compared. Noise
        alone gives 1. None online, where all windows are of the same length, and where a pass does not say.
        """
        if self.online:
            return None
        centres = [window.mu[self.rows_of(update, Role.CENTRE)].sum() for update, window in enumerate(self.updates)]
        chi2 = np.array([window.chi2 for window in self.updates])
        with np.errstate(divide="ignore", invalid="ignore"):
            count = np.array(centres) / chi2
        return count if np.all(np.isfinite(count) & (count > 0.0)) else None


def _deviations(result: Result) -> FloatArray:
    """Standard deviations of every row and parameter, NaN where none is known; the last row has those of the result."""
    out = np.full((1 + len(result.windows), len(result.space)), np.nan)
    for row, window in enumerate(result.windows, start=1):
        if window.std is not None:
            out[row] = window.std
    if result.uncertainty is not None:
        out[-1] = result.uncertainty.std
    out[:, ~result.excitation.identifiable] = np.nan
    return out
