"""What a walker must know about a humanoid's body, read from its MuJoCo model.

Feet, soles, legs, knees, torso and arms are found from the kinematic tree at qpos0, in which the robot must stand
upright with level feet. A name given by the caller replaces what would be guessed.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.errors import ModelError, unknown_name
from massid.typing import FloatArray, IntArray

_PITCH_AXIS_MIN = 0.8
_GRAVITY_M_S2 = 9.81


@dataclass(frozen=True)
class Sole:
    """The rectangle a foot stands on.

    Attributes:
        body_id: the foot.
        body_name: its name.
        centre: centre of the rectangle in the foot's frame [m], shape (3,).
        rotation: axes of the sole (x forward, z up) in the foot's frame, shape (3, 3).
        half_length_m: half extent along x [m].
        half_width_m: half extent along y [m].
    """

    body_id: int
    body_name: str
    centre: FloatArray
    rotation: FloatArray
    half_length_m: float
    half_width_m: float


@dataclass(frozen=True)
class Morphology:
    """The parts of a humanoid, by index into its model.

    Attributes:
        root_id: body with the free joint.
        torso_id: heaviest body above the legs; the root itself if no other is heavier.
        soles: left sole, right sole.
        leg_dofs: dofs of the left and right leg from hip to ankle, two arrays of shape (n_leg,).
        knee_dofs: dof of each knee, shape (2,).
        knee_bend_signs: sign of the knee joint's coordinate when it bends, shape (2,).
        knee_straight_rad: the coordinate at which each knee is straight, shape (2,).
        back_dofs: dofs between root and torso, shape (n_back,).
        arm_dofs: all other actuated dofs, shape (n_arm,).
        leg_length_m: hip pitch axis to sole with a straight knee [m].
        hip_height_m: root origin above the sole with straight legs [m].
        foot_spacing_m: lateral distance between the soles' centres [m].
        torque_limits_nm: limit of each joint dof, zero without a motor, shape (nv - 6,).
        total_mass_kg: of the model.
    """

    root_id: int
    torso_id: int
    soles: tuple[Sole, Sole]
    leg_dofs: tuple[IntArray, IntArray]
    knee_dofs: IntArray
    knee_bend_signs: FloatArray
    knee_straight_rad: FloatArray
    back_dofs: IntArray
    arm_dofs: IntArray
    leg_length_m: float
    hip_height_m: float
    foot_spacing_m: float
    torque_limits_nm: FloatArray
    total_mass_kg: float

    @property
    def foot_names(self) -> tuple[str, str]:
        """Names of the left and the right foot body."""
        return (self.soles[0].body_name, self.soles[1].body_name)

    @classmethod
    def from_model(
        cls,
        model: mujoco.MjModel,
        feet: tuple[str, str] | None = None,
        torso: str | None = None,
    ) -> Morphology:
        """Read the morphology of a robot-only model.

        Args:
            model: robot without a floor, one free joint first and one-axis joints after it.
            feet: names of the left and right foot body; guessed if None.
            torso: name of the torso body; guessed if None.

        Returns:
            The robot's parts.

        Raises:
            ModelError: no free joint at the front, other joints than hinges and slides, no two feet with collision
                geoms, or no knee; a given name does not exist.
        """
        root_id = _root_body(model)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        foot_ids = _named(model, feet) if feet else _guess_feet(model, data)
        soles = (_sole(model, data, foot_ids[0]), _sole(model, data, foot_ids[1]))
        legs = (_chain_dofs(model, root_id, foot_ids[0]), _chain_dofs(model, root_id, foot_ids[1]))
        torso_id = _named(model, (torso,))[0] if torso else _guess_torso(model, root_id, foot_ids)
        back = _chain_dofs(model, root_id, torso_id)
        used = set(np.concatenate([*legs, back]).tolist())
        arms = np.array([i for i in range(6, model.nv) if i not in used], dtype=np.int64)
        knees = np.array([_knee(model, data, leg) for leg in legs], dtype=np.int64)
        signs = np.array([np.sign(data.xaxis[model.dof_jntid[dof]][1]) for dof in knees])
        straight = np.array([_straight_knee(model, data, leg, knee) for leg, knee in zip(legs, knees, strict=True)])
        centres = [_sole_centre(data, sole) for sole in soles]
        hip = data.xanchor[model.dof_jntid[_pitch_dofs(model, data, legs[0])[0]]]
        return cls(
            root_id=root_id,
            torso_id=torso_id,
            soles=soles,
            leg_dofs=legs,
            knee_dofs=knees,
            knee_bend_signs=signs,
            knee_straight_rad=straight,
            back_dofs=back,
            arm_dofs=arms,
            leg_length_m=float(hip[2] - centres[0][2]),
            hip_height_m=float(data.xpos[root_id][2] - centres[0][2]),
            foot_spacing_m=float(centres[0][1] - centres[1][1]),
            torque_limits_nm=torque_limits(model),
            total_mass_kg=float(model.body_subtreemass[root_id]),
        )


def torque_limits(model: mujoco.MjModel) -> FloatArray:
    """Largest torque of each joint dof [N m or N], shape (nv - 6,): the smallest of control, force and joint range.

    The control of a servo is no torque: its range, times its gain, counts only where there is no other limit.
    """
    limits = np.zeros(model.nv)
    for actuator in range(model.nu):
        if int(model.actuator_trntype[actuator]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            continue
        joint = model.actuator_trnid[actuator, 0]
        gain, gear = abs(model.actuator_gainprm[actuator, 0]), abs(model.actuator_gear[actuator, 0])
        ranges = []
        if model.actuator_forcelimited[actuator]:
            ranges.append(gear * float(np.min(np.abs(model.actuator_forcerange[actuator]))))
        if model.jnt_actfrclimited[joint]:
            ranges.append(float(np.min(np.abs(model.jnt_actfrcrange[joint]))))
        if model.actuator_ctrllimited[actuator] and not (ranges and is_servo(model, actuator)):
            ranges.append(gear * gain * float(np.min(np.abs(model.actuator_ctrlrange[actuator]))))
        limits[model.jnt_dofadr[joint]] = min(ranges, default=np.inf)
    return limits[6:]


def is_servo(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator holds a position or a velocity: its force depends on the joint's state."""
    return int(model.actuator_biastype[actuator]) == int(mujoco.mjtBias.mjBIAS_AFFINE)


