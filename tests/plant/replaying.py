"""Replay a log step by step in an identification model with given masses, to see whether it makes the same steps."""

from collections.abc import Mapping

import mujoco
import numpy as np

from massid.model.realisation import write_fields
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.observer.replay import replay_block
from massid.typing import FloatArray
from massid.walk import Segment, Walk


def velocity_errors(walk: Walk, robot: Robot, masses_kg: Mapping[str, float]) -> FloatArray:
    """Largest velocity error of each single step from the logged state [rad/s, m/s], shape (n - 1,)."""
    walk = robot.align(walk)
    model = robot.identification_model(walk.contact_bodies)
    space = mass_space(robot, masses_kg, welded_too=True)
    write_fields(model, robot.realise(space, np.array(list(masses_kg.values()))))
    data = mujoco.MjData(model)
    block = replay_block(walk, robot.layout, Segment(0, len(walk)))
    errors = np.empty(len(block))
    for k in range(len(block)):
        data.qpos[:], data.qvel[:] = block.qpos[k], block.qvel[k]
        data.qfrc_applied[:], data.ctrl[:] = block.effort[k], block.wrench[k]
        mujoco.mj_step(model, data)
        errors[k] = np.abs(data.qvel - block.qvel[k + 1]).max()
    return errors


def nominal_kg(robot: Robot) -> dict[str, float]:
    return {link: robot.nominal_mass_kg(link) for link in robot.links}
