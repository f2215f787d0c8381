"""The part of a report on what was estimated beside what was asked for: errors of sensors, inertias, other links."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from massid.model.unknowns.sensors import WrenchOffset
from massid.result.document import Document, NuisanceEntry
from massid.result.posterior import INTERVAL_95
from massid.view.chart import Chart
from massid.view.page import HtmlPage

_COLOUR = "#0a8a78"
_FAR, _KNOWN = 3.0, 0.5
_LEAST_REACH = 2.5
_LEAST_PRIOR = 1e-12


@dataclass(frozen=True)
class _Row:
    """One number, in its unit and as a multiple of what was believed to be likely beforehand."""

    name: str
    text: str
    share: float
    std: float


def write_nuisances(page: HtmlPage, document: Document) -> None:
    """Add one drawing for each kind, and a table that sums them up.

    Offsets of force sensors are compared with what such sensors ordinarily have: readings in the air, which a fit
    begins with, are a part of what the log taught.
    """
    if document.uncertainty is None or not document.uncertainty.nuisances:
        return
    kinds: dict[str, list[_Row]] = {}
    for name, entry in document.uncertainty.nuisances.items():
        row = _row(entry.label or name, entry, document.uncertainty.noise)
        kinds.setdefault(entry.title or "nuisances", []).append(row)
    page.heading("Errors of the sensors, and what else was not asked for")
    page.paragraph(
        "Each dot is an estimate with its 95 % interval, in units of the standard deviation that was believed before; "
        "the numbers beside it are in the unit named. An interval from −2 to 2 around zero learned nothing. Offsets of "
        "force sensors include what their readings in the air said.",
        soft=True,
    )
    rows = []
    for title, found in kinds.items():
        reach = max(_LEAST_REACH, *(abs(one.share) + INTERVAL_95 * one.std for one in found))
        names = [f"{one.name} {one.text}" for one in found]
        chart = Chart.of_rows(title, names, (-reach, reach), "prior deviations", 17.0)
        chart.level(0.0, upright=True)
        for k, one in enumerate(found):
            half = INTERVAL_95 * one.std
            chart.bar(one.share - half, one.share + half, k, _COLOUR, 3.0, 0.6)
            chart.dot(one.share, k, _COLOUR, 3.0, hint=names[k])
        page.drawing(chart.svg())
        known = sum(one.std < _KNOWN for one in found)
        far = [one.name for one in found if abs(one.share) > _FAR]
        rows.append([title, str(len(found)), str(known), ", ".join(far) or "none"])
    page.table(["", "how many", "known to half of the prior or better", "beyond three prior deviations"], rows)


def _row(label: str, entry: NuisanceEntry, noise: Mapping[str, float]) -> _Row:
    centre, prior = entry.nominal, entry.prior_std
    if entry.kind == WrenchOffset.kind and noise.get("force_offset", 0.0) > _LEAST_PRIOR:
        centre, prior = 0.0, noise["force_offset"]
    label += f" (log {entry.log})" if entry.log else ""
    unit = "" if entry.unit == "1" else f" {entry.unit}"
    text = f"{entry.estimate:+.3g} ±{INTERVAL_95 * entry.std:.2g}{unit}"
    return _Row(label, text, (entry.estimate - centre) / prior, entry.std / prior)
