"""A second-order picture of mu around a point; pictures of several windows, logs and priors add up."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massid.typing import FloatArray, IntArray

_BLIND = 1e-14
"""Share of the largest eigenvalue below which one is rounding."""
_SOUND = 1e10
"""Condition number below which none is, by far."""


@dataclass(frozen=True)
class LocalQuadratic:
    """mu(centre + d) = value + gradient^T d + d^T curvature d / 2.

    Attributes:
        centre: where it was measured, shape (n_p,).
        value: mu at the centre.
        gradient: shape (n_p,).
        curvature: Gauss-Newton Hessian, positive semidefinite, shape (n_p, n_p). (Remark 3's Q is half of it.)
        explained: mean over the samples of |J d|^2, what they change in the output error as far as it is affine.
        misfit: mean over the samples of the squared rest.
        samples: number of scalar output errors behind it.
        slope: derivative of the gradient, shape (n_p, n_p); None where it is the curvature. A gradient 2 Z^T y~ taken
            with instruments Z has the slope 2 Z^T J; its covariance is twice 2 Z^T Z, which `curvature` then is.
    """

    centre: FloatArray
    value: float
    gradient: FloatArray
    curvature: FloatArray
    explained: float
    misfit: float
    samples: int
    slope: FloatArray | None = None

    @classmethod
    def belief(cls, centre: FloatArray, precision: FloatArray) -> LocalQuadratic:
        """sum(precision (p - centre)^2), minus twice the logarithm of a normal density."""
        n_p = len(centre)
        return cls(centre, 0.0, np.zeros(n_p), 2.0 * np.diag(precision), explained=0.0, misfit=0.0, samples=0)

    def at(self, point: FloatArray) -> float:
        """Predicted mu at a point."""
        d = point - self.centre
        return float(self.value + self.gradient @ d + 0.5 * d @ self.curvature @ d)

    def change(self, offset: FloatArray, n_sampled: int) -> float:
        """|J d|^2 of the part of an offset that models were sampled in; what enters by its derivative is affine."""
        part = offset[:n_sampled]
        return 0.5 * float(part @ self.curvature[:n_sampled, :n_sampled] @ part)

    def shifted(self, centre: FloatArray) -> LocalQuadratic:
        """The same quadratic, expanded around another point."""
        return replace(
            self,
            centre=centre,
            value=self.at(centre),
            gradient=self.gradient + self._slope @ (centre - self.centre),
        )

    @property
    def _slope(self) -> FloatArray:
        return self.curvature if self.slope is None else self.slope

    def symmetric(self) -> LocalQuadratic:
        """The quadratic that is least where the gradient is zero, and half of whose Hessian is the information on that.

        The root of a gradient with slope M and covariance N scatters by M^-1 N M^-T (the sandwich), so the information
        is M^T N^-1 M. Instruments that have little in common with the derivatives, as where nothing moves, thus tell
        little, however much noise they hold themselves.
        """
        if self.slope is None:
            return self
        weights = self.weights
        curvature = weights @ self.slope
        return replace(self, gradient=weights @ self.gradient, curvature=0.5 * (curvature + curvature.T), slope=None)

    @property
    def weights(self) -> FloatArray:
        """What the gradient is multiplied by to be that of the symmetric quadratic, M^T N^-1, shape (n_p, n_p)."""
        return np.eye(len(self.centre)) if self.slope is None else self.slope.T @ inverse(self.curvature)

    def weighed(self, weights: FloatArray) -> LocalQuadratic:
        """One of several parts, with the weights of their sum; its curvature stays the covariance of its gradient."""
        return replace(
            self, gradient=weights @ self.gradient, curvature=weights @ self.curvature @ weights.T, slope=None
        )

    def marginal(self, kept: IntArray) -> LocalQuadratic:
        """What it says about some coordinates, the others having settled wherever they fit best.

        For a belief that is minus twice the logarithm of a normal density this is the marginal's, by the Schur
        complement; the others' curvature must be positive definite.
        """
        if self.slope is not None:
            return self.symmetric().marginal(kept)
        rest = np.setdiff1d(np.arange(len(self.centre)), kept)
        lift = np.linalg.solve(self.curvature[np.ix_(rest, rest)], self.curvature[np.ix_(rest, kept)]).T
        settled = np.linalg.solve(self.curvature[np.ix_(rest, rest)], self.gradient[rest])
        return replace(
            self,
            centre=self.centre[kept],
            value=self.value - 0.5 * float(self.gradient[rest] @ settled),
            gradient=self.gradient[kept] - lift @ self.gradient[rest],
            curvature=self.curvature[np.ix_(kept, kept)] - lift @ self.curvature[np.ix_(rest, kept)],
        )

    def embedded(self, centre: FloatArray, columns: IntArray) -> LocalQuadratic:
        """The same belief among more coordinates, of which it says nothing.

        Args:
            centre: point to expand around in the larger space, shape (n,).
            columns: where the own coordinates are in it.
        """
        moved = self.shifted(centre[columns])
        gradient, curvature = np.zeros(len(centre)), np.zeros((len(centre), len(centre)))
        gradient[columns], curvature[np.ix_(columns, columns)] = moved.gradient, moved.curvature
        slope = None
        if moved.slope is not None:
            slope = np.zeros_like(curvature)
            slope[np.ix_(columns, columns)] = moved.slope
        return replace(moved, centre=centre, gradient=gradient, curvature=curvature, slope=slope)

    def scaled(self, factor: float) -> LocalQuadratic:
        """The quadratic times a positive number: a weight, or a discount for age."""
        return replace(
            self,
            value=factor * self.value,
            gradient=factor * self.gradient,
            curvature=factor * self.curvature,
            explained=factor * self.explained,
            misfit=factor * self.misfit,
            slope=None if self.slope is None else factor * self.slope,
        )

    def __add__(self, other: LocalQuadratic) -> LocalQuadratic:
        """Sum, around this one's centre."""
        moved = other.shifted(self.centre)
        return replace(
            self,
            value=self.value + moved.value,
            gradient=self.gradient + moved.gradient,
            curvature=self.curvature + moved.curvature,
            explained=self.explained + moved.explained,
            misfit=self.misfit + moved.misfit,
            samples=self.samples + moved.samples,
            slope=None if self.slope is None and moved.slope is None else self._slope + moved._slope,
        )

    @property
    def lipschitz(self) -> float:
        """L of Eq. (12): the largest eigenvalue of the Hessian."""
        return float(np.linalg.eigvalsh(self.curvature)[-1])


def inverse(information: FloatArray) -> FloatArray:
    """Inverse of a positive semidefinite matrix, in units in which its diagonal is 1; huge where that is blind."""
    scale = np.sqrt(np.diagonal(information))
    scale = np.where(scale > 0.0, scale, 1.0)
    units = np.outer(scale, scale)
    scaled = information / units
    try:
        root = np.linalg.inv(np.linalg.cholesky(scaled))
    except np.linalg.LinAlgError:
        root = None
    if root is not None:
        found = root.T @ root
        if float(np.linalg.norm(scaled, 1) * np.linalg.norm(found, 1)) < _SOUND:
            return np.asarray(found / units)
    values, vectors = np.linalg.eigh(scaled)
    floored = np.maximum(values, _BLIND * max(float(values[-1]), np.finfo(float).tiny))
    return np.asarray((vectors / floored) @ vectors.T / units)
