"""Do positions and velocities of a log belong together? Moves over short spans, against the integral of velocity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from massid.audit.base_motion import BaseMotion
from massid.audit.frames import frame_share, rests
from massid.typing import FloatArray, IntArray
from massid.walk import Walk
from massid.walk.conventions import to_body, to_world
from massid.walk.resampling import from_rotation, multiply, rotation_between
from massid.walk.white_noise import white_level

SPAN_S = 0.05
LONG_SPANS_S = (0.5, 1.5)
"""Over longer spans a convention shows through noise and on straight walks."""
MISMATCH = 0.3
"""Share of the move that may stay unexplained; beyond it, something is wrong with a convention."""
_LEAST = 0.005  # mismatch from which on a convention that leaves hardly any of it is named
_BETTER = 0.3  # another convention is suspected if it leaves less than this share of the mismatch
_SURE = 4.0  # and if that is so all along the walk: deviations of the gain's mean over parts of it
_PARTS = 12
_FEWEST_SPANS = 5
_FEWEST_TURNS = 100  # in which a long turn is followed
_SCALED = 0.05  # mismatch of a joint from which on another scale that takes it away is named
_MARGIN = 1.3  # noise levels read off a log are this uncertain
_LEAST_MOVE = {"position": 1e-3, "attitude": 2e-3, "joint": 2e-3}  # m, rad, rad: root mean square over a span


@dataclass(frozen=True)
class Kinematics:
    """How much of the moves the velocities do not explain, as a share of the moves (root mean squares).

    Attributes:
        position: of the base's position; None if it hardly moves.
        attitude: of the base's attitude; None if it hardly turns.
        joints: by joint, of those that move.
        suspicions: what is probably wrong, one line each.
        misread: whether another convention explains what this one does not.
    """

    position: float | None
    attitude: float | None
    joints: dict[str, float]
    suspicions: tuple[str, ...]
    misread: bool = False


def check_kinematics(walk: Walk) -> Kinematics:
    """Compare positions with velocities, and look for the convention that would make them agree."""
    starts, span = _spans(walk, SPAN_S)
    if not len(starts):
        return Kinematics(None, None, {}, ())
    base = BaseMotion.of(walk)
    position = _mismatch(base, starts, span, "position")
    attitude = _mismatch(base, starts, span, "attitude")
    of_base = [
        _suspect_base(walk, base, "attitude", "base attitude and turn rate disagree by", _ATTITUDE_TRIALS),
        _suspect_base(walk, base, "position", "base position and velocity disagree by", _POSITION_TRIALS),
    ]
    joints, scales = _joint_mismatch(walk, starts, span)
    found = [one for one in (*of_base, _suspect_joints(joints, scales)) if one is not None]
    return Kinematics(
        None if position is None else position.share,
        None if attitude is None else attitude.share,
        {name: one.share for name, one in joints.items()},
        tuple(one.text for one in found),
        misread=any(one.explained for one in found),
    )


def _spans(walk: Walk, span_s: float) -> tuple[IntArray, int]:
    span = max(2, round(span_s / walk.timestep_s))
    starts = [np.arange(s.start, s.stop - span, max(1, span // 2)) for s in walk.segments if len(s) > span]
    return (np.concatenate(starts) if starts else np.zeros(0, dtype=np.int64)), span


def _integral(moved: FloatArray, velocity: FloatArray, starts: IntArray, span: int, step_s: float) -> FloatArray:
    """Integral of velocity over each span by the rule that fits the moves best, shape (n, width).

    The trapezoidal rule lies half-way between that of simulators, which move with the velocity at the end of a step,
    and its mirror. They differ by what the velocity changes over the span, which matters when a robot shakes.
    """
    total = np.zeros_like(velocity)
    np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * step_s, axis=0, out=total[1:])
    expected = total[starts + span] - total[starts]
    to_end = 0.5 * step_s * (velocity[starts + span] - velocity[starts])
    power = float((to_end**2).sum())
    rule = np.clip(float((to_end * (moved - expected)).sum()) / power, -1.0, 1.0) if power else 0.0
    return np.asarray(expected + rule * to_end)


@dataclass(frozen=True)
class _Mismatch:
    """What velocities leave of moves: as a share of these, and squared for each span."""

    share: float
    squares: FloatArray


def _left(moved: FloatArray, expected: FloatArray, least: float, noise: float) -> _Mismatch | None:
    """Mismatch as a share of the move, both without what white noise of the position adds to the difference of two."""
    added = 2.0 * noise**2 * moved.shape[1]
    size = float(np.sqrt(max(0.0, float((moved**2).sum(axis=1).mean()) - added)))
    wanted = float(np.sqrt((expected**2).sum(axis=1).mean()))
    if max(size, wanted) < least:
        return None
    margin = _MARGIN + 3.0 * np.sqrt(4.0 / moved.size)  # spans overlap by half; few of them scatter
    squares = ((moved - expected) ** 2).sum(axis=1)
    rest = float(squares.mean()) - margin * added
    return _Mismatch(float(np.sqrt(max(0.0, rest))) / max(size, wanted), squares)


def _mismatch(base: BaseMotion, starts: IntArray, span: int, what: str) -> _Mismatch | None:
    """What the base's velocity leaves of the moves of its position, or its turn rate of those of its attitude."""
    if what == "position":
        p = base.position
        moved = p[starts + span] - p[starts]
        expected = _integral(moved, base.linear, starts, span, base.step_s)
        return _left(moved, expected, _LEAST_MOVE[what], white_level(p))
    q = base.attitude
    turned = rotation_between(q[starts], q[starts + span])
    if span * base.step_s > 2.0 * SPAN_S:  # such turns do not add up as vectors
        spun = rotation_between(q[starts], _turned_on(q[starts], base.angular, starts, span, base.step_s))
    else:
        spun = _integral(turned, base.angular, starts, span, base.step_s)
    noise = white_level(rotation_between(q[:-1], q[1:]), already_differenced=1)
    return _left(turned, spun, _LEAST_MOVE[what], noise)