def natural_frequency(com_height_m: float) -> float:
    """Rate of the linear inverted pendulum [1/s], sqrt(g / z)."""
    return float(np.sqrt(_GRAVITY_M_S2 / com_height_m))


def _root_body(model: mujoco.MjModel) -> int:
    one_axis = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    if model.njnt == 0 or int(model.jnt_type[0]) != int(mujoco.mjtJoint.mjJNT_FREE):
        raise ModelError("A walking robot's first joint must be a free joint; this model's is not.")
    for joint in range(1, model.njnt):
        if int(model.jnt_type[joint]) not in one_axis:
            raise ModelError(f"Joint '{model.joint(joint).name}' is neither a hinge nor a slide.")
    return int(model.jnt_bodyid[0])


def _named(model: mujoco.MjModel, names: tuple[str, ...]) -> tuple[int, ...]:
    known = [model.body(i).name for i in range(model.nbody)]
    for name in names:
        if name not in known:
            raise ModelError(unknown_name("body", name, known, "The model"))
    return tuple(known.index(name) for name in names)


def _colliding_geoms(model: mujoco.MjModel, body: int) -> list[int]:
    """Geoms that can touch, of a body and of those that are welded to it, such as a toe to its foot."""
    colliding = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    welded = model.body_weldid[model.geom_bodyid] == model.body_weldid[body]
    found: list[int] = np.flatnonzero(colliding & welded).tolist()
    return found


def _corners(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> FloatArray:
    """World positions of points that bound the geom, of round ones those below their centres, shape (n, 3)."""
    points: FloatArray
    kind, radius_m = int(model.geom_type[geom]), model.geom_size[geom, 0]
    if kind in (int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)):
        half_m = model.geom_size[geom, 1] if kind == int(mujoco.mjtGeom.mjGEOM_CAPSULE) else 0.0
        axis = data.geom_xmat[geom].reshape(3, 3)[:, 2]
        points = data.geom_xpos[geom] + np.outer([-half_m, half_m], axis) - np.array([0.0, 0.0, radius_m])
        return points
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    local = model.geom_aabb[geom, :3] + signs * model.geom_aabb[geom, 3:]
    points = local @ data.geom_xmat[geom].reshape(3, 3).T
    points += data.geom_xpos[geom]
    return points


