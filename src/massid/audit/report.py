"""All checks of a log against a robot, gathered."""

from __future__ import annotations

from dataclasses import dataclass

from massid.audit.balance import measure_balance
from massid.audit.forces import REST, Rest, Weight, check_rest, check_weight, torque_suspicions, weight_suspicions
from massid.audit.kinematics import Kinematics, check_kinematics
from massid.audit.lag import Lag, estimate_lag, lag_margin
from massid.audit.limits import in_degrees, limit_suspicions
from massid.audit.one_step import OneStep, one_step_residual
from massid.audit.self_contact import SelfContact, find_self_contact, self_contact_warnings, without_samples
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
    kinematics = check_kinematics(walk)
    contact = find_self_contact(robot, walk)
    lines = [*kinematics.suspicions, *limit_suspicions(robot, walk), *self_contact_warnings(contact)]
    if contact.samples.any():
        walk = without_samples(walk, contact.samples)
    weight = check_weight(robot, walk)
    doubts = list(kinematics.suspicions)
    misread = kinematics.misread
    if in_degrees(robot, walk):
        doubts += limit_suspicions(robot, walk)
        misread = True
    if not misread:  # in a wrong pose every force leans
        doubts += weight_suspicions(weight)
        lines += weight_suspicions(weight)
    lines += torque_suspicions(robot, walk)
    balance = measure_balance(robot, walk, lag_margin(walk))
    lag = rest = one_step = None
    if balance is not None:
        lag = estimate_lag(robot, walk, balance)
        if lag is None or not lag.believed:
            rest = check_rest(robot, walk, balance)
            # With a wrong state no force fits: then the state's own suspicion is the one to follow.
            told = rest.suspicions if not (misread or kinematics.suspicions) or rest.names_a_setting else ()
            lines += told
            doubts += told if rest.share > REST else ()
            misread |= rest.names_a_setting
        if thorough:
            one_step = one_step_residual(robot, walk, balance)
    warnings = tuple(f"{walk.source}: {line}" for line in lines)
    return Audit(walk, kinematics, weight, contact, lag, rest, one_step, warnings, tuple(doubts), misread)
