"""massid identify: link masses from a log."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from massid.assets import resolve_model, shipped_models
from massid.cli import CONTRADICTED, INTERRUPTED, NOT_IDENTIFIABLE
from massid.cli.arguments import (
    OptionalFile,
    OptionalLinks,
    OptionalModel,
    OptionalTopics,
    PayloadList,
    UnknownList,
    parse_names,
    topics_file,
)
from massid.errors import BadInputError
from massid.identify.options import IdentifyOptions
from massid.outputs import check_outputs, check_suffix, is_pipe
from massid.result.document import Document, ReferenceEntry
from massid.result.result import Status

if TYPE_CHECKING:
    from massid.identify.progress import Progress
    from massid.result import Result
    from massid.result.verdict import Verdict
    from massid.score import Score, Truth
    from massid.weighing import Weighing

EXIT_CODES = {
    Status.CONVERGED: 0,
    Status.NOT_IDENTIFIABLE: NOT_IDENTIFIABLE,
    Status.NOT_CONVERGED: 4,
    Status.CONTRADICTED: CONTRADICTED,
}


@dataclass(frozen=True)
class Identify:
    """Find the masses of a robot's links from the log of a walk, or from several logs of the same robot.

    A log without noise is read once, or a few times if it is short. A noisy one is replayed several times, which takes
    a few times its length. Its white noise is read off it (--noise auto); offsets and gains, which no log shows, are
    taken as in --noise realistic.
    What is printed after +- is a 95 % interval.

    Examples:
      massid identify walk.mcap --model robot.xml --links torso,l_thigh,r_thigh
      massid identify monday.mcap tuesday.mcap --model robot.xml --mode offline
      massid identify walk.mcap --truth walk.truth.json --rerun walk.rrd
      massid identify walk.mcap --direction gradient --mode offline --json result.json
    """

    logs: tyro.conf.Positional[tuple[Path, ...]]
    """Logs of walks of one robot, as massid inspect takes them; online they follow each other, offline their scores are
    added."""
    model: OptionalModel = None
    """MJCF or URDF file of the robot, or the name of a shipped one; default the shipped model that made the log."""
    links: OptionalLinks = None
    """Links to weigh, separated by commas; default trunk, thighs, shanks and feet, found in the robot's tree."""
    com: OptionalLinks = None
    """Links whose centre of mass is unknown, too."""
    inertia: OptionalLinks = None
    """Links whose rotational inertia is unknown, too: any that a body can have."""
    payload: PayloadList = ()
    """Point masses that bodies may carry; the point is in the frame of the body [m], default its origin."""
    friction: OptionalLinks = None
    """Joints whose friction loss is unknown, too."""
    damping: OptionalLinks = None
    """Joints whose viscous damping is unknown, too."""
    unknown: UnknownList = ()
    topics: OptionalTopics = None
    """Topic map: a YAML file, or a preset such as ros2 or unitree_g1; default what massid records."""
    mode: Literal["auto", "online", "offline"] = "auto"
    """online sees every dwell window once; offline replays the log and sums over all windows, which gets more out of a
    noisy log; auto is online for a log without noise, and offline else or if that has not settled."""
    truth: OptionalFile = None
    """NAME.truth.json of a simulated walk: adds true masses and errors to what is printed, nothing else."""
    json: OptionalFile = None
    """Write the result as JSON."""
    reference: bool = False
    """Also fit filtered inverse-dynamics least squares with the same unknowns, to compare with: in --json and in its
    report. It takes about half as long again."""
    save_model: OptionalFile = None
    """Write the robot's model file with the identified masses and inertias: .xml, or .urdf for a robot from a URDF."""
    copy_assets: bool = False
    """Copy the meshes and textures of the saved model into a folder beside it."""
    rerun: OptionalFile = None
    """Write a Rerun recording of the walk and of the search."""
    png: OptionalFile = None
    """Write a picture that sums up the search."""
    held_out: float = 0.2
    """Share at the end of each log that is not fitted: its joint torques are predicted instead; 0 fits everything."""
    options: IdentifyOptions = field(default_factory=IdentifyOptions)

    def run(self) -> int:
        """Identify, print the table, write what was asked for."""
        from massid.cli.console import print_result, progress_bar, warn_of_hidden
        from massid.cli.interrupts import stop_on_interrupt
        from massid.score import Truth, score
        from massid.weighing import weigh

        self._check_files(None if self.model is None else resolve_model(self.model))
        truth = Truth.load(self.truth) if self.truth else None
        heard = _Heard(truth, by_default=self.links is None)
        with progress_bar("weighing") as progress, stop_on_interrupt() as stop:
            result = weigh(
                self.logs,
                self.model,
                None if self.links is None else parse_names("--links", self.links),
                unknowns=self._unknowns(),
                topics=self.topics,
                mode=self.mode,
                held_out=self.held_out,
                options=self.options,
                progress=progress,
                tell=heard,
                stop=stop,
            )
        scored = score(result, truth) if truth else None
        print_result(result, scored)
        heard.rest()
        warn_of_hidden(result)
        self._write(result, scored)
        if result.stopped:
            return INTERRUPTED
        return EXIT_CODES[result.status]

    def _check_files(self, model: Path | None) -> None:
        """Pass if all that was asked for can be written, and nothing that is read is lost by it."""
        from massid.model.urdf import SUFFIX, is_urdf
        from massid.result.sidecar import sidecar_path

        check_outputs(
            [
                *(("the log", log) for log in self.logs),
                ("the model (--model)", model),
                *(("a shipped model", shipped) for shipped in shipped_models().values()),
                ("the truth file (--truth)", self.truth),
                topics_file(self.topics),
            ],
            [
                ("--json", self.json),
                ("the sidecar of --json", sidecar_path(self.json) if self.json and not is_pipe(self.json) else None),
                ("--save-model", self.save_model),
                ("--rerun", self.rerun),
                ("--png", self.png),
            ],
        )
        if self.reference and self.json is None:
            raise BadInputError("--reference goes into --json, which was not asked for.")
        from_urdf = model is not None and model.is_file() and is_urdf(model.read_bytes())
        if self.save_model is not None and self.save_model.suffix.lower() == SUFFIX and not from_urdf:
            raise BadInputError(f"--save-model {self.save_model}: only what was read from a URDF is saved as one.")
        if self.copy_assets and self.save_model is None:
            raise BadInputError("--copy-assets goes with --save-model, which was not asked for.")
        check_suffix("--json", self.json, ".json")
        check_suffix("--rerun", self.rerun, ".rrd", pipes=False)
        if self.save_model is not None and is_pipe(self.save_model):
            raise BadInputError(f"--save-model {self.save_model}: is a pipe or a device; models are saved to files.")
        if self.reference and self.json is not None and is_pipe(self.json):
            raise BadInputError("--reference is added to --json when that is written, so it must be a file.")
        check_suffix("--png", self.png, ".png")

    def _unknowns(self) -> list[str]:
        """What was asked for besides masses, as KIND/TARGET."""
        found = {
            "com": parse_names("--com", self.com),
            "inertia": parse_names("--inertia", self.inertia),
            "payload": list(self.payload),
            "friction": parse_names("--friction", self.friction),
            "damping": parse_names("--damping", self.damping),
        }
        return [*(f"{kind}/{target}" for kind, targets in found.items() for target in targets), *self.unknown]

    def _write(self, result: Result, scored: Score | None) -> None:
        """Write the files that were asked for, and say where they are; what is slow and optional comes last."""
        from massid.cli.console import progress_bar, say, warn
        from massid.cli.interrupts import EndedError
        from massid.result.evidence import Evidence

        evidence = result.evidence
        assert isinstance(evidence, Evidence)  # `weigh` keeps it
        walk, robot = evidence.walks[0], evidence.robot
        shows = f", the motion is that of {walk.source}" if len(evidence.walks) > 1 else ""
        document = self._write_json(result, scored) if self.json else None
        if self.save_model:
            result.save_model(self.save_model, with_assets=self.copy_assets)
            say(f"model: {self.save_model}" + (f" ({result.kept_text})" if result.kept_text else ""))
        if self.rerun:
            from massid.view import write_recording

            write_recording(self.rerun, walk, robot, result, scored)
            say(f"recording: {self.rerun} (massid view {self.rerun}){shows}")
        if self.png:
            from massid.view import write_summary_png

            write_summary_png(self.png, walk, robot, result, scored)
            say(f"picture: {self.png}{shows}")
        if self.reference and self.json and document is not None and not result.stopped:
            from massid.result.file import write_json

            try:
                with progress_bar("least squares beside it") as progress:
                    write_json(document.beside(reference_fit(result, progress)), self.json)
            except EndedError:
                raise
            except KeyboardInterrupt:
                warn(f"interrupted: {self.json} is complete but for the least-squares fit on the same log")

    def _write_json(self, result: Result, scored: Score | None) -> Document:
        """Write the result document and its sidecar, which a pipe has no place for."""
        from massid.cli.console import say
        from massid.outputs import write_files
        from massid.result.file import as_json
        from massid.result.sidecar import sidecar_of, sidecar_path
        from massid.score import with_score

        assert self.json is not None
        sidecar = None if is_pipe(self.json) else sidecar_of(result)
        digest = None if sidecar is None else sidecar.sha256
        document = result.document(options=self.options.to_json(), sidecar_sha256=digest)
        document = with_score(document, scored) if scored else document
        beside = {} if sidecar is None else {sidecar_path(self.json): sidecar.content}
        write_files({**beside, self.json: as_json(document)})
        say(f"result: {self.json} (massid report {self.json})")
        return document


