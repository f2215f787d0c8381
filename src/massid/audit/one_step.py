"""The one-step residual: a step of the identification model from each measured state, against the next one."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.audit.balance import Balance, fitted_model
from massid.model.robot import Robot
from massid.typing import FloatArray
from massid.walk import Walk


@dataclass(frozen=True)
class OneStep:
    """Velocity change per step that a model gets wrong, root mean squares over joints and samples.

    Attributes:
        change: measured change of joint velocities per step [rad/s].
        nominal: what the model's own masses leave [rad/s].
        fitted: what the masses that fit the log's balance best leave [rad/s].
        worst: the joint with the largest rest under these masses.
    """

    change: float
    nominal: float
    fitted: float
    worst: str


def one_step_residual(robot: Robot, walk: Walk, balance: Balance) -> OneStep:
    """Step nominal and best-fitting masses through the samples of a balance.

    Args:
        robot: with nominal masses.
        walk: aligned with the robot.
        balance: of this walk.
    """
    model = robot.identification_model(walk.contact_bodies)
    model.opt.timestep = walk.timestep_s
    nominal = _residual(robot, walk, balance, model)
    fitted = _residual(robot, walk, balance, fitted_model(robot, walk, balance))
    joints = robot.layout.joint_dof
    qvel = robot.layout.to_qvel(walk.qvel)
    change = qvel[balance.rows + 1] - qvel[balance.rows]
    per_joint = np.sqrt((fitted[:, joints] ** 2).mean(axis=0))
    return OneStep(
        change=_rms(change[:, joints]),
        nominal=_rms(nominal[:, joints]),
        fitted=_rms(fitted[:, joints]),
        worst=robot.joint_names[int(np.argmax(per_joint))],
    )


def _residual(robot: Robot, walk: Walk, balance: Balance, model: mujoco.MjModel) -> FloatArray:
    layout = robot.layout
    qpos, qvel = layout.to_qpos(walk.qpos), layout.to_qvel(walk.qvel)
    data = mujoco.MjData(model)
    out = np.empty((len(balance.rows), model.nv))
    for k, row in enumerate(balance.rows):
        data.qpos[:], data.qvel[:] = qpos[row], qvel[row]
        data.qfrc_applied[:] = 0.0
        data.qfrc_applied[layout.joint_dof] = walk.effort[row]
        data.ctrl[:] = walk.wrench[row].ravel()
        data.qacc_warmstart[:] = 0.0
        mujoco.mj_step(model, data)
        out[k] = qvel[row + 1] - data.qvel
    return out


def _rms(values: FloatArray) -> float:
    return float(np.sqrt((values**2).mean())) if values.size else 0.0
