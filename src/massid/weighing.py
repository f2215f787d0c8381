"""The trunk: from logs to masses. Read, check, choose sensors, say what can be known, identify, check the answer.

`weigh` is all of it in one call. `Weighing` is the same step by step, for those who want to look in between, as
`massid inspect` does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import mujoco

from massid.assets import find_model_by_hash, resolve_model
from massid.audit import Prepared, differing_masses, prepare_walks
from massid.errors import BadInputError, LogError, StoppedError
from massid.identify import IdentifyOptions, OnlineIdentifier, identify_offline, identify_online
from massid.identify.grounded import as_judged, identify_on_ground, said_of_ground
from massid.identify.logs import PreparedLog
from massid.identify.options import idle_options
from massid.identify.prepare import prepare_logs
from massid.identify.progress import Progress, never, part_of, silent
from massid.identify.replay import WalkReplay
from massid.judge.foresee import foresee
from massid.judge.residuals import channel_residuals
from massid.judge.validation import Split, hold_out, validate
from massid.log import TopicMap, load_topics, read_walk
from massid.model.robot import Robot
from massid.model.unknowns.bodies import Mass
from massid.model.unknowns.spaces import parameter_space
from massid.model.unknowns.unknown import Unknown
from massid.observer.blas import single_threaded
from massid.observer.sensors import NoisySensors
from massid.result import Result, Status
from massid.result.evidence import Evidence
from massid.result.verdict import Verdict
from massid.search.guided import check_bank_size
from massid.search.parameters import ParameterSpace
from massid.search.scan import scanned_columns
from massid.walk import Walk

Log: TypeAlias = "str | Path | Walk"
"""An MCAP file, or a walk that was read or made elsewhere."""
Model: TypeAlias = "str | Path | mujoco.MjSpec | Robot"
"""An MJCF or URDF file, the name of a shipped robot, a spec, or a robot that was loaded before."""
Mode: TypeAlias = Literal["auto", "online", "offline"]
Tell: TypeAlias = "Callable[[Weighing | str | Verdict], None]"
"""Told what is about to be done, each warning, and the verdict, as soon as it is known."""

FEW_PASSES = 6
"""Of a log without noise that one pass has not settled: with second-order steps each squares what is left."""
_READ, _JUDGED, _FITTED = 0.06, 0.15, 0.95
"""Fractions of the work that are done after each step."""


def weigh(
    logs: Log | Sequence[Log],
    robot: Model | None = None,
    links: Sequence[str] | None = None,
    *,
    unknowns: Sequence[str | Unknown] = (),
    topics: TopicMap | str | Path | None = None,
    mode: Mode = "auto",
    held_out: float = 0.2,
    checks: bool = True,
    options: IdentifyOptions | None = None,
    progress: Progress = silent,
    tell: Tell | None = None,
    stop: Callable[[], bool] = never,
) -> Result:
    """Weigh the links of a robot from the log of a walk, or from several logs of the same robot.

    Args:
        logs: MCAP files or walks. Online they follow each other, offline their scores are added.
        robot: the robot with nominal masses; default the shipped model that made the log.
        links: whose mass is unknown; default trunk, thighs, shanks and feet, see `Robot.default_links`.
        unknowns: what else is, as KIND/TARGET (com/LINK, inertia/LINK, payload/BODY@X,Y,Z, friction/JOINT,
            damping/JOINT and others, see `massid.model.unknowns`), or objects of such classes or of a user's own.
        topics: which topic plays which role: a map, a YAML file or the name of a preset; default what massid records.
        mode: online sees every dwell window once; offline replays the logs; auto is offline for logs with sensor noise.
        held_out: share at the end of each log that is not fitted: its joint torques are predicted instead.
        checks: whether to say before the fit what the logs can reveal, and to check the answer after it.
        options: how to identify.
        progress: told the fraction done and a few words.
        tell: told what is about to be done, warnings and the verdict at once; the last two are in the result as well.
        stop: asked now and then; once it says so, what is found so far is the result.

    Returns:
        Masses, with intervals where the log has sensor noise, and what speaks against them.

    Raises:
        LogError: a log cannot be read, does not fit the robot, or is too short.
        ModelError: the robot cannot be loaded, or has no such link.
        BadInputError: options or unknowns that do not fit together.
        DivergedBankError: too few models stayed finite.
        StoppedError: stopped before anything was found.
    """
    tell = tell or _ignore
    job = Weighing.prepare(
        logs, robot, links, unknowns=unknowns, topics=topics, mode=mode, held_out=held_out, options=options,
        progress=part_of(progress, 0.0, _READ),
    )  # fmt: skip
    job.require_windows()
    tell(job)
    for warning in job.warnings:
        tell(warning)
    verdict = None
    if checks:
        verdict = job.foresee(part_of(progress, _READ, _JUDGED))
        tell(verdict)
    result = job.identify(part_of(progress, _JUDGED, _FITTED), stop)
    if verdict is not None:
        result = job.check(result.judged(verdict))
    for warning in result.warnings[len(job.warnings) :]:
        tell(warning)
    progress(1.0, "done")
    return result


@dataclass(frozen=True)
class Weighing:
    """Logs that were read and checked, and what is to be found from them.

    Attributes:
        complete: the robot as the model file has it.
        prepared: each log with the robot that fits it and what the checks found.
        asked: what was asked for.
        logs: the parts of the logs that are fitted, with their sensor models and nuisances.
        held: the parts that are not; None where it would be too short.
        is_offline: whether the logs are replayed.
        may_replay: whether they are if one pass over logs without noise does not suffice.
        options: how to identify.
        warnings: what the user should know, one line each.
        differing: those of them that say which logs are of robots with different masses.
    """

    complete: Robot
    prepared: tuple[Prepared, ...]
    asked: ParameterSpace
    logs: tuple[PreparedLog, ...]
    held: tuple[Walk | None, ...]
    is_offline: bool
    may_replay: bool
    options: IdentifyOptions
    warnings: tuple[str, ...]
    differing: tuple[str, ...] = ()

    @classmethod
    def prepare(
        cls,
        logs: Log | Sequence[Log],
        robot: Model | None = None,
        links: Sequence[str] | None = None,
        *,
        unknowns: Sequence[str | Unknown] = (),
        topics: TopicMap | str | Path | None = None,
        mode: Mode = "auto",
        held_out: float = 0.2,
        thorough: bool = False,
        options: IdentifyOptions | None = None,
        progress: Progress = silent,
    ) -> Weighing:
        """Read and check logs, take off their lags, choose their sensor models; arguments and errors as of `weigh`.

        Args:
            logs: MCAP files or walks.
            robot: with nominal masses.
            links: whose mass is unknown.
            unknowns: what else is.
            topics: which topic plays which role.
            mode: how windows are seen.
            held_out: share of each log that is not fitted.
            thorough: also compute the one-step residual.
            options: how to identify.
            progress: told the fraction done.
        """
        options = IdentifyOptions() if options is None else options
        if not isinstance(options, IdentifyOptions):
            raise BadInputError(f"options is a {type(options).__name__}; expected IdentifyOptions.")
        if mode not in get_args(Mode):
            raise BadInputError(f"`mode` is {mode!r}; expected one of {', '.join(get_args(Mode))}.")
        links = (links,) if isinstance(links, str) else None if links is None else tuple(links)
        unknowns = (unknowns,) if isinstance(unknowns, str | Unknown) else tuple(unknowns)
        if not 0.0 <= held_out < 1.0:
            raise BadInputError(f"`held_out` is {held_out}; it must be at least 0 and less than 1.")
        sources = (logs,) if isinstance(logs, str | Path | Walk) else tuple(logs)
        if not sources:
            raise BadInputError("No log given: name at least one.")
        topic_map = topics if isinstance(topics, TopicMap) else load_topics(topics) if topics else TopicMap()
        progress(0.0, "reading")
        read = [one if isinstance(one, Walk) else read_walk(one, topic_map) for one in sources]
        complete = load_robot(robot, read)
        asked_of = parameter_space(complete, named_links(complete, links), unknowns)
        check_bank_size(asked_of, options.models(len(asked_of)))
        scanned_columns(asked_of, options.search.scan)
        progress(0.3, "checking")
        with single_threaded():
            prepared = prepare_walks(
                sources, complete, topic_map, read, thorough=thorough, interpolate=options.noise == "clean"
            )
            differing = differing_masses(prepared)
            weighed = prepared[0].robot
            asked = parameter_space(weighed, named_links(weighed, links), unknowns)
            parts = [hold_out(one.walk, held_out) for one in prepared]
            _require_rest(parts, prepared, held_out, options.dwell_s)
            fitted = prepare_logs(
                [part.fitted for part in parts], weighed, asked, options, [one.audit.clean for one in prepared]
            )
        is_blind = any(log.walk.open_axes for log in fitted)
        noisy = isinstance(fitted[0].sensors, NoisySensors)
        is_offline = mode == "offline" or (mode == "auto" and (noisy or is_blind))
        if mode == "online" and is_blind:
            raise BadInputError(
                f"{fitted[0].walk.source}: no sensor reads all wrenches, and which feet carry is judged by the whole "
                "log: `mode` must be offline or auto."
            )
        said = [
            *complete.notes,
            *_on_compensation(weighed, asked),
            *(warning for one in prepared for warning in one.walk.warnings),
            *differing,
        ]
        return cls(
            complete=complete,
            prepared=prepared,
            asked=asked,
            logs=fitted,
            held=tuple(part.held for part in parts),
            is_offline=is_offline,
            may_replay=mode == "auto" and not is_offline,
            options=options,
            warnings=(*said, *(doubt for log in fitted for doubt in log.doubts), *idle_options(options, noisy)),
            differing=differing,
        )

    @property
    def robot(self) -> Robot:
        """The robot that the logs fit: joints that they do not show are held still."""
        return self.prepared[0].robot

    @property
    def nominal_kg(self) -> dict[str, float]:
        """Nominal mass of each link asked for [kg]."""
        return {one.body: one.nominal for one in self.asked.parameters if isinstance(one, Mass)}

    @property
    def doubts(self) -> tuple[str, ...]:
        """What makes any masses found from the logs meaningless until it is settled, one line each."""
        return (*(doubt for one in self.prepared for doubt in one.audit.doubts), *self.differing)

    @property
    def denied(self) -> bool:
        """Whether the logs contradict how they were read, or each other: no search finds the masses then.

        Forces that another convention explains may be explained by what is asked for besides masses, such as a scale of
        all torques: then the fit tells.
        """
        asks_for_more = any(not isinstance(one, Mass) for one in self.asked.parameters)
        audits = [one.audit for one in self.prepared]
        misread = any(one.misread and not (one.forces_misread and asks_for_more) for one in audits)
        return misread or bool(self.differing)

    def asking_for(self, links: Sequence[str]) -> Weighing:
        """The same logs, from which other links are to be weighed.

        Args:
            links: whose mass is unknown, and nothing else.

        Raises:
            ModelError: the robot has no such link.
        """
        asked = parameter_space(self.robot, tuple(links))
        cleans = [one.audit.clean for one in self.prepared]
        logs = prepare_logs([log.walk for log in self.logs], self.robot, asked, self.options, cleans)
        return replace(self, asked=asked, logs=logs)

    def require_windows(self) -> None:
        """Pass if the logs fill dwell windows: each of them that is replayed, or at least one.

        Raises:
            LogError: they do not, or the dwell time is shorter than two samples of one.
        """
        walks, dwell_s = [log.walk for log in self.logs], self.options.dwell_s
        fullest = max(walks, key=lambda walk: len(list(walk.windows(dwell_s))))
        try:
            for walk in walks if self.is_offline else [fullest]:
                walk.filled_windows(dwell_s)
        except LogError as error:
            doubts = [f"{one.walk.source}: {doubt}" for one in self.prepared for doubt in one.audit.doubts]
            if doubts:  # what was misread cuts logs, too
                raise LogError(f"{doubts[0]} What is left besides: {error}") from error
            raise

    def identifier(self) -> OnlineIdentifier:
        """An identifier for a stream of the same robot through the same sensors as the first log's."""
        log = self.logs[0]
        return OnlineIdentifier(
            self.robot, log.space, log.walk.contact_bodies, log.walk.timestep_s, self.options, log.sensors
        )

    def foresee(self, progress: Progress = silent) -> Verdict:
        """Say what the logs can reveal, without fitting anything; no other motion helps a log that was misread."""
        with single_threaded():
            verdict = foresee(self.logs, self.robot, self.asked, self.options, progress)
        return replace(verdict, advice=()) if self.denied else verdict

    def replay(self, n_models: int | None = None) -> WalkReplay:
        """The first log with a bank of models, for an optimiser of one's own; see `WalkReplay.score`.

        Args:
            n_models: size of the bank; default what the options say.

        Raises:
            LogError: the log is shorter than one dwell window.
        """
        return WalkReplay(self.logs[0], self.robot, self.options, n_models or self.options.models(len(self.asked)))

    def identify(self, progress: Progress = silent, stop: Callable[[], bool] = never) -> Result:
        """Find what was asked for; see `weigh`."""
        logs, walks, held = self.logs, tuple(one.walk for one in self.prepared), self.held
        with single_threaded():
            if any(log.walk.open_axes for log in logs):
                result, logs = identify_on_ground(logs, self.robot, self.options, progress, stop)
                walks = as_judged(walks, logs, self.robot, result)
                held = as_judged(held, logs, self.robot, result)
                result = replace(result, warnings=(*said_of_ground(logs), *result.warnings))
            else:
                identify = identify_offline if self.is_offline else identify_online
                result = identify(logs, self.robot, self.options, progress, stop)
            if self.may_replay and result.status is Status.NOT_CONVERGED and not result.stopped:
                result = self._replayed(result, progress, stop)
        if self.denied:
            result = result.denied(settled_or_not=True)
        evidence = Evidence(
            robot=self.robot,
            complete=self.complete,
            walks=walks,
            fitted=tuple(log.walk for log in logs),
            held=held,
        )
        return replace(result, evidence=evidence, warnings=(*self.warnings, *result.warnings))

    def _replayed(self, once: Result, progress: Progress, stop: Callable[[], bool]) -> Result:
        """A few passes over logs that ended before one pass had settled; that one's result if they do not settle."""
        options = replace(self.options, passes=min(self.options.passes, FEW_PASSES))
        filled = [log for log in self.logs if any(True for _ in log.walk.windows(options.dwell_s))]
        try:
            # The first pass has told the caller that all is done; what follows cannot go back behind that.
            again = identify_offline(filled, self.robot, options, lambda _, what: progress(1.0, what), stop)
        except StoppedError:
            return once.stopped_early()
        return replace(once, replayed=True) if again.status is Status.NOT_CONVERGED else again

    def check(self, result: Result) -> Result:
        """The result with what the logs say about it."""
        evidence = result.evidence
        walks = [one.walk for one in self.prepared] if evidence is None else evidence.walks
        every = self.held if evidence is None else evidence.held
        held = every[0]
        log = self.logs[0] if held is None else replace(self.logs[0], walk=held)
        with single_threaded():
            validation = validate(result, walks, every, self.robot)
            residuals = channel_residuals(result, log, self.robot)
        return result.checked(replace(validation, residuals=residuals))


