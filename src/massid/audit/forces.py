"""Do torques and wrenches of a log make sense: weight, direction of gravity, and what the balance leaves over."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from massid.audit.balance import Balance
from massid.audit.conventions import likely_conventions
from massid.errors import LogError
from massid.model.inverse import takes_stages
from massid.model.kinematics import body_rotations
from massid.model.robot import Robot
from massid.typing import FloatArray
from massid.walk import Walk
from massid.walk.noise import PRESETS, SensorNoise
from massid.walk.white_noise import CLEAN_VELOCITY, white_level

WEIGHT_RANGE = (0.6, 1.6)
"""Measured over nominal weight: beyond this it is not a mass error but another fault."""
TILT_RAD = 0.17
_MARGIN = 1.3  # noise levels read off a log are this uncertain
REST = 0.05
"""Share of the required force that inputs and any link masses may leave over before it is worth a warning."""
_SLOW = PRESETS["realistic"]
"""Offsets and gains, which no log shows, are taken to be in proportion to the white noise, which it does show."""
_SURE = 2.0
"""They are the same all along, so their sum of squares scatters more than that of noise: allowed in deviations."""
_EXACT = 1e-6
_RUNGE_KUTTA = (
    "the model integrates with RK4, whose step has no single torque and wrench; a simulation with Euler or "
    "implicitfast is replayed exactly"
)
_BETTER, _BETTER_FITTED, _BETTER_IN_NOISE = 0.5, 0.3, 0.7
_MOST_LEFT = 0.1
"""Share of the unexplained force that a convention may leave besides what the sensors' noise does: it explains it."""
_WORTH = 1e-3
"""Share of the required force below which no convention can be wrong."""
_LEAST_ITERATIONS, _LARGEST_TOLERANCE = 30, 1e-6
"""Of a constraint solver that runs to the end: Newton's takes ten at most."""
_NOTEWORTHY = 1e-3
"""Share that a solver leaves which masses notice."""
_MOVING = 0.02
"""Standard deviation of a velocity beyond which a joint is said to move [rad/s]."""
_LOADED = 0.02  # of the weight: less than this on a body is no stance
_SHOWN = 4
_IMPLICIT = (int(mujoco.mjtIntegrator.mjINT_IMPLICIT), int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST))


@dataclass(frozen=True)
class Weight:
    """What the ground carried on average.

    Attributes:
        measured_kg: mean force along gravity, less what lifted the base, over g; what `gravcomp` bears added; None if
            some body's force has no sensor [kg].
        nominal_kg: mass of the model [kg].
        tilt_rad: angle between the mean force and the upward vertical [rad].
        loaded: by contact body with a sensor, share of the samples in which it carried load.
        stances: by contact body with a sensor, how many times it was put down.
    """

    measured_kg: float | None
    nominal_kg: float
    tilt_rad: float
    loaded: dict[str, float]
    stances: dict[str, int]

    @property
    def plausible(self) -> bool:
        """Whether a mass error may be all that is between them."""
        return self.measured_kg is None or WEIGHT_RANGE[0] <= self.measured_kg / self.nominal_kg <= WEIGHT_RANGE[1]


def check_weight(robot: Robot, walk: Walk) -> Weight:
    """Sum the measured forces in the world over a walk that is aligned with the robot."""
    rotations = body_rotations(robot.model, robot.layout.to_qpos(walk.qpos), walk.contact_bodies)
    force = np.einsum("kcij,kcj->kci", rotations, walk.wrench[:, :, :3])
    gravity = robot.model.opt.gravity
    size = float(np.linalg.norm(gravity)) or 9.81
    up = -gravity / size if np.any(gravity) else np.array([0.0, 0.0, 1.0])
    inside = np.zeros(len(walk), dtype=bool)
    gained, time_s = np.zeros(3), 0.0
    for segment in walk.segments:
        inside[segment.start : segment.stop] = True
        gained += walk.qvel[segment.stop - 1, :3] - walk.qvel[segment.start, :3]
        time_s += len(segment) * walk.timestep_s
    total = force[inside].sum(axis=1).mean(axis=0)
    lift = float(up @ gained) / time_s
    tilt = float(np.arccos(np.clip(up @ total / max(float(np.linalg.norm(total)), 1e-9), -1.0, 1.0)))
    on_body = np.linalg.norm(force, axis=2) > _LOADED * robot.total_mass_kg * size
    with_sensor = np.asarray(walk.measured[:, :3].all(axis=1))
    bodies = [(c, body) for c, body in enumerate(walk.contact_bodies) if with_sensor[c]]
    loaded = {body: float(on_body[inside, c].mean()) for c, body in bodies}
    stances = {body: _landings(walk, on_body[:, c]) for c, body in bodies}
    measured_kg = (float(up @ total) + size * robot.lifted_kg({})) / (size + lift)
    return Weight(measured_kg if with_sensor.all() else None, robot.total_mass_kg, tilt, loaded, stances)


