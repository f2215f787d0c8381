"""massid record: a walk of a simulated robot whose masses are not what its model says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from massid.cli.arguments import MassErrorList, OptionalHz, OptionalKg
from massid.errors import BadInputError, FallError
from massid.outputs import check_outputs, check_suffix
from massid.ranges import require_at_most, require_not_negative, require_positive
from massid.walk.noise import NoisePreset

if TYPE_CHECKING:
    from massid.plant import RecordingReport

LONGEST_S = 3600.0
"""An hour of walking is 3 GB."""


@dataclass(frozen=True)
class Record:
    """Let a simulated robot walk with hidden mass errors, and log it to MCAP.

    The walker knows only the nominal masses. The true ones go into NAME.truth.json beside the log.

    Examples:
      massid record walk.mcap
      massid record walk.mcap --robot light --seconds 30 --gait turn --seed 3
      massid record walk.mcap --robot nimble --gait stamp --rate-hz 500
      massid record walk.mcap --mass torso=+4 l_foot=-0.5
      massid record walk.mcap --payload l_hand=+0.5
      massid record walk.mcap --noise realistic
    """

    out: tyro.conf.Positional[Path]
    """Log to write, NAME.mcap."""
    robot: str = "atlas"
    """Shipped robot, or MJCF or URDF file; an unknown name lists the shipped ones."""
    seconds: float = 20.0
    """How long to walk [s]."""
    gait: str = "random"
    """How to walk; an unknown name lists all gaits."""
    controller: Literal["auto", "torque", "servo"] = "auto"
    """What moves the joints: torques, or the position servos of the robot's file; auto as the file drives them."""
    rate_hz: OptionalHz = None
    """Samples per second in the log, torques and wrenches being means; default all of the model's steps."""
    mass_error_kg: OptionalKg = None
    """L2 norm of mass errors in a random direction; default 6 for atlas, a quarter of the links' norm for others."""
    mass: MassErrorList = ()
    """Mass errors of your own, LINK=+KG, instead of random ones."""
    payload: MassErrorList = ()
    """What links carry, LINK=+KG or LINK@X,Y,Z=+KG: a point mass at the origin of the link's frame, or at a point in it
    [m]; however light, and on any link that moves. The truth file has it beside the masses of the links themselves."""
    noise: NoisePreset = "clean"
    """Noise of the sensors; offsets and gains that were drawn go into the truth file alone."""
    sensors: Literal["all", "no-wrench"] = "all"
    """Which the robot has; no-wrench for none at its feet."""
    seed: int = 0
    """Seeds mass errors, gait and sensors."""

    def run(self) -> int:
        """Record, and say where the files are."""
        from massid.cli.console import say

        report = self.record()
        say(f"log: {report.path} ({report.duration_s:.1f} s, {report.samples} samples)")
        say(f"truth: {report.truth_path} (L2 mass error {report.error_norm_kg:.3g} kg)")
        if report.end == "diverged":
            raise FallError(
                f"The simulation diverged after {report.duration_s:.1f} s; the log up to there is complete."
            )
        if report.fell:
            raise FallError(
                f"The robot fell after {report.duration_s:.1f} s; the log up to the fall is complete and says so. "
                "Try another --gait, another --seed or smaller mass errors."
            )
        return 0

    def record(self) -> RecordingReport:
        """Record with a progress bar.

        Raises:
            BadInputError: something about the arguments is wrong; nothing was recorded.
        """
        from massid.assets import resolve_model
        from massid.cli.console import progress_bar
        from massid.plant import HiddenMasses, MassErrors, record_walk
        from massid.plant.truth import truth_path

        if self.mass and self.mass_error_kg is not None:
            raise BadInputError("Give either --mass or --mass-error-kg, not both.")
        require_positive({"seconds": self.seconds} | ({} if self.rate_hz is None else {"rate_hz": self.rate_hz}))
        require_at_most(LONGEST_S, {"seconds": self.seconds})
        require_not_negative({"seed": self.seed})
        model = resolve_model(self.robot)
        truth = truth_path(self.out)
        check_outputs(
            [("the model (--robot)", model)], [("the log", self.out), ("the truth file beside the log", truth)]
        )
        check_suffix("the log", self.out, ".mcap", pipes=False)
        masses = parse_masses("--mass", self.mass)
        hidden = HiddenMasses(masses) if masses else MassErrors(norm_kg=self.mass_error_kg)
        payload_kg = parse_masses("--payload", self.payload)
        with progress_bar("walking") as progress:
            return record_walk(
                model,
                self.out,
                self.seconds,
                gait=self.gait,
                controller=self.controller,
                hidden=hidden,
                payload_kg=payload_kg,
                noise=self.noise,
                wrenches=self.sensors == "all",
                period_s=None if self.rate_hz is None else 1.0 / self.rate_hz,
                seed=self.seed,
                progress=progress,
            )


def parse_masses(option: str, arguments: Sequence[str]) -> dict[str, float]:
    """Read LINK=+KG arguments of an option.

    Raises:
        BadInputError: an argument has another form, or names a link twice.
    """
    errors: dict[str, float] = {}
    for argument in arguments:
        link, equals, value = argument.partition("=")
        try:
            error_kg = float(value)
        except ValueError:
            equals = ""
        if not equals or not link:
            raise BadInputError(f"{option} {argument}: expected LINK=+KG, for example torso=+4 or l_foot=-0.5.")
        if link in errors:
            raise BadInputError(f"{option} names '{link}' twice.")
        errors[link] = error_kg
    return errors
