"""What the command line draws: progress bars on stderr, tables on stdout."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from massid.cli.flags import in_flags
from massid.identify.progress import Progress as ProgressCallback
from massid.result import Result
from massid.result.posterior import INTERVAL_95
from massid.score import Score

OUT = Console(highlight=False)
ERR = Console(stderr=True, highlight=False)


@contextlib.contextmanager
def progress_bar(title: str) -> Iterator[ProgressCallback]:
    """Draw a bar on stderr while work goes on; nothing when stderr is not a terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[what]}"), TimeRemainingColumn())
    with Progress(*columns, console=ERR, transient=True, disable=not ERR.is_terminal) as bar:
        task = bar.add_task(title, total=1.0, what="")

        def update(fraction: float, what: str) -> None:
            bar.update(task, completed=fraction, what=what)

        yield update


def warn(message: str) -> None:
    """Print one warning line on stderr."""
    ERR.print(f"massid: warning: {in_flags(message)}", soft_wrap=True, markup=False)


def warn_of_hidden(result: Result) -> None:
    """Say what the logs do not reveal, and what the verdict makes of it; what it did not foresee, a warning tells."""
    lacking = [name for name in result.hidden if name not in result.unforeseen]
    if lacking:
        warn(f"{'this log does' if len(result.sources) == 1 else 'these logs do'} not reveal {', '.join(lacking)}")
    if result.verdict and result.verdict.hidden:
        for line in result.verdict.lines():
            warn(line)


def say(message: str) -> None:
    """Print one line on stdout."""
    OUT.print(in_flags(message), soft_wrap=True, markup=False)


def result_table(result: Result, scored: Score | None) -> Table:
    """The table that every identification ends with: link, nominal, estimate and, with the truth, its error."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("link")
    table.add_column(r"nominal \[kg]", justify="right")
    table.add_column(r"estimate \[kg]", justify="right")
    std = result.std_kg
    if std:
        table.add_column(r"95 % \[kg]", justify="right")
    if scored:
        table.add_column(r"true \[kg]", justify="right")
        table.add_column(r"error \[kg]", justify="right")
    nominal, hidden = result.nominal_kg, result.hidden_links
    for link, estimate in result.estimate_kg.items():
        identifiable = link not in hidden
        row = [link, f"{nominal[link]:.3f}", f"{estimate:.4f}" if identifiable else "not identifiable"]
        if std:
            row.append(f"+-{INTERVAL_95 * std[link]:.3f}" if identifiable else "-")
        if scored:
            row += [f"{scored.true_kg[link]:.4f}", f"{scored.error_kg[link]:+.1e}" if identifiable else "-"]
        table.add_row(*row)
    together = result.together
    if std and len(nominal) > 1 and together is not None:
        row = ["together", f"{together.nominal_kg:.3f}", f"{together.estimate_kg:.4f}"]
        row.append(f"+-{INTERVAL_95 * together.std_kg:.3f}")
        if scored:
            row += [f"{sum(scored.true_kg.values()):.4f}", f"{sum(scored.error_kg.values()):+.1e}"]
        table.add_row(*row, style="dim")
    return table


def quantity_table(result: Result, scored: Score | None) -> Table:
    """What was asked for besides masses of links, each with its unit, and its error where the truth is known."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("also asked for")
    for title in ("model file", "estimate", "95 %") if result.uncertainty else ("model file", "estimate"):
        table.add_column(title, justify="right")
    true = scored.true_quantities if scored else {}
    for title in ("true", "error") if true else ():
        table.add_column(title, justify="right")
    table.add_column("unit")
    for one in result.quantities:
        row = [one.name, f"{one.nominal:.4f}", f"{one.estimate:.5f}" if one.identifiable else "not identifiable"]
        if one.std is not None:
            row.append(f"+-{INTERVAL_95 * one.std:.4f}" if one.identifiable else "-")
        if scored and true:
            known = one.name in true
            row.append(f"{true[one.name]:.4f}" if known else "-")
            row.append(f"{scored.quantity_errors[one.name]:+.1e}" if known and one.identifiable else "-")
        table.add_row(*row, one.unit)
    return table


def print_result(result: Result, scored: Score | None) -> None:
    """Print the table and one line on how the identification went."""
    OUT.print(result_table(result, scored))
    if result.quantities:
        say("")
        OUT.print(quantity_table(result, scored))
    unit = "dwell windows" if result.mode == "online" else "passes over the log"
    speed = f"{result.log_s:.1f} s of walking in {result.wall_s:.1f} s"
    say(f"\n{result.status} after {len(result.windows)} {unit} ({speed})")
    if result.unsettled:
        say(result.unsettled)
    if result.validation is not None:
        for line in result.validation.lines():
            say(line)
    if scored and not result.hidden_links:
        say(f"L2 mass error: {scored.l2_error_initial_kg:.3g} kg before, {scored.l2_error_kg[-1]:.2g} kg after")
