"""A page with several results side by side."""

from __future__ import annotations

from pathlib import Path

from massid.result.agreement import Agreement, LinkAgreement
from massid.result.posterior import INTERVAL_95
from massid.view.chart import Chart
from massid.view.colours import LINK_COLOURS
from massid.view.page import Cell, HtmlPage

_COMMON = "#1d2229"


def write_comparison(agreement: Agreement, page_path: Path) -> None:
    """Write the page.

    Raises:
        BadInputError: it cannot be written.
    """
    page = HtmlPage(f"massid: {' and '.join(agreement.names)}")
    differing = agreement.differing
    value = "the same masses" if not differing else f"{len(differing)} of {len(agreement.links)} links differ"
    page.cards([(value, "each link at 95 % over all of them", "bad" if differing else "good")])
    for doubt in agreement.doubts:
        page.warning(doubt)
    page.heading("Masses")
    head = ["link", *(f"{name} [kg]" for name in agreement.names), "last less first [kg]", "together [kg]", ""]
    page.table(head, [_row(one) for one in agreement.links])
    for link, why in agreement.alone.items():
        page.paragraph(f"{link}: {why}.", soft=True)
    for one in agreement.links:
        page.drawing(_chart(agreement, one).svg())
    page.key([(_COMMON, "mean of all, each with the weight of its own deviation")])
    page.write(page_path)


def _row(one: LinkAgreement) -> list[str | Cell]:
    each = [
        "–" if mass_kg is None or std_kg is None else f"{mass_kg:.3f} ±{INTERVAL_95 * std_kg:.2g}"
        for mass_kg, std_kg in zip(one.estimates_kg, one.std_kg, strict=True)
    ]
    difference = f"{one.difference_kg:+.3f} ±{INTERVAL_95 * one.difference_std_kg:.2g}"
    common = f"{one.common_kg:.3f} ±{INTERVAL_95 * one.common_std_kg:.2g}" if one.agrees else "–"
    return [one.link, *each, difference, common, Cell("agree", "good") if one.agrees else Cell("differ", "bad")]


def _chart(agreement: Agreement, one: LinkAgreement) -> Chart:
    """The interval of each result, a row each."""
    ends = [
        mass_kg + side * INTERVAL_95 * std_kg
        for mass_kg, std_kg in zip(one.estimates_kg, one.std_kg, strict=True)
        if mass_kg is not None and std_kg is not None
        for side in (-1.0, 1.0)
    ]
    margin = 0.08 * (max(ends) - min(ends))
    chart = Chart.of_rows(one.link, agreement.names, (min(ends) - margin, max(ends) + margin), "kg")
    if one.agrees:
        chart.level(one.common_kg, _COMMON, upright=True)
    for row, (mass_kg, std_kg) in enumerate(zip(one.estimates_kg, one.std_kg, strict=True)):
        if mass_kg is None or std_kg is None:
            continue
        colour = LINK_COLOURS[row % len(LINK_COLOURS)]
        half = INTERVAL_95 * std_kg
        chart.bar(mass_kg - half, mass_kg + half, row, colour, 6.0, 0.45)
        chart.dot(mass_kg, row, colour, 4.5, hint=f"{agreement.names[row]} {mass_kg:.3f} kg")
    return chart
