"""massid identify: link masses from a log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro

from massid.assets import find_model_by_hash, resolve_model
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
from massid.errors import BadInputError, LogError
from massid.identify.options import IdentifyOptions, idle_options
from massid.model.robot import Robot
from massid.model.unknowns.bodies import Mass
from massid.model.unknowns.spaces import parameter_space
from massid.outputs import check_outputs, check_suffix
from massid.result.result import Status
from massid.search.guided import check_bank_size, enough_models
from massid.search.parameters import ParameterSpace
from massid.search.scan import scanned_columns
from massid.walk import Walk

if TYPE_CHECKING:
    from massid.audit import Audit
    from massid.judge.validation import Split
    from massid.result import Result
    from massid.score import Score

EXIT_CODES = {Status.CONVERGED: 0, Status.NOT_IDENTIFIABLE: 3, Status.NOT_CONVERGED: 4}


@dataclass(frozen=True)
class Identify:
    """Find the masses of a robot's links from the log of a walk, or from several logs of the same robot.

    A log without noise is read once. A noisy one is replayed several times, which takes a few times its length. Its
    white noise is read off it (--noise auto); offsets and gains, which no log shows, are taken as in --noise realistic.
    What is printed after +- is a 95 % interval.

    Examples:
      massid identify walk.mcap --model robot.xml --links torso,l_thigh,r_thigh
      massid identify monday.mcap tuesday.mcap --model robot.xml --mode offline
      massid identify walk.mcap --truth walk.truth.json --rerun walk.rrd
      massid identify walk.mcap --direction gradient --mode offline --json result.json
    """

    logs: tyro.conf.Positional[tuple[Path, ...]]
    """MCAP logs of walks of one robot; online they follow each other, offline their scores are added."""
    model: OptionalModel = None
    """MJCF file of the robot, or the name of a shipped one; default the shipped model that made the log."""
    links: OptionalLinks = None
    """Links to weigh, separated by commas; default torso, thighs, calves and feet."""
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
    noisy log; auto is online for a log without noise, and else offline."""
    truth: OptionalFile = None
    """NAME.truth.json of a simulated walk: adds true masses and errors to what is printed, nothing else."""
    json: OptionalFile = None
    """Write the result as JSON."""
    save_model: OptionalFile = None
    """Write the robot's MJCF with the identified masses and inertias."""
    rerun: OptionalFile = None
    """Write a Rerun recording of the walk and of the search."""
    png: OptionalFile = None
    """Write a picture that sums up the search."""
    held_out: float = 0.2
    """Share at the end of each log that is not fitted: its joint torques are predicted instead; 0 fits everything."""
    options: IdentifyOptions = field(default_factory=IdentifyOptions)

    def run(self) -> int:
        """Identify, print the table, write what was asked for."""
        from massid.audit import prepare_walks
        from massid.cli.console import print_result, progress_bar, say, warn, warn_of_hidden
        from massid.identify import identify_offline, identify_online
        from massid.identify.sensing import resolve_noise
        from massid.judge.foresee import foresee
        from massid.judge.validation import hold_out, validate
        from massid.log import TopicMap, load_topics, read_walk
        from massid.score import Truth, score

        self._check_numbers()
        self._check_files(None if self.model is None else resolve_model(self.model))
        truth = Truth.load(self.truth) if self.truth else None
        topics = load_topics(self.topics) if self.topics else TopicMap()
        read = [read_walk(log, topics) for log in self.logs]
        model = self._model_path(read)
        self._check_files(model)
        complete = Robot.load(model)
        prepared = prepare_walks(self.logs, complete, topics, read)
        walks, robot = [one.walk for one in prepared], prepared[0].robot
        known = [warning for walk in walks for warning in walk.warnings]
        for warning in known:
            warn(warning)
        space = self._space(robot)
        weighed = {one.target: one.nominal for one in space.parameters if isinstance(one, Mass)}
        strange = truth.check_robot(weighed) if truth else ()
        options = options_for(self.options, [one.audit for one in prepared], len(space))
        parts = [hold_out(walk, self.held_out) for walk in walks]
        fitted, held = [part.fitted for part in parts], [part.held for part in parts]
        noisy = resolve_noise(fitted[0], robot, options) is not None
        is_offline = self.mode == "offline" or (self.mode == "auto" and noisy)
        check_bank_size(space, options.bank_size)
        scanned_columns(space, options.search.scan)
        for warning in (*strange, *idle_options(options, noisy)):
            warn(warning)
        check_windows(fitted, options.dwell_s, all_needed=is_offline)
        with progress_bar("judging") as progress:
            verdict = foresee(fitted, robot, space, options, progress, self.options.noise)
        if not verdict.hidden:
            say(f"verdict: {verdict.lines()[0]}\n")
        identify = identify_offline if is_offline else identify_online
        with progress_bar("identifying") as progress:
            result = identify(fitted, robot, space, options, progress).judged(verdict)
        result = result.checked(validate(result, walks, held, robot))
        scored = score(result, truth) if truth else None
        print_result(result, scored)
        for warning in result.warnings[len(known) :]:
            warn(warning)
        warn_of_hidden(result)
        if self.json:
            self._write_json(result, scored, parts[0], robot, options)
        self._write(result, scored, walks, robot, complete)
        return EXIT_CODES[result.status]

    def _check_numbers(self) -> None:
        if not 0.0 <= self.held_out < 1.0:
            raise BadInputError(f"--held-out is {self.held_out}; it must be at least 0 and less than 1.")
        if not self.logs:
            raise BadInputError("No log given: massid identify LOG [LOG ...].")

    def _check_files(self, model: Path | None) -> None:
        """Pass if all that was asked for can be written, and nothing that is read is lost by it."""
        from massid.result.sidecar import sidecar_path

        check_outputs(
            [
                *(("the log", log) for log in self.logs),
                ("the model (--model)", model),
                ("the truth file (--truth)", self.truth),
                topics_file(self.topics),
            ],
            [
                ("--json", self.json),
                ("the sidecar of --json", None if self.json is None else sidecar_path(self.json)),
                ("--save-model", self.save_model),
                ("--rerun", self.rerun),
                ("--png", self.png),
            ],
        )
        check_suffix("--rerun", self.rerun, ".rrd")
        check_suffix("--png", self.png, ".png")

    def _write(
        self, result: Result, scored: Score | None, walks: Sequence[Walk], robot: Robot, complete: Robot
    ) -> None:
        """Write the files that were asked for, and say where they are."""
        from massid.cli.console import say

        shows = f", the motion is that of {walks[0].source}" if len(walks) > 1 else ""
        if self.save_model:
            kept = f"{', '.join(result.hidden)}: not identifiable, the model file's value kept" if result.hidden else ""
            complete.write_mjcf(result.space, result.reported, self.save_model, remark=kept)
            say(f"model: {self.save_model}" + (f" ({kept})" if kept else ""))
        if self.rerun:
            from massid.view import write_recording

            write_recording(self.rerun, walks[0], robot, result, scored)
            say(f"recording: {self.rerun} (massid view {self.rerun}){shows}")
        if self.png:
            from massid.view import write_summary_png

            write_summary_png(self.png, walks[0], robot, result, scored)
            say(f"picture: {self.png}{shows}")

    def _write_json(
        self, result: Result, scored: Score | None, part: Split, robot: Robot, options: IdentifyOptions
    ) -> None:
        """Write the result document and its sidecar, with the reference method beside it."""
        from massid.cli.console import say
        from massid.judge.residuals import channel_residuals
        from massid.result.result import write_json
        from massid.result.sidecar import DIGEST, sidecar_path, write_sidecar
        from massid.score import with_score

        if self.json is None:
            return
        settings = replace(options, noise=self.options.noise).to_json()
        document = result.to_json() | {"reference": reference_fit(result, part.fitted, robot), "options": settings}
        digest = write_sidecar(
            sidecar_path(self.json), result, channel_residuals(result, part.held or part.fitted, robot, options)
        )
        document |= {DIGEST: digest}
        write_json(with_score(document, scored) if scored else document, self.json)
        say(f"result: {self.json} (massid report {self.json})")

    def _model_path(self, walks: Sequence[Walk]) -> Path:
        if self.model is not None:
            return resolve_model(self.model)
        paths: list[Path] = []
        for walk in walks:
            path = find_model_by_hash(walk.metadata.get("model_sha256", ""))
            if path is None:
                made_with = walk.metadata.get("model_file", "an unknown model")
                raise LogError(f"{walk.source} was made with {made_with}, which is not shipped: name it with --model.")
            if paths and path != paths[0]:
                raise LogError(
                    f"{walk.source} was made with {path.name}, {walks[0].source} with {paths[0].name}: several logs "
                    "must be of one robot."
                )
            paths.append(path)
        return paths[0]

    def _space(self, robot: Robot) -> ParameterSpace:
        wanted = {
            "com": parse_names("--com", self.com),
            "inertia": parse_names("--inertia", self.inertia),
            "payload": self.payload,
            "friction": parse_names("--friction", self.friction),
            "damping": parse_names("--damping", self.damping),
        }
        named = [f"{kind}/{target}" for kind, targets in wanted.items() for target in targets]
        return parameter_space(robot, self._links(robot), [*named, *self.unknown])

    def _links(self, robot: Robot) -> list[str]:
        if self.links is not None:
            return parse_names("--links", self.links)
        links = robot.walking_links()
        if not links:
            raise BadInputError(
                f"{robot.source} has no links named like torso, l_thigh, l_calf or l_foot: name the links to weigh "
                f"with --links. It has: {', '.join(robot.links)}."
            )
        return list(links)


