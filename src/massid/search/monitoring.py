"""Monitoring signals mu_j of all models (Eq. 5-7) and the Gram matrix that holds them on its diagonal.

For output errors y~_j of models j the filter of Eq. (7) is run on all pairs at once,

    dG/dt = -lambda G + Y~^T Y~,      G_jk = integral w(t) y~_j^T y~_k dt,      mu_j = G_jj,

so that the same models yield, besides their scores, the gradient of mu and its Gauss-Newton Hessian at the centre,
with no trajectory stored.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from massid.errors import DivergedBankError
from massid.search.bank import OutputErrors
from massid.search.proposal import Proposal
from massid.search.quadratic import LocalQuadratic
from massid.typing import BoolArray, FloatArray, IntArray


class MonitoringFilter:
    """Eq. (7) with zero-order hold, for all pairs of models, from one dwell start on.

    Args:
        n_models: size of the bank N.
        timestep_s: period of the output errors [s], > 0.
        forgetting_rate: lambda [1/s], >= 0.
    """

    def __init__(self, n_models: int, timestep_s: float, forgetting_rate: float = 0.0) -> None:
        self._timestep_s = timestep_s
        self._rate = forgetting_rate
        self._n_models = n_models
        self._gram: FloatArray = np.zeros((n_models, n_models))
        self._diverged: BoolArray = np.zeros(n_models, dtype=np.bool_)
        self._samples = 0
        self._shown: IntArray | None = None

    def update(self, errors: OutputErrors) -> None:
        """Add a block of output errors, shape (n_models, n_steps, n_y)."""
        n_models, n_steps, _ = errors.values.shape
        self._diverged = self._diverged | errors.diverged | ~np.isfinite(errors.values).all(axis=(1, 2))
        age_s = self._timestep_s * np.arange(n_steps - 1, -1, -1)
        weight = np.sqrt(self._timestep_s * np.exp(-self._rate * age_s))
        weighted = np.where(self._diverged[:, None, None], 0.0, errors.values) * weight[:, None]
        rows = weighted.reshape(n_models, -1)
        if errors.tangents is not None:
            rows = np.vstack([rows, (errors.tangents * weight[:, None]).reshape(len(errors.tangents), -1)])
        if errors.shown is not None:
            shown = errors.shown.values
            rows = np.vstack([rows, (shown * weight[:, None]).reshape(len(shown), -1)])
            self._shown = errors.shown.columns
        if len(self._gram) != len(rows):
            self._gram = np.zeros((len(rows), len(rows)))
        self._gram *= np.exp(-self._rate * self._timestep_s * n_steps)
        self._gram += rows @ rows.T
        self._samples += errors.values[0].size
        if errors.explained is not None:
            self._samples -= int(errors.explained.sum())

    def result(self, proposal: Proposal, prior: LocalQuadratic | None = None) -> Monitoring:
        """Close the window: what the models of a proposal scored, on top of what was known before."""
        return Monitoring(
            proposal=proposal,
            gram=self._gram.copy(),
            diverged=self._diverged,
            samples=self._samples,
            prior=prior,
            shown=self._shown,
        )


@dataclass(frozen=True)
class Monitoring:
    """Scores of one dwell window, or the sum over several windows with the same points.

    Attributes:
        proposal: the points and what each was for.
        gram: G, shape (n_models + n_tangents, n_models + n_tangents); the last rows belong to derivatives of the
            output error by the last coordinates of the points.
        diverged: models that left the finite numbers, shape (n_models,); never ranked.
        samples: number of scalar output errors behind each entry of G.
        prior: what is known besides, in units of mu: beliefs, or the windows before; None for nothing.
        shown: coordinates whose derivatives as the centre shows them are in rows of their own, the last of G.
        slope: of the gradient, as an earlier pass has shown it nearby; taken where these windows do not show their own.
    """

    proposal: Proposal
    gram: FloatArray
    diverged: BoolArray
    samples: int
    prior: LocalQuadratic | None = None
    shown: IntArray | None = None
    slope: FloatArray | None = None

    def __add__(self, other: Monitoring) -> Monitoring:
        """Sum over windows: a model that diverged in one of them is out."""
        return Monitoring(
            proposal=self.proposal,
            gram=self.gram + other.gram,
            diverged=self.diverged | other.diverged,
            samples=self.samples + other.samples,
            prior=self.prior,
            shown=self.shown,
            slope=None if self.slope is None or other.slope is None else self.slope + other.slope,
        )

    def embedded(self, proposal: Proposal, columns: IntArray) -> Monitoring:
        """The same scores for a proposal with more coordinates, which these windows say nothing about.

        Args:
            proposal: the same points with all coordinates; sampled ones come first and are the same.
            columns: where the own coordinates are among them.
        """
        n_models, n_points = len(self.diverged), proposal.points.shape[1]
        n_shown = 0 if self.shown is None else len(self.shown)
        n_tangents = len(self.gram) - n_models - n_shown
        first = len(columns) - n_tangents
        own = np.arange(n_models + n_tangents)
        rows = np.concatenate([np.arange(n_models), n_models - first + columns[first:]])
        size, shown = n_models + n_points - first, self.shown
        if shown is not None:
            as_shown = own[-n_tangents:].copy()
            as_shown[shown - first] = n_models + n_tangents + np.arange(n_shown)
            own, rows = np.concatenate([own, as_shown]), np.concatenate([rows, size - first + columns[first:]])
            size, shown = size + n_points - first, np.arange(first, n_points)
        gram = np.zeros((size, size))
        gram[np.ix_(rows, rows)] = self.gram[np.ix_(own, own)]
        return replace(self, proposal=proposal, gram=gram, shown=shown)

    @cached_property
    def mu(self) -> FloatArray:
        """Monitoring signals plus prior, shape (n_models,); inf for diverged models. Lower is better."""
        mu = np.where(self.diverged, np.inf, np.diagonal(self.gram)[: len(self.diverged)])
        if self.prior is not None:
            mu = mu + np.array([self.prior.at(point) for point in self.proposal.points])
        return mu

    def require_finite(self) -> None:
        """Check that enough models are left to span every direction around the centre.

        Raises:
            DivergedBankError: the centre, or all but fewer than n_p samples, diverged.
        """
        n_p = self.proposal.n_sampled
        finite_samples = int(np.sum(~self.diverged[self.proposal.samples]))
        if self.diverged[self.proposal.centre] or finite_samples < n_p:
            named = ", ".join(str(i) for i in np.flatnonzero(self.diverged))
            raise DivergedBankError(
                f"{int(self.diverged.sum())} of {len(self.diverged)} identification models diverged (models {named}; "
                f"0 is the centre); a search direction for {n_p} parameters needs the centre and {n_p} samples. Use a "
                "smaller `radius` or another `bandwidth_rad_s`, or check the log."
            )

    def local_quadratic(self) -> LocalQuadratic:
        """Expand mu around the centre to second order (Gauss-Newton), prior included.

        With D the samples' offsets from the centre and D+ its pseudo-inverse, the output error is taken as affine,
        y~(p_c + d) = y~_c + J d with J^T = D+ (Y~_samples - y~_c). Then mu = G_cc, its gradient 2 J^T y~_c and its
        Hessian 2 J^T J are entries of T G T^T, with T built from D+. Columns Z that the bank supplies stand in for J's.

        Raises:
            DivergedBankError: see `require_finite`.
        """
        window = self.window_quadratic().symmetric()
        return window if self.prior is None else window + self.prior

    def window_quadratic(self) -> LocalQuadratic:
        """The part of `local_quadratic` that this window brought, from the models that stayed finite.

        Where the bank also says what the centre shows, J, the gradient's own slope 2 Z^T J comes with it. It is not
        symmetric: Z is smoother than J, and what nuisances explain of a mass is the product of both.

        Raises:
            DivergedBankError: see `require_finite`.
        """
        self.require_finite()
        centre = self.proposal.centre
        samples = self.proposal.samples[~self.diverged[self.proposal.samples]]
        (n_points, n_p), n_sampled = self.proposal.points.shape, self.proposal.n_sampled
        offsets = self.proposal.points[samples, :n_sampled] - self.proposal.points[centre, :n_sampled]
        spread = np.linalg.norm(offsets, axis=0) / np.sqrt(max(len(offsets), 1))
        spread = np.where(spread > 0.0, spread, 1.0)
        inverse = np.linalg.pinv(offsets / spread) / spread[:, None]
        transform = np.zeros((1 + n_p, len(self.gram)))
        transform[0, centre] = 1.0
        transform[1 : 1 + n_sampled, samples] = inverse
        transform[1 : 1 + n_sampled, centre] = -inverse.sum(axis=1)
        affine = np.hstack([np.ones((len(samples), 1)), offsets]) @ transform[: 1 + n_sampled]
        change = affine.copy()
        change[:, centre] -= 1.0
        residual = -affine
        residual[np.arange(len(samples)), samples] += 1.0
        squares = (np.einsum("ij,jk,ik->i", rows, self.gram, rows) for rows in (change, residual))
        explained, unexplained = (float(rows.mean()) if len(rows) else 0.0 for rows in squares)
        n_shown = 0 if self.shown is None else len(self.shown)
        supplied, slope = len(self.gram) - n_points - n_shown, self.slope
        if supplied:
            sampled = transform[1 : 1 + n_sampled].copy()
            transform[-supplied:] = 0.0
            transform[-supplied:, n_points : n_points + supplied] = np.eye(supplied)
            if self.shown is not None:
                derivatives = transform[1:].copy()
                derivatives[self.shown] = 0.0
                derivatives[self.shown, n_points + supplied + np.arange(n_shown)] = 1.0
                derivatives[:n_sampled] = sampled
                slope = 2.0 * transform[1:] @ self.gram @ derivatives.T
        moments = transform @ self.gram @ transform.T
        return LocalQuadratic(
            centre=self.proposal.points[centre],
            value=float(moments[0, 0]),
            gradient=2.0 * moments[1:, 0],
            curvature=2.0 * moments[1:, 1:],
            explained=explained,
            misfit=max(unexplained, 0.0),
            samples=self.samples,
            slope=slope,
        )
