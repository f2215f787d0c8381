"""Combinations of link masses that a covariance leaves open, and those that it does not, named by links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from massid.result.document import SumEntry
from massid.result.posterior import INTERVAL_95
from massid.typing import FloatArray

_SHOWN = 0.3
"""Links that take part in a combination with less than this share of its largest part are not named."""
_SWEEPS = 60


@dataclass(frozen=True)
class Combination:
    """A joint change of several masses that the log hardly shows.

    Attributes:
        change: relative change of each mass along it, a unit vector, shape (n_links,).
        std: how far along it the masses may move: standard deviation in relative units.
        text: named by links, such as "l_thigh + l_calf against torso".
        is_trade: several links take part.
    """

    change: FloatArray
    std: float
    text: str
    is_trade: bool


@dataclass(frozen=True)
class Sum:
    """The mass of several links together.

    Attributes:
        links: which.
        nominal_kg: of the model file [kg].
        std_kg: standard deviation to which it can be known, or is known [kg].
        estimate_kg: as found; None before the fit [kg].
    """

    links: tuple[str, ...]
    nominal_kg: float
    std_kg: float
    estimate_kg: float | None = None

    @property
    def text(self) -> str:
        """In words, with its 95 % interval; the model file's sum would look like an answer, and is not one."""
        half = f"+-{INTERVAL_95 * self.std_kg:.2g} kg"
        found = f"to {half}" if self.estimate_kg is None else f"{self.estimate_kg:.2f} {half}"
        return f"{' + '.join(self.links)} together, {found}"

    def entry(self) -> SumEntry:
        """As a document holds it."""
        return SumEntry(
            links=list(self.links), nominal_kg=self.nominal_kg, std_kg=self.std_kg, estimate_kg=self.estimate_kg
        )


def open_combinations(links: Sequence[str], relative: FloatArray, limit: float) -> tuple[Combination, ...]:
    """Name the directions in which a covariance is wider than a limit.

    The eigenvectors of equal eigenvalues are any rotation of each other; of the wide ones, that rotation is taken in
    which as few links as possible take part (varimax).

    Args:
        links: names.
        relative: covariance of the relative masses, shape (n_links, n_links).
        limit: largest standard deviation of a direction that counts as known.
    """
    values, vectors = np.linalg.eigh(relative)
    wide = vectors[:, np.sqrt(np.maximum(values, 0.0)) > limit]
    if not wide.shape[1]:
        return ()
    turned = wide @ _varimax(wide)
    found = []
    for change in turned.T:
        std = float(np.sqrt(change @ relative @ change))
        signed = change * np.sign(change[np.argmax(np.abs(change))])
        text = _text(links, signed)
        found.append(Combination(signed, std, text, is_trade=text not in links))
    order = {link: k for k, link in enumerate(links)}
    return tuple(sorted(found, key=lambda one: (-round(one.std, 2), order.get(one.text, -1))))


def known_sums(
    links: Sequence[str],
    masses_kg: FloatArray,
    covariance: FloatArray,
    groups: Sequence[Sequence[str]],
    limit: float,
) -> tuple[Sum, ...]:
    """Those of some groups of links whose mass together is known although not all of theirs are.

    Args:
        links: names, in the order of the covariance.
        masses_kg: nominal masses, shape (n_links,).
        covariance: of the masses [kg^2].
        groups: which links to add up.
        limit: largest standard deviation of a sum, relative to it, that counts as known.
    """
    found = []
    for group in groups:
        chosen = np.isin(links, group).astype(np.float64)
        nominal_kg, std_kg = float(chosen @ masses_kg), float(np.sqrt(chosen @ covariance @ chosen))
        if std_kg < limit * nominal_kg:
            found.append(Sum(tuple(group), nominal_kg, std_kg))
    return tuple(found)


def _text(links: Sequence[str], change: FloatArray) -> str:
    size = np.abs(change)
    order = np.argsort(-size, kind="stable")
    shown = [k for k in order if size[k] >= _SHOWN * size[order[0]]]
    up = " + ".join(links[k] for k in shown if change[k] > 0.0)
    down = " + ".join(links[k] for k in shown if change[k] < 0.0)
    if down:
        return f"{up} against {down}"
    return f"{up} together" if len(shown) > 1 else up


def _varimax(vectors: FloatArray) -> FloatArray:
    """Rotation that makes the columns of orthonormal vectors as sparse as it can, shape (k, k)."""
    rotation = np.eye(vectors.shape[1])
    for _ in range(_SWEEPS):
        turned = vectors @ rotation
        target = turned**3 - turned * (turned**2).mean(axis=0)
        left, _, right = np.linalg.svd(vectors.T @ target)
        rotation = left @ right
    return np.asarray(rotation)
