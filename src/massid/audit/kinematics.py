"""Do positions and velocities of a log belong together? Moves over short spans, against the integral of velocity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from massid.typing import FloatArray
from massid.walk import Walk
from massid.walk.conventions import to_body, to_world
from massid.walk.resampling import rotation_between
from massid.walk.white_noise import white_level

SPAN_S = 0.05
MISMATCH = 0.3
"""Share of the move that may stay unexplained; beyond it, something is wrong with a convention."""
_BETTER = 0.3  # another convention is suspected if it leaves less than this share of the mismatch
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
    """

    position: float | None
    attitude: float | None
    joints: dict[str, float]
    suspicions: tuple[str, ...]


def check_kinematics(walk: Walk) -> Kinematics:
    """Compare positions with velocities, and look for the convention that would make them agree."""
    starts, span = _spans(walk)
    if not len(starts):
        return Kinematics(None, None, {}, ())
    position, attitude = _base_mismatch(walk, starts, span)
    suspicions = _base_suspicions(walk, starts, span, position, attitude)
    joints, scales = _joint_mismatch(walk, starts, span)
    suspicions += _joint_suspicions(joints, scales)
    return Kinematics(position, attitude, joints, tuple(suspicions))


def _spans(walk: Walk) -> tuple[FloatArray, int]:
    span = max(2, round(SPAN_S / walk.timestep_s))
    starts = [np.arange(s.start, s.stop - span, max(1, span // 2)) for s in walk.segments if len(s) > span]
    return (np.concatenate(starts) if starts else np.zeros(0, dtype=np.int64)), span


def _integral(moved: FloatArray, velocity: FloatArray, starts: FloatArray, span: int, step_s: float) -> FloatArray:
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


def _share(moved: FloatArray, expected: FloatArray, least: float, noise: float) -> float | None:
    """Mismatch as a share of the move, both without what white noise of the position adds to the difference of two."""
    added = 2.0 * noise**2 * moved.shape[1]
    size = float(np.sqrt(max(0.0, float((moved**2).sum(axis=1).mean()) - added)))
    wanted = float(np.sqrt((expected**2).sum(axis=1).mean()))
    if max(size, wanted) < least:
        return None
    margin = _MARGIN + 3.0 * np.sqrt(4.0 / moved.size)  # spans overlap by half; few of them scatter
    rest = float(((moved - expected) ** 2).sum(axis=1).mean()) - margin * added
    return float(np.sqrt(max(0.0, rest))) / max(size, wanted)


def _base_mismatch(walk: Walk, starts: FloatArray, span: int) -> tuple[float | None, float | None]:
    p, q = walk.qpos[:, :3], walk.qpos[:, 3:7]
    moved = p[starts + span] - p[starts]
    expected = _integral(moved, walk.qvel[:, :3], starts, span, walk.timestep_s)
    position = _share(moved, expected, _LEAST_MOVE["position"], white_level(p))
    turned = rotation_between(q[starts], q[starts + span])
    spun = _integral(turned, walk.qvel[:, 3:6], starts, span, walk.timestep_s)
    noise = white_level(rotation_between(q[:-1], q[1:]), already_differenced=1)
    return position, _share(turned, spun, _LEAST_MOVE["attitude"], noise)


def _base_suspicions(
    walk: Walk, starts: FloatArray, span: int, position: float | None, attitude: float | None
) -> list[str]:
    """Try the other conventions on what does not agree; name the first that does."""
    found = []
    if attitude is not None and attitude > MISMATCH:
        text = f"base attitude and turn rate disagree by {attitude:.0%} of the motion"
        reason = _first_better(walk, starts, span, attitude, 1, _ATTITUDE_TRIALS)
        found.append(f"{text}: {reason}.")
    if position is not None and position > MISMATCH:
        text = f"base position and velocity disagree by {position:.0%} of the motion"
        reason = _first_better(walk, starts, span, position, 0, _POSITION_TRIALS)
        found.append(f"{text}: {reason}.")
    return found


def _first_better(
    walk: Walk, starts: FloatArray, span: int, mismatch: float, which: int, trials: dict[str, str]
) -> str:
    for reason, change in trials.items():
        other = _base_mismatch(_CHANGES[change](walk), starts, span)[which]
        if other is not None and other < _BETTER * mismatch:
            return f"{reason} (then {other:.1%})"
    return "no other convention that was tried explains it; check units, frames and which body the pose is of"


def _reordered(walk: Walk, order: list[int]) -> Walk:
    qpos, qvel = walk.qpos.copy(), walk.qvel.copy()
    in_body = to_body(walk.qpos[:, 3:7], walk.qvel[:, :3])
    qpos[:, 3:7] = walk.qpos[:, 3:7][:, order]
    qvel[:, :3] = to_world(qpos[:, 3:7], in_body)
    return replace(walk, qpos=qpos, qvel=qvel)


def _conjugated(walk: Walk) -> Walk:
    qpos = walk.qpos.copy()
    qpos[:, 4:7] *= -1.0
    return replace(walk, qpos=qpos)


def _turned(walk: Walk, columns: slice, forward: bool) -> Walk:
    qvel = walk.qvel.copy()
    turn = to_world if forward else to_body
    qvel[:, columns] = turn(walk.qpos[:, 3:7], walk.qvel[:, columns])
    return replace(walk, qvel=qvel)


_CHANGES: dict[str, Callable[[Walk], Walk]] = {
    "was wxyz": lambda walk: _reordered(walk, [1, 2, 3, 0]),  # read as xyzw, x stands where w should
    "was xyzw": lambda walk: _reordered(walk, [3, 0, 1, 2]),
    "inverse": _conjugated,
    "linear was world": lambda walk: _turned(walk, slice(0, 3), forward=False),
    "linear was body": lambda walk: _turned(walk, slice(0, 3), forward=True),
    "angular was world": lambda walk: _turned(walk, slice(3, 6), forward=False),
    "angular was body": lambda walk: _turned(walk, slice(3, 6), forward=True),
}
_ATTITUDE_TRIALS = {
    "the attitude looks as if it were stored as wxyz (orientation: order: wxyz)": "was wxyz",
    "the attitude looks as if it were stored as xyzw (orientation: order: xyzw)": "was xyzw",
    "the turn rate looks as if it were given in the world (angular_velocity: frame: world)": "angular was world",
    "the turn rate looks as if it were given in the body (angular_velocity: frame: body)": "angular was body",
    "the attitude looks as if it were that of the world in the body, the inverse": "inverse",
}
_POSITION_TRIALS = {
    "the velocity looks as if it were given in the world (linear_velocity: frame: world)": "linear was world",
    "the velocity looks as if it were given in the body (linear_velocity: frame: body)": "linear was body",
    "the attitude looks as if it were stored as wxyz (orientation: order: wxyz)": "was wxyz",
    "the attitude looks as if it were stored as xyzw (orientation: order: xyzw)": "was xyzw",
}


def _joint_mismatch(walk: Walk, starts: FloatArray, span: int) -> tuple[dict[str, float], dict[str, float]]:
    """Mismatch of each joint that moves, and the factor between its moves and its velocity."""
    positions = walk.qpos[:, 7:]
    moved = positions[starts + span] - positions[starts]
    expected = _integral(moved, walk.qvel[:, 6:], starts, span, walk.timestep_s)
    joints, scales, noise = {}, {}, white_level(positions)
    for column, name in enumerate(walk.joint_names):
        share = _share(moved[:, [column]], expected[:, [column]], _LEAST_MOVE["joint"], noise)
        if share is not None:
            joints[name] = share
            power = float((expected[:, column] ** 2).sum())
            scales[name] = float(moved[:, column] @ expected[:, column]) / power if power else np.inf
    return joints, scales


def _joint_suspicions(joints: dict[str, float], scales: dict[str, float]) -> list[str]:
    wrong = [name for name, share in joints.items() if share > MISMATCH]
    if not wrong:
        return []
    worst = max(wrong, key=lambda name: joints[name])
    scale = scales[worst]
    why = "positions and velocities may be in another order than the joint names, or of another time"
    if abs(scale + 1.0) < 0.2:
        why = "the sign of the velocity or of the position is turned"
    elif 45.0 < abs(scale) < 70.0:
        why = "positions look as if they were in degrees (scale: 0.0174533)"
    elif 1 / 70.0 < abs(scale) < 1 / 45.0:
        why = "velocities look as if they were in degrees per second (scale: 0.0174533)"
    elif abs(scale) < 0.5 or abs(scale) > 2.0:
        why = f"moves are {scale:.3g} times what the velocities give; check the units"
    listed = ", ".join(sorted(wrong, key=lambda name: -joints[name])[:5])
    more = f" and {len(wrong) - 5} more" if len(wrong) > 5 else ""
    return [f"position and velocity of {listed}{more} disagree by up to {joints[worst]:.0%} of the motion: {why}."]
