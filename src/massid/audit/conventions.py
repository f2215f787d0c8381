"""Conventions of torques and wrenches that would explain a log better than those it was read with."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from massid.audit.balance import Balance
from massid.model.robot import Robot
from massid.typing import FloatArray
from massid.walk import Walk

_TORQUE_UNITS = {
    1e-3: "in mN m",
    1e-2: "in N cm",
    9.80665: "in kgf m",
    0.0980665: "in kgf cm",
    0.112985: "in lbf in",
    1.35582: "in lbf ft",
}
_FORCE_UNITS = {9.80665: "in kgf and kgf m", 4.44822: "in lbf", 1e3: "in kN", 1e-3: "in mN"}
_OFF = 2.0  # a factor beyond this is no gain of a sensor
_RIDGE = 1e-9
_UPSIDE_DOWN = {"x": (1.0, -1.0, -1.0), "y": (-1.0, 1.0, -1.0), "z": (-1.0, -1.0, 1.0)}
_HALF_TURN = {"x": "[0, 1, 0, 0]", "y": "[0, 0, 1, 0]", "z": "[0, 0, 0, 1]"}
_CHANGED = 0.01
"""Share by which a factor must be off 1 in a log without noise."""
_SURE = 4.0
"""Deviations of the gains of sensors by which it must be, beside noise."""
_EXACTLY = 0.02
"""Share of the unexplained force that factors of single joints, which are many, may leave."""
_CARRIED = 0.3
"""Share of the weight that another reading of the wrenches must carry."""
_SHOWN = 4
_MOST_BODIES = 6
_CONVINCING, _LESS, _MUCH_LESS = 0.3, 0.5, 0.1
_LEAST = 0.1
"""Factors of single joints below this look for masses of nothing, which no force explains best."""
_TAKES = 0.01
_COUNTS = 1e-4  # share of the largest torque below which a joint's factor says nothing


@dataclass(frozen=True)
class Convention:
    """Another way to read torques and wrenches; K is the number of steps.

    Attributes:
        reason: what is suspected, and the setting that cures it.
        effort: torques of the steps, read so, shape (K, n_j).
        wrench: wrenches of the steps, read so, shape (K, n_c, 6).
        rest: what it leaves of the smoothed force that no link masses explain, shape (m,).
        fitted: whether factors were fitted, which always leaves less.
        of_gains: whether these are any numbers, joint by joint, which other faults look like, too.
    """

    reason: str
    effort: FloatArray
    wrench: FloatArray
    rest: FloatArray
    fitted: bool = False
    of_gains: bool = False


def likely_conventions(
    robot: Robot, walk: Walk, balance: Balance, *, carried: bool = True, gain: float = 0.0
) -> tuple[Convention, ...]:
    """The convention that leaves least, of those that are got wrong most often, and factors of single joints.

    These always leave less: they come first only where they are worth it.

    Args:
        robot: with nominal masses.
        walk: aligned with the robot.
        balance: of this walk.
        carried: whether the wrenches as they are read carry about the weight of the robot.
        gain: standard deviation of the sensors' gains, as their noise goes; 0 for a log without noise.
    """
    required = balance.unexplained(balance.smooth(balance.required))

    def rest(effort: FloatArray, wrench: FloatArray) -> FloatArray:
        supplied = balance.force_of_torques(effort, robot) + balance.force_of(wrench)
        return np.asarray(required - balance.unexplained(balance.smooth(supplied)))

    effort, wrench = walk.effort[balance.rows], walk.wrench[balance.rows]
    given = rest(effort, wrench)
    others = [
        Convention(why, torques, forces, rest(torques, forces))
        for why, torques, forces in _readings(robot, walk, balance)
        if np.array_equal(forces, wrench) or _carries(robot, balance, forces)
    ]
    least = max(_CHANGED, _SURE * gain)
    others += _scaled(robot, walk, balance, given, carried=carried, least=least)
    simple = min(others, key=lambda one: float(np.linalg.norm(one.rest)))
    by_joint = _by_joint(robot, walk, balance)
    if by_joint is None:
        return (simple,)
    explains = np.linalg.norm(simple.rest) < _CONVINCING * np.linalg.norm(given)
    worth = _MUCH_LESS if explains else _LESS
    is_worth_it = np.linalg.norm(by_joint.rest) < worth * np.linalg.norm(simple.rest)
    return (by_joint, simple) if is_worth_it else (simple, by_joint)


def _carries(robot: Robot, balance: Balance, wrench: FloatArray) -> bool:
    """Whether forces carry the robot, not push it down: masses that are free to be anything do not tell."""
    up = -robot.model.opt.gravity
    weight = robot.total_mass_kg * float(np.linalg.norm(up))
    if weight == 0.0:
        return True
    force = np.einsum("kcij,kcj->i", balance.rotation, wrench[:, :, :3]) / len(wrench)
    return bool(force @ up > _CARRIED * weight * np.linalg.norm(up))


def _readings(robot: Robot, walk: Walk, balance: Balance) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """What is suspected, and torques and wrenches as they would be then."""
    effort, wrench = walk.effort[balance.rows], walk.wrench[balance.rows]
    yield "the forces look as if they were those on the ground (contacts: on: ground)", effort, -wrench
    yield "the torques look as if their sign were turned (effort: scale: -1)", -effort, wrench
    for said, order in swapped_sides(robot, walk.contact_bodies):
        yield f"the torques of left and right {said} look swapped (joints: names, or rename)", effort[:, order], wrench
    parts = wrench.reshape(len(balance.rows), balance.rotation.shape[1], 2, 3)
    in_body = np.einsum("kcji,kcpj->kcpi", balance.rotation, parts).reshape(wrench.shape)
    yield "the wrenches look as if they were given in the world (contacts: frame: world)", effort, in_body
    for axis, signs in _UPSIDE_DOWN.items():
        said = f"the axes of the force sensors look as if they were turned by 180 degrees about {axis}"
        setting = f"rotation: {_HALF_TURN[axis]}"
        upright = (parts * np.array(signs)).reshape(wrench.shape)
        yield f"{said} (contacts: {setting})", effort, upright
        yield (
            f"{said}, and the forces as if they were those on the ground (contacts: on: ground, {setting})",
            effort,
            -upright,
        )
    bodies = walk.contact_bodies[:_MOST_BODIES]
    for one, other in combinations(range(len(bodies)), 2):
        swapped = wrench.copy()
        swapped[:, [one, other]] = wrench[:, [other, one]]
        yield f"the wrenches of {bodies[one]} and {bodies[other]} look swapped (contacts: body)", effort, swapped
    if len(bodies) > 1:
        for column, body in enumerate(bodies):
            turned = wrench.copy()
            turned[:, column] *= -1.0
            yield f"the wrench of {body} looks as if it were that on the ground (contacts: on: ground)", effort, turned
    turned = wrench.copy()
    turned[:, :, 3:] *= -1.0
    yield "the moments of the wrenches look as if their sign were turned (contacts: torque: scale: -1)", effort, turned


def _scaled(
    robot: Robot, walk: Walk, balance: Balance, given: FloatArray, *, carried: bool, least: float
) -> Iterator[Convention]:
    """Torques, wrenches, moments or the wrench of one body that are a multiple of what acted."""
    effort, wrench = walk.effort[balance.rows], walk.wrench[balance.rows]
    still, no_wrench = np.zeros_like(effort), np.zeros_like(wrench)
    moments = wrench.copy()
    moments[:, :, :3] = 0.0
    both = "contacts: force, torque"
    parts = [
        ("the torques look", "effort", _TORQUE_UNITS, effort, no_wrench)
        if carried
        else ("the wrenches look", both, _FORCE_UNITS, still, wrench),
        ("the moments of the wrenches look", "contacts: torque", _TORQUE_UNITS, still, moments),
    ]
    bodies = walk.contact_bodies[:_MOST_BODIES]
    for k, body in enumerate(bodies if len(bodies) > 1 else ()):
        alone = no_wrench.copy()
        alone[:, k] = wrench[:, k]
        parts.append((f"the wrench of {body} looks", both, _FORCE_UNITS, still, alone))
    for part, setting, units, torques, wrenches in parts:
        force = balance.force_of_torques(torques, robot) + balance.force_of(wrenches)
        column = balance.unexplained(balance.smooth(force))
        factor = _factor(given + column, column)
        if factor <= 0.0 or abs(factor - 1.0) <= least:
            continue
        looks, scale = _as_unit(factor, units, least)
        said = f"{part} {looks} ({setting}: scale: {scale:.3g})"
        if setting == "effort" and 1.0 / _OFF < factor < _OFF:  # which of the two are right no balance shows
            said += f", or the wrenches {_times(1.0 / factor)} ({both}: scale: {1.0 / factor:.3g})"
        yield Convention(
            said,
            effort + (factor - 1.0) * torques,
            wrench + (factor - 1.0) * wrenches,
            given + (1.0 - factor) * column,
            fitted=True,
        )


def swapped_sides(robot: Robot, contact_bodies: Sequence[str]) -> list[tuple[str, list[int]]]:
    """Orders in which joints of left and right, as named (l_knee, r_knee), change places: all of them, or the legs'."""
    names = robot.joint_names
    places = {name: k for k, name in enumerate(names)}
    partners = [next((places[one] for one in _other_side(name) if one in places), k) for k, name in enumerate(names)]
    if any(partners[partners[k]] != k for k in range(len(names))):
        return []
    legs = {places[name] for name in _above(robot, contact_bodies) if name in places}
    only_legs = [partner if k in legs and partner in legs else k for k, partner in enumerate(partners)]
    found = [("joints", partners)] + ([("legs", only_legs)] if only_legs != partners else [])
    return [one for one in found if one[1] != list(range(len(names)))]


