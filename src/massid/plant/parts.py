"""Which part of a simulation is the robot: its bodies, joints and floating base, with the names of its own file.

A model composed of several attached ones gives the robot's names a prefix and its root body a frame body, which carries
the free joint. A log speaks of the robot's own bodies and joints, so both are taken off here.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.errors import ModelError, unknown_name
from massid.typing import FloatArray, IntArray
from massid.walk.conventions import to_body, to_world

_SEPARATOR = "/"


@dataclass(frozen=True)
class RobotParts:
    """The robot in a simulated world, by index into the world's model.

    Attributes:
        prefix: what the world puts before the robot's names; empty for a robot that is not attached.
        root_body: own name of the floating base.
        root_id: its body.
        offset_m: its origin in the frame that the free joint moves, shape (3,).
        offset_quat: its attitude in that frame (wxyz), shape (4,).
        free_joint: the free joint.
        free_qpos: address of the free joint in qpos.
        free_dof: address of the free joint in qvel.
        joint_names: own names of the one-axis joints, in model order.
        joint_ids: joints.
        joint_qpos: their addresses in qpos.
        joint_dof: their addresses in qvel.
        body_names: own names of the bodies, in model order; a frame body is not among them.
        body_ids: bodies.
    """

    prefix: str
    root_body: str
    root_id: int
    offset_m: FloatArray
    offset_quat: FloatArray
    free_joint: int
    free_qpos: int
    free_dof: int
    joint_names: tuple[str, ...]
    joint_ids: IntArray
    joint_qpos: IntArray
    joint_dof: IntArray
    body_names: tuple[str, ...]
    body_ids: IntArray

    @classmethod
    def find(cls, model: mujoco.MjModel, root_body: str | None = None) -> RobotParts:
        """Find the robot in a world.

        Args:
            model: the world.
            root_body: own or full name of the robot's floating base; None for the floating body with the most joints.

        Raises:
            ModelError: no floating body, none of the given name, a ball joint, or joints and bodies without names.
        """
        free = _free_body(model, root_body)
        prefix, root = _frame(model, free)
        bodies = [b for b in range(model.nbody) if b == root or (b != free and _is_under(model, b, free))]
        free_joint = int(model.body_jntadr[free])
        joints = [j for j in range(model.njnt) if j != free_joint and _is_under(model, int(model.jnt_bodyid[j]), free)]
        for j in joints:
            if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_BALL:
                raise ModelError(f"Joint '{model.joint(j).name}' is a ball joint; model it as three hinges.")
        joint_names = tuple(model.joint(j).name.removeprefix(prefix) for j in joints)
        body_names = tuple(model.body(b).name.removeprefix(prefix) for b in bodies)
        if "" in joint_names or body_names[bodies.index(root)] == "":
            raise ModelError("Every joint of the robot and its floating base need a name to be recorded.")
        for body, name in zip(bodies, body_names, strict=True):
            if not name and (model.body_contype[body] or model.body_conaffinity[body]):
                raise ModelError(
                    f"Body {body} of the robot can touch things but has no name to record its wrench under."
                )
        framed = root != free
        return cls(
            prefix=prefix,
            root_body=model.body(root).name.removeprefix(prefix),
            root_id=root,
            offset_m=model.body_pos[root].copy() if framed else np.zeros(3),
            offset_quat=model.body_quat[root].copy() if framed else np.array([1.0, 0.0, 0.0, 0.0]),
            free_joint=free_joint,
            free_qpos=int(model.jnt_qposadr[free_joint]),
            free_dof=int(model.jnt_dofadr[free_joint]),
            joint_names=joint_names,
            joint_ids=np.asarray(joints, dtype=np.int64),
            joint_qpos=np.asarray(model.jnt_qposadr[joints], dtype=np.int64),
            joint_dof=np.asarray(model.jnt_dofadr[joints], dtype=np.int64),
            body_names=body_names,
            body_ids=np.asarray(bodies, dtype=np.int64),
        )

    def log_qpos(self, qpos: FloatArray) -> FloatArray:
        """Root pose and joint positions, shape (n, 7 + n_j), of the world's positions, shape (n, nq)."""
        pose = qpos[:, self.free_qpos : self.free_qpos + 7]
        if self._has_offset:
            position = pose[:, :3] + to_world(pose[:, 3:], np.broadcast_to(self.offset_m, (len(pose), 3)))
            pose = np.hstack([position, _multiply(pose[:, 3:], self.offset_quat)])
        return np.hstack([pose, qpos[:, self.joint_qpos]])

    def log_qvel(self, qpos: FloatArray, qvel: FloatArray) -> FloatArray:
        """Root twist and joint velocities, shape (n, 6 + n_j), of the world's state, shapes (n, nq), (n, nv)."""
        twist = qvel[:, self.free_dof : self.free_dof + 6]
        if self._has_offset:
            attitude = qpos[:, self.free_qpos + 3 : self.free_qpos + 7]
            arm = to_world(attitude, np.cross(twist[:, 3:], self.offset_m))
            turned = to_body(np.broadcast_to(self.offset_quat, (len(twist), 4)), twist[:, 3:])
            twist = np.hstack([twist[:, :3] + arm, turned])
        return np.hstack([twist, qvel[:, self.joint_dof]])

    @property
    def _has_offset(self) -> bool:
        return bool(self.offset_m.any() or self.offset_quat[1:].any())


def _free_body(model: mujoco.MjModel, root_body: str | None) -> int:
    """The body that carries the robot's free joint."""
    free = [int(model.jnt_bodyid[j]) for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE]
    if not free:
        raise ModelError("The world has no body with a free joint, so no floating-base robot.")
    if root_body is None:
        under = [sum(_is_under(model, int(b), body) for b in model.jnt_bodyid) for body in free]
        return free[int(np.argmax(under))]
    names: dict[str, int] = {}
    for body in free:
        prefix, root = _frame(model, body)
        full = model.body(root).name
        names |= {full.removeprefix(prefix): body, full: body}
    if root_body not in names:
        raise ModelError(unknown_name("floating body", root_body, names, "The world"))
    return names[root_body]


def _frame(model: mujoco.MjModel, free: int) -> tuple[str, int]:
    """Prefix of the robot's names, and its root body: the one welded to the frame if the free body is a frame."""
    name: str = model.body(free).name
    if not name.endswith(_SEPARATOR):
        return name[: name.rfind(_SEPARATOR) + 1], free
    children = [b for b in range(1, model.nbody) if model.body_parentid[b] == free and b != free]
    if len(children) != 1 or model.body_jntnum[children[0]]:
        raise ModelError(f"The frame '{name}' should hold one root body without joints; it holds {len(children)}.")
    return name, children[0]


def _is_under(model: mujoco.MjModel, body: int, ancestor: int) -> bool:
    while body > ancestor:
        body = int(model.body_parentid[body])
    return body == ancestor


def _multiply(left: FloatArray, right: FloatArray) -> FloatArray:
    """Hamilton product of quaternions (wxyz), shapes (n, 4) and (4,)."""
    scalar = left[:, :1] * right[0] - left[:, 1:] @ right[1:, None]
    vector = left[:, :1] * right[1:] + right[0] * left[:, 1:] + np.cross(left[:, 1:], right[1:])
    return np.hstack([scalar, vector])
