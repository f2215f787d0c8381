"""massid compare: do results agree?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from massid.cli import CONTRADICTED
from massid.cli.arguments import OptionalFile
from massid.errors import BadInputError
from massid.outputs import check_outputs, check_suffix

if TYPE_CHECKING:
    from massid.result.agreement import Agreement


@dataclass(frozen=True)
class Compare:
    """Compare results: of other days, of a robot's sisters, of other methods; which links differ?

    Links that both results know are compared within their intervals, all of them together at 95 %. A log without noise
    has no intervals; its masses count as known to 0.1 %. If a link differs, the exit code is 5.

    Examples:
      massid compare monday.json friday.json
      massid compare robot_1.json robot_2.json robot_3.json --html fleet.html
    """

    results: tyro.conf.Positional[tuple[Path, ...]]
    """What `massid identify --json` wrote, two or more."""
    html: Annotated[OptionalFile, tyro.conf.arg(aliases=("-o",))] = None
    """Write a page with all of them."""

    def run(self) -> int:
        """Print the table, write the page."""
        from massid.cli.console import say, warn
        from massid.result.agreement import compare_results
        from massid.result.file import read_document
        from massid.view.comparison import write_comparison

        if len(self.results) < 2:
            raise BadInputError(f"{len(self.results)} result named; expected two or more to compare.")
        if twice := [path for path in self.results if self.results.count(path) > 1]:
            raise BadInputError(f"{twice[0]} is named twice; a result always agrees with itself.")
        check_suffix("--html", self.html, ".html")
        check_outputs([("a result", path) for path in self.results], [("the page (--html)", self.html)])
        agreement = compare_results(_names(self.results), [read_document(path) for path in self.results])
        for doubt in agreement.doubts:
            warn(doubt)
        _show(agreement)
        for link, why in agreement.alone.items():
            say(f"{link}: {why}")
        if agreement.differing:
            say(f"\ndiffer: {', '.join(agreement.differing)}")
        else:
            say("\nthe same masses, as far as these results can tell")
        if self.html:
            write_comparison(agreement, self.html)
            say(f"page: {self.html}")
        return CONTRADICTED if agreement.differing else 0


def _names(paths: tuple[Path, ...]) -> list[str]:
    """Short names that differ: of the files, or with their folders."""
    stems = [path.stem for path in paths]
    return stems if len(set(stems)) == len(stems) else [str(path) for path in paths]


def _show(agreement: Agreement) -> None:
    from rich.table import Table

    from massid.cli.console import OUT
    from massid.errors import printable
    from massid.result.posterior import INTERVAL_95

    table = Table(box=None, pad_edge=False)
    table.add_column("link")
    for name in agreement.names:
        table.add_column(f"{printable(name)} [kg]", justify="right")
    for head in ("last less first [kg]", "+- [kg]", ""):
        table.add_column(head, justify="right")
    for one in agreement.links:
        masses = ["-" if mass_kg is None else f"{mass_kg:.4f}" for mass_kg in one.estimates_kg]
        half = INTERVAL_95 * one.difference_std_kg
        end = "" if one.agrees else "differ"
        table.add_row(printable(one.link), *masses, f"{one.difference_kg:+.4f}", f"{half:.2g}", end)
    OUT.print(table)
