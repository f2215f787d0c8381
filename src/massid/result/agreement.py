"""Do several results agree: two days, two robots, two methods? Each link by itself, within what each leaves open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from massid.errors import BadInputError
from massid.result.document import Document, LinkEntry

RISK = 0.05
"""Chance that links of one robot, weighed again, are said to differ somewhere."""
WITHOUT_NOISE = 1e-3
"""Share of its mass to which a link counts as known from a log without noise, which has no interval."""


@dataclass(frozen=True)
class LinkAgreement:
    """One link in several results.

    Attributes:
        link: its name.
        nominal_kg: of the model files; of the first, if they differ [kg].
        estimates_kg: in each result [kg]; None where it has none.
        std_kg: standard deviation in each result [kg]; None likewise.
        common_kg: the mean, each result with the weight that its deviation gives it [kg].
        common_std_kg: its standard deviation, if all weigh the same [kg].
        chi2: sum of squared deviations from the mean, each with its own standard deviation as unit.
        limit: that chi2 stays below it if they do.
    """

    link: str
    nominal_kg: float
    estimates_kg: tuple[float | None, ...]
    std_kg: tuple[float | None, ...]
    common_kg: float
    common_std_kg: float
    chi2: float
    limit: float

    @property
    def agrees(self) -> bool:
        """Whether nothing says that the results are of different masses."""
        return self.chi2 <= self.limit

    @property
    def difference_kg(self) -> float:
        """The last estimate less the first [kg]."""
        found = [mass_kg for mass_kg in self.estimates_kg if mass_kg is not None]
        return found[-1] - found[0]

    @property
    def difference_std_kg(self) -> float:
        """Its standard deviation [kg]."""
        found = [std_kg for std_kg in self.std_kg if std_kg is not None]
        return float(np.hypot(found[-1], found[0]))


@dataclass(frozen=True)
class Agreement:
    """Several results side by side.

    Attributes:
        names: of the results.
        links: those that two of them or more have a mass of.
        alone: links that cannot be compared, with the reason.
        doubts: results that are not to be relied on, one line each.
    """

    names: tuple[str, ...]
    links: tuple[LinkAgreement, ...]
    alone: Mapping[str, str]
    doubts: tuple[str, ...]

    @property
    def differing(self) -> tuple[str, ...]:
        """Links whose masses differ."""
        return tuple(one.link for one in self.links if not one.agrees)


def compare_results(names: Sequence[str], documents: Sequence[Document]) -> Agreement:
    """Compare what several results say of each link.

    Args:
        names: what to call the results.
        documents: the results.

    Raises:
        BadInputError: fewer than two, or no link that two of them know.
    """
    if len(documents) < 2:
        raise BadInputError("Name two results or more to compare.")
    links = list(dict.fromkeys(link for document in documents for link in document.links))
    known = {link: sum(_known(document.links.get(link)) for document in documents) for link in links}
    shared = [link for link in links if known[link] > 1]
    if not shared:
        each = "; ".join(f"{name} has {_listed(one)}" for name, one in zip(names, documents, strict=True))
        raise BadInputError(f"No link has a mass in two of these results: {each}.")
    alone = {link: _why_alone(link, names, documents) for link in links if known[link] < 2}
    doubts = [
        f"{name} ended as {document.status}: its masses are not to be relied on."
        for name, document in zip(names, documents, strict=True)
        if document.status != "converged"
    ]
    for link in shared:
        files = {document.links[link].nominal_kg for document in documents if link in document.links}
        if max(files) - min(files) > 1e-9 * max(files):
            doubts.append(f"{link} weighs {_range(files)} kg in the model files: these are of different models.")
    return Agreement(
        tuple(names),
        tuple(_compared(link, documents, len(shared)) for link in shared),
        alone,
        tuple(doubts),
    )


def _compared(link: str, documents: Sequence[Document], n_links: int) -> LinkAgreement:
    entries = [document.links.get(link) for document in documents]
    estimates = tuple(entry.estimate_kg if entry is not None and _known(entry) else None for entry in entries)
    std = tuple(_std_kg(entry) if entry is not None and _known(entry) else None for entry in entries)
    mass = np.array([one for one in estimates if one is not None])
    weight = np.array([one for one in std if one is not None]) ** -2.0
    common = float(weight @ mass / weight.sum())
    return LinkAgreement(
        link=link,
        nominal_kg=next(entry.nominal_kg for entry in entries if entry is not None),
        estimates_kg=estimates,
        std_kg=std,
        common_kg=common,
        common_std_kg=float(weight.sum() ** -0.5),
        chi2=float(weight @ (mass - common) ** 2),
        limit=float(chdtri(len(mass) - 1, RISK / n_links)),
    )


def _known(entry: LinkEntry | None) -> bool:
    return entry is not None and entry.estimate_kg is not None


def _std_kg(entry: LinkEntry) -> float:
    return WITHOUT_NOISE * entry.nominal_kg if entry.std_kg is None else max(entry.std_kg, 1e-12)


def _why_alone(link: str, names: Sequence[str], documents: Sequence[Document]) -> str:
    hidden = [
        name for name, one in zip(names, documents, strict=True) if link in one.links and not _known(one.links[link])
    ]
    lacking = [name for name, one in zip(names, documents, strict=True) if link not in one.links]
    parts = [f"not identifiable in {', '.join(hidden)}"] if hidden else []
    parts += [f"not asked for in {', '.join(lacking)}"] if lacking else []
    return "; ".join(parts)


def _listed(document: Document) -> str:
    return ", ".join(link for link, entry in document.links.items() if _known(entry)) or "none"


def _range(files: set[float]) -> str:
    return f"{min(files):.4g} to {max(files):.4g}"
