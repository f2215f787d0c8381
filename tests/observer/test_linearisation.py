from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from massid.observer.inputs import UNLIMITED, BelievedBlock, InputBelief
from massid.observer.linearisation import Lineariser
from massid.observer.replay import replay_block
from massid.typing import FloatArray
from massid.walk import Segment
from massid.walk.noise import PRESETS
from tests.conftest import Pushed
from tests.pushed_robot import FEET, make_robot

K, STEP_NM = 25, 1e-3
EULERDAMP, DAMPER = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP), int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
TOLERANCE = {
    "Euler": 1e-6,
    "implicitfast": 1e-6,
    "implicit": 3e-4,  # its step has the slope of the Coriolis force in it, too
    "discrete": 3e-3,  # damping and joints that stick are one solve
    "RK4": 1e-2,  # linearised as Euler
}


@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("sticking", [(), ("l_knee",), ("l_hip_roll", "r_knee", "r_ankle")])
@pytest.mark.parametrize("disabled", [0, EULERDAMP, DAMPER])
@pytest.mark.parametrize("integrator", TOLERANCE)
def test_forces_act_as_in_steps_of_the_engine(
    integrator: str, disabled: int, sticking: tuple[str, ...], substeps: int, pushed: Pushed
) -> None:
    robot = make_robot(integrator, disabled=disabled)
    lineariser = Lineariser(robot.identification_model(FEET), robot.layout, substeps)
    belief = InputBelief(lineariser.model, robot.layout, PRESETS["white"])
    block = belief.believe(replay_block(pushed.walk, robot.layout, Segment(500, 551)))
    friction_loss = np.zeros_like(block.friction)
    for name in sticking:
        friction_loss[:, robot.model.joint(name).dofadr[0]] = UNLIMITED
    block = replace(block, friction_loss=friction_loss)
    found = lineariser.step(block, K)
    model = robot.identification_model(FEET)
    expected = np.empty((model.nv, model.nv))
    for dof, change in enumerate(STEP_NM * np.eye(model.nv)):
        before, after = (_velocity(model, block, sign * change, substeps) for sign in (-1, 1))
        expected[:, dof] = (after - before) / (2.0 * STEP_NM)
    tolerance = TOLERANCE[integrator] if substeps == 1 else 1e-2  # a linearisation is kept for all of the steps
    np.testing.assert_allclose(
        found.from_force[model.nv :], expected, rtol=0.0, atol=tolerance * np.abs(expected).max()
    )
    np.testing.assert_array_equal(found.from_force[:, robot.layout.joint_dof], found.from_effort)


def _velocity(model: mujoco.MjModel, block: BelievedBlock, more_force: FloatArray, substeps: int) -> FloatArray:
    """After some steps from the estimated motion."""
    data, motion = mujoco.MjData(model), block.motion
    model.dof_frictionloss[:] = block.friction_loss[K]
    data.qpos[:], data.qvel[:], data.ctrl[:] = motion.position[K], motion.velocity[K], motion.wrench[K]
    data.qfrc_applied[:] = motion.effort[K] + block.friction[K] + more_force
    mujoco.mj_step(model, data, substeps)
    return data.qvel.copy()
