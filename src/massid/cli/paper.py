"""massid paper: the paper's simulations and statements, run again."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from massid.ranges import require_not_negative


@dataclass(frozen=True)
class Paper:
    """Run the paper's simulations again: its figures and Table I beside its numbers, and its theory as checks.

    Writes fig1.png to fig6.png, results.json and index.html into one folder. V-D records a walk first.

    Examples:
      massid paper --out paper_out
      massid paper --only B --out paper_out
      massid paper --only D --walk-s 0 --out paper_out
    """

    out: Path = field(default_factory=lambda: Path("massid_paper"))
    """Folder to write into; made if it does not exist."""
    only: Annotated[Literal["A", "B", "C", "D"] | None, tyro.conf.arg(metavar="{A,B,C,D}", help_behavior_hint="")] = (
        None
    )
    """One section of V alone: A affine, B non-affine and disturbed, C dynamic sampling, D humanoid."""
    walk_s: float = 40.0
    """Length of the walk of V-D [s]; 0 takes the 5 s that come with massid."""
    seed: int = 0
    """Seeds the walk of V-D and its mass errors."""

    def run(self) -> int:
        """Run, print the comparison, and say where the page is."""
        from massid.cli.console import progress_bar, say
        from massid.paper.page import summary_lines, write_page
        from massid.paper.reproduce import PARTS, reproduce

        require_not_negative({"walk_s": self.walk_s})
        parts = (self.only,) if self.only else PARTS
        with progress_bar("paper") as progress:
            outcome = reproduce(self.out, parts, self.walk_s, self.seed, progress)
        write_page(outcome, self.out / "index.html")
        for line in summary_lines(outcome):
            say(line)
        say(f"page: {self.out / 'index.html'} (numbers: {self.out / 'results.json'})")
        return 0
