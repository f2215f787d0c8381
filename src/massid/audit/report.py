"""All checks of a log against a robot, gathered."""

from __future__ import annotations

from dataclasses import dataclass

from massid.audit.balance import measure_balance
from massid.audit.forces import REST, Rest, Weight, check_rest, check_weight, torque_suspicions, weight_suspicions
from massid.audit.friction import missing_friction
from massid.audit.joint_readings import better_reading
from massid.audit.kinematics import Kinematics, check_kinematics
from massid.audit.lag import Lag, estimate_lag, lag_margin
from massid.audit.limits import in_degrees, limit_suspicions, turned_joints
from massid.audit.one_step import OneStep, one_step_residual
from massid.audit.self_contact import (
    SelfContact,
    find_self_contact,
    no_self_contact,
    self_contact_warnings,
    without_samples,
)
from massid.model.robot import Robot
from massid.walk import Walk

CLEAN_REST = 1e-6
"""Unexplained share of the force below which a log has no sensor noise."""


@dataclass(frozen=True)
class Audit:
    """What a log looks like to a robot's physics.

    Attributes:
        walk: the log, aligned with the robot; samples in which its links touch each other are in no segment.
        kinematics: positions against velocities.
        weight: contact forces against the weight.
        self_contact: between the robot's links.
        lag: of the inputs; None if the log is too short.
        rest: what inputs and link masses leave unexplained; None if the log is too short.
        one_step: the same step by step; None if the log is too short or it was not asked for.
        warnings: what is suspect, one line each, the log's name first.
        doubts: those of them with which masses mean nothing until they are settled.
        misread: whether another convention explains the log, so that it was surely read wrongly.
        forces_misread: whether that is one of torques or wrenches, which an unknown may stand for as well.
    """

    walk: Walk
    kinematics: Kinematics
    weight: Weight
    self_contact: SelfContact
    lag: Lag | None
    rest: Rest | None
    one_step: OneStep | None
    warnings: tuple[str, ...]
    doubts: tuple[str, ...] = ()
    misread: bool = False
    forces_misread: bool = False

    @property
    def clean(self) -> bool:
        """Whether inputs and link masses explain the motion to rounding: sensors with noise never do."""
        return self.rest is not None and self.rest.share < CLEAN_REST


def audit_walk(robot: Robot, walk: Walk, *, thorough: bool = False) -> Audit:
    """Check a log against the physics of a robot.

    Args:
        robot: with nominal masses.
        walk: as read.
        thorough: also step models through it, which takes longer.

    Raises:
        LogError: the log does not fit the robot.
    """
    walk = robot.align(walk)
    kinematics, limits = check_kinematics(walk), limit_suspicions(robot, walk)
    misread, forces_misread = kinematics.misread or in_degrees(robot, walk), False
    doubts = [*kinematics.suspicions, *(limits if misread or turned_joints(robot, walk) else ())]
    lines = [*kinematics.suspicions, *limits]
    # Links that are where they are not touch each other: that would blame the geometry, and cut the log to pieces.
    contact = no_self_contact(walk) if misread else find_self_contact(robot, walk)
    if contact.samples.any():
        walk = without_samples(walk, contact.samples)
    weight = check_weight(robot, walk)
    balance = measure_balance(robot, walk, lag_margin(walk))
    lag = rest = one_step = None
    if balance is not None:
        lag = estimate_lag(robot, walk, balance)
        if lag is None or not lag.believed:
            rest = check_rest(robot, walk, balance, weight)
        if thorough:
            one_step = one_step_residual(robot, walk, balance)
    lines += torque_suspicions(robot, walk)
    if not misread:  # with a wrong state no force fits, and in a wrong pose every force leans
        forces = _of_forces(robot, walk, weight, rest, state_is_sound=not (kinematics.suspicions or limits))
        lines += forces.lines
        doubts += forces.doubts
        misread = forces_misread = forces.misread
    if balance is not None and rest is not None and not misread:
        friction = missing_friction(robot, walk, balance)
        lines += [friction] if friction else []
    lines += self_contact_warnings(contact)
    warnings = tuple(f"{walk.source}: {line}" for line in lines)
    return Audit(
        walk, kinematics, weight, contact, lag, rest, one_step, warnings, tuple(doubts), misread, forces_misread
    )


@dataclass(frozen=True)
class _Forces:
    """What is wrong with the forces of a log: lines, those that are doubts, and whether another reading explains it."""

    lines: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    misread: bool = False


def _of_forces(robot: Robot, walk: Walk, weight: Weight, rest: Rest | None, *, state_is_sound: bool) -> _Forces:
    """The reading that explains them first; without one, what the weight and the balance say."""
    of_weight = tuple(weight_suspicions(weight))
    if rest is None:
        return _Forces(of_weight, of_weight)
    is_doubtful = rest.beyond_noise or bool(turned_joints(robot, walk)) or (rest.then is not None and rest.then > REST)
    if is_doubtful and (reason := better_reading(robot, walk, rest)) is not None:
        return _Forces((reason,), (reason,), misread=True)
    if rest.names_a_setting:
        also = () if rest.blames_wrenches else of_weight
        return _Forces((*rest.suspicions, *also), (*rest.suspicions, *also), misread=True)
    told = rest.suspicions if state_is_sound else ()
    return _Forces((*of_weight, *told), (*of_weight, *(told if rest.share > REST else ())))
