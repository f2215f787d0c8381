"""Logs in the messages of robot vendors, written by rosbags: identified with a preset, or the missing role named.

    python scripts/bench_presets.py

The walking humanoid gets the vendor's joint and body names; joints for which the vendor's message has no place are
welded. Vendor messages hold float32. Seven links are off by a quarter of the norm of their masses.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from lab.motions import LINKS, Short, walk
from lab.plant import START_NS, Recorded, RosLog
from lab.traits import atlas_spec
from massid import IdentifyOptions, weigh
from massid.errors import LogError
from massid.log import TopicMap, load_topics
from massid.model.robot import Robot
from massid.typing import FloatArray
from massid.walk.conventions import to_body, to_world

FOLDER = Path("bench_presets")
IMU = "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\n"
DEFINITIONS = {
    "unitree_hg/msg/IMUState": IMU + "int16 temperature\n",
    "unitree_hg/msg/MotorState": "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\n"
    "int16[2] temperature\nfloat32 vol\nuint32[2] sensor\nuint32 motorstate\nuint32[4] reserve\n",
    "unitree_hg/msg/LowState": "uint32[2] version\nuint8 mode_pr\nuint8 mode_machine\nuint32 tick\nIMUState imu_state\n"
    "MotorState[35] motor_state\nuint8[40] wireless_remote\nuint32[4] reserve\nuint32 crc\n",
    "unitree_go/msg/IMUState": IMU + "int8 temperature\n",
    "unitree_go/msg/MotorState": "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nfloat32 q_raw\n"
    "float32 dq_raw\nfloat32 ddq_raw\nint8 temperature\nuint32 lost\nuint32[2] reserve\n",
    "unitree_go/msg/BmsState": "uint8 version_high\nuint8 version_low\nuint8 status\nuint8 soc\nint32 current\n"
    "uint16 cycle\nint8[2] bq_ntc\nint8[2] mcu_ntc\nuint16[15] cell_vol\n",
    "unitree_go/msg/LowState": "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\n"
    "uint16 bandwidth\nIMUState imu_state\nMotorState[20] motor_state\nBmsState bms_state\nint16[4] foot_force\n"
    "int16[4] foot_force_est\nuint32 tick\nuint8[40] wireless_remote\nuint8 bit_flag\nfloat32 adc_reel\n"
    "int8 temperature_ntc1\nint8 temperature_ntc2\nfloat32 power_v\nfloat32 power_a\nuint16[4] fan_frequency\n"
    "uint32 reserve\nuint32 crc\n",
    "unitree_go/msg/TimeSpec": "int32 sec\nuint32 nanosec\n",
    "unitree_go/msg/SportModeState": "TimeSpec stamp\nuint32 error_code\nIMUState imu_state\nuint8 mode\n"
    "float32 progress\nuint8 gait_type\nfloat32 foot_raise_height\nfloat32[3] position\nfloat32 body_height\n"
    "float32[3] velocity\nfloat32 yaw_speed\nfloat32[4] range_obstacle\nint16[4] foot_force\n"
    "float32[12] foot_position_body\nfloat32[12] foot_speed_body\n",
    "booster_interface/msg/ImuState": "float32[3] rpy\nfloat32[3] gyro\nfloat32[3] acc\n",
    "booster_interface/msg/MotorState": "int8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\n"
    "int8 temperature\nuint32 lost\nuint32[2] reserve\n",
    "booster_interface/msg/LowState": "ImuState imu_state\nMotorState[] motor_state_parallel\n"
    "MotorState[] motor_state_serial\n",
}


def vendor_robot(topics: TopicMap, feet: tuple[str, str]) -> Robot:
    """The walking humanoid with a vendor's names; arms are welded until no more joints are left than names."""
    if topics.joints is None or topics.base is None:
        raise RuntimeError("a preset has joints and a base")
    plain = Robot(atlas_spec())
    names = topics.joints.names
    order = list(plain.joint_names)
    given = [n for n in names if n != "-"] if isinstance(names, tuple) else order
    arms = [name for name in order if "arm" in name]
    welded = arms[: max(0, len(order) - len(given))]
    kept = [name for name in order if name not in welded]
    robot = plain.locked(dict.fromkeys(welded, 0.0))
    body = topics.base.body if isinstance(topics.base.body, str) else "pelvis"
    renamed = {**dict(zip(kept, given, strict=False)), "pelvis": body, "l_foot": feet[0], "r_foot": feet[1]}
    xml = robot.spec.to_xml()
    for old, new in renamed.items():
        xml = xml.replace(f'"{old}"', f'"{new}"')
    return Robot(mujoco.MjSpec.from_string(xml), "vendor.xml")


