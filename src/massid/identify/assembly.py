"""Puts a bank together from options: which injection, which nuisances, which prior."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

from massid.identify.options import IdentifyOptions
from massid.model.robot import Robot
from massid.observer.bank import RobotBank
from massid.observer.injection import InertiaShapedInjection, OutputInjection
from massid.observer.inputs import InputBelief
from massid.observer.kalman import KalmanInjection
from massid.observer.linearisation import Lineariser
from massid.observer.spans import REACH_S
from massid.observer.tangents import TangentFilter
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.walk.noise import SensorNoise


@dataclass(frozen=True)
class Assembly:
    """A bank and what goes with it.

    Attributes:
        bank: the identification models.
        prior: belief about the nuisances, in units of mu; None for a log without noise.
        forgetting_rate: lambda of the monitoring signal [1/s]; likelihoods are not forgotten.
    """

    bank: RobotBank
    prior: LocalQuadratic | None
    forgetting_rate: float


def assemble(
    robot: Robot,
    space: ParameterSpace,
    contact_bodies: Sequence[str],
    timestep_s: float,
    noise: SensorNoise | None,
    options: IdentifyOptions,
    *,
    tangents: bool = True,
    reach_s: float = REACH_S,
) -> Assembly:
    """Build the bank of identification models that options and noise call for.

    Without noise the output injection is inertia-shaped; with noise it is the Kalman gain, and mu is minus twice the
    logarithm of the likelihood. Without `tangents` it computes no derivatives, for who wants output errors alone;
    `reach_s` is how far around a sample the motion is averaged that they are made of [s].

    Raises:
        ModelError: a contact body is not in the model.
    """
    model = robot.identification_model(contact_bodies)
    # A slower log without noise is on the model's clock already, as far as that goes.
    substeps = 1 if noise is None else robot.steps_in(timestep_s)
    model.opt.timestep = timestep_s / substeps
    injection: OutputInjection
    if noise is None:
        injection = InertiaShapedInjection(model, options.bandwidth_rad_s, options.damping_ratio)
    else:
        is_unknown = robot.realise(space, space.nominal, contact_bodies).friction_loss is not None
        beliefs = InputBelief(
            model, robot.layout, noise, timestep_s=timestep_s, reach_s=reach_s, unknown_friction=is_unknown
        )
        model.dof_frictionloss[:] = 0.0  # the beliefs say what friction was
        lineariser = Lineariser(copy.copy(model), robot.layout, substeps)
        columns = TangentFilter(robot, space, contact_bodies, lineariser) if tangents else None
        injection = KalmanInjection(lineariser, robot.layout, noise, beliefs, columns)
    bank = RobotBank(
        robot,
        space,
        contact_bodies,
        options.bank_size,
        injection,
        timestep_s=timestep_s,
        substeps=substeps,
        n_threads=options.threads,
        model=model,
    )
    if noise is None:
        return Assembly(bank, None, options.forgetting_rate)
    return Assembly(bank, LocalQuadratic.belief(space.nominal, space.prior_precision), 0.0)
