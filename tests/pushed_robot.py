"""A small biped that wriggles on its feet under joint PD: the shortest way to a log with real contacts."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np

from massid.model.inverse import takes_stages
from massid.model.realisation import write_fields
from massid.model.robot import Robot
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Segment, Walk


def _leg(side: str, y: float) -> str:
    return f"""
      <body name="{side}_thigh" pos="0 {y} -0.15">
        <joint name="{side}_hip_roll" axis="1 0 0"/>
        <joint name="{side}_hip_pitch" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.01 0 -0.35" size="0.05" mass="4"/>
        <body name="{side}_calf" pos="0.01 0 -0.35">
          <joint name="{side}_knee" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 -0.01 0 -0.35" size="0.04" mass="2.5"/>
          <body name="{side}_foot" pos="-0.01 0 -0.35">
            <joint name="{side}_ankle" axis="0 1 0"/>
            <geom type="box" pos="0.04 0 -0.05" size="0.2 0.08 0.02" mass="1" contype="0" conaffinity="1"/>
          </body>
        </body>
      </body>"""


_MOTORS = "".join(
    f'<motor joint="{side}_{joint}"/>'
    for side in ("r", "l")  # not the order of the joints, on purpose
    for joint in ("knee", "hip_roll", "ankle", "hip_pitch")
)
XML = f"""
<mujoco model="pushed">
  <option timestep="0.001" cone="elliptic" impratio="10" iterations="100" tolerance="0"/>
  <default><geom contype="0" conaffinity="0"/><joint damping="0.2" armature="0.01"/></default>
  <worldbody>
    <body name="torso" pos="0 0 0.92">
      <freejoint name="root"/>
      <geom type="box" size="0.1 0.15 0.2" pos="0.01 0 0.1" mass="20"/>
      {_leg("l", 0.1)}
      {_leg("r", -0.1)}
    </body>
  </worldbody>
  <actuator>{_MOTORS}</actuator>
</mujoco>
"""

LINKS = ("torso", "l_thigh", "r_thigh", "l_calf", "r_calf", "l_foot", "r_foot")
FEET = ("l_foot", "r_foot")


INTEGRATORS = {
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "discrete": mujoco.mjtIntegrator.mjINT_DISCRETE,
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
}


def make_robot(integrator: str = "Euler", friction_loss: float = 0.0, disabled: int = 0) -> Robot:
    """The biped with nominal masses; `disabled` are flags of the engine."""
    spec = mujoco.MjSpec.from_string(XML)
    spec.option.disableflags |= int(disabled)
    spec.option.integrator = INTEGRATORS[integrator]
    for joint in spec.joints:
        if joint.name != "root":
            joint.frictionloss = friction_loss
    return Robot(spec)


def draw_truth(space: ParameterSpace, seed: int, relative_error: float = 0.15) -> FloatArray:
    """True masses: nominal ones times 1 +- relative_error."""
    rng = np.random.default_rng(seed)
    return space.nominal * (1.0 + relative_error * rng.choice([-1.0, 1.0], len(space)))


def push_about(
    robot: Robot,
    space: ParameterSpace,
    truth: FloatArray,
    seconds: float,
    seed: int = 0,
    amplitude: float = 0.08,
    shaking_nm: float = 0.0,
    floor: bool = True,
) -> Walk:
    """Simulate the robot with its true masses on a floor and log states, torques and foot wrenches."""
    rng = np.random.default_rng(seed)
    spec = robot.spec.copy()
    if floor:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1], contype=1, conaffinity=0)
    model = spec.compile()
    write_fields(model, robot.realise(space, truth))
    data = mujoco.MjData(model)
    first_stage = mujoco.MjData(model) if takes_stages(model) else data
    joints = model.nv - 6
    phase, frequency = rng.uniform(0, 2 * np.pi, joints), rng.uniform(0.5, 2.0, joints)
    motor_dof = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    feet = [model.body(name).id for name in FEET]
    rows: dict[str, list[FloatArray]] = {"qpos": [], "qvel": [], "effort": [], "wrench": []}
    for k in range(round(seconds / model.opt.timestep)):
        time = k * model.opt.timestep
        target = amplitude * np.sin(2 * np.pi * frequency * time + phase) * min(1.0, 2.0 * time)
        torque = 600.0 * (target - data.qpos[7:]) - 20.0 * data.qvel[6:]
        if shaking_nm:
            torque += shaking_nm * rng.normal(size=joints)
        data.ctrl[:] = torque[motor_dof - 6]
        rows["qpos"].append(data.qpos.copy())
        rows["qvel"].append(data.qvel.copy())
        if first_stage is not data:
            first_stage.qpos[:], first_stage.qvel[:], first_stage.ctrl[:] = data.qpos, data.qvel, data.ctrl
            mujoco.mj_forward(model, first_stage)
        mujoco.mj_step(model, data)
        rows["effort"].append(first_stage.qfrc_actuator[6:].copy())
        rows["wrench"].append(np.array([_wrench(model, first_stage, foot) for foot in feet]))
    arrays = {name: np.array(values) for name, values in rows.items()}
    return Walk(
        root_body=robot.root_body,
        joint_names=robot.joint_names,
        contact_bodies=FEET,
        stamps_ns=np.arange(len(arrays["qpos"]), dtype=np.int64) * 1_000_000,
        timestep_s=0.001,
        **arrays,
    )


def fly_about(robot: Robot, space: ParameterSpace, truth: FloatArray, seconds: float, amplitude: float = 0.08) -> Walk:
    """The same robot with its legs in motion, but without a floor: it falls."""
    return push_about(robot, space, truth, seconds, amplitude=amplitude, floor=False)


def stamped_late(walk: Walk, effort_s: float, wrench_s: float) -> Walk:
    """The walk with torques and wrenches as they were some time before their stamps, linear between samples."""
    stamps_s = np.arange(len(walk)) * walk.timestep_s

    def earlier(values: FloatArray, lag_s: float) -> FloatArray:
        columns = values.reshape(len(values), -1).T
        return np.stack([np.interp(stamps_s - lag_s, stamps_s, x) for x in columns], axis=1).reshape(values.shape)

    return replace(walk, effort=earlier(walk.effort, effort_s), wrench=earlier(walk.wrench, wrench_s))


def cut(walk: Walk, *rows: slice) -> Walk:
    """Some stretches of a walk one after the other, with their stamps and the gaps between them."""
    lengths = np.cumsum([0, *[stretch.stop - stretch.start for stretch in rows]])
    segments = tuple(Segment(int(a), int(b)) for a, b in pairwise(lengths))
    names = ("stamps_ns", "qpos", "qvel", "effort", "wrench")
    kept = {name: np.concatenate([getattr(walk, name)[stretch] for stretch in rows]) for name in names}
    return replace(walk, segments=segments, **kept)


def _wrench(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> FloatArray:
    """Wrench of the floor on a body, in its frame; contact geometry is still that of the step just made."""
    total, raw = np.zeros(6), np.zeros(6)
    rotation = data.xmat[body].reshape(3, 3)
    for index in range(data.ncon):
        contact = data.contact[index]
        if body not in model.geom_bodyid[contact.geom]:
            continue
        mujoco.mj_contactForce(model, data, index, raw)
        sign = 1.0 if model.geom_bodyid[contact.geom[1]] == body else -1.0
        frame = contact.frame.reshape(3, 3)
        force, moment = sign * frame.T @ raw[:3], sign * frame.T @ raw[3:]
        total[:3] += rotation.T @ force
        total[3:] += rotation.T @ (moment + np.cross(contact.pos - data.xpos[body], force))
    return total
