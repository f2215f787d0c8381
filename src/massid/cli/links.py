"""massid links: what can be weighed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from massid.errors import BadInputError

_LOGS = (".mcap", ".bag", ".db3", ".partial")


@dataclass(frozen=True)
class Links:
    """List the links of a robot with their nominal masses, as --links takes them.

    A link that has no joint of its own moves with another, so only the two together can be weighed: name that one.
    Those with a * are weighed if none is named.

    Examples:
      massid links atlas
      massid links my_robot.xml
    """

    model: tyro.conf.Positional[str]
    """MJCF or URDF file, or the name of a shipped robot."""

    def run(self) -> int:
        """Print one line per link."""
        from massid.assets import resolve_model
        from massid.cli.console import say, warn
        from massid.model.robot import Robot

        if Path(self.model).suffix in _LOGS:
            raise BadInputError(f"{self.model} is a log, expected a robot's MJCF file or the name of a shipped robot.")
        robot = Robot.load(resolve_model(self.model))
        for note in robot.notes:
            warn(note)
        usual = robot.default_links()
        width = max(len(link) for link in robot.links)
        for link in robot.links:
            parent = robot.welded_to(link)
            note = "  *" if link in usual else "" if parent is None else f"  moves with {parent}"
            say(f"{link:{width}}  {robot.nominal_mass_kg(link):8.3f} kg{note}")
        say(f"{'total':{width}}  {robot.total_mass_kg:8.3f} kg")
        return 0
