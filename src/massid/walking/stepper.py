"""The walk's clock: which feet stand, where the swinging foot goes, and where the zero-moment point shall be."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from massid.typing import FloatArray
from massid.walking.capture import possible_shift, uncorrectable
from massid.walking.dcm import DcmPiece, ZmpPiece, plan_dcm
from massid.walking.footsteps import LEFT, RIGHT, FootPose, FootstepPlanner
from massid.walking.morphology import Morphology
from massid.walking.state import RobotState
from massid.walking.swing import SwingTarget, SwingTrajectory, wrap

_PLANNED_STEPS = 4
_STOP_S = 1.0


class Phase(Enum):
    """What the feet do."""

    STAND = "stand"
    DOUBLE = "double support"
    SINGLE = "single support"


@dataclass(frozen=True)
class StepperOptions:
    """When feet lift and land, and how the DCM is held.

    Lengths are for legs of 0.87 m and scale with the robot's legs.

    Attributes:
        dcm_gain: k of p = p_ref + (1 + k/w)(xi - xi_ref) [1/s].
        sole_margin: part of the sole's half extents that the zero-moment point may use.
        touchdown_share: part of the robot's weight on the swinging foot that counts as touchdown.
        earliest_touchdown: part of the planned swing before which a load is taken for scuffing.
        latest_touchdown_s: time after the planned end at which the foot is taken to stand.
        sink_m: the swing aims this far below the floor, so that touchdown is not late.
        longest_wait_s: longest extension of a double support while the stance foot alone could not catch the DCM.
        lift_tolerance_m: part of the DCM's final error that may be left uncaught when a foot lifts.
        adjust_m: farthest that a landing is moved, forward and sideways, to catch the DCM.
        adjust_until: part of the planned swing after which the landing stays.
        adjust_time_s: time constant with which the landing moves.
    """

    dcm_gain: float = 3.0
    sole_margin: float = 0.85
    touchdown_share: float = 0.025
    earliest_touchdown: float = 0.6
    latest_touchdown_s: float = 0.2
    sink_m: float = 0.008
    longest_wait_s: float = 0.4
    lift_tolerance_m: float = 0.01
    adjust_m: float = 0.12
    adjust_until: float = 0.8
    adjust_time_s: float = 0.03


class Stepper:
    """State machine of stands, shifts and swings.

    Args:
        planner: source of the steps.
        morphology: the robot's parts.
        frequency: w of the pendulum [1/s].
        first_shift_s: duration of the first shift of weight.
        options: timing and limits.

    Attributes:
        phase: what the feet do now.
        yaw_rad: heading wanted for pelvis and torso.
        steps_taken: swings begun so far.
    """

    def __init__(
        self,
        planner: FootstepPlanner,
        morphology: Morphology,
        frequency: float,
        first_shift_s: float,
        options: StepperOptions,
    ) -> None:
        self._planner = planner
        self._options = options
        self._frequency = frequency
        self._first_shift_s = first_shift_s
        self._reach = [
            options.sole_margin * np.array([sole.half_length_m, sole.half_width_m]) for sole in morphology.soles
        ]
        self.phase = Phase.STAND
        self.yaw_rad = 0.0
        self.steps_taken = 0
        self._started = False
        self._elapsed_s = 0.0

    @property
    def standing_feet(self) -> tuple[int, ...]:
        """Sides of the feet that stand."""
        return (self._stance,) if self.phase is Phase.SINGLE else (LEFT, RIGHT)

    def advance(self, time_s: float, state: RobotState, foot_load_n: FloatArray) -> None:
        """Move on to time_s [s] with the measured state and the vertical load on both feet [N], shape (2,)."""
        if not self._started:
            self._begin(time_s, state)
        options, planned = self._options, self._duration_s
        elapsed = time_s - self._start_s
        if self.phase is Phase.DOUBLE and elapsed >= planned:
            if elapsed >= planned + options.longest_wait_s or self._may_lift(state):
                self._start_swing(time_s, state)
        elif self.phase is Phase.SINGLE:
            loaded = foot_load_n[self._step.side] > options.touchdown_share * state.mass_kg * 9.81
            late = elapsed > planned + options.latest_touchdown_s
            if late or (loaded and elapsed > options.earliest_touchdown * planned):
                self._touch_down(time_s, state)
        self._elapsed_s = time_s - self._start_s
        if self.phase is Phase.SINGLE:
            self._adjust_landing(time_s, state)
            fraction = min(self._elapsed_s / self._duration_s, 1.0)
            self.yaw_rad = self._yaw_from + fraction * wrap(self._yaw_to - self._yaw_from)

    def swing(self) -> tuple[int, SwingTarget]:
        """Side and target of the swinging foot; only in single support."""
        return self._step.side, self._swing.at(self._elapsed_s)

    def wanted_zmp(self, state: RobotState) -> FloatArray:
        """Zero-moment point that holds the DCM to its reference [m], shape (2,); in the sole in single support."""
        error = self._dcm(state) - self._piece.dcm_at(self._elapsed_s)
        zmp: FloatArray = self._piece.zmp_at(self._elapsed_s) + (1.0 + self._options.dcm_gain / self._frequency) * error
        if self.phase is not Phase.SINGLE:
            return zmp
        foot, reach = state.feet[self._stance], self._reach[self._stance]
        axes = foot.rotation[:2, :2]
        zmp = axes @ np.clip(axes.T @ (zmp - foot.position[:2]), -reach, reach)
        zmp += foot.position[:2]
        return zmp

    def shares(self, state: RobotState) -> tuple[float, ...]:
        """Part of the weight planned on each standing foot, in the order of standing_feet."""
        if self.phase is Phase.SINGLE:
            return (1.0,)
        left, right = (foot.position[:2] for foot in state.feet)
        along = right - left
        zmp = self._piece.zmp_at(self._elapsed_s)
        share = float((zmp - left) @ along) / max(float(along @ along), 1e-6)
        share = min(max(share, 0.0), 1.0)
        return (1.0 - share, share)

    def _begin(self, time_s: float, state: RobotState) -> None:
        self._started = True
        left, right = (foot.level_pose for foot in state.feet)
        middle = (left.position[:2] + right.position[:2]) / 2
        self.yaw_rad = _mean_yaw(left, right)
        upcoming = self._planner.upcoming(1)
        if not upcoming:
            self._stand(time_s, state, middle)
            return
        self._stance = 1 - upcoming[0].side
        self._shift(time_s, state, self._first_shift_s, middle)

    def _stand(self, time_s: float, state: RobotState, zmp: FloatArray) -> None:
        """Stay on both feet for good, the weight moving from zmp to the middle."""
        self.phase, self._start_s, self._duration_s = Phase.STAND, time_s, _STOP_S
        left, right = (foot.level_pose for foot in state.feet)
        middle = (left.position[:2] + right.position[:2]) / 2
        self._piece = plan_dcm([ZmpPiece(_STOP_S, zmp, middle)], self._frequency)[0]

    def _shift(self, time_s: float, state: RobotState, duration_s: float, zmp: FloatArray) -> None:
        """Bring the weight from zmp to the stance foot."""
        self.phase, self._start_s, self._duration_s = Phase.DOUBLE, time_s, duration_s
        stance = state.feet[self._stance].level_pose
        plan = self._plan([ZmpPiece(duration_s, zmp, stance.position[:2])], stance)
        self._piece, self._next_piece = plan[0], plan[1] if len(plan) > 1 else None

    def _start_swing(self, time_s: float, state: RobotState) -> None:
        stance = state.feet[self._stance].level_pose
        if not self._planner.upcoming(1):
            self._stand(time_s, state, stance.position[:2])
            return
        self._piece = self._plan([], stance)[0]
        self._step = self._planner.take()
        self.steps_taken += 1
        foot, landing = state.feet[self._step.side].level_pose, self._step.landing(stance)
        self._landing = replace(landing, position=landing.position - np.array([0.0, 0.0, self._scaled("sink_m")]))
        self.phase, self._start_s, self._duration_s = Phase.SINGLE, time_s, self._step.single_support_s
        self._swing = SwingTrajectory(
            foot, self._landing, self._step.single_support_s, self._step.apex_m, self._step.landing_m_s
        )
        self._adjusted_s = time_s
        self._yaw_from, self._yaw_to = _mean_yaw(foot, stance), _mean_yaw(landing, stance)

    def _touch_down(self, time_s: float, state: RobotState) -> None:
        """The double support grows by the time that touchdown came early, so the clock of the steps stays."""
        early = max(0.0, self._duration_s - (time_s - self._start_s))
        zmp = state.feet[self._stance].position[:2].copy()
        self._stance = self._step.side
        self.yaw_rad = self._yaw_to
        self._shift(time_s, state, self._step.double_support_s + early, zmp)

    def _plan(self, pieces: list[ZmpPiece], stance: FootPose) -> list[DcmPiece]:
        """Plan the coming steps from the stance foot on, after the given pieces."""
        for step in self._planner.upcoming(_PLANNED_STEPS):
            landing = step.landing(stance)
            here, there = stance.position[:2], landing.position[:2]
            pieces.append(ZmpPiece(step.single_support_s, here, here))
            pieces.append(ZmpPiece(step.double_support_s, here, there))
            stance = landing
        return plan_dcm(pieces, self._frequency)

    def _adjust_landing(self, time_s: float, state: RobotState) -> None:
        """Move the landing by what the sole cannot correct."""
        elapsed, options = self._elapsed_s, self._options
        if elapsed > options.adjust_until * self._duration_s:
            return
        shift = self._landing_shift(state, self._piece, self._duration_s - elapsed, self._step.side, self._landing)[1]
        moved = self._landing.position.copy()
        moved[:2] += state.feet[self._stance].rotation[:2, :2] @ shift
        blend = min(1.0, (time_s - self._adjusted_s) / options.adjust_time_s)
        self._adjusted_s = time_s
        position = self._swing.end.position + blend * (moved - self._swing.end.position)
        self._swing = replace(self._swing, end=replace(self._swing.end, position=position))

    def _may_lift(self, state: RobotState) -> bool:
        """Tell whether the stance foot alone can catch the DCM, with the next landing moved if need be."""
        if self._next_piece is None:
            return True
        step = self._planner.upcoming(1)[0]
        landing = step.landing(state.feet[self._stance].level_pose)
        excess, shift = self._landing_shift(state, self._next_piece, step.single_support_s, step.side, landing)
        return bool(np.max(np.abs(excess - shift)) < self._scaled("lift_tolerance_m"))

    def _landing_shift(
        self, state: RobotState, piece: DcmPiece, remaining_s: float, side: int, landing: FootPose
    ) -> tuple[FloatArray, FloatArray]:
        """Uncorrectable error of the DCM and the possible shift of the landing [m], in the stance sole's axes."""
        foot = state.feet[self._stance]
        axes, origin = foot.rotation[:2, :2], foot.position[:2]
        excess = uncorrectable(
            axes.T @ (self._dcm(state) - origin),
            axes.T @ (piece.final_dcm - origin),
            float(np.exp(self._frequency * remaining_s)),
            self._reach[self._stance],
        )
        left = float((axes.T @ (landing.position[:2] - origin))[1])
        outward = 1.0 if side == LEFT else -1.0
        shift = possible_shift(excess, left, outward, self._scaled("adjust_m"), self._planner.narrowest_m)
        return excess, shift

    def _dcm(self, state: RobotState) -> FloatArray:
        dcm: FloatArray = state.com[:2] + state.com_velocity[:2] / self._frequency
        return dcm

    def _scaled(self, option: str) -> float:
        """An option's length for this robot [m]."""
        return float(getattr(self._options, option)) * self._planner.scale


def _mean_yaw(first: FootPose, second: FootPose) -> float:
    return first.yaw_rad + wrap(second.yaw_rad - first.yaw_rad) / 2