def _above(robot: Robot, bodies: Sequence[str]) -> set[str]:
    """Names of the joints between some bodies and the base."""
    model = robot.model
    found: set[str] = set()
    for name in bodies:
        body = model.body(name).id
        while body:
            first = int(model.body_jntadr[body])
            found |= {str(model.joint(first + k).name) for k in range(int(model.body_jntnum[body]))}
            body = int(model.body_parentid[body])
    return found


_SIDES = {"left": "right", "Left": "Right", "LEFT": "RIGHT", "l": "r", "L": "R"}
_OTHER = _SIDES | {other: one for one, other in _SIDES.items()}
_SIDE = re.compile(r"left|right|Left|Right|LEFT|RIGHT|(?<![A-Za-z])[lrLR](?![a-z])|(?<=[a-z0-9_])[LR](?![A-Za-z])")


def _other_side(name: str) -> Iterator[str]:
    """Names with one mark of a side turned into that of the other."""
    for mark in _SIDE.finditer(name):
        yield name[: mark.start()] + _OTHER[mark[0]] + name[mark.end() :]


def _by_joint(robot: Robot, walk: Walk, balance: Balance) -> Convention | None:
    """Torques of single joints, or of all of them, that are another multiple of what acted: before gears, turned."""
    target = balance.unexplained(balance.smooth(balance.required - balance.wrench(walk)))
    torque = walk.effort[balance.rows]
    columns = []
    for joint in range(len(robot.joint_names)):
        alone = np.zeros_like(torque)
        alone[:, joint] = torque[:, joint]
        columns.append(balance.unexplained(balance.smooth(balance.force_of_torques(alone, robot))))
    matrix = np.stack(columns, axis=1)
    size = np.linalg.norm(matrix, axis=0)
    counts = size > _COUNTS * size.max(initial=0.0)
    if not counts.any():
        return None
    matrix = matrix[:, counts]
    scale = np.linalg.norm(matrix, axis=0)
    normal = (matrix / scale).T @ (matrix / scale) + _RIDGE * np.eye(len(scale))
    factors = np.linalg.solve(normal, (matrix / scale).T @ target) / scale
    names = [name for name, used in zip(robot.joint_names, counts, strict=True) if used]
    # What a joint's factor takes away, of what all of them do: a little of it is noise of the torques.
    gain = (factors - 1.0) ** 2 * scale**2
    found = {
        name: float(factor) for name, factor, one in zip(names, factors, gain, strict=True) if one > _TAKES * gain.sum()
    }
    rest = target - matrix @ factors
    read = torque.copy()
    read[:, [robot.joint_names.index(name) for name in found]] *= list(found.values())
    wrench = walk.wrench[balance.rows]
    turned = [name for name, factor in found.items() if -1.5 < factor < -0.6]
    geared = {name: factor for name, factor in found.items() if factor > _OFF}
    if turned:
        more = f" and {len(turned) - _SHOWN} more" if len(turned) > _SHOWN else ""
        return Convention(
            f"the torques of {', '.join(turned[:_SHOWN])}{more} look as if their sign were turned (joints: gears: "
            f"{{{turned[0]}: -1}})",
            read,
            wrench,
            rest,
            fitted=True,
        )
    if geared:
        listed = ", ".join(f"{name}: {factor:.3g}" for name, factor in list(geared.items())[:_SHOWN])
        more = f" and {len(geared) - _SHOWN} more" if len(geared) > _SHOWN else ""
        return Convention(
            f"torques look as if they were those of motors before gears (joints: gears: {{{listed}}}{more})",
            read,
            wrench,
            rest,
            fitted=True,
        )
    off = {name: factor for name, factor in found.items() if abs(factor - 1.0) > _CHANGED}
    given = target - balance.unexplained(balance.smooth(balance.force_of_torques(torque, robot)))
    if off and min(off.values()) > _LEAST and np.linalg.norm(rest) < _EXACTLY * np.linalg.norm(given):
        listed = ", ".join(f"{name}: {factor:.3g}" for name, factor in list(off.items())[:_SHOWN])
        more = f" and {len(off) - _SHOWN} more" if len(off) > _SHOWN else ""
        return Convention(
            f"torques of single joints look too large or too small (joints: gears: {{{listed}}}{more})",
            read,
            wrench,
            rest,
            fitted=True,
            of_gains=True,
        )
    return None


def _factor(target: FloatArray, column: FloatArray) -> float:
    power = float(column @ column)
    return float(column @ target) / power if power else 1.0


def _times(factor: float) -> str:
    return f"{1.0 / factor:.3g} times too large" if factor < 1.0 else f"{factor:.3g} times too small"


def _as_unit(factor: float, units: Mapping[float, str], near: float) -> tuple[str, float]:
    """What a factor looks like, and the number to set: that of a unit, if gains of sensors are all that is between."""
    unit = next((unit for unit in units if abs(factor / unit - 1.0) < near), None)
    return (_times(factor), factor) if unit is None else (f"as if they were {units[unit]}", unit)
