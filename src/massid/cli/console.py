"""What the command line draws: progress bars on stderr, tables on stdout."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from massid.cli.flags import in_flags
from massid.errors import cut, on_one_line, printable
from massid.identify.progress import Progress as ProgressCallback
from massid.result import Result
from massid.result.presentation import mass_table, outcome, quantity_table
from massid.score import Score

UNCUT = 200
"""Columns of what is written to a file or a pipe, where nothing need be cut off."""
OUT = Console(highlight=False, markup=False, emoji=False)
ERR = Console(stderr=True, highlight=False, markup=False, emoji=False)
if not OUT.is_terminal:
    OUT.width = max(OUT.width, UNCUT)


@contextlib.contextmanager
def progress_bar(title: str) -> Iterator[ProgressCallback]:
    """Draw a bar on stderr while work goes on; nothing when stderr is not a terminal."""
    said = TextColumn("{task.description}", markup=False), TextColumn("{task.fields[what]}", markup=False)
    columns = (said[0], BarColumn(), said[1], TimeRemainingColumn())
    with Progress(*columns, console=ERR, transient=True, disable=not ERR.is_terminal) as bar:
        task = bar.add_task(title, total=1.0, what="")

        def update(fraction: float, what: str) -> None:
            bar.update(task, completed=fraction, what=printable(what))

        yield update


def warn(message: str) -> None:
    """Print one warning line on stderr."""
    ERR.print(f"massid: warning: {on_one_line(in_flags(message))}", soft_wrap=True)


def warn_of_hidden(result: Result) -> None:
    """Say what the logs do not reveal, and what the verdict makes of it; what it did not foresee, a warning tells."""
    lacking = [name for name in result.hidden if name not in result.unforeseen]
    if lacking:
        warn(f"{'this log does' if len(result.sources) == 1 else 'these logs do'} not reveal {', '.join(lacking)}")
    if result.verdict and result.verdict.hidden:
        for line in result.verdict.lines():
            warn(line)


def say(message: str) -> None:
    """Print one line on stdout, after as many empty ones as it begins with."""
    line = message.lstrip("\n")
    OUT.print(message[: len(message) - len(line)] + printable(cut(in_flags(line))), soft_wrap=True)


def result_table(result: Result, scored: Score | None) -> Table:
    """The table that every identification ends with: link, nominal, estimate and, with the truth, its error."""
    masses, hidden = mass_table(result), result.hidden_links
    table = _table((*masses.head, "true [kg]", "error [kg]") if scored else masses.head)
    for row, link in zip(masses.rows, result.estimate_kg, strict=True):
        errors: tuple[str, ...] = ()
        if scored:
            errors = (f"{scored.true_kg[link]:.4f}", "-" if link in hidden else f"{scored.error_kg[link]:+.1e}")
        table.add_row(*map(cell, row + errors))
    if masses.total:
        errors = ()
        if scored:
            errors = (f"{sum(scored.true_kg.values()):.4f}", f"{sum(scored.error_kg.values()):+.1e}")
        table.add_row(*map(cell, masses.total + errors), style="dim")
    return table


def other_table(result: Result, scored: Score | None) -> Table:
    """What was asked for besides masses of links, each with its unit, and its error where the truth is known."""
    quantities = quantity_table(result)
    *head, unit = quantities.head
    true = scored.true_quantities if scored else {}
    table = _table([*head, *(("true", "error") if true else ())])
    table.add_column(unit)
    for one, (*row, name) in zip(result.quantities, quantities.rows, strict=True):
        if scored and true:
            known = one.name in true
            row.append(f"{true[one.name]:.4f}" if known else "-")
            row.append(f"{scored.quantity_errors[one.name]:+.1e}" if known and one.identifiable else "-")
        table.add_row(*map(cell, (*row, name)))
    return table


def _table(head: Sequence[str]) -> Table:
    """An empty table of numbers, whose first column names them."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for k, name in enumerate(head):
        table.add_column(cell(name), justify="right" if k else "left")
    return table


def cell(text: str) -> Text:
    """What stands in one place of a table, as it is: a name like `arm[left]` is no markup."""
    return Text(printable(cut(text)))


def print_result(result: Result, scored: Score | None) -> None:
    """Print the table and one line on how the identification went."""
    OUT.print(result_table(result, scored))
    if result.quantities:
        say("")
        OUT.print(other_table(result, scored))
    say(f"\n{outcome(result)}")
    if result.unsettled:
        say(result.unsettled)
    if result.validation is not None:
        for line in result.validation.lines():
            say(line)
    if scored and not result.hidden_links:
        say(f"L2 mass error: {scored.l2_error_initial_kg:.3g} kg before, {scored.l2_error_kg[-1]:.2g} kg after")
