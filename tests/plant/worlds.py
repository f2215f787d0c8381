"""Environments that the recorder did not make itself."""

import warnings
from typing import Any

import mujoco
import numpy as np

from massid.model.robot import Robot
from massid.plant.backend import composer, mjcf

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from dm_control import suite

SERVO_ROBOT = """
<mujoco model="crab">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="{integrator}"/>
  <default>
    <joint damping="0.05" armature="0.01" frictionloss="0.2" range="-1.2 1.2"/>
    <geom contype="1" conaffinity="0" condim="6" friction="0.8 0.05 0.02"/>
  </default>
  <worldbody>
    <body name="shell" pos="{pos}" quat="{quat}">
      {free}
      <geom type="box" size="0.15 0.1 0.05" mass="3"/>
      <body name="left" pos="0 0.12 0">
        <joint name="left_hip" axis="1 0 0"/>
        <geom type="capsule" fromto="0 0 0 0 0.25 -0.05" size="0.03" mass="0.8"/>
        <body name="left_claw" pos="0 0.25 -0.05">
          <joint name="left_wrist" axis="0 0 1"/>
          <geom type="sphere" pos="0 0.08 0" size="0.04" mass="0.4"/>
        </body>
      </body>
      <body name="right" pos="0 -0.12 0">
        <joint name="right_hip" axis="1 0 0"/>
        <geom type="capsule" fromto="0 0 0 0 -0.25 -0.05" size="0.03" mass="0.9"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    {actuators}
  </actuator>
</mujoco>
"""
_SERVO = '<position name="{0}" joint="{0}" kp="60" kv="6" forcerange="-20 20"/>'
_MOTOR = '<motor name="{0}" joint="{0}" ctrlrange="-4 4"/>'
_JOINTS = ("left_hip", "left_wrist", "right_hip")


def crab_xml(integrator: str, servo: bool, *, free: bool, offset: bool = False) -> str:
    """A robot with three joints; its root may sit off the frame that it is attached with."""
    actuator = _SERVO if servo else _MOTOR
    return SERVO_ROBOT.format(
        integrator=integrator,
        pos="0.1 -0.2 0.05" if offset else "0 0 0",
        quat="0.8 0.36 0.48 0" if offset else "1 0 0 0",
        free='<freejoint name="root"/>' if free else "",
        actuators="\n".join(actuator.format(joint) for joint in _JOINTS),
    )


def crab(integrator: str, *, servo: bool) -> Robot:
    return Robot(mujoco.MjSpec.from_string(crab_xml(integrator, servo, free=True)))


class _Crab(composer.Entity):
    def _build(self, xml: str) -> None:
        self._root = mjcf.from_xml_string(xml)

    @property
    def mjcf_model(self) -> Any:
        return self._root


class _Drop(composer.Task):
    """Drop the crab onto a floor and a heavy loose box, itself a floating body."""

    def __init__(self, xml: str) -> None:
        self._arena = composer.Arena()
        root = self._arena.mjcf_model
        root.option.noslip_iterations = 0
        root.option.tolerance = 1e-25  # what its solver leaves open, no log can tell
        root.compiler.boundmass = root.compiler.boundinertia = 0
        root.worldbody.add("geom", type="plane", size=(5, 5, 0.1))
        box = root.worldbody.add("body", name="box", pos=(0.2, 0, 0.15))
        box.add("freejoint")
        box.add("geom", type="box", size=(0.15, 0.15, 0.15), mass=20)
        frame = self._arena.add_free_entity(_Crab(xml))
        frame.pos, frame.quat = (0.0, 0.1, 0.6), (0.9, 0.1, 0.3, 0.3)
        self.set_timesteps(0.01, 0.002)

    @property
    def root_entity(self) -> Any:
        return self._arena

    def get_reward(self, physics: Any) -> float:
        return 0.0


def drop_crab(
    integrator: str, *, servo: bool, offset: bool = False, legacy_step: bool = False, time_limit: float = float("inf")
) -> Any:
    """A composer environment with five physics steps per control step and a loose box."""
    task = _Drop(crab_xml(integrator, servo, free=False, offset=offset))
    return composer.Environment(task, time_limit=time_limit, random_state=0, legacy_step=legacy_step)


def suite_humanoid(*, legacy_step: bool = True, self_collision: bool = True) -> Any:
    """dm_control's own humanoid, five physics steps per control step."""
    environment = suite.load("humanoid", "stand", {"random": 1}, environment_kwargs={"legacy_step": legacy_step})
    if not self_collision:
        model = environment.physics.model
        model.geom_conaffinity[np.arange(model.ngeom) != model.name2id("floor", "geom")] = 0
    return environment


class RandomAgent:
    """Uniform actions within the environment's bounds, or within one unit where there are none."""

    def __init__(self, environment: Any, seed: int = 0) -> None:
        spec = environment.action_spec()
        self._low, self._high = np.clip(spec.minimum, -4, 4), np.clip(spec.maximum, -4, 4)
        self._rng = np.random.default_rng(seed)

    def __call__(self, timestep: Any) -> Any:
        return self._rng.uniform(self._low, self._high)