def reference_fit(result: Result, walk: Walk, robot: Robot) -> dict[str, Any] | None:
    """Filtered inverse-dynamics least squares on the same log with the same unknowns; None if the log is too short."""
    from massid.compare import CUTOFFS_HZ, scan_cutoffs, self_chosen

    space, _ = result.unknowns()
    cutoffs = [cutoff_hz for cutoff_hz in CUTOFFS_HZ if cutoff_hz < 0.25 / walk.timestep_s]
    try:
        fit = self_chosen(scan_cutoffs(walk, robot, space, cutoffs))
    except BadInputError:
        return None
    asked = len(result.space)
    return {
        "method": "filtered inverse-dynamics least squares",
        "cutoff_hz": fit.cutoff_hz,
        "estimate_kg": result.masses_kg(fit.estimate[:asked]),
        "std_kg": result.masses_kg(fit.std[:asked]),
    }


def check_windows(walks: Sequence[Walk], dwell_s: float, *, all_needed: bool) -> None:
    """Pass if the walks fill dwell windows: each of them, or at least one.

    Raises:
        LogError: they do not, or dwell_s is shorter than two samples of one.
    """
    fullest = max(walks, key=lambda walk: len(list(walk.windows(dwell_s))))
    for walk in walks if all_needed else [fullest]:
        walk.filled_windows(dwell_s)


def options_for(options: IdentifyOptions, audits: Sequence[Audit], n_unknowns: int = 0) -> IdentifyOptions:
    """With `--noise auto`, logs that the physics explains to rounding have no noise; more unknowns get more models."""
    if options.bank_size == IdentifyOptions.bank_size:
        options = replace(options, bank_size=max(options.bank_size, enough_models(n_unknowns)))
    is_clean = options.noise == "auto" and all(audit.clean for audit in audits)
    return replace(options, noise="clean") if is_clean else options
