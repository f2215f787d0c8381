"""From a file and a robot to a walk that is ready for identification: read, checked, lags taken off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from massid.audit.balance import measure_balance
from massid.audit.forces import check_rest, check_torques
from massid.audit.inner_steps import FACTOR, with_inner_steps
from massid.audit.lag import Lag, estimate_lag, lag_margin
from massid.audit.names import without_prefix
from massid.audit.report import CLEAN_REST, Audit, audit_walk
from massid.errors import BadInputError, LogError
from massid.log import TopicMap, read_walk
from massid.model.robot import Robot
from massid.walk import Walk
from massid.walk.refine import refined
from massid.walk.resampling import stamped_earlier
from massid.walk.white_noise import looks_noisy

_CLEARLY = 0.5
"""Share of the unexplained force that another reading of a log must leave at most to be believed."""
_MOST_STEPS = 10
"""A log this many times slower than the model's step is not refined any further."""


@dataclass(frozen=True)
class Prepared:
    """A log and the robot that fits it.

    Attributes:
        walk: aligned with the robot, lags taken off, samples with self-contact in no segment; all warnings with it.
        robot: joints that the topic map says were locked are held still.
        audit: what the checks found.
    """

    walk: Walk
    robot: Robot
    audit: Audit


def prepare_walk(
    source: Path | str | Walk,
    robot: Robot,
    topics: TopicMap | None = None,
    *,
    walk: Walk | None = None,
    thorough: bool = False,
    interpolate: bool = False,
) -> Prepared:
    """Read a log, check it against the robot and compensate lags between its streams.

    Args:
        source: an MCAP file, or a walk.
        robot: with nominal masses.
        topics: which topic plays which role in the file.
        walk: the file as read with these topics, if it was read already.
        thorough: also compute the one-step residual.
        interpolate: whether to put a log without noise on the model's step even if that is much shorter.

    Raises:
        LogError: the log cannot be read, does not fit the robot, or nothing usable is left of it.
        ModelError: a joint cannot be locked where the topic map says.
    """
    topics = topics or TopicMap()
    if walk is None:
        walk = source if isinstance(source, Walk) else read_walk(source, topics)
    walk = without_prefix(walk, robot)
    robot.require_bodies(walk)
    robot = robot.locked(_locked(robot, walk, topics))
    check_torques(robot, walk, _passive(walk, topics))
    robot, taken_off, notes = _gravity_compensation(robot, walk)
    walk = robot.without_compensation(robot.align(walk)) if taken_off else walk
    steps, noisy = robot.steps_in(walk.timestep_s), looks_noisy(walk)
    if steps > 1 and not noisy and _steps_with_samples(robot, walk):
        notes += (
            f"{walk.source}: it was simulated with steps of its own sample period, {walk.timestep_s:g} s, not with the "
            f"{robot.model.opt.timestep:g} s that the model file has; the models do the same.",
        )
        robot, steps = robot.stepping(walk.timestep_s), 1
    coarse = noisy or (steps > FACTOR and not interpolate)  # interpolated noise looks like motion
    factor = min(steps, _MOST_STEPS)

    def audit_of(walk: Walk) -> Audit:
        if not coarse:
            return audit_walk(robot, refined(walk, factor), thorough=thorough)
        found = audit_walk(robot, walk, thorough=thorough)
        if noisy:
            return found
        # Differences of coarse samples are no accelerations: the forces are judged on a finer clock.
        return replace(audit_walk(robot, refined(walk, factor), thorough=thorough), walk=found.walk)

    audit = audit_of(walk)
    if steps > 1:
        notes += (_on_slowness(robot, walk, factor, noisy=noisy, coarse=coarse),)
    lag = audit.lag
    if lag is not None and lag.believed:
        walk = without_prefix(_without_lag(source, topics, lag), robot)
        walk = robot.without_compensation(robot.align(walk)) if taken_off else walk
        audit = replace(audit_of(walk), lag=lag)
        notes += (
            f"{walk.source}: against the state, torques are stamped {lag.effort_s * 1e3:+.2f} ms and wrenches "
            f"{lag.wrench_s * 1e3:+.2f} ms late, and were shifted back (unexplained force {lag.rest_before:.1%} "
            f"before, {lag.rest_after:.1%} after)." + _at_limit(lag, walk),
        )
    if not audit.walk.segments:
        why = audit.doubts[0] if audit.doubts else audit.warnings[-1] if audit.warnings else "no samples"
        raise LogError(f"{walk.source}: nothing usable is left: {why.removeprefix(f'{walk.source}: ')}")
    ready = audit.walk
    if not coarse and factor == FACTOR and (inner := with_inner_steps(robot, walk, ready)) is not None:
        ready = inner
        notes += (
            f"{walk.source}: states between samples and the change of the forces within a period were reconstructed "
            "as for a simulated log, whose steps end with the velocity that they move with.",
        )
    ready = replace(ready, warnings=(*audit.walk.warnings, *notes, *audit.warnings))
    return Prepared(ready, robot, audit)


