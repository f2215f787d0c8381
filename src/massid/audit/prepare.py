"""From a file and a robot to a walk that is ready for identification: read, checked, lags taken off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from massid.audit.forces import check_torques
from massid.audit.inner_steps import FACTOR, with_inner_steps
from massid.audit.lag import Lag, lag_margin
from massid.audit.names import check_names, without_prefix
from massid.audit.report import Audit, audit_walk
from massid.errors import BadInputError, LogError
from massid.log import TopicMap, read_walk
from massid.model.robot import Robot
from massid.walk import Walk
from massid.walk.refine import refined
from massid.walk.resampling import stamped_earlier
from massid.walk.white_noise import looks_noisy

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
) -> Prepared:
    """Read a log, check it against the robot and compensate lags between its streams.

    Args:
        source: an MCAP file, or a walk.
        robot: with nominal masses.
        topics: which topic plays which role in the file.
        walk: the file as read with these topics, if it was read already.
        thorough: also compute the one-step residual.

    Raises:
        LogError: the log cannot be read, does not fit the robot, or nothing usable is left of it.
        ModelError: a joint cannot be locked where the topic map says.
    """
    topics = topics or TopicMap()
    if walk is None:
        walk = source if isinstance(source, Walk) else read_walk(source, topics)
    walk = without_prefix(walk, robot)
    check_names(walk, robot)
    robot = robot.locked(_locked(robot, walk, topics))
    steps, noisy = min(robot.steps_in(walk.timestep_s), _MOST_STEPS), looks_noisy(walk)
    factor = 1 if noisy else steps  # interpolated noise looks like motion, and the log like one without noise
    check_torques(robot, walk, _passive(walk, topics))
    audit = audit_walk(robot, refined(walk, factor), thorough=thorough)
    notes: tuple[str, ...] = ()
    if factor > 1:
        notes = (
            f"{walk.source}: {1 / walk.timestep_s:.6g} Hz is slower than the model's step of "
            f"{robot.model.opt.timestep:g} s; {factor - 1} states were put between samples by cubic interpolation, "
            "torques and wrenches held.",
        )
    elif steps > 1:
        notes = (
            f"{walk.source}: {1 / walk.timestep_s:.6g} Hz is slower than the model's step of "
            f"{robot.model.opt.timestep:g} s; the log has sensor noise, so nothing was put between its samples: the "
            "models take their own steps there, with torques and wrenches held.",
        )
    lag = audit.lag
    if lag is not None and lag.believed:
        walk = without_prefix(_without_lag(source, topics, lag), robot)
        audit = replace(audit_walk(robot, refined(walk, factor), thorough=thorough), lag=lag)
        notes += (
            f"{walk.source}: against the state, torques are stamped {lag.effort_s * 1e3:+.2f} ms and wrenches "
            f"{lag.wrench_s * 1e3:+.2f} ms late, and were shifted back (unexplained force {lag.rest_before:.1%} "
            f"before, {lag.rest_after:.1%} after)." + _at_limit(lag, walk),
        )
    if not audit.walk.segments:
        raise LogError(
            f"{walk.source}: nothing usable is left: {audit.warnings[-1] if audit.warnings else 'no samples'}"
        )
    ready = audit.walk
    if factor == FACTOR and (inner := with_inner_steps(robot, walk, ready)) is not None:
        ready = inner
        notes += (
            f"{walk.source}: states between samples and the change of the forces within a period were reconstructed "
            "as for a simulated log, whose steps end with the velocity that they move with.",
        )
    ready = replace(ready, warnings=(*audit.walk.warnings, *notes, *audit.warnings))
    return Prepared(ready, robot, audit)


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
) -> tuple[Prepared, ...]:
    """Prepare several logs of one robot; see `prepare_walk`.

    Args:
        sources: MCAP files or walks.
        robot: with nominal masses.
        topics: which topic plays which role, in all files.
        walks: the files as read with these topics, if they were read already.
        thorough: also compute the one-step residual.

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
        prepare_walk(source, robot, topics, walk=walk, thorough=thorough)
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
