"""Simulate any robot with its own actuators on a floor, and write what happens with an independent ROS 2 writer."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import mujoco
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from massid.model.inverse import takes_stages
from massid.model.realisation import write_fields
from massid.model.robot import Robot
from massid.plant import motorised
from massid.plant.contacts import ContactRecorder, LoadCells
from massid.plant.effort import effort_meter
from massid.plant.parts import RobotParts
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray, IntArray
from massid.walk.conventions import to_body
from massid.walking import Walker, find_gait

START_NS = 1_767_225_600_000_000_000
BLOCK = 200
LEAST_FLIGHT_S = 0.1
LANDED = 0.15
"""A foot has landed when it bears this share of the weight after being in the air for that long."""

Control: TypeAlias = Callable[[float, FloatArray, FloatArray, FloatArray], FloatArray]
"""Joint torques, in the order of the robot's joints, from time, qpos, qvel and foot loads."""
Support: TypeAlias = Callable[[mujoco.MjModel, mujoco.MjData, float], FloatArray]
"""Applies a wrench to the base over the next step, given the feet's load; returns it in the base's frame, about it."""


@dataclass
class Recorded:
    """Samples of a simulated robot, in the order of its own model."""

    robot: Robot
    qpos: FloatArray
    qvel: FloatArray
    effort: FloatArray
    wrenches: dict[str, FloatArray]
    self_contact_samples: int
    landings: tuple[int, ...]
    fell: bool

    @property
    def timestep_s(self) -> float:
        """Sample period [s]."""
        return float(self.robot.model.opt.timestep)


def walking_control(
    robot: Robot, seed: int, walker_robot: Robot | None = None
) -> tuple[Control, FloatArray, tuple[str, str]]:
    """A walker for the robot: its control, its initial pose and its feet."""
    believed = motorised(walker_robot or robot)
    walker = Walker(believed.model, find_gait("random"), np.random.default_rng(seed))
    names = list(walker.joint_names)
    columns = [robot.joint_names.index(name) for name in names]

    def control(time_s: float, qpos: FloatArray, qvel: FloatArray, loads: FloatArray) -> FloatArray:
        layout = robot.layout
        base_q, base_v = qpos[layout.root_qpos : layout.root_qpos + 7], qvel[layout.root_dof : layout.root_dof + 6]
        q = np.concatenate([base_q, qpos[layout.joint_qpos][columns]])
        v = np.concatenate([base_v, qvel[layout.joint_dof][columns]])
        torques = np.zeros(len(robot.joint_names))
        torques[columns] = walker.control(time_s, q, v, loads)
        held = [k for k in range(len(torques)) if k not in columns]  # joints that the walker takes as locked
        torques[held] = -2000.0 * qpos[layout.joint_qpos][held] - 40.0 * qvel[layout.joint_dof][held]
        return torques

    start = robot.model.qpos0.copy()
    stand = walker.initial_qpos()
    start[robot.layout.root_qpos : robot.layout.root_qpos + 7] = stand[:7]
    start[robot.layout.joint_qpos[columns]] = stand[7:]
    return control, start, walker.foot_names


def wriggling_control(robot: Robot, seed: int, stiffness: float, amplitude: float) -> tuple[Control, FloatArray]:
    """Sines around the initial pose under joint PD, until and after the robot falls: contact everywhere."""
    rng = np.random.default_rng(seed)
    joints = len(robot.joint_names)
    phase, rate = rng.uniform(0, 2 * np.pi, joints), 2 * np.pi * rng.uniform(0.4, 1.5, joints)
    start = robot.model.qpos0.copy()
    low, high = robot.model.jnt_range[[robot.model.joint(n).id for n in robot.joint_names]].T
    middle = np.where(high > low, 0.5 * (low + high), 0.0)
    reach = np.where(high > low, 0.4 * (high - low), amplitude)
    centre = np.clip(start[robot.layout.joint_qpos], middle - 0.5 * reach, middle + 0.5 * reach)

    def control(time_s: float, qpos: FloatArray, qvel: FloatArray, loads: FloatArray) -> FloatArray:
        del loads
        target = centre + np.minimum(amplitude, reach) * min(1.0, time_s) * np.sin(rate * time_s + phase)
        layout = robot.layout
        return stiffness * (target - qpos[layout.joint_qpos]) - 0.05 * stiffness * qvel[layout.joint_dof]

    return control, start


def on_floor(robot: Robot, space: ParameterSpace, truth: FloatArray) -> mujoco.MjModel:
    """The robot with its true masses and its own actuators on a plane, solved exactly."""
    spec = robot.spec.copy()
    if not any(geom.type == mujoco.mjtGeom.mjGEOM_PLANE for geom in spec.worldbody.geoms):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50, 50, 0.1], contype=1, conaffinity=1)
    model = spec.compile()
    write_fields(model, robot.realise(space, truth))
    model.opt.iterations, model.opt.ls_iterations, model.opt.tolerance = 100, 50, 1e-25
    return model


