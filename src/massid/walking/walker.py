"""The walker: senses, moves the stepper on, and turns its wishes into torques by the whole-body programme."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np

from massid.errors import ModelError
from massid.typing import FloatArray
from massid.walking.excitation import Excitation
from massid.walking.footsteps import FootstepPlanner
from massid.walking.gait import Gait
from massid.walking.morphology import Morphology, natural_frequency
from massid.walking.qp import Contact, QpOptions, WholeBodyQp
from massid.walking.stance import standing_qpos
from massid.walking.state import RobotState
from massid.walking.stepper import Phase, Stepper, StepperOptions
from massid.walking.tasks import TaskOptions, Tasks

_FALL_HEIGHT = 0.6
_FALL_TILT_RAD = 1.0


@dataclass(frozen=True)
class WalkerOptions:
    """Settings of a walker that do not depend on the gait.

    Attributes:
        control_period_s: torques are held for this long.
        knee_bend_rad: bend of the knees when standing.
        stepper: timing of the feet and control of the DCM.
        tasks: gains and weights of the tasks.
        qp: weights and margins of the programme.
    """

    control_period_s: float = 0.002
    knee_bend_rad: float = 0.8
    stepper: StepperOptions = field(default_factory=StepperOptions)
    tasks: TaskOptions = field(default_factory=TaskOptions)
    qp: QpOptions = field(default_factory=QpOptions)


class Walker:
    """Walks a humanoid by joint torques.

    It knows the robot only by the model it is given, never the true one, and senses joint and base states and the
    vertical load of each foot.

    Args:
        model: nominal robot without a floor; copied.
        gait: how to walk.
        rng: source of the gait's randomness; two generators are spawned from it.
        options: settings.
        morphology: the robot's parts; read from the model if None.

    Attributes:
        failed_solves: control ticks whose programme had no solution and that held the last torques.

    Raises:
        ModelError: the model is not a humanoid that can stand; see Morphology.from_model and standing_qpos.
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
        self._morphology = morphology or Morphology.from_model(model)
        self._joint_names = _joint_names(model)
        self._take_model(model)
        self._stand_qpos = standing_qpos(self._model, self._morphology, self._options.knee_bend_rad)
        self._com_height_m = self._standing_com_height()
        self._frequency = natural_frequency(self._com_height_m)
        steps_rng, motion_rng = rng.spawn(2)
        planner = FootstepPlanner(gait, self._morphology, steps_rng)
        self._stepper = Stepper(
            planner, self._morphology, self._frequency, planner.clock * gait.first_shift_s, self._options.stepper
        )
        self._excitation = Excitation(gait, self._model, self._morphology, motion_rng)
        self._tasks = Tasks(self._model, self._morphology, self._stand_qpos, self._options.tasks)
        self._qp = WholeBodyQp(self._morphology.torque_limits_nm, self._options.qp)
        self._torques = np.zeros(self._model.nv - 6)
        self._accelerations = np.zeros(self._model.nv - 6)
        self._start_s: float | None = None
        self._held_until_s = -np.inf
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
    def accelerations(self) -> FloatArray:
        """Of the joints, that the last torques were to bring about [rad/s^2], in the order of joint_names."""
        return self._accelerations

    @property
    def control_period_s(self) -> float:
        """Torques are held for this long."""
        return self._options.control_period_s

    @property
    def phase(self) -> Phase:
        """What the feet do."""
        return self._stepper.phase

    @property
    def steps_taken(self) -> int:
        """Swings begun so far."""
        return self._stepper.steps_taken

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
        names = _joint_names(model)
        if names != self._joint_names:
            raise ModelError(
                f"The new model's joints differ from the first's. It has: {', '.join(names)};"
                f" expected: {', '.join(self._joint_names)}."
            )
        self._take_model(model)
        self._com_height_m = self._standing_com_height()

    def has_fallen(self, qpos: FloatArray) -> bool:
        """Tell whether the root has sunk below 0.6 of its standing height or leans by more than 1 rad."""
        up = 1.0 - 2.0 * (qpos[4] ** 2 + qpos[5] ** 2)
        standing = qpos[2] >= _FALL_HEIGHT * self._stand_qpos[2] and up >= np.cos(_FALL_TILT_RAD)
        return not standing

    def control(self, time_s: float, qpos: FloatArray, qvel: FloatArray, foot_load_n: FloatArray) -> FloatArray:
        """Compute the torques for this instant.

        Args:
            time_s: time [s], not decreasing from call to call; the walk starts at the first call.
            qpos: measured positions, shape (nq,).
            qvel: measured velocities in MuJoCo's convention, shape (nv,).
            foot_load_n: vertical force on the left and the right foot [N], shape (2,).

        Returns:
            Torque of each joint [N m], in the order of joint_names, shape (nv - 6,); read-only.
        """
        if time_s < self._held_until_s:
            return self._torques
        if self._start_s is None:
            self._start_s = time_s
        self._held_until_s = time_s + self._options.control_period_s - 1e-9
        self._state.update(qpos, qvel)
        self._stepper.advance(time_s, self._state, foot_load_n)
        self._solve(time_s - self._start_s)
        return self._torques

    def _take_model(self, model: mujoco.MjModel) -> None:
        self._model = model.__copy__()
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._state = RobotState(self._model, self._morphology)

    def _standing_com_height(self) -> float:
        self._state.update(self._stand_qpos, np.zeros(self._model.nv))
        return float(self._state.com[2])

    def _solve(self, time_s: float) -> None:
        state, stepper, tasks = self._state, self._stepper, self._tasks
        contacts = [
            Contact(self._morphology.soles[side], state.feet[side], share)
            for side, share in zip(stepper.standing_feet, stepper.shares(state), strict=True)
        ]
        floor_m = min(contact.frame.position[2] for contact in contacts)
        com_acceleration = np.empty(3)
        com_acceleration[:2] = self._frequency**2 * (state.com[:2] - stepper.wanted_zmp(state))
        com_acceleration[2] = tasks.height(state, floor_m + self._com_height_m, self._excitation.height(time_s))
        motions = [tasks.standing_foot(contact.frame) for contact in contacts]
        if stepper.phase is Phase.SINGLE:
            side, target = stepper.swing()
            motions.append(tasks.swinging_foot(state.feet[side], target))
        motions += tasks.trunk(state, stepper.yaw_rad, self._excitation.torso(time_s))
        solution = self._qp.solve(
            state,
            contacts,
            com_acceleration,
            tasks.momentum_rate(state),
            motions,
            tasks.joints(state, self._excitation.arms(time_s)),
        )
        if solution is None:
            self.failed_solves += 1
            return
        self._torques, self._accelerations = solution.torques, solution.qacc[6:]
        self._torques.flags.writeable = False


def _joint_names(model: mujoco.MjModel) -> tuple[str, ...]:
    return tuple(model.joint(j).name for j in range(1, model.njnt))
