"""massid report: one page about a result."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from massid.cli.arguments import OptionalFile
from massid.errors import BadInputError


@dataclass(frozen=True)
class Report:
    """Make one page of a result: masses with intervals, convergence, held-out torques, residuals, sensor errors.

    The page needs no network and no other file.

    Examples:
      massid report result.json
      massid report result.json -o report.html
    """

    result: tyro.conf.Positional[Path]
    """What `massid identify --json` wrote; its sidecar of the same name lies beside it."""
    out: Annotated[OptionalFile, tyro.conf.arg(aliases=("-o",))] = None
    """Page to write; default the result's name with .html."""

    def run(self) -> int:
        """Write the page and say where it is."""
        from massid.cli.console import say
        from massid.view.report import write_report

        page = self.out or self.result.with_suffix(".html")
        if not page.resolve().parent.is_dir():
            raise BadInputError(f"Cannot write {page}: the folder {page.parent} does not exist.")
        write_report(self.result, page)
        say(f"report: {page}")
        return 0
