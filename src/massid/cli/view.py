"""massid view: opens a Rerun recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro


@dataclass(frozen=True)
class View:
    """Open a recording written by `massid identify --rerun` or `massid demo` in the Rerun viewer.

    Examples:
      massid view demo_out/walk.rrd
    """

    recording: tyro.conf.Positional[Path]
    """An .rrd file."""

    def run(self) -> int:
        """Open the viewer and wait until it is closed."""
        from massid.view import open_viewer

        open_viewer(self.recording)
        return 0
