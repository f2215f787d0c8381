"""massid corrupt: what noisy sensors would have logged."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from massid.errors import BadInputError
from massid.outputs import check_suffix
from massid.walk.noise import NoisePreset


@dataclass(frozen=True)
class Corrupt:
    """Give a log without noise the sensors of a real robot.

    Offsets and gains that were drawn, and their seed, go into the truth file beside the new log, together with what the
    clean log's truth file says; the log itself does not show them.

    Examples:
      massid corrupt walk.mcap noisy.mcap
      massid corrupt walk.mcap noisy.mcap --noise white --seed 7
      massid corrupt walk.mcap blind.mcap --noise realistic --drop wrench
      massid corrupt real.mcap blind.mcap --drop wrench
    """

    source: tyro.conf.Positional[Path]
    """Log without noise."""
    out: tyro.conf.Positional[Path]
    """Log to write, NAME.mcap."""
    noise: Annotated[NoisePreset | None, tyro.conf.arg(metavar="PRESET", help_behavior_hint="")] = None
    """white: white noise on every channel; realistic: with offsets and gains; harsh: twice that; clean: none. Default
    realistic, with --drop clean."""
    seed: int = 0
    """Seeds offsets, gains and white noise."""
    drop: tuple[Literal["wrench"], ...] = ()
    """Sensors that the robot does not have; wrench: its feet."""

    def run(self) -> int:
        """Write the noisy log, and say where the files are."""
        from massid.cli.console import say, warn
        from massid.plant import corrupt_log

        check_suffix("the log", self.out, ".mcap", pipes=False)
        noise: NoisePreset = self.noise or ("clean" if self.drop else "realistic")
        if noise == "clean" and not self.drop:
            raise BadInputError("--noise clean changes nothing: choose white, realistic or harsh, or --drop a sensor.")
        written = corrupt_log(self.source, self.out, noise, self.seed, wrenches="wrench" not in self.drop)
        for warning in written.walk.warnings:
            warn(warning)
        say(f"log: {written.path} ({written.walk.duration_s:.1f} s, {len(written.walk)} samples)")
        say(f"truth: {written.truth_path}")
        return 0
