"""The walker: a state machine of shifts and swings around the DCM plan and the whole-body programme."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

import mujoco
import numpy as np

from massid.errors import ModelError
from massid.typing import FloatArray
from massid.walking.dcm import DcmPiece, ZmpPiece, plan_dcm
from massid.walking.excitation import Excitation
from massid.walking.footsteps import LEFT, RIGHT, FootPose, FootstepPlanner, Step
from massid.walking.gait import REFERENCE_LEG_M, Gait
from massid.walking.morphology import Morphology, natural_frequency
from massid.walking.qp import Contact, QpOptions, WholeBodyQp
from massid.walking.stance import standing_qpos
from massid.walking.state import RobotState
from massid.walking.swing import SwingTrajectory, wrap
from massid.walking.tasks import TaskOptions, Tasks

_PLANNED_STEPS = 4
_TOUCHDOWN_AFTER = 0.6
_LATEST_TOUCHDOWN_S = 0.2
_LONGEST_WAIT_S = 0.4
_LIFT_TOLERANCE_M = 0.01
_ADJUST_UNTIL = 0.8
_ADJUST_TIME_S = 0.03
_SINK_M = 0.008
_FALL_HEIGHT = 0.6
_FALL_TILT_RAD = 1.0


class Phase(Enum):
    """What the feet do."""

    STAND = "stand"
    DOUBLE = "double support"
    SINGLE = "single support"


@dataclass(frozen=True)
class WalkerOptions:
    """Settings of a walker that do not depend on the gait.

    Attributes:
        control_period_s: torques are held for this long.
        knee_bend_rad: bend of the knees when standing.
        touchdown_share: part of the robot's weight on the swinging foot that counts as touchdown.
        dcm_gain: k of p = p_ref + (1 + k/w)(xi - xi_ref) [1/s].
        adjust_m: farthest that a landing is moved, forward and sideways, when the sole is too small to correct the DCM.
        tasks: gains and weights of the tasks.
        qp: weights and margins of the programme.
    """

    control_period_s: float = 0.002
    knee_bend_rad: float = 0.65
    touchdown_share: float = 0.025
    dcm_gain: float = 3.0
    adjust_m: float = 0.12
    tasks: TaskOptions = field(default_factory=TaskOptions)
    qp: QpOptions = field(default_factory=QpOptions)


class Walker:
    """Walks a humanoid by joint torques.

    It knows the robot only by the model it is given, never the true one, and senses joint and base states and the
    vertical load of each foot.

    Args:
        model: nominal robot without a floor; copied.
        gait: how to walk.
        rng: source of the gait's randomness.
        options: settings.
        morphology: the robot's parts; read from the model if None.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        gait: Gait,
        rng: np.random.Generator,
        options: WalkerOptions | None = None,
        morphology: Morphology | None = None,
    ) -> None:
        self._options = options or WalkerOptions()
        self._gait = gait
        self._morphology = morphology or Morphology.from_model(model)
        self._planner = FootstepPlanner(gait, self._morphology, rng)
        self._qp = WholeBodyQp(self._morphology.torque_limits_nm, self._options.qp)
        self._joint_names = tuple(model.joint(j).name for j in range(1, model.njnt))
        self._take_model(model)
        self._stand_qpos = standing_qpos(self._model, self._morphology, self._options.knee_bend_rad)
        self._excitation = Excitation(gait, self._model, self._morphology, rng)
        self._tasks = Tasks(self._model, self._morphology, self._stand_qpos, self._options.tasks)
        self._state.update(self._stand_qpos, np.zeros(self._model.nv))
        self._com_height_m = float(self._state.com[2])
        self._frequency = natural_frequency(self._com_height_m)
        self._torques = np.zeros(self._model.nv - 6)
        self._held_until_s = -np.inf
        self._phase: Phase | None = None
        self.failed_solves = 0

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in the order of the torques."""
        return self._joint_names

    @property
    def foot_names(self) -> tuple[str, str]:
        """Names of the foot bodies in the order of the loads."""
        return self._morphology.foot_names

    @property
    def morphology(self) -> Morphology:
        """The robot's parts."""
        return self._morphology

    @property
    def phase(self) -> Phase | None:
        """What the feet do; None before the first control."""
        return self._phase

    def initial_qpos(self) -> FloatArray:
        """Standing pose with level soles on z = 0, shape (nq,)."""
        return self._stand_qpos.copy()

    def update_model(self, model: mujoco.MjModel) -> None:
        """Go on with other masses, as an estimate improves.

        Args:
            model: the same robot with other masses, inertias or centres of mass; copied.

        Raises:
            ModelError: the joints are not those of the first model.
        """
        names = tuple(model.joint(j).name for j in range(1, model.njnt))
        if names != self._joint_names:
            raise ModelError(f"The new model's joints differ: {', '.join(set(names) ^ set(self._joint_names))}.")
        self._take_model(model)

    def _take_model(self, model: mujoco.MjModel) -> None:
        self._model = model.__copy__()
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._state = RobotState(self._model, self._morphology)

    def has_fallen(self, qpos: FloatArray) -> bool:
        """Tell whether the root has sunk below 0.6 of its standing height or leans by more than 1 rad."""
        up = 1 - 2 * (qpos[4] ** 2 + qpos[5] ** 2)
        low = qpos[2] < _FALL_HEIGHT * self._stand_qpos[2]
        return bool(low or up < np.cos(_FALL_TILT_RAD) or not np.isfinite(qpos).all())

    def control(self, time_s: float, qpos: FloatArray, qvel: FloatArray, foot_load_n: FloatArray) -> FloatArray:
        """Compute the torques for this instant.

        Args:
            time_s: time since the walk's start [s], not decreasing.
            qpos: measured positions, shape (nq,).
            qvel: measured velocities in MuJoCo's convention, shape (nv,).
            foot_load_n: vertical force on the left and the right foot [N], shape (2,).

        Returns:
            Torque of each joint [N m], in the order of joint_names, shape (nv - 6,); read-only.
        """
        if time_s < self._held_until_s:
            return self._torques
        self._held_until_s = time_s + self._options.control_period_s - 1e-9
        self._state.update(qpos, qvel)
        self._advance(time_s, foot_load_n)
        self._solve(time_s)
        return self._torques

    def _advance(self, time_s: float, foot_load_n: FloatArray) -> None:
        """Move the state machine on."""
        if self._phase is None:
            self._begin(time_s)
        elapsed = time_s - self._phase_start_s
        if self._phase is Phase.DOUBLE and elapsed >= self._phase_duration_s:
            if self._may_lift() or elapsed >= self._phase_duration_s + _LONGEST_WAIT_S:
                self._start_swing(time_s)
        elif self._phase is Phase.SINGLE:
            loaded = foot_load_n[self._step.side] > self._options.touchdown_share * self._state.mass_kg * 9.81
            late = elapsed > self._phase_duration_s + _LATEST_TOUCHDOWN_S
            if late or (loaded and elapsed > _TOUCHDOWN_AFTER * self._phase_duration_s):
                self._touch_down(time_s)

    def _begin(self, time_s: float) -> None:
        feet = [foot.level_pose for foot in self._state.feet]
        self._walk_start_s = time_s
        self._floor_m = float(np.mean([foot.position[2] for foot in feet]))
        middle = (feet[LEFT].position[:2] + feet[RIGHT].position[:2]) / 2
        self._yaw_from = self._yaw_to = _mean_yaw(feet[LEFT], feet[RIGHT])
        upcoming = self._planner.upcoming(1)
        if not upcoming:
            self._stand(time_s, middle)
            return
        self._stance = 1 - upcoming[0].side
        self._double(time_s, self._gait.first_shift_s, middle)

    def _stand(self, time_s: float, zmp: FloatArray) -> None:
        """Stay on both feet for good."""
        self._phase = Phase.STAND
        self._phase_start_s, self._phase_duration_s = time_s, 1.0
        feet = [foot.level_pose for foot in self._state.feet]
        middle = (feet[LEFT].position[:2] + feet[RIGHT].position[:2]) / 2
        self._piece = plan_dcm([ZmpPiece(1.0, zmp, middle)], self._frequency)[0]
        self._yaw_from = self._yaw_to = _mean_yaw(feet[LEFT], feet[RIGHT])

    def _double(self, time_s: float, duration_s: float, zmp: FloatArray) -> None:
        """Shift the weight from zmp to the stance foot."""
        self._phase = Phase.DOUBLE
        self._phase_start_s, self._phase_duration_s = time_s, duration_s
        stance = self._state.feet[self._stance].level_pose
        self._pieces = self._plan([ZmpPiece(duration_s, zmp, stance.position[:2])], stance)
        self._piece = self._pieces[0]

    def _start_swing(self, time_s: float) -> None:
        upcoming = self._planner.upcoming(1)
        stance = self._state.feet[self._stance].level_pose
        if not upcoming:
            self._stand(time_s, stance.position[:2])
            return
        self._step = upcoming[0]
        foot = self._state.feet[self._step.side].level_pose
        landing = self._step.landing(stance)
        landing = replace(landing, position=landing.position - np.array([0.0, 0.0, _SINK_M]))
        self._phase = Phase.SINGLE
        self._phase_start_s, self._phase_duration_s = time_s, self._step.single_support_s
        self._landing = landing
        self._swing = SwingTrajectory(foot, landing, self._step.single_support_s, self._step.apex_m)
        self._yaw_from, self._yaw_to = _mean_yaw(foot, stance), _mean_yaw(landing, stance)
        self._piece = self._plan([], stance)[0]
        self._planner.take()

    def _touch_down(self, time_s: float) -> None:
        early = max(0.0, self._phase_duration_s - (time_s - self._phase_start_s))
        zmp = self._state.feet[self._stance].position[:2].copy()
        self._stance = self._step.side
        self._yaw_from = self._yaw_to
        self._double(time_s, self._step.double_support_s + early, zmp)

    def _plan(self, pieces: list[ZmpPiece], stance: FootPose) -> list[DcmPiece]:
        """Plan the coming steps from the stance foot on, after the given pieces."""
        for step in self._planner.upcoming(_PLANNED_STEPS):
            landing = step.landing(stance)
            here, there = stance.position[:2], landing.position[:2]
            pieces.append(ZmpPiece(step.single_support_s, here, here))
            pieces.append(ZmpPiece(step.double_support_s, here, there))
            stance = landing
        return plan_dcm(pieces, self._frequency)

    def _solve(self, time_s: float) -> None:
        state, options, tasks = self._state, self._options, self._tasks
        elapsed = time_s - self._phase_start_s
        since = time_s - self._walk_start_s
        height, torso = self._excitation.height(since), self._excitation.torso(since)
        swinging = self._phase is Phase.SINGLE
        feet = (self._stance,) if swinging else (LEFT, RIGHT)
        shares = self._shares(feet, self._piece.zmp_at(elapsed))
        contacts = [Contact(self._morphology.soles[i], state.feet[i], s) for i, s in zip(feet, shares, strict=True)]
        zmp = self._wanted_zmp(elapsed, swinging)
        com_xy = self._frequency**2 * (state.com[:2] - zmp)
        com_z = tasks.height(state, self._floor_m + self._com_height_m, height)
        fraction = min(elapsed / self._phase_duration_s, 1.0) if swinging else 1.0
        yaw = self._yaw_from + fraction * wrap(self._yaw_to - self._yaw_from)
        motions = [tasks.standing_foot(contact.frame) for contact in contacts]
        if swinging:
            self._adjust_landing(elapsed)
            motions.append(tasks.swinging_foot(state.feet[self._step.side], self._swing.at(elapsed)))
        motions += tasks.trunk(state, yaw, torso)
        solution = self._qp.solve(
            state,
            contacts,
            np.array([*com_xy, com_z]),
            -options.tasks.momentum_rate * state.angular_momentum,
            motions,
            tasks.joints(state, self._excitation.arms(since)),
        )
        if solution is None:
            self.failed_solves += 1
            return
        self._torques = solution.torques
        self._torques.flags.writeable = False

    def _wanted_zmp(self, elapsed: float, swinging: bool) -> FloatArray:
        state, frequency = self._state, self._frequency
        error = self._dcm() - self._piece.dcm_at(elapsed)
        zmp: FloatArray = self._piece.zmp_at(elapsed) + (1 + self._options.dcm_gain / frequency) * error
        if swinging:
            foot = state.feet[self._stance]
            axes, reach = foot.rotation[:2, :2], self._reach(self._stance)
            local = np.clip(axes.T @ (zmp - foot.position[:2]), -reach, reach)
            zmp = foot.position[:2] + axes @ local
        return zmp

    def _adjust_landing(self, elapsed: float) -> None:
        """Move the landing by the part of the DCM's final error that no zero-moment point in the sole can remove."""
        remaining = self._phase_duration_s - elapsed
        if elapsed > _ADJUST_UNTIL * self._phase_duration_s:
            return
        state, side = self._state, self._step.side
        foot = state.feet[self._stance]
        axes = foot.rotation[:2, :2]
        shift = self._within_room(self._excess(self._piece, remaining), side, self._landing)
        moved = self._landing.position.copy()
        moved[:2] += axes @ shift
        blend = min(1.0, self._options.control_period_s / _ADJUST_TIME_S)
        position = self._swing.end.position + blend * (moved - self._swing.end.position)
        self._swing = replace(self._swing, end=replace(self._swing.end, position=position))

    def _may_lift(self) -> bool:
        """Tell whether the stance foot alone can catch the DCM, with the next landing moved if need be."""
        if len(self._pieces) < 2:
            return True
        step = self._planner.upcoming(1)[0]
        excess = self._excess(self._pieces[1], step.single_support_s)
        landing = step.landing(self._state.feet[self._stance].level_pose)
        uncaught = excess - self._within_room(excess, step.side, landing)
        return bool(np.max(np.abs(uncaught)) < _LIFT_TOLERANCE_M)

    def _excess(self, piece: DcmPiece, remaining_s: float) -> FloatArray:
        """Error of the DCM at a single support's end that no point in the sole can remove [m], in the foot's axes."""
        foot, reach = self._state.feet[self._stance], self._reach(self._stance)
        axes = foot.rotation[:2, :2]
        growth = np.exp(self._frequency * remaining_s)
        dcm = axes.T @ (self._dcm() - foot.position[:2])
        wanted = axes.T @ (piece.final_dcm - foot.position[:2])
        zmp = np.clip((growth * dcm - wanted) / (growth - 1), -reach, reach)
        excess: FloatArray = growth * dcm - (growth - 1) * zmp - wanted
        return excess

    def _within_room(self, shift: FloatArray, side: int, landing: FootPose) -> FloatArray:
        """The part of a landing's shift that the legs and the other foot leave room for [m], in the foot's axes."""
        limit = self._options.adjust_m * self._morphology.leg_length_m / REFERENCE_LEG_M
        possible = np.clip(shift, -limit, limit)
        foot = self._state.feet[self._stance]
        outward = 1.0 if side == LEFT else -1.0
        planned = outward * (foot.rotation[:2, :2].T @ (landing.position[:2] - foot.position[:2]))[1]
        room = max(planned - self._planner.narrowest_m, 0.0)
        possible[1] = outward * max(outward * possible[1], -room)
        return possible

    def _dcm(self) -> FloatArray:
        dcm: FloatArray = self._state.com[:2] + self._state.com_velocity[:2] / self._frequency
        return dcm

    def _reach(self, side: int) -> FloatArray:
        """Half extents of the sole that the centre of pressure may use [m], shape (2,)."""
        sole = self._morphology.soles[side]
        return self._options.qp.sole_margin * np.array([sole.half_length_m, sole.half_width_m])

    def _shares(self, feet: tuple[int, ...], zmp: FloatArray) -> tuple[float, ...]:
        """Part of the weight on each standing foot when the zero-moment point lies between them."""
        if len(feet) == 1:
            return (1.0,)
        left, right = (self._state.feet[i].position[:2] for i in feet)
        along = right - left
        share = float(np.clip((zmp - left) @ along / max(along @ along, 1e-6), 0.0, 1.0))
        return (1.0 - share, share)


def _mean_yaw(first: FootPose, second: FootPose) -> float:
    return first.yaw_rad + wrap(second.yaw_rad - first.yaw_rad) / 2