def _landings(walk: Walk, loaded: FloatArray) -> int:
    """Count runs of load; touches shorter than 20 ms are not counted."""
    least = max(1, round(0.02 / walk.timestep_s))
    count = 0
    for segment in walk.segments:
        part = np.concatenate([[False], loaded[segment.start : segment.stop], [False]]).astype(int)
        edges = np.flatnonzero(np.diff(part))
        count += int(((edges[1::2] - edges[::2]) >= least).sum())
    return count


def weight_suspicions(weight: Weight) -> list[str]:
    """What is probably wrong with wrenches that do not carry the robot."""
    if weight.measured_kg is None:
        return []
    ratio = weight.measured_kg / weight.nominal_kg
    said = f"the ground carries {weight.measured_kg:.1f} kg on average, the model weighs {weight.nominal_kg:.1f} kg"
    if weight.plausible and weight.tilt_rad < TILT_RAD:
        return []
    if ratio < -WEIGHT_RANGE[0] and ratio > -WEIGHT_RANGE[1]:
        return [f"{said}: the forces look as if they were those on the ground (contacts: on: ground)."]
    if weight.tilt_rad >= TILT_RAD and abs(ratio) > 0.2:
        degrees = np.degrees(weight.tilt_rad)
        return [
            f"the mean contact force leans {degrees:.0f} degrees from the vertical ({said}): check the frame of the "
            "wrenches (contacts: frame, rotation) and the order of the base's attitude."
        ]
    if 0.0 <= ratio < WEIGHT_RANGE[0]:
        return [f"{said}: a body that touches the ground may have no wrench topic, or forces may not be in newtons."]
    return [f"{said}: forces may not be in newtons, or a wrench may be counted twice."]


def check_torques(robot: Robot, walk: Walk, passive: Sequence[str] = ()) -> None:
    """Pass if a log shows any torque, or no load either, as in a free fall.

    Args:
        robot: with joints.
        walk: aligned with the robot.
        passive: joints that are said to have no actuator.

    Raises:
        LogError: the torque of every joint is zero all along, although the ground carries the robot.
    """
    carried = walk.wrench.any() or bool(walk.open_axes)
    if walk.effort.any() or not carried or set(passive) >= set(walk.joint_names):
        return
    raise LogError(
        f"{walk.source}: the effort of all {len(walk.joint_names)} joints of {robot.source} is 0 in every sample: the "
        "log holds no torques (a simulator without an effort interface?), and without them no mass can be known. "
        "`joints: effort` in a topic map says where they are."
    )


def torque_suspicions(robot: Robot, walk: Walk) -> list[str]:
    """Name driven joints that move while their torque channel reads one number all along, and others do not."""
    model, rows = robot.model, np.concatenate([np.arange(part.start, part.stop) for part in walk.segments])
    spread = np.ptp(walk.effort[rows], axis=0)
    is_flat = spread <= _EXACT * np.abs(walk.effort).max(initial=0.0)
    moves = walk.qvel[rows, 6:].std(axis=0) > _MOVING
    on_joints = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    driven = {model.joint(int(joint)).name for joint in model.actuator_trnid[on_joints, 0]}
    dead = [
        name
        for name, flat, moving in zip(robot.joint_names, is_flat, moves, strict=True)
        if flat and moving and (name in driven or not model.nu)
    ]
    if not dead or is_flat.all():
        return []
    more = f" and {len(dead) - _SHOWN} more" if len(dead) > _SHOWN else ""
    return [
        f"the torque of {', '.join(dead[:_SHOWN])}{more} never changes although the joint moves: a channel that is not "
        "connected, or not mapped (joints: effort)."
    ]


@dataclass(frozen=True)
class Rest:
    """What neither the inputs nor any link masses explain.

    Attributes:
        share: of the required force, root mean square over all degrees of freedom.
        joints: by degree of freedom ("base" for the free joint), the same for it alone.
        suspicions: what is probably wrong, one line each.
        then: what the convention that they name would leave; None if they name none.
        blames_wrenches: whether it is one of the wrenches.
        beyond_noise: whether no convention explains it, and no noise of the sensors.
    """

    share: float
    joints: dict[str, float]
    suspicions: tuple[str, ...]
    then: float | None = None
    blames_wrenches: bool = False
    beyond_noise: bool = False

    @property
    def names_a_setting(self) -> bool:
        """Whether another convention explains it."""
        return self.then is not None

    @property
    def sound(self) -> bool:
        """Whether nothing is left but what the sensors' noise or a simulation's step may leave."""
        return not (self.names_a_setting or self.beyond_noise)


