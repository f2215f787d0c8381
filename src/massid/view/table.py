"""The table of all links as text: what the file said, what was found, what is true."""

from __future__ import annotations

from massid.identify.result import Result
from massid.score import Score
from massid.view.trace import Trace


def table_markdown(trace: Trace, update: int, result: Result, score: Score | None) -> str:
    """Markdown for the moment after an update; 0 is before the first one."""
    heading = _moment(trace, update)
    reference = "true" if score is not None else "final"
    norm = (
        f"L2 error **{format_kg(float(trace.l2_error_kg[update]))}**"
        if score is not None
        else "no truth known: errors are distances to the final estimate"
    )
    lines = [
        f"{heading}: {norm}",
        "",
        f"| link | model file [kg] | estimate [kg] | {reference} [kg] | error [kg] |",
        "|:--|--:|--:|--:|--:|",
    ]
    for k, link in enumerate(trace.links):
        error = trace.error_kg[update, k]
        lines.append(
            f"| {link} | {trace.nominal_kg[k]:.3f} | **{trace.estimate_kg[update, k]:.3f}** "
            f"| {trace.reference_kg[k]:.3f} | {format_error(error)} |"
        )
    return "\n".join(lines)


def format_error(error_kg: float) -> str:
    """A signed error with as many digits as it deserves."""
    return f"{error_kg:+.3f}" if abs(error_kg) >= 5e-4 or error_kg == 0.0 else f"{error_kg:+.0e}"


def format_kg(mass_kg: float) -> str:
    """A positive mass with a unit."""
    return f"{mass_kg:.3g} kg" if mass_kg >= 1e-3 else f"{mass_kg:.0e} kg"


def _moment(trace: Trace, update: int) -> str:
    if update == 0:
        return "Masses of the model file"
    if trace.online:
        return f"After window {update} of {len(trace.updates)}, {trace.update_time_s[update]:.2f} s"
    return f"After pass {update} of {len(trace.updates)}"