class Messages:
    """Fills vendors' messages from samples."""

    def __init__(self, log: RosLog, recorded: Recorded, topics: TopicMap) -> None:
        self.log, self.recorded = log, recorded
        layout, robot = recorded.robot.layout, recorded.robot
        self.pose = recorded.qpos[:, layout.root_qpos :][:, :7]
        self.twist = recorded.qvel[:, layout.root_dof :][:, :6]
        self.linear = to_body(self.pose[:, 3:7], self.twist[:, :3])
        names = topics.joints.names if topics.joints is not None and isinstance(topics.joints.names, tuple) else ()
        columns = [robot.joint_names.index(n) if n in robot.joint_names else -1 for n in names]
        padded = [np.zeros((len(recorded.qpos), 1))]
        q = np.hstack([recorded.qpos[:, layout.joint_qpos], *padded])
        v = np.hstack([recorded.qvel[:, layout.joint_dof], *padded])
        tau = np.hstack([recorded.effort, *padded])
        self.motors = (
            np.stack([q[:, columns], v[:, columns], tau[:, columns]], axis=2) if columns else np.zeros((0, 0, 3))
        )

    def empty(self, name: str, **fields: Any) -> Any:
        """A message whose other fields are zero."""
        from rosbags.interfaces import Nodetype

        values = dict(fields)
        for field, (node, what) in self.log.store.fielddefs[name][1]:
            if field in values:
                continue
            if node == Nodetype.BASE:
                values[field] = "" if what[0] == "string" else 0
            elif node == Nodetype.NAME:
                values[field] = self.empty(what)
            elif node == Nodetype.ARRAY:
                (kind, inner), count = what
                base = kind == Nodetype.BASE
                values[field] = np.zeros(count, inner[0]) if base else [self.empty(inner) for _ in range(count)]
            else:
                values[field] = []
        return self.log.make(name, **values)

    def motor_list(self, kind: str, k: int, count: int) -> list[Any]:
        """Motor states, padded with unused ones."""
        rows = [self.empty(kind, q=float(q), dq=float(v), tau_est=float(tau)) for q, v, tau in self.motors[k]]
        return rows + [self.empty(kind) for _ in range(count - len(rows))]

    def unitree(self, k: int, stamp: int, package: str, count: int) -> None:
        """LowState and SportModeState of Unitree's robots."""
        imu = self.empty(
            f"{package}/msg/IMUState",
            quaternion=self.pose[k, 3:7].astype(np.float32),
            gyroscope=self.twist[k, 3:].astype(np.float32),
        )
        motors = self.motor_list(f"{package}/msg/MotorState", k, count)
        name = f"{package}/msg/LowState"
        self.log.write("/lowstate", name, stamp, self.empty(name, imu_state=imu, motor_state=motors))
        name = "unitree_go/msg/SportModeState"
        position, velocity = self.pose[k, :3].astype(np.float32), self.twist[k, :3].astype(np.float32)
        self.log.write("/odommodestate", name, stamp, self.empty(name, position=position, velocity=velocity))

    def booster(self, k: int, stamp: int) -> None:
        """LowState of Booster's robots, and an odometry."""
        imu = self.empty(
            "booster_interface/msg/ImuState",
            rpy=_rpy(self.pose[k, 3:7]).astype(np.float32),
            gyro=self.twist[k, 3:].astype(np.float32),
        )
        motors = self.motor_list("booster_interface/msg/MotorState", k, 0)
        name = "booster_interface/msg/LowState"
        self.log.write("/low_state", name, stamp, self.empty(name, imu_state=imu, motor_state_serial=motors))
        self.log.odometry("/odom", stamp, "Trunk", self.pose[k], self.linear[k], self.twist[k, 3:])

    def standard(self, k: int, stamp: int, odometry: str, world: bool) -> None:
        """JointState and Odometry."""
        robot, recorded = self.recorded.robot, self.recorded
        q, v = recorded.qpos[k, robot.layout.joint_qpos], recorded.qvel[k, robot.layout.joint_dof]
        self.log.joints(stamp, robot.joint_names, q, v, recorded.effort[k])
        linear, turn = self.linear[k], self.twist[k, 3:]
        if world:
            linear, turn = self.twist[k, :3], to_world(self.pose[k : k + 1, 3:7], turn[None])[0]
        self.log.odometry(odometry, stamp, robot.root_body, self.pose[k], linear, turn)

    def wrenches(self, k: int, stamp: int, topic: Callable[[str], str]) -> None:
        """One WrenchStamped for each body."""
        for body, values in self.recorded.wrenches.items():
            self.log.wrench(topic(body), stamp, body, values[k])