def check_rest(robot: Robot, walk: Walk, balance: Balance, weight: Weight | None = None) -> Rest:
    """Look at what the balance leaves over, and for the convention that would leave less.

    Args:
        robot: with nominal masses.
        walk: aligned with the robot.
        balance: of this walk.
        weight: what the ground carries, which tells wrong torques from wrong wrenches.
    """
    required = balance.smooth(balance.required)
    effort, wrench = walk.effort[balance.rows], walk.wrench[balance.rows]
    size = float(np.linalg.norm(balance.smooth(balance.required, whole=bool(walk.open_axes)))) or 1.0
    supplied = balance.smooth(balance.force_of_torques(effort, robot) + balance.force_of(wrench))
    rest = balance.unexplained(required - supplied)
    share = float(np.linalg.norm(rest)) / size
    joints = _by_joint(robot, rest.reshape(-1, balance.required.shape[1]), required.reshape(-1, robot.model.nv))
    if share <= _WORTH:
        return Rest(share, joints, _of_simulation(robot, walk, share))
    white = _noise_of(robot, walk, balance, len(rest) // balance.required.shape[1])

    def allowed(effort: FloatArray, wrench: FloatArray) -> float:
        errors = slow_errors(robot, walk, balance, effort, wrench)
        slow = float(np.sqrt(sum(np.sum(balance.unexplained(error) ** 2) for error in errors)))
        return float(np.hypot(REST, np.hypot(white, _SURE * slow) / size))

    within = share <= allowed(effort, wrench)
    carried = weight is None or weight.plausible
    gain = _slow_noise(walk).effort_gain
    said = f"{share:.0%} of the force that the motion took is explained neither by the log nor by any link masses"
    worst = sorted(joints, key=lambda name: -joints[name])[:_SHOWN]
    # Without force sensors any multiple of the torques fits some masses: nothing stands beside their scale.
    others = () if walk.open_axes else likely_conventions(robot, walk, balance, carried=carried, gain=gain)
    for other in others:
        if other.of_gains and _implicit_servos(robot, worst):
            continue
        then = float(np.linalg.norm(other.rest)) / size
        within_then = then < allowed(other.effort, other.wrench)
        # Noise is left by every convention: beside it, the right one need not leave half. But it leaves little else.
        in_noise = within or (white > 0.0 and within_then)
        better = _BETTER_IN_NOISE if in_noise else _BETTER_FITTED if other.fitted else _BETTER
        if then < better * share and (within_then or then < _MOST_LEFT * share):
            return Rest(
                share,
                joints,
                (f"{said}: {other.reason} (then {then:.0%}).",),
                then=then,
                blames_wrenches=not np.array_equal(other.wrench, wrench),
            )
    if within:
        return Rest(share, joints, _of_simulation(robot, walk, share))
    listed = ", ".join(f"{name} {joints[name]:.0%}" for name in worst)
    return Rest(share, joints, (f"{said}, most of it at {listed}: {_reason(robot, worst)}.",), beyond_noise=True)


def _noise_of(robot: Robot, walk: Walk, balance: Balance, count: int) -> float:
    """Norm of what white noise of the velocities adds to so many smoothed required forces, all dofs weighted."""
    qvel = robot.layout.to_qvel(walk.qvel)
    std = np.zeros(robot.model.nv)
    root = robot.layout.root_dof
    groups = (np.arange(root, root + 3), np.arange(root + 3, root + 6), robot.layout.joint_dof)
    for dofs in groups:
        std[dofs] = white_level(qvel[:, dofs])
    if not std.any():
        return 0.0
    kernel = np.hanning(balance.smoothing + 2)[1:-1]
    roughness = np.linalg.norm(np.diff(np.pad(kernel / kernel.sum(), 1)))
    data = mujoco.MjData(robot.model)
    data.qpos[:] = robot.layout.to_qpos(walk.qpos[balance.rows[len(balance.rows) // 2]])
    mujoco.mj_fwdPosition(robot.model, data)
    inertia = np.zeros((robot.model.nv, robot.model.nv))
    mujoco.mj_fullM(robot.model, data, inertia)
    force = np.linalg.norm(inertia * std, axis=1) * roughness / walk.timestep_s
    return float(_MARGIN * np.sqrt(count) * np.linalg.norm(force * balance.weight))


def _slow_noise(walk: Walk) -> SensorNoise:
    """Offsets and gains in proportion to the white noise of a log: to that at 1 kHz which would tell as much."""
    at_1_khz = white_level(walk.qvel[:, 6:]) * np.sqrt(walk.timestep_s / 1e-3)
    return _SLOW.scaled(float(at_1_khz) / _SLOW.joint_velocity)


def slow_errors(
    robot: Robot, walk: Walk, balance: Balance, effort: FloatArray, wrench: FloatArray
) -> Iterator[FloatArray]:
    """What one deviation of each offset and gain of torque and force sensors adds to the balance, smoothed, shape (m,).

    Args:
        robot: whose joints have the torques.
        walk: whose noise tells the deviations.
        balance: of this walk.
        effort: torques of the steps, shape (K, n_j).
        wrench: wrenches of the steps, shape (K, n_c, 6).
    """
    slow = _slow_noise(walk)
    steps = np.ones((len(balance.rows), 1))
    wrench = wrench.reshape(len(steps), -1)
    jacobian = balance.jacobian.reshape(len(steps), -1, robot.model.nv)
    for column, dof in enumerate(robot.layout.joint_dof):
        unit = np.eye(robot.model.nv)[dof]
        yield balance.smooth(slow.effort_offset * steps * unit)
        yield balance.smooth(slow.effort_gain * effort[:, column, None] * unit)
    for column in range(wrench.shape[1]):
        yield balance.smooth(slow.wrench_gain * wrench[:, column, None] * jacobian[:, column])
        if column % 6 < 3:
            yield balance.smooth(slow.force_offset * jacobian[:, column])


def _by_joint(robot: Robot, rest: FloatArray, required: FloatArray) -> dict[str, float]:
    layout = robot.layout
    groups = {"base": np.arange(layout.root_dof, layout.root_dof + 6)}
    groups |= {name: np.array([dof]) for name, dof in zip(robot.joint_names, layout.joint_dof, strict=True)}
    return {
        name: float(np.linalg.norm(rest[:, dofs]) / max(float(np.linalg.norm(required[:, dofs])), 1e-12))
        for name, dofs in groups.items()
    }


def _of_simulation(robot: Robot, walk: Walk, share: float) -> tuple[str, ...]:
    """Say what a small rest comes from if the model's own integrator or solver explains it.

    Under noise, an integrator adds to it.
    """
    if share < _EXACT:
        return ()
    if not takes_stages(robot.model):
        early = stopped_early(robot.model)
        if early is None or share < _NOTEWORTHY or white_level(walk.qvel[:, 6:]) >= CLEAN_VELOCITY:
            return ()
        return (f"{share:.2%} of the force that the motion took stays unexplained: {early}.",)
    if white_level(walk.qvel[:, 6:]) >= CLEAN_VELOCITY:
        return (f"{_RUNGE_KUTTA}.",)
    return (f"{share:.2%} of the force that the motion took stays unexplained: {_RUNGE_KUTTA}.",)


def stopped_early(model: mujoco.MjModel) -> str | None:
    """What is to be said of simulations with a model whose solver does not run to the end; None if it does."""
    option = model.opt
    settles = option.solver != mujoco.mjtSolver.mjSOL_PGS and option.tolerance <= _LARGEST_TOLERANCE
    if option.iterations >= _LEAST_ITERATIONS and settles:
        return None
    solver = mujoco.mjtSolver(option.solver).name.removeprefix("mjSOL_")
    return (
        f"in a simulation with this model the {solver} solver stops after {option.iterations} iterations or at a "
        f"tolerance of {option.tolerance:g}, before the forces of contacts, friction and limits are found; record with "
        f'<option solver="Newton" iterations="100" tolerance="1e-10"/>'
    )


def gravity_is_off(model: mujoco.MjModel) -> bool:
    """Whether nothing weighs anything in a model."""
    return bool(model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY) or not np.any(model.opt.gravity)


def _reason(robot: Robot, worst: list[str]) -> str:
    """What is known to leave such a rest in this model."""
    model = robot.model
    if gravity_is_off(model):
        return 'the model has no gravity (<option gravity="..."/>, <flag gravity="disable"/>)'
    if takes_stages(model):
        return _RUNGE_KUTTA
    servos = _implicit_servos(robot, worst)
    if servos:
        return (
            f"{servos[0]} is a servo whose torque depends on velocity, and the model's integrator is implicit: the "
            "torque at the start of a step is then not what acted over it; log the torque that makes the step, or use "
            "Euler"
        )
    checked = (
        "check the torques (after gears? without friction?), the joint order, a contact without a wrench topic, and "
        "contact between the robot's own links"
    )
    early = stopped_early(model)
    return checked if early is None else f"{checked}; or {early}"


def _implicit_servos(robot: Robot, joints: Sequence[str]) -> list[str]:
    """Actuators of some joints whose torque depends on velocity, under an implicit integrator."""
    model = robot.model
    if int(model.opt.integrator) not in _IMPLICIT:
        return []
    return [
        model.actuator(a).name or model.joint(int(model.actuator_trnid[a, 0])).name
        for a in range(model.nu)
        if model.actuator_biasprm[a, 2] != 0.0
        and int(model.actuator_trntype[a]) == int(mujoco.mjtTrn.mjTRN_JOINT)
        and model.joint(int(model.actuator_trnid[a, 0])).name in joints
    ]
