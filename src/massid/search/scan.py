"""A first window that looks over Theta: a parameter in which mu has many minima is scanned from end to end.

Local samples cannot see past the nearest minimum. Here the samples span every direction once, and all other models
take values of the scanned parameters from all over Theta. The Gram matrix tells of each of them how much of its
error the other parameters could still explain:

    min over d of |y~_j + J d|^2,    J from the samples, d in Theta and zero for the scanned parameters,

so a value is judged by what it would score with the others adjusted, not by the initial guess of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from massid.errors import BadInputError, unknown_name
from massid.search.directions.box import box_minimum
from massid.search.monitoring import Monitoring
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray, IntArray

_PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29)


@dataclass(frozen=True)
class ScanChoice:
    """What a scan found.

    Attributes:
        best: row of the model whose scanned values are best.
        estimate: its point, with the other parameters adjusted, shape (n_p,).
    """

    best: int
    estimate: FloatArray


def scanned_columns(space: ParameterSpace, names: Sequence[str]) -> IntArray:
    """Coordinates of the parameters with these names or targets.

    Raises:
        BadInputError: the space has no such parameter, or more are scanned than can be.
    """
    columns = []
    for name in names:
        found = [i for i, p in enumerate(space.parameters) if name in (p.name, p.target)]
        if not found:
            raise BadInputError(unknown_name("parameter", name, (p.target for p in space.parameters), "The search"))
        columns += found
    if len(columns) > len(_PRIMES):
        raise BadInputError(f"{len(columns)} parameters cannot be scanned together; at most {len(_PRIMES)} can.")
    return np.array(columns, dtype=np.int64)


def scan_points(space: ParameterSpace, start: FloatArray, columns: IntArray, n_points: int) -> FloatArray:
    """Points that differ from the start in the scanned coordinates alone, spread evenly over Theta.

    One coordinate is cut into equal cells, of which the middles are taken; more follow a Hammersley set.

    Args:
        space: Theta.
        start: shape (n_p,).
        columns: scanned coordinates.
        n_points: how many.

    Returns:
        Shape (n_points, n_p).
    """
    points = np.tile(start, (n_points, 1))
    share = (np.arange(n_points) + 0.5) / n_points
    for place, column in enumerate(columns):
        spread = share if place == 0 else _radical_inverse(n_points, _PRIMES[place - 1])
        points[:, column] = space.lower[column] + spread * (space.upper[column] - space.lower[column])
    return points


def choose_scanned(monitoring: Monitoring, columns: IntArray, space: ParameterSpace) -> ScanChoice:
    """Choose among centre and scanned points, each with the other parameters adjusted as far as the samples tell.

    Raises:
        DivergedBankError: too few samples stayed finite.
    """
    monitoring.require_finite()
    proposal, gram = monitoring.proposal, monitoring.gram
    samples = proposal.samples[~monitoring.diverged[proposal.samples]]
    sampled = slice(monitoring.proposal.n_sampled)
    inverse = np.linalg.pinv(proposal.points[samples, sampled] - proposal.points[proposal.centre, sampled])
    jacobian = np.zeros((len(space), len(gram)))  # rows of J^T in terms of the models' errors
    jacobian[sampled, samples] = inverse
    jacobian[sampled, proposal.centre] -= inverse.sum(axis=1)
    jacobian[columns] = 0.0
    curvature = 2.0 * jacobian @ gram @ jacobian.T
    rows = [row for row in (proposal.centre, *proposal.candidates) if not monitoring.diverged[row]]
    choices = []
    for row in rows:
        quadratic = LocalQuadratic(
            centre=proposal.points[row],
            value=float(gram[row, row]),
            gradient=2.0 * jacobian @ gram[:, row],
            curvature=curvature,
            explained=0.0,
            misfit=0.0,
            samples=monitoring.samples,
        )
        point = space.project(quadratic.centre + box_minimum(quadratic, space))
        choices.append((quadratic.at(point), row, point))
    _, best, estimate = min(choices, key=lambda choice: choice[0])
    return ScanChoice(best=int(best), estimate=estimate)


def _radical_inverse(n: int, base: int) -> FloatArray:
    """First n numbers of the van der Corput sequence, moved off the border, shape (n,)."""
    values = np.zeros(n)
    for i in range(n):
        rest, digit = i, 1.0 / base
        while rest:
            rest, remainder = divmod(rest, base)
            values[i] += remainder * digit
            digit /= base
    return np.minimum(values + 0.5 / n, 1.0)