def _rpy(wxyz: FloatArray) -> FloatArray:
    w, x, y, z = wxyz
    return np.array(
        [
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(np.clip(2 * (w * y - z * x), -1, 1)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        ]
    )


Write = Callable[[Messages, int, int], None]
PAL_FEET = {"leg_left_6_link": "/left_ankle_ft", "leg_right_6_link": "/right_ankle_ft"}
FEET: dict[str, tuple[str, str]] = {"pal": ("leg_left_6_link", "leg_right_6_link")}
WRITERS: dict[str, tuple[Write, Callable[[str], str]]] = {
    "ros2": (lambda m, k, t: m.standard(k, t, "/odom", world=False), lambda body: f"/{body}/wrench"),
    "unitree_g1": (lambda m, k, t: m.unitree(k, t, "unitree_hg", 35), lambda body: f"/contact/{body}"),
    "unitree_h1": (lambda m, k, t: m.unitree(k, t, "unitree_go", 20), lambda body: f"/contact/{body}"),
    "booster_t1": (lambda m, k, t: m.booster(k, t), lambda body: f"/contact/{body}"),
    "pal": (lambda m, k, t: m.standard(k, t, "/floating_base_pose_simulated", world=True), PAL_FEET.__getitem__),
}


CLEAN = IdentifyOptions(noise="clean")


def main() -> None:
    """Every preset: once with wrenches, once without."""
    for preset, (write, topic) in WRITERS.items():
        topics = load_topics(preset)
        robot = vendor_robot(topics, FEET.get(preset, ("l_foot", "r_foot")))
        if topics.joints is not None and isinstance(topics.joints.names, tuple):
            extra = tuple(n for n in topics.joints.names if n != "-" and n not in robot.joint_names)
            topics = replace(topics, joints=replace(topics.joints, ignore=extra))
        recorded, motion, space, truth = walk(robot, Short(5.5))
        links = [parameter.target for parameter in space.parameters]
        for with_wrench in (True, False):
            log = RosLog(FOLDER / f"{preset}_{with_wrench}", DEFINITIONS)
            messages = Messages(log, recorded, topics)
            for k in range(len(recorded.qpos) if with_wrench else 50):
                stamp = START_NS + k * 1_000_000
                write(messages, k, stamp)
                if with_wrench:
                    messages.wrenches(k, stamp, topic)
            path = log.close()
            try:
                result = weigh(
                    path, robot, links, topics=topics, mode="online", held_out=0.0, checks=False, options=CLEAN
                )
            except LogError as error:
                sys.stdout.write(f"{preset}: {error}\n")
                continue
            before = float(np.linalg.norm(space.nominal - truth))
            after = float(np.linalg.norm(result.estimate[:LINKS] - truth))
            said = [w.partition(": ")[2] for w in result.warnings if "checksum" not in w]
            sys.stdout.write(f"{preset}: {motion}, {before:.2f} -> {after:.2g} kg, {result.status}; {said}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
