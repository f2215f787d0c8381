"""Put a robot's constants into a composed world, to the last bit.

A robot on its way into a composed world is written as text, which rounds inertias and attitudes to six digits, and a
world has options of its own. After compiling, every number of the robot and its options are copied from the robot's own
model, true masses included.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.errors import ModelError
from massid.plant.parts import RobotParts
from massid.typing import AnyArray, IntArray

PLANT_SOLVER_ITERATIONS = 100
PLANT_SOLVER_TOLERANCE = 1e-25
"""Accelerations are then exact to 1e-11; it takes as long as 1e-8, while 0 never stops before the last iteration."""

_WHOLE = ("tendon_", "eq_")
_KEPT = ("body_pos", "body_quat")


@dataclass(frozen=True)
class _Rows:
    """Rows of one kind of element in the world and in the robot's own model."""

    prefix: str
    count: int
    world: IntArray
    robot: IntArray


def transplant(robot: mujoco.MjModel, world: mujoco.MjModel) -> None:
    """Copy a robot's numbers and options into a world that it is attached to.

    Args:
        robot: the robot alone, with true masses.
        world: changed in place; its constants that depend on masses are refreshed.

    Raises:
        ModelError: the world's robot has other elements.
    """
    source, target = RobotParts.find(robot), RobotParts.find(world)
    if (source.joint_names, source.body_names) != (target.joint_names, target.body_names):
        raise ModelError("The robot changed on its way into the world: its joints or bodies are others.")
    for rows in _element_rows(robot, world, source, target):
        for name in _float_fields(robot, rows.prefix):
            theirs, ours = getattr(world, name), getattr(robot, name)
            if len(ours) != rows.count or theirs.shape[1:] != ours.shape[1:]:
                continue
            at = slice(1, None) if name in _KEPT else slice(None)  # the first body's frame is the free joint's
            theirs[rows.world[at]] = ours[rows.robot[at]]
    for prefix in _WHOLE:
        for name in _float_fields(robot, prefix):
            if getattr(world, name).shape == getattr(robot, name).shape:
                getattr(world, name)[:] = getattr(robot, name)
    for name in ("qpos0", "qpos_spring"):
        theirs, ours = getattr(world, name), getattr(robot, name)
        theirs[target.joint_qpos] = ours[source.joint_qpos]
        theirs[target.free_qpos : target.free_qpos + 7] = ours[source.free_qpos : source.free_qpos + 7]
    _copy_options(robot, world)
    mujoco.mj_setConst(world, mujoco.MjData(world))


def _copy_options(robot: mujoco.MjModel, world: mujoco.MjModel) -> None:
    for name in dir(robot.opt):
        if name.startswith("_"):
            continue
        value = getattr(robot.opt, name)
        if isinstance(value, np.ndarray):
            getattr(world.opt, name)[:] = value
        else:
            setattr(world.opt, name, value)
    world.opt.iterations, world.opt.tolerance = PLANT_SOLVER_ITERATIONS, PLANT_SOLVER_TOLERANCE
    world.opt.noslip_iterations = 0
    world.opt.disableactuator = 0
    enabled = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
    world.opt.disableflags &= ~int(enabled)
    world.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)


def _element_rows(
    robot: mujoco.MjModel, world: mujoco.MjModel, source: RobotParts, target: RobotParts
) -> tuple[_Rows, ...]:
    def dofs(parts: RobotParts) -> IntArray:
        return np.concatenate([np.arange(parts.free_dof, parts.free_dof + 6), parts.joint_dof])

    def joints(parts: RobotParts) -> IntArray:
        return np.concatenate([[parts.free_joint], parts.joint_ids])

    return (
        _Rows("body_", robot.nbody, target.body_ids, source.body_ids),
        _Rows("jnt_", robot.njnt, joints(target), joints(source)),
        _Rows("dof_", robot.nv, dofs(target), dofs(source)),
        _Rows("geom_", robot.ngeom, _geoms(world, target), _geoms(robot, source)),
    )


def _geoms(model: mujoco.MjModel, parts: RobotParts) -> IntArray:
    geoms = [np.arange(model.body_geomadr[b], model.body_geomadr[b] + model.body_geomnum[b]) for b in parts.body_ids]
    return np.concatenate(geoms).astype(np.int64)


def _float_fields(model: mujoco.MjModel, prefix: str) -> list[str]:
    names = []
    for name in dir(model):
        if name.startswith(prefix):
            values: AnyArray = getattr(model, name)
            if isinstance(values, np.ndarray) and values.ndim and np.issubdtype(values.dtype, np.floating):
                names.append(name)
    return names
