"""massid demo: the whole path in one command."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from massid.cli.identify import Identify
from massid.cli.record import Record
from massid.errors import BadInputError, FallError


@dataclass(frozen=True)
class Demo:
    """Record a walking humanoid with hidden mass errors, then find its masses from the log.

    Writes the log, its truth, the result, the identified model, a Rerun recording and a picture into one folder.

    Examples:
      massid demo
      massid demo --robot light --seconds 30 --out light_demo --view
    """

    out: Path = field(default_factory=lambda: Path("massid_demo"))
    """Folder to write into; made if it does not exist."""
    robot: str = "atlas"
    """Shipped robot, or MJCF or URDF file; an unknown name lists the shipped ones."""
    seconds: float = 10.0
    """How long to walk [s]."""
    gait: str = "random"
    """How to walk; an unknown name lists all gaits."""
    seed: int = 0
    """Seeds mass errors, gait and search."""
    view: bool = False
    """Open the recording in the Rerun viewer at the end."""

    def run(self) -> int:
        """Record, identify, print the table and where the files are."""
        from massid.assets import resolve_model
        from massid.cli.console import say
        from massid.identify import IdentifyOptions

        model = resolve_model(self.robot)
        try:
            self.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BadInputError(f"Cannot make the folder {self.out}: {error.strerror}.") from error
        log = self.out / "walk.mcap"
        report = Record(log, robot=str(model), seconds=self.seconds, gait=self.gait, seed=self.seed).record()
        if report.end != "complete":
            raise FallError(
                f"The walk ended after {report.duration_s:.1f} s ({report.end}); try another --gait or --seed."
            )
        say(f"{model.stem} walked {report.duration_s:.1f} s ({self.gait}), masses {report.error_norm_kg:.2f} kg off\n")
        code = Identify(
            (log,),
            model=str(model),
            truth=report.truth_path,
            json=self.out / "result.json",
            save_model=self.out / f"{model.stem}_identified.xml",
            rerun=self.out / "walk.rrd",
            png=self.out / "summary.png",
            options=IdentifyOptions(seed=self.seed),
        ).run()
        say(f"log: {log} (truth: {report.truth_path})")
        if self.view:
            from massid.view import open_viewer

            open_viewer(self.out / "walk.rrd")
        return code