def _require_rest(parts: Sequence[Split], prepared: Sequence[Prepared], held_out: float, dwell_s: float) -> None:
    """Refuse to hold out so much that nothing is left to fit."""
    for part, whole in zip(parts, prepared, strict=True):
        if any(True for _ in whole.walk.windows(dwell_s)) and not any(True for _ in part.fitted.windows(dwell_s)):
            raise BadInputError(
                f"`held_out` is {held_out}: of {whole.walk.source} {part.fitted.duration_s:.3g} s are left to fit, "
                f"less than one dwell window of {dwell_s} s; hold less out."
            )


def load_robot(robot: Model | None, walks: Sequence[Walk] = ()) -> Robot:
    """Load a robot from whatever names it; from nothing, the shipped model that made the walks.

    Raises:
        ModelError: there is no such robot, or it cannot be used.
        LogError: nothing was named, and the walks were made with another model, or with several.
    """
    if isinstance(robot, Robot):
        return robot
    if isinstance(robot, mujoco.MjSpec):
        return Robot.load(robot)
    return Robot.load(model_path(robot, walks))


def model_path(robot: str | Path | None, walks: Sequence[Walk] = ()) -> Path:
    """Where a model file is that was named, or is known by its hash; see `load_robot`."""
    if robot is not None:
        return resolve_model(str(robot))
    paths: list[Path] = []
    for walk in walks:
        path = find_model_by_hash(walk.metadata.get("model_sha256", ""))
        if path is None:
            made_with = walk.metadata.get("model_file", "an unknown model")
            raise LogError(f"{walk.source} was made with {made_with}, which is not shipped: name the robot's `model`.")
        if paths and path != paths[0]:
            raise LogError(
                f"{walk.source} was made with {path.name}, {walks[0].source} with {paths[0].name}: several logs must "
                "be of one robot."
            )
        paths.append(path)
    return paths[0]


def named_links(robot: Robot, links: Sequence[str] | None) -> tuple[str, ...]:
    """The links to weigh: those named, or those that matter most to walking (`Robot.default_links`).

    Raises:
        BadInputError: none was named, and the robot has no two legs.
    """
    if links is not None:
        return tuple(links)
    usual = robot.default_links()
    if not usual:
        raise BadInputError(
            f"{robot.source} has no two legs of three links that reach the ground where it stands: name the links to "
            f"weigh (`links`). It has: {', '.join(robot.links)}."
        )
    return usual


def _on_compensation(robot: Robot, asked: ParameterSpace) -> tuple[str, ...]:
    """Say so if actuators compensate the weight of links that are asked for."""
    links = [one.body for one in asked.parameters if isinstance(one, Mass) and one.body in robot.compensated_links]
    if not links:
        return ()
    return (
        f"{robot.source}: actuators compensate the weight of {', '.join(links)} (`gravcomp`, `actuatorgravcomp`), with "
        "the mass of the model file as far as is known here; their masses found are off if it was another.",
    )


def _ignore(said: Weighing | str | Verdict) -> None:
    """Nobody listens."""