def _gravity_compensation(robot: Robot, walk: Walk) -> tuple[Robot, bool, tuple[str, ...]]:
    """What a log makes of `gravcomp`: a joint's torque may be that of all its actuators or of its motors alone.

    A real robot knows nothing of what a model file bears for it.

    Returns:
        The robot that the log is of, whether to take the compensation off the torques, and what to say.
    """
    if not robot.lifted_kg({}):
        return robot, False, ()
    aligned = robot.align(walk)
    by_actuators = bool(robot.compensated_links)
    weighty = robot.without_gravcomp()
    rests = {"off": _rest(robot, robot.without_compensation(aligned)) if by_actuators else np.inf}
    rests |= {"as is": _rest(robot, aligned), "weighty": _rest(weighty, aligned)}
    usual = "off" if by_actuators else "as is"
    best = min(rests, key=lambda kind: rests[kind])
    if best == usual or not rests[best] < _CLEARLY * rests[usual]:
        return robot, by_actuators, ()
    if best == "weighty":
        said = "nothing of the robot's weight was borne by `gravcomp`, so the models have none"
        return weighty, False, (f"{walk.source}: {said}.",)
    said = "the logged torques lack what compensates gravity (`actuatorgravcomp`), so nothing is taken off them"
    return robot, False, (f"{walk.source}: {said}.",)


def _rest(robot: Robot, walk: Walk) -> float:
    """Share of the force that stays unexplained; 0 if the log is too short to say."""
    balance = measure_balance(robot, walk, lag_margin(walk))
    return 0.0 if balance is None else check_rest(robot, walk, balance).share


def _steps_with_samples(robot: Robot, walk: Walk) -> bool:
    """Whether steps of a log's own period explain it: a simulation whose time step was set in code, not in the file."""
    aligned = robot.align(walk)
    balance = measure_balance(robot, aligned, lag_margin(walk))
    if balance is None:
        return False
    lag = estimate_lag(robot, aligned, balance)
    rest = check_rest(robot, aligned, balance).share
    return min(rest, rest if lag is None else lag.rest_after) < CLEAN_REST


def _on_slowness(robot: Robot, walk: Walk, factor: int, *, noisy: bool, coarse: bool) -> str:
    """What is done about a log whose samples are further apart than the model's steps."""
    said = (
        f"{walk.source}: {1 / walk.timestep_s:.6g} Hz is slower than the model's step of "
        f"{robot.model.opt.timestep:g} s; "
    )
    if not coarse:
        return f"{said}{factor - 1} states were put between samples by cubic interpolation, torques and wrenches held."
    why = "the log has sensor noise, so" if noisy else "what happened between samples is not known, so"
    return (
        f"{said}{why} nothing was put between its samples: the models take their own steps there, with torques and "
        "wrenches held."
    )


