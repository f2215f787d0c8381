"""Marching in an instrumented harness: a sprung support at the base whose wrench is measured like that of a foot.

For robots that cannot balance by themselves, or whose motors are too weak to walk. The gantry lowers the robot until
the feet carry a good part of its weight; then the legs are lifted in turn by position control, with the robot's own
motors. The harness holds the base by springs and dampers in all six directions, as elastic straps would.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import least_squares

from lab.plant import Control
from massid.model.robot import Robot
from massid.typing import FloatArray, IntArray

LIFT_M = 0.08
PERIOD_S = 1.1
LOWERED_S, MARCH_S = 1.5, 2.0
"""When the gantry stops and when the march begins."""
GANTRY_S, GANTRY_M_S = 0.2, 0.1
"""Time constant of its load cell, and its speed."""
G = 9.81


@dataclass(frozen=True)
class March:
    """Joint targets of a march.

    Attributes:
        stand: both feet down, legs slightly bent, shape (n_j,).
        lifted: the same with one foot up, by foot.
    """

    stand: FloatArray
    lifted: tuple[FloatArray, ...]


class Harness:
    """Springs and dampers between the base and a gantry; a `Support`.

    Args:
        robot: whose base is held.
        share: of the weight that the feet shall carry.
    """

    def __init__(self, robot: Robot, share: float = 0.6) -> None:
        self._body = robot.model.body(robot.root_body).id
        self._dof = robot.layout.root_dof
        self._share = share
        self._weight = robot.total_mass_kg * G
        self._stiffness = np.array([60.0, 60.0, 100.0]) * robot.total_mass_kg
        self._damping = np.sqrt(self._stiffness * robot.total_mass_kg)
        self._turn_stiffness = 15.0 * robot.total_mass_kg
        self._turn_damping = 0.1 * self._turn_stiffness
        self._anchor: FloatArray | None = None
        self._load = 0.0

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData, load: float) -> FloatArray:
        """Pull at the base over the next step; see `Support`. The gantry goes down until the feet have their share."""
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        position, rotation = data.xpos[self._body], data.xmat[self._body].reshape(3, 3)
        if self._anchor is None:
            self._anchor, self._upright = position.copy(), data.xquat[self._body].copy()
        self._load += (load - self._load) * model.opt.timestep / GANTRY_S
        if data.time < LOWERED_S:
            missing = self._share - self._load / self._weight
            self._anchor[2] -= np.clip(missing, -1.0, 1.0) * GANTRY_M_S * model.opt.timestep
        velocity, turn = data.qvel[self._dof : self._dof + 3], data.qvel[self._dof + 3 : self._dof + 6]
        force = self._stiffness * (self._anchor - position) - self._damping * velocity
        tilt = np.zeros(3)
        mujoco.mju_subQuat(tilt, self._upright, data.xquat[self._body])  # in the base's frame
        moment = self._turn_stiffness * tilt - self._turn_damping * turn
        data.xfrc_applied[self._body, :3] = force  # at the centre of mass
        arm = data.xipos[self._body] - position
        data.xfrc_applied[self._body, 3:] = rotation @ moment - np.cross(arm, force)
        return np.concatenate([rotation.T @ force, moment])


def hang(robot: Robot, march: March, feet: Sequence[str]) -> FloatArray:
    """Initial state of the simulation: legs ready, feet just above the floor, shape (nq,)."""
    model, layout = robot.model, robot.layout
    data = mujoco.MjData(model)
    data.qpos[layout.joint_qpos] = march.stand
    mujoco.mj_forward(model, data)
    ours = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] in {model.body(foot).id for foot in feet}]
    lowest = min(data.geom_xpos[geom, 2] - model.geom_rbound[geom] for geom in ours)
    data.qpos[layout.root_qpos + 2] -= lowest
    return np.array(data.qpos)


def plan_march(robot: Robot, feet: Sequence[str], stance_width_m: float = 0.28, bend: float = 0.95) -> March:
    """Find leg postures by inverse kinematics: feet under the hips, soles level, and each foot lifted once."""
    model = robot.model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start = data.qpos[robot.layout.joint_qpos].copy()
    low, high = model.jnt_range[[model.joint(name).id for name in robot.joint_names]].T
    start = np.clip(start, low + 0.01, high - 0.01)
    hips = [data.xpos[_leg_bodies(robot, foot)[0]].copy() for foot in feet]
    sideways = hips[0] - hips[1]
    sideways = np.array([sideways[0], sideways[1], 0.0]) / np.linalg.norm(sideways[:2])
    middle = 0.5 * (hips[0] + hips[1])
    level = [data.xmat[model.body(foot).id].reshape(3, 3).copy() for foot in feet]
    reach = min(_leg_length(robot, data, foot) for foot in feet)
    stand, places = start.copy(), []
    for sign, foot, turned in zip((1.0, -1.0), feet, level, strict=True):
        place = middle + sign * 0.5 * stance_width_m * sideways - np.array([0.0, 0.0, bend * reach])
        places.append(place)
        stand = _reach_for(robot, data, stand, foot, place, turned)
    lifted = tuple(
        _reach_for(robot, data, stand, foot, place + np.array([0.0, 0.0, LIFT_M]), turned)
        for foot, place, turned in zip(feet, places, level, strict=True)
    )
    return March(stand, lifted)


def marching_control(robot: Robot, march: March, seed: int) -> Control:
    """Lift the feet in turn and swing everything else, within what the robot's own motors can do."""
    model, layout, rng = robot.model, robot.layout, np.random.default_rng(seed)
    gear = np.zeros(len(robot.joint_names))
    for actuator in range(model.nu):
        name = model.joint(int(model.actuator_trnid[actuator, 0])).name
        gear[robot.joint_names.index(name)] = abs(model.actuator_gear[actuator, 0])
    moves = np.max([np.abs(one - march.stand) for one in march.lifted], axis=0) > 1e-6
    free = ~moves
    phase, rate = rng.uniform(0, 2 * np.pi, len(gear)), 2 * np.pi * rng.uniform(0.4, 1.2, len(gear))
    low, high = model.jnt_range[[model.joint(name).id for name in robot.joint_names]].T
    centre = np.where(free, np.clip(march.stand, low + 0.15 * (high - low), high - 0.15 * (high - low)), march.stand)
    swing = np.where(free, np.minimum(0.2, 0.1 * (high - low)), 0.0)
    inertia = _joint_inertia(robot)
    stiffness = np.minimum(6.0 * gear, inertia * (0.3 / model.opt.timestep) ** 2)
    damping = np.minimum(0.05 * stiffness, 0.2 * inertia / model.opt.timestep)

    def control(time_s: float, qpos: FloatArray, qvel: FloatArray, loads: FloatArray) -> FloatArray:
        del loads
        ramp = min(1.0, time_s)
        target = centre + ramp * swing * np.sin(rate * time_s + phase)
        marched = time_s - MARCH_S
        if marched > 0.0:
            for index, lifted in enumerate(march.lifted):
                part = (marched / PERIOD_S + 0.5 * index) % 1.0
                if part < 0.5 and marched > 0.5 * PERIOD_S * index:
                    target = target + 0.5 * (1.0 - np.cos(4.0 * np.pi * part)) * (lifted - march.stand)
        torque = stiffness * (target - qpos[layout.joint_qpos]) - damping * qvel[layout.joint_dof]
        return np.asarray(np.clip(torque, -gear, gear))

    return control


