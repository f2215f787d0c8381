"""massid repair: a clean file from a damaged one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from massid.cli.arguments import OptionalTopics, topics_file
from massid.outputs import check_outputs


@dataclass(frozen=True)
class Repair:
    """Copy what is sound of a damaged MCAP file into a new one, and say what was lost.

    Works for any MCAP file: cut off by a killed recorder, without an index, with damaged chunks. With --topics the new
    file is a log as massid records it: one clock, standard topics, samples that are not finite left out.

    Examples:
      massid repair walk.mcap.partial walk.mcap
      massid repair lowstate.mcap walk.mcap --topics unitree_g1
    """

    source: tyro.conf.Positional[Path]
    """The damaged file."""
    out: tyro.conf.Positional[Path]
    """The new file."""
    topics: OptionalTopics = None
    """Topic map by which to read the file and write it anew as massid records it."""

    def run(self) -> int:
        """Copy, and print what was kept and lost."""
        from massid.cli.console import say, warn

        if self.topics is not None:
            return self._rewrite()
        from massid.log import repair_log

        repaired = repair_log(self.source, self.out)
        for loss in repaired.losses:
            warn(f"{self.source}: {loss}")
        total = sum(repaired.messages.values())
        say(f"{repaired.path}: {total} messages on {len(repaired.messages)} topics")
        for topic, count in repaired.messages.items():
            say(f"  {topic}: {count}")
        if not repaired.losses:
            say("no damage was found")
        return 0

    def _rewrite(self) -> int:
        from massid.cli.console import say, warn
        from massid.log import load_topics, read_walk, write_walk
        from massid.log.mcap.sink import partial_path

        topics = load_topics(self.topics or "")
        check_outputs(
            [("the damaged file", self.source), topics_file(self.topics)],
            [
                ("the new file", self.out),
                ("the new file, NAME.partial until it is complete,", partial_path(self.out)),
            ],
        )
        walk = read_walk(self.source, topics)
        for warning in walk.warnings:
            warn(warning)
        write_walk(walk, self.out)
        say(f"{self.out}: {len(walk)} samples, {walk.duration_s:.2f} s in {len(walk.segments)} segments")
        return 0