class _Heard:
    """Prints warnings and the verdict as they come: warnings after the fit wait for the table.

    Args:
        truth: whose robot is compared with the one that is weighed, before the verdict; None for no truth.
        by_default: whether nobody named the links that are weighed.
    """

    def __init__(self, truth: Truth | None, *, by_default: bool) -> None:
        self._truth = truth
        self._by_default = by_default
        self._waiting: list[str] | None = None
        self._doubted = False

    def __call__(self, said: Weighing | str | Verdict) -> None:
        from massid.cli.console import say, warn
        from massid.weighing import Weighing

        match said:
            case Weighing():
                if self._by_default:
                    say(f"links: {', '.join(said.nominal_kg)} (--links names others)")
                self._doubted = bool(said.doubts)
                for line in self._truth.check_robot(said.nominal_kg) if self._truth else ():
                    warn(line)
            case str():
                if self._waiting is None:
                    warn(said)
                else:
                    self._waiting.append(said)
            case _:
                if not said.hidden:
                    doubted = ", if what the warnings say were settled" if self._doubted else ""
                    say(f"verdict{doubted}: {said.lines()[0]}\n")
                self._waiting = []

    def rest(self) -> None:
        """Print what waited."""
        from massid.cli.console import warn

        for line in self._waiting or ():
            warn(line)


def reference_fit(result: Result, progress: Progress) -> ReferenceEntry | None:
    """Filtered inverse-dynamics least squares on the same log with the same unknowns; None if the log is too short."""
    from massid.compare import CUTOFFS_HZ, scan_cutoffs, self_chosen
    from massid.observer.blas import single_threaded

    if result.evidence is None:
        return None
    space, _ = result.unknowns()
    walk = result.evidence.fitted[0]
    cutoffs = [cutoff_hz for cutoff_hz in CUTOFFS_HZ if cutoff_hz < 0.25 / walk.timestep_s]
    try:
        with single_threaded():  # threads of BLAS would wait for each other longer than they work
            fit = self_chosen(scan_cutoffs(walk, result.evidence.robot, space, cutoffs, progress))
    except BadInputError:
        return None
    asked = len(result.space)
    return ReferenceEntry(
        method="filtered inverse-dynamics least squares",
        cutoff_hz=fit.cutoff_hz,
        estimate_kg=result.masses_kg(fit.estimate[:asked]),
        std_kg=result.masses_kg(fit.std[:asked]),
    )
