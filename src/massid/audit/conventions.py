"""Conventions of torques and wrenches that would explain a log better than those it was read with."""

from __future__ import annotations

from collections.abc import Iterator
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
_NEAR = 0.08  # of a unit: gains of sensors are off by some percents
_OFF = 2.0  # a factor beyond this is no gain of a sensor
_RIDGE = 1e-9
_SHOWN = 4
_MOST_BODIES = 6
_CONVINCING, _LESS, _MUCH_LESS = 0.3, 0.5, 0.1
_TAKES = 0.01
_COUNTS = 1e-4  # share of the largest torque below which a joint's factor says nothing


@dataclass(frozen=True)
class Convention:
    """Another way to read a log.

    Attributes:
        reason: what is suspected, and the setting that cures it.
        rest: what it leaves of the smoothed force that no link masses explain, shape (m,).
        fitted: whether factors were fitted, which always leaves less.
    """

    reason: str
    rest: FloatArray
    fitted: bool = False


def best_convention(robot: Robot, walk: Walk, balance: Balance) -> Convention:
    """The convention that leaves least, of those that are got wrong most often."""
    given = balance.unexplained(balance.smooth(balance.required - balance.effort(walk, robot) - balance.wrench(walk)))
    simple = min(_conventions(robot, walk, balance), key=lambda one: float(np.linalg.norm(one.rest)))
    by_joint = _by_joint(robot, walk, balance)
    if by_joint is None:
        return simple
    # One factor for each joint always leaves less: it must be worth it.
    explains = np.linalg.norm(simple.rest) < _CONVINCING * np.linalg.norm(given)
    worth = _MUCH_LESS if explains else _LESS
    return by_joint if np.linalg.norm(by_joint.rest) < worth * np.linalg.norm(simple.rest) else simple


def _conventions(robot: Robot, walk: Walk, balance: Balance) -> Iterator[Convention]:
    def left(terms: FloatArray) -> FloatArray:
        return balance.unexplained(terms)

    required = left(balance.smooth(balance.required))
    effort = left(balance.smooth(balance.effort(walk, robot)))
    wrenches = walk.wrench[balance.rows]

    def of(changed: FloatArray) -> FloatArray:
        return left(balance.smooth(balance.force_of(changed)))

    wrench = of(wrenches)
    yield Convention("the forces look as if they were those on the ground (contacts: on: ground)",
                     required - effort + wrench)  # fmt: skip
    yield Convention("the torques look as if their sign were turned (effort: scale: -1)", required + effort - wrench)
    parts = wrenches.reshape(len(balance.rows), balance.rotation.shape[1], 2, 3)
    world = np.einsum("kcji,kcpj->kcpi", balance.rotation, parts).reshape(wrenches.shape)
    yield Convention("the wrenches look as if they were given in the world (contacts: frame: world)",
                     required - effort - of(world))  # fmt: skip
    bodies = walk.contact_bodies[:_MOST_BODIES]
    for one, other in combinations(range(len(bodies)), 2):
        swapped = wrenches.copy()
        swapped[:, [one, other]] = wrenches[:, [other, one]]
        yield Convention(f"the wrenches of {bodies[one]} and {bodies[other]} look swapped (contacts: body)",
                         required - effort - of(swapped))  # fmt: skip
    if len(bodies) > 1:
        for column, body in enumerate(bodies):
            turned = wrenches.copy()
            turned[:, column] *= -1.0
            yield Convention(f"the wrench of {body} looks as if it were that on the ground (contacts: on: ground)",
                             required - effort - of(turned))  # fmt: skip
    moments = wrenches.copy()
    moments[:, :, :3] = 0.0
    moment = of(moments)
    factor = _rounded(_factor(required - effort - (wrench - moment), moment))
    if _is_another(factor):
        yield Convention(f"the moments of the wrenches look {_unit(factor)}",
                         required - effort - (wrench - moment) - factor * moment,
            fitted=True)  # fmt: skip
    turned = wrenches.copy()
    turned[:, :, 3:] *= -1.0
    yield Convention("the moments of the wrenches look as if their sign were turned", required - effort - of(turned))
    factor = _rounded(_factor(required - wrench, effort))
    if _is_another(factor):
        yield Convention(f"the torques look {_unit(factor)} (effort: scale: {factor:.3g})",
                         required - wrench - factor * effort,
            fitted=True)  # fmt: skip


def _by_joint(robot: Robot, walk: Walk, balance: Balance) -> Convention | None:
    """Torques of single joints, or of all of them, that are another multiple of what acted: before gears, turned."""
    target = balance.unexplained(balance.smooth(balance.required - balance.wrench(walk)))
    torque = walk.effort[balance.rows]
    columns = []
    for joint, dof in enumerate(robot.layout.joint_dof):
        force = np.zeros_like(balance.required)
        force[:, dof] = torque[:, joint]
        columns.append(balance.unexplained(balance.smooth(force)))
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
    turned = [name for name, factor in found.items() if -1.5 < factor < -0.6]
    geared = {name: factor for name, factor in found.items() if factor > _OFF}
    if turned:
        more = f" and {len(turned) - _SHOWN} more" if len(turned) > _SHOWN else ""
        return Convention(
            f"the torques of {', '.join(turned[:_SHOWN])}{more} look as if their sign were turned (joints: gears: "
            f"{{{turned[0]}: -1}})",
            rest,
            fitted=True,
        )
    if geared:
        listed = ", ".join(f"{name}: {factor:.3g}" for name, factor in list(geared.items())[:_SHOWN])
        more = f" and {len(geared) - _SHOWN} more" if len(geared) > _SHOWN else ""
        return Convention(
            f"torques look as if they were those of motors before gears (joints: gears: {{{listed}}}{more})",
            rest,
            fitted=True,
        )
    return None


def _factor(target: FloatArray, column: FloatArray) -> float:
    power = float(column @ column)
    return float(column @ target) / power if power else 1.0


def _rounded(factor: float) -> float:
    """The factor of a unit, if it is close to one."""
    return next((unit for unit in _TORQUE_UNITS if abs(factor / unit - 1.0) < _NEAR), factor)


def _is_another(factor: float) -> bool:
    return factor > 0.0 and not 1.0 / _OFF < factor < _OFF


def _unit(factor: float) -> str:
    if factor in _TORQUE_UNITS:
        return f"as if they were {_TORQUE_UNITS[factor]}"
    return f"{1.0 / factor:.3g} times too large" if factor < 1.0 else f"{factor:.3g} times too small"
