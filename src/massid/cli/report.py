"""massid report: one page about a result."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from massid.cli.arguments import OptionalFile
from massid.outputs import check_outputs, check_suffix


@dataclass(frozen=True)
class Report:
    """Make one page of a result: masses with intervals, convergence, held-out torques, residuals, nuisances.

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
        from massid.cli.console import say, warn
        from massid.result.sidecar import sidecar_path
        from massid.view.report import write_report

        page = self.out or self.result.with_suffix(".html")
        check_outputs(
            [("the result", self.result), ("the result's sidecar", sidecar_path(self.result))],
            [("the page (-o)", page)],
        )
        check_suffix("the page (-o)", page, ".html")
        for warning in write_report(self.result, page):
            warn(warning)
        say(f"report: {page}")
        return 0
