"""The table of all links as text: what the file said, what was found, what is true; at the end, of all else, too."""

from __future__ import annotations

import numpy as np

from massid.result.posterior import INTERVAL_95
from massid.result.quantities import Quantity
from massid.result.result import Result
from massid.score import Score
from massid.view.trace import Trace
from massid.view.words import in_markdown


def table_markdown(trace: Trace, update: int, result: Result, score: Score | None) -> str:
    """Markdown for the moment after an update; 0 is before the first one."""
    heading = _moment(trace, update)
    if score is None:
        summary = "no truth known, so distances to the final estimate"
        columns = "final [kg] | distance [kg]"
    else:
        summary = f"L2 error **{format_kg(float(trace.l2_error_kg[update]))}**"
        columns = "true [kg] | error [kg]"
    if update == len(trace.updates):
        summary += f", {result.status}"
    interval = ", 95 %" if trace.has_intervals else ""
    lines = [
        f"{heading}: {summary}",
        "",
        f"| link | model file [kg] | estimate{interval} [kg] | {columns} |",
        "|:--|--:|--:|--:|--:|",
    ]
    lines += [_row(trace, update, k) for k in range(len(trace.links))]
    if result.quantities and update == len(trace.updates):
        true = score.true_quantities if score else {}
        lines += ["", "| also asked for | model file | estimate | true | unit |", "|:--|--:|--:|--:|:--|"]
        lines += [_quantity(one, true.get(one.name)) for one in result.quantities]
    return "\n".join(lines)


def _row(trace: Trace, update: int, k: int) -> str:
    half = trace.half_width_kg[update, k]
    interval = f" ±{half:.3f}" if np.isfinite(half) else ""
    error = format_error(float(trace.error_kg[update, k]))
    name = in_markdown(trace.links[k])
    return (
        f"| {name} | {trace.nominal_kg[k]:.3f} | **{trace.estimate_kg[update, k]:.3f}**{interval} "
        f"| {trace.reference_kg[k]:.3f} | {error if trace.identifiable[k] else f'{error} (not identifiable)'} |"
    )


def _quantity(one: Quantity, true: float | None) -> str:
    interval = "" if one.std is None else f" ±{INTERVAL_95 * one.std:.4f}"
    found = f"**{one.estimate:.4f}**{interval}" if one.identifiable else "not identifiable"
    known = "" if true is None else f"{true:.4f}"
    return f"| {in_markdown(one.name)} | {one.nominal:.4f} | {found} | {known} | {one.unit} |"


def format_error(error_kg: float) -> str:
    """A signed error with as many digits as it deserves."""
    return f"{error_kg:+.3f}" if abs(error_kg) >= 5e-4 or error_kg == 0.0 else f"{error_kg:+.0e}"


def format_kg(mass_kg: float) -> str:
    """A positive mass with a unit."""
    return f"{mass_kg:#.3g} kg" if mass_kg >= 1e-3 else f"{mass_kg:.0e} kg"


def _moment(trace: Trace, update: int) -> str:
    if update == 0:
        return "Masses of the model file" if trace.online else f"Model file, before pass 1 of {len(trace.updates)}"
    if trace.online:
        return f"After window {update} of {len(trace.updates)}, {trace.update_time_s[update]:.2f} s"
    return f"After pass {update} of {len(trace.updates)}"