def _turned_on(attitude: FloatArray, rate: FloatArray, starts: IntArray, span: int, step_s: float) -> FloatArray:
    """Attitudes at the end of each span, from turning on with the measured rates, shape (n, 4)."""
    per_step = max(1, span // _FEWEST_TURNS)
    edges = np.linspace(0, span, max(1, span // per_step) + 1).round().astype(np.int64)
    total = np.zeros_like(rate)
    np.cumsum(0.5 * (rate[1:] + rate[:-1]) * step_s, axis=0, out=total[1:])
    for a, b in pairwise(edges.tolist()):
        attitude = multiply(attitude, from_rotation(total[starts + b] - total[starts + a]))
    return attitude


@dataclass(frozen=True)
class _Suspicion:
    """What is probably wrong, and whether another convention explains it."""

    text: str
    explained: bool


def _suspect_base(walk: Walk, base: BaseMotion, what: str, text: str, trials: dict[str, str]) -> _Suspicion | None:
    """Try the other conventions; name the one that explains most, or say so if none does and too much is left."""
    others = {reason: _CHANGES[change](base) for reason, change in trials.items()}
    for span_s in (SPAN_S, *LONG_SPANS_S):
        starts, span = _spans(walk, span_s)
        if len(starts) < _FEWEST_SPANS:
            continue
        given = _mismatch(base, starts, span, what)
        if given is None or given.share < _LEAST:
            continue
        left = {reason: _mismatch(other, starts, span, what) for reason, other in others.items()}
        better = {
            reason: one
            for reason, one in left.items()
            if one is not None and one.share < _BETTER * given.share and _gains_all_along(given, one)
        }
        if better:
            best = min(better, key=lambda reason: float(better[reason].squares.mean()))
            said = f"{text} {given.share:.1%} of the motion: {best} (then {better[best].share:.1%})."
            return _Suspicion(said, explained=True)
    frames = [reason for reason in trials if reason in _FRAMES]
    rest = rests(base, what) if frames else ()
    for reason in frames:
        if (share := frame_share(rest, rests(others[reason], what))) is not None:
            return _Suspicion(
                f"{text} little, but all along the walk: {reason}, which explains {share:.0%} of it.", explained=True
            )
    starts, span = _spans(walk, SPAN_S)
    given = _mismatch(base, starts, span, what)
    if given is None or given.share <= MISMATCH:
        return None
    return _Suspicion(
        f"{text} {given.share:.0%} of the motion: no other convention that was tried explains it; check units, frames "
        "and which body the pose is of.",
        explained=False,
    )


def _gains_all_along(given: _Mismatch, other: _Mismatch) -> bool:
    """Whether the other convention leaves less in all parts of the walk, not only in one by chance."""
    parts = np.array_split(given.squares - other.squares, min(_PARTS, len(given.squares)))
    gains = np.array([part.mean() for part in parts])
    deviation = float(gains.std(ddof=1)) / np.sqrt(len(gains))
    return bool(gains.mean() > min(_SURE * deviation, 0.5 * given.squares.mean()))


_DEGREE = np.pi / 180.0
_CHANGES: dict[str, Callable[[BaseMotion], BaseMotion]] = {
    "was wxyz": lambda base: base.reordered([1, 2, 3, 0]),  # read as xyzw, x stands where w should
    "was xyzw": lambda base: base.reordered([3, 0, 1, 2]),
    "inverse": lambda base: replace(base, attitude=base.attitude * (1.0, -1.0, -1.0, -1.0)),
    "linear was world": lambda base: replace(base, linear=to_body(base.attitude, base.linear)),
    "linear was body": lambda base: replace(base, linear=to_world(base.attitude, base.linear)),
    "angular was world": lambda base: replace(base, angular=to_body(base.attitude, base.angular)),
    "angular was body": lambda base: replace(base, angular=to_world(base.attitude, base.angular)),
    "angular was degrees": lambda base: replace(base, angular=_DEGREE * base.angular),
    "position was mm": lambda base: replace(base, position=1e-3 * base.position),
    "linear was mm": lambda base: replace(base, linear=1e-3 * base.linear),
}
_ATTITUDE_TRIALS = {
    "the attitude looks as if it were stored as wxyz (orientation: order: wxyz)": "was wxyz",
    "the attitude looks as if it were stored as xyzw (orientation: order: xyzw)": "was xyzw",
    "the turn rate looks as if it were given in the world (angular_velocity: frame: world)": "angular was world",
    "the turn rate looks as if it were given in the body (angular_velocity: frame: body)": "angular was body",
    "the attitude looks as if it were that of the world in the body, the inverse": "inverse",
    "the turn rate looks as if it were in degrees per second (angular_velocity: scale: 0.0174533)": (
        "angular was degrees"
    ),
}
_POSITION_TRIALS = {
    "the velocity looks as if it were given in the world (linear_velocity: frame: world; the turn rate, too?)": (
        "linear was world"
    ),
    "the velocity looks as if it were given in the body (linear_velocity: frame: body)": "linear was body",
    "the attitude looks as if it were stored as wxyz (orientation: order: wxyz)": "was wxyz",
    "the attitude looks as if it were stored as xyzw (orientation: order: xyzw)": "was xyzw",
    "the position looks as if it were in millimetres (position: scale: 0.001)": "position was mm",
    "the velocity looks as if it were in millimetres per second (linear_velocity: scale: 0.001)": "linear was mm",
}
_FRAMES = {
    reason
    for reason, change in (*_ATTITUDE_TRIALS.items(), *_POSITION_TRIALS.items())
    if change.startswith(("linear was world", "linear was body", "angular was world", "angular was body"))
}


def _joint_mismatch(
    walk: Walk, starts: IntArray, span: int
) -> tuple[dict[str, _Mismatch], dict[str, tuple[float, float]]]:
    """Mismatch of each joint that moves; the factor between its moves and its velocity, and the share left with it."""
    positions = walk.qpos[:, 7:]
    moved = positions[starts + span] - positions[starts]
    expected = _integral(moved, walk.qvel[:, 6:], starts, span, walk.timestep_s)
    joints: dict[str, _Mismatch] = {}
    scales: dict[str, tuple[float, float]] = {}
    noise = white_level(positions)
    for column, name in enumerate(walk.joint_names):
        here, given = moved[:, [column]], expected[:, [column]]
        mismatch = _left(here, given, _LEAST_MOVE["joint"], noise)
        if mismatch is not None:
            joints[name] = mismatch
            power = float((given**2).sum())
            scale = float((here * given).sum()) / power if power else np.inf
            scaled = _left(here, scale * given, 0.0, noise) if power else None
            scales[name] = (scale, mismatch.share if scaled is None else scaled.share)
    return joints, scales


def _suspect_joints(joints: dict[str, _Mismatch], scales: dict[str, tuple[float, float]]) -> _Suspicion | None:
    wrong = {
        name: one.share
        for name, one in joints.items()
        if one.share > MISMATCH or (one.share > _SCALED and scales[name][1] < _BETTER * one.share)
    }
    if not wrong:
        return None
    worst = max(wrong, key=lambda name: wrong[name])
    scale, left = scales[worst]
    explained = left < _BETTER * wrong[worst]
    named = True
    why = "positions and velocities may be in another order than the joint names, or of another time"
    if abs(scale + 1.0) < 0.2:
        why = "the sign of the velocity or of the position is turned (velocity: scale: -1)"
    elif 45.0 < abs(scale) < 70.0:
        why = "positions look as if they were in degrees (position: scale: 0.0174533)"
    elif 1 / 70.0 < abs(scale) < 1 / 45.0:
        why = "velocities look as if they were in degrees per second (velocity: scale: 0.0174533)"
    else:
        named = False
        if abs(scale) < 0.5 or abs(scale) > 2.0 or explained:
            why = f"moves are {scale:.3g} times what the velocities give; check the units"
    listed = ", ".join(sorted(wrong, key=lambda name: -wrong[name])[:5])
    more = f" and {len(wrong) - 5} more" if len(wrong) > 5 else ""
    said = f"position and velocity of {listed}{more} disagree by up to {wrong[worst]:.0%} of the motion: {why}."
    return _Suspicion(said, explained=explained and named)