def simulate(
    robot: Robot, space: ParameterSpace, truth: FloatArray, control: Control, start: FloatArray, seconds: float,
    feet: Sequence[str] = (), period_s: float = 0.002, fallen: float = 0.6, support: Support | None = None,
) -> Recorded:  # fmt: skip
    """Simulate with whatever actuators the robot has: motors get torques, servos a target that gives the torque.

    A support pulls at the base as a harness does; its wrench is logged as that of the base.
    """
    model = on_floor(robot, space, truth)
    data = mujoco.MjData(model)
    data.qpos[:] = start
    parts = RobotParts.find(model, robot.root_body)
    contacts, meter = ContactRecorder(model, parts, BLOCK), effort_meter(model)
    cells = LoadCells(model, np.array([model.body(foot).id for foot in feet], dtype=np.int64))
    joints = [robot.joint_names.index(model.joint(int(j)).name) for j in model.actuator_trnid[:, 0]]
    actuated: IntArray = np.array(joints, dtype=np.int64)
    every = max(1, round(period_s / model.opt.timestep))
    stages = takes_stages(model)
    instant = mujoco.MjData(model) if stages else data
    n = round(seconds / model.opt.timestep)
    qpos, qvel = np.zeros((n, model.nq)), np.zeros((n, model.nv))
    effort = np.zeros((n, len(robot.joint_names)))
    wrenches: dict[str, FloatArray] = {}
    pulled = np.zeros((n, 6))
    self_contact, fell, loads, aloft = 0, False, np.zeros(len(feet)), np.zeros(len(feet), dtype=np.int64)
    lifted, landings = np.zeros(len(feet), dtype=bool), np.zeros(len(feet), dtype=np.int64)
    for k in range(n):
        if k % every == 0:
            torques = control(data.time, data.qpos, data.qvel, loads)[actuated]
            data.ctrl[:] = _controls(model, data, robot, actuated, torques)
        qpos[k], qvel[k] = data.qpos, data.qvel
        meter.before(data)
        if support is not None:
            pulled[k] = support(model, data, float(loads.sum()))
        if stages:
            instant.qpos[:], instant.qvel[:], instant.ctrl[:] = data.qpos, data.qvel, data.ctrl
            mujoco.mj_forward(model, instant)
        mujoco.mj_step(model, data)
        effort[k] = meter.after(instant)[robot.layout.joint_dof]
        contacts.take(k % BLOCK, instant)
        loads = cells.read(instant)
        aloft = np.where(loads > 1.0, 0, aloft + 1)
        lifted |= aloft * model.opt.timestep >= LEAST_FLIGHT_S
        landed = lifted & (loads > LANDED * robot.total_mass_kg * 9.81)
        landings += landed
        lifted &= ~landed
        fell = fell or bool(data.qpos[2] < fallen * start[2])
        if (k + 1) % BLOCK == 0 or k + 1 == n:
            size = k % BLOCK + 1
            acted = contacts.finish(size)
            self_contact += int(acted.self_contact.sum())
            for body, values in acted.wrench.items():
                wrenches.setdefault(body, np.zeros((n, 6)))[k + 1 - size : k + 1] = values
    if support is not None:
        wrenches[robot.root_body] = wrenches.get(robot.root_body, 0.0) + pulled
    return Recorded(robot, qpos, qvel, effort, wrenches, self_contact, tuple(landings.tolist()), fell)


def _controls(
    model: mujoco.MjModel, data: mujoco.MjData, robot: Robot, actuated: IntArray, torques: FloatArray
) -> FloatArray:
    """Controls that make each actuator exert a torque at this instant."""
    gain, bias = model.actuator_gainprm[:, 0], model.actuator_biasprm
    gear = model.actuator_gear[:, 0]
    length = gear * data.qpos[robot.layout.joint_qpos[actuated]]
    rate = gear * data.qvel[robot.layout.joint_dof[actuated]]
    affine = model.actuator_biastype == int(mujoco.mjtBias.mjBIAS_AFFINE)
    offset = np.where(affine, bias[:, 0] + bias[:, 1] * length + bias[:, 2] * rate, 0.0)
    return np.asarray((torques / gear - offset) / gain)