def _without_lag(source: Path | str | Walk, topics: TopicMap, lag: Lag) -> Walk:
    """The walk with torques and wrenches as they were when the state was, not some time later.

    A file is read again: a stream that is faster than the walk is averaged over the periods that it belongs to.
    """
    if isinstance(source, Walk):
        return stamped_earlier(source, lag.effort_s, lag.wrench_s)
    known = {"effort": 0.0, "wrench": 0.0, **topics.lag_s}
    lags = {**known, "effort": known["effort"] + lag.effort_s, "wrench": known["wrench"] + lag.wrench_s}
    return read_walk(source, replace(topics, lag_s=lags))


def _at_limit(lag: Lag, walk: Walk) -> str:
    """Say so if a lag may be longer than what was looked at."""
    limit_s = lag_margin(walk) * walk.timestep_s
    if max(abs(lag.effort_s), abs(lag.wrench_s)) < limit_s - 0.5 * walk.timestep_s:
        return ""
    return f" No more than {limit_s * 1e3:g} ms is looked at: it may be more (`lag_s` in a topic map says how much)."


def prepare_walks(
    sources: Sequence[Path | str | Walk],
    robot: Robot,
    topics: TopicMap | None = None,
    walks: Sequence[Walk] | None = None,
    *,
    thorough: bool = False,
    interpolate: bool = False,
) -> tuple[Prepared, ...]:
    """Prepare several logs of one robot; see `prepare_walk`.

    Args:
        sources: MCAP files or walks.
        robot: with nominal masses.
        topics: which topic plays which role, in all files.
        walks: the files as read with these topics, if they were read already.
        thorough: also compute the one-step residual.
        interpolate: see `prepare_walk`.

    Raises:
        BadInputError: a file is named twice.
        LogError: see `prepare_walk`; also if the logs show different joints of the robot.
        ModelError: a joint cannot be locked where the topic map says.
    """
    resolved = [Path(source).resolve() for source in sources if not isinstance(source, Walk)]
    for path in resolved:
        if resolved.count(path) > 1:
            raise BadInputError(f"{path.name} is named twice: its information would count twice.")
    known = walks if walks is not None else [None] * len(sources)
    prepared = tuple(
        prepare_walk(source, robot, topics, walk=walk, thorough=thorough, interpolate=interpolate)
        for source, walk in zip(sources, known, strict=True)
    )
    first = prepared[0]
    for k, other in enumerate(prepared):
        for earlier in prepared[:k]:
            if all(
                np.array_equal(getattr(other.walk, part), getattr(earlier.walk, part))
                for part in ("stamps_ns", "qpos", "effort")
            ):
                raise BadInputError(
                    f"{earlier.walk.source} and {other.walk.source} are one log: its information would count twice."
                )
    for other in prepared[1:]:
        differing = sorted(set(first.walk.joint_names) ^ set(other.walk.joint_names))
        if differing:
            raise LogError(
                f"{first.walk.source} and {other.walk.source} do not show the same joints ({', '.join(differing)}): "
                "several logs need one set of joints; `ignore` and `locked` in a topic map leave joints out."
            )
    return prepared


def _passive(walk: Walk, topics: TopicMap) -> tuple[str, ...]:
    """Joints that the topic map says have no actuator."""
    patterns = topics.joints.passive if topics.joints is not None else ()
    return tuple(name for name in walk.joint_names if any(fnmatchcase(name, pattern) for pattern in patterns))


def _locked(robot: Robot, walk: Walk, topics: TopicMap) -> dict[str, float]:
    """Joints of the model that the log does not show, and where the topic map says they were held."""
    patterns = topics.joints.locked if topics.joints is not None else {}
    found = {}
    for name in robot.joint_names:
        if name not in walk.joint_names:
            for pattern, position in patterns.items():
                if fnmatchcase(name, pattern):
                    found[name] = position
                    break
    return found