def _joint_inertia(robot: Robot) -> FloatArray:
    """Inertia about each joint with everything else free, shape (n_j,): what a stiff joint spring has to move."""
    model = robot.model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inverse = np.zeros((model.nv, model.nv))
    mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
    return np.asarray(1.0 / np.diagonal(inverse)[robot.layout.joint_dof])


def _chain(robot: Robot, foot: str) -> IntArray:
    """Columns of the joints between the base and a foot."""
    model, body, names = robot.model, robot.model.body(foot).id, set()
    while body != model.body(robot.root_body).id:
        first = int(model.body_jntadr[body])
        names |= {model.joint(first + k).name for k in range(int(model.body_jntnum[body]))}
        body = int(model.body_parentid[body])
    return np.array([k for k, name in enumerate(robot.joint_names) if name in names], dtype=np.int64)


def _leg_bodies(robot: Robot, foot: str) -> list[int]:
    """The three bodies of a leg, thigh first."""
    model, found = robot.model, [robot.model.body(foot).id]
    while len(found) < 3:
        found.append(int(model.body_parentid[found[-1]]))
    return found[::-1]


def _leg_length(robot: Robot, data: mujoco.MjData, foot: str) -> float:
    thigh, shin, sole = (data.xpos[body] for body in _leg_bodies(robot, foot))
    return float(np.linalg.norm(shin - thigh) + np.linalg.norm(sole - shin))


def _reach_for(
    robot: Robot, data: mujoco.MjData, joints: FloatArray, foot: str, place: FloatArray, level: FloatArray
) -> FloatArray:
    """Joint positions with a foot at a place and its sole as level as the ankle allows."""
    model, layout = robot.model, robot.layout
    body, thigh = model.body(foot).id, _leg_bodies(robot, foot)[0]
    ids = [model.joint(name).id for name in robot.joint_names]
    columns = [k for k in _chain(robot, foot) if model.jnt_bodyid[ids[k]] >= thigh]
    low, high = model.jnt_range[[ids[k] for k in columns]].T

    def miss(angles: FloatArray) -> FloatArray:
        data.qpos[layout.joint_qpos] = joints
        data.qpos[layout.joint_qpos[columns]] = angles
        mujoco.mj_kinematics(model, data)
        tilt = (data.xmat[body].reshape(3, 3) - level).ravel()
        return np.concatenate([10.0 * (data.xpos[body] - place), 0.5 * tilt, 0.02 * (angles - joints[columns])])

    found = least_squares(miss, np.clip(joints[columns], low + 1e-3, high - 1e-3), bounds=(low, high))
    out = joints.copy()
    out[columns] = found.x
    return out