def _guess_feet(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[int, int]:
    lowest = {}
    for body in range(1, model.nbody):
        if model.body_weldid[body] != body:
            continue
        geoms = _colliding_geoms(model, body)
        if geoms:
            points = np.concatenate([_corners(model, data, geom) for geom in geoms])
            lowest[body] = float(points[:, 2].min())
    if len(lowest) < 2:
        raise ModelError(f"The model has {len(lowest)} bodies that can touch the floor; walking takes two feet.")
    pair = sorted(lowest, key=lambda body: lowest[body])[:2]
    left, right = sorted(pair, key=lambda body: -float(data.xpos[body][1]))
    return left, right


def _sole(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> Sole:
    geoms = _colliding_geoms(model, body)
    name = model.body(body).name
    if not geoms:
        raise ModelError(f"Foot '{name}' has no geom that can touch the floor.")
    points = np.concatenate([_corners(model, data, geom) for geom in geoms])
    floor_m = float(points[:, 2].min())
    bottom = points[points[:, 2] < floor_m + 0.005]
    low, high = bottom.min(axis=0), bottom.max(axis=0)
    centre = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, floor_m])
    to_foot = data.xmat[body].reshape(3, 3).T
    half_length, half_width = (high[:2] - low[:2]) / 2
    if min(half_length, half_width) < 0.01:
        raise ModelError(f"Foot '{name}' stands on {half_length:.3f} x {half_width:.3f} m; both must exceed 0.01 m.")
    return Sole(
        body_id=body,
        body_name=name,
        centre=to_foot @ (centre - data.xpos[body]),
        rotation=to_foot.copy(),
        half_length_m=float(half_length),
        half_width_m=float(half_width),
    )


def _sole_centre(data: mujoco.MjData, sole: Sole) -> FloatArray:
    centre: FloatArray = data.xpos[sole.body_id] + data.xmat[sole.body_id].reshape(3, 3) @ sole.centre
    return centre


def _ancestors(model: mujoco.MjModel, body: int) -> list[int]:
    chain = [body]
    while chain[-1] != 0:
        chain.append(int(model.body_parentid[chain[-1]]))
    return chain


def _chain_dofs(model: mujoco.MjModel, root: int, body: int) -> IntArray:
    """Dofs of the joints from root (excluded) to body (included), in that order."""
    chain = _ancestors(model, body)
    bodies = chain[: chain.index(root)][::-1]
    dofs = [d for b in bodies for d in range(model.body_dofadr[b], model.body_dofadr[b] + model.body_dofnum[b])]
    return np.array(dofs, dtype=np.int64)


def _guess_torso(model: mujoco.MjModel, root: int, feet: tuple[int, ...]) -> int:
    legs = {body for foot in feet for body in _ancestors(model, foot)} - set(_ancestors(model, root))
    best = root
    for body in range(root + 1, model.nbody):
        if legs.isdisjoint(_ancestors(model, body)) and model.body_mass[body] > model.body_mass[best]:
            best = body
    return best


def _pitch_dofs(model: mujoco.MjModel, data: mujoco.MjData, leg: IntArray) -> list[int]:
    return [int(d) for d in leg if abs(data.xaxis[model.dof_jntid[d]][1]) > _PITCH_AXIS_MIN]


def _knee(model: mujoco.MjModel, data: mujoco.MjData, leg: IntArray) -> int:
    pitch = _pitch_dofs(model, data, leg)
    if len(pitch) != 3:
        raise ModelError(f"A leg must have three pitch joints (hip, knee, ankle) at qpos0; this one has {len(pitch)}.")
    return pitch[1]


def _straight_knee(model: mujoco.MjModel, data: mujoco.MjData, leg: IntArray, knee: np.int64) -> float:
    """Knee coordinate at which hip, knee and ankle pitch axes lie in one line, seen from the side."""
    hip, middle, ankle = (data.xanchor[model.dof_jntid[d]][[0, 2]] for d in _pitch_dofs(model, data, leg))
    thigh, calf = middle - hip, ankle - middle
    bend = np.arctan2(calf[0], -calf[1]) - np.arctan2(thigh[0], -thigh[1])
    sign = np.sign(data.xaxis[model.dof_jntid[knee]][1])
    return float(model.qpos0[knee + 1] + sign * bend)