class RosLog:
    """Writes MCAP through rosbags, with rosbags' own message types and serialiser."""

    def __init__(self, folder: Path, definitions: dict[str, str] | None = None) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        self.store = get_typestore(Stores.ROS2_JAZZY)
        if definitions:
            from rosbags.typesys import get_types_from_msg

            for name, text in definitions.items():
                self.store.register(get_types_from_msg(text, name))
        self.writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        self.writer.open()
        self.connections: dict[str, Any] = {}
        self.folder = folder

    def make(self, name: str, /, **fields: Any) -> Any:
        """Build a message."""
        return self.store.types[name](**fields)

    def header(self, stamp_ns: int, frame: str) -> Any:
        """Build a header."""
        stamp = self.make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def vector(self, values: FloatArray) -> Any:
        """Build a Vector3."""
        x, y, z = map(float, values)
        return self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def write(self, topic: str, name: str, stamp_ns: int, message: Any) -> None:
        """Write a message."""
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, name, typestore=self.store)
        self.writer.write(self.connections[topic], stamp_ns, self.store.serialize_cdr(message, name))

    def odometry(
        self, topic: str, stamp_ns: int, body: str, pose: FloatArray, linear: FloatArray, turn: FloatArray
    ) -> None:
        """Write an Odometry message: pose [position, wxyz], velocities in the body."""
        make = self.make
        orientation = make("geometry_msgs/msg/Quaternion", w=pose[3], x=pose[4], y=pose[5], z=pose[6])
        position = make("geometry_msgs/msg/Point", x=pose[0], y=pose[1], z=pose[2])
        covariance = np.zeros(36)
        twist = make("geometry_msgs/msg/Twist", linear=self.vector(linear), angular=self.vector(turn))
        message = make(
            "nav_msgs/msg/Odometry",
            header=self.header(stamp_ns, "world"),
            child_frame_id=body,
            pose=make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=make("geometry_msgs/msg/Pose", position=position, orientation=orientation),
                covariance=covariance,
            ),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=covariance),
        )
        self.write(topic, "nav_msgs/msg/Odometry", stamp_ns, message)

    def wrench(self, topic: str, stamp_ns: int, body: str, wrench: FloatArray) -> None:
        """Write a WrenchStamped message."""
        force = self.make("geometry_msgs/msg/Wrench", force=self.vector(wrench[:3]), torque=self.vector(wrench[3:]))
        message = self.make("geometry_msgs/msg/WrenchStamped", header=self.header(stamp_ns, body), wrench=force)
        self.write(topic, "geometry_msgs/msg/WrenchStamped", stamp_ns, message)

    def joints(
        self, stamp_ns: int, names: Sequence[str], q: FloatArray, v: FloatArray, effort: FloatArray,
        topic: str = "/joint_states",
    ) -> None:  # fmt: skip
        """Write a JointState message."""
        message = self.make(
            "sensor_msgs/msg/JointState",
            header=self.header(stamp_ns, ""),
            name=list(names),
            position=q.copy(),
            velocity=v.copy(),
            effort=effort.copy(),
        )
        self.write(topic, "sensor_msgs/msg/JointState", stamp_ns, message)

    def close(self) -> Path:
        """Finish; returns the MCAP file."""
        self.writer.close()
        (path,) = self.folder.glob("*.mcap")
        return path


def write_ros2(
    recorded: Recorded, folder: Path, stride: int = 1, input_lag_s: float = 0.0, split_effort: bool = False
) -> Path:
    """Write a plain ROS 2 log.

    Args:
        recorded: the samples.
        folder: of the bag; replaced.
        stride: write every so many samples, torques and wrenches averaged over them.
        input_lag_s: stamp wrenches, and torques if they have a topic of their own, this much later.
        split_effort: write torques on /joint_efforts.
    """
    log, robot = RosLog(folder), recorded.robot
    layout, n = robot.layout, len(recorded.qpos) // stride * stride
    step_ns = round(recorded.timestep_s * 1e9)
    base, joints = recorded.qpos[:, layout.root_qpos :][:, :7], recorded.qpos[:, layout.joint_qpos]
    twist, rates = recorded.qvel[:, layout.root_dof :][:, :6], recorded.qvel[:, layout.joint_dof]
    linear = to_body(base[:, 3:7], twist[:, :3])

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(values[:n].reshape(n // stride, stride, -1).mean(axis=1))

    effort, wrenches = mean(recorded.effort), {body: mean(values) for body, values in recorded.wrenches.items()}
    late_ns = round(input_lag_s * 1e9)
    for k in range(n // stride):
        row, stamp = k * stride, START_NS + k * stride * step_ns
        log.odometry("/odom", stamp, robot.root_body, base[row], linear[row], twist[row, 3:])
        log.joints(stamp, robot.joint_names, joints[row], rates[row], effort[k])
        if split_effort:
            log.joints(stamp + late_ns, robot.joint_names, joints[row], rates[row], effort[k], "/joint_efforts")
        for body, values in wrenches.items():
            log.wrench(f"/contact/{body}", stamp + late_ns, body, values[k])
    return log.close()
