"""The sensor model: what a log's sensors are taken to do, and the bank of models that suits it.

It is chosen once for each log (`massid.identify.sensing`) and carried along with it. Readings without error leave the
models an output injection of a fixed bandwidth and mu as the paper has it; white noise asks for its Kalman gain, and
then mu is minus twice the logarithm of the likelihood.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from massid.model.robot import Robot
from massid.observer.averaging import suitable_reach_s
from massid.observer.bank import RobotBank
from massid.observer.contact_gate import ForceOffsets
from massid.observer.injection import InertiaShapedInjection
from massid.observer.inputs import InputBelief
from massid.observer.kalman import KalmanInjection
from massid.observer.linearisation import Lineariser
from massid.observer.scales import Scales
from massid.observer.spans import REACH_S
from massid.observer.tangents import TangentFilter
from massid.observer.unread import UnreadInjection
from massid.search.parameters import ParameterSpace
from massid.walk import Walk
from massid.walk.noise import SensorNoise


@dataclass(frozen=True)
class ExactSensors:
    """Readings without error, as of a simulator.

    Attributes:
        bandwidth_rad_s: w of the output injection K1 = w^2 H0, K2 = 2 zeta w H0 [rad/s].
        damping_ratio: zeta of it.
        forgetting_rate: lambda of the monitoring signal, Eq. 6 [1/s].
        open_axes: columns of the wrenches, six for each contact body, that no sensor measures.
    """

    bandwidth_rad_s: float = 60.0
    damping_ratio: float = 1.0
    forgetting_rate: float = 1.0
    open_axes: tuple[int, ...] = ()

    def suited_to(self, walk: Walk) -> ExactSensors:
        """The same: nothing depends on the motion."""
        return self

    def bank(
        self,
        robot: Robot,
        space: ParameterSpace,
        contact_bodies: Sequence[str],
        timestep_s: float,
        n_models: int,
        n_threads: int = 0,
        *,
        tangents: bool = True,
        slopes: bool = False,
    ) -> RobotBank:
        """Identification models with inertia-shaped injection; see `RobotBank`. They show all derivatives themselves.

        Raises:
            ModelError: a contact body is not in the model.
        """
        model = robot.identification_model(contact_bodies)
        model.opt.timestep = timestep_s  # a slower log is on the model's clock already, as far as that goes
        shaped = InertiaShapedInjection(model, self.bandwidth_rad_s, self.damping_ratio)
        injection = UnreadInjection(shaped, contact_bodies, self.open_axes) if self.open_axes else shaped
        return RobotBank(
            robot, space, contact_bodies, n_models, injection, timestep_s=timestep_s, n_threads=n_threads, model=model
        )


@dataclass(frozen=True)
class NoisySensors:
    """Readings with white noise of known levels.

    Attributes:
        noise: the levels, and how large slow errors may be.
        reach_s: how far around a sample the motion is averaged that columns of the Jacobian are made of [s].
        steps: that the models take from one sample to the next; None for what the model file asks for.
        forgetting_rate: likelihoods are not forgotten.
        open_axes: columns of the wrenches, six for each contact body, that no sensor measures.
        scales: what the whole robot weighed; None if nobody put it on scales.
    """

    noise: SensorNoise
    reach_s: float = REACH_S
    steps: int | None = None
    forgetting_rate: float = 0.0
    open_axes: tuple[int, ...] = ()
    scales: Scales | None = None

    def suited_to(self, walk: Walk) -> NoisySensors:
        """The same with the reach that the motion of a log bears."""
        return replace(self, reach_s=suitable_reach_s(walk, self.noise))

    def bank(
        self,
        robot: Robot,
        space: ParameterSpace,
        contact_bodies: Sequence[str],
        timestep_s: float,
        n_models: int,
        n_threads: int = 0,
        *,
        tangents: bool = True,
        slopes: bool = False,
    ) -> RobotBank:
        """Identification models with the Kalman gain; they take their own steps within a longer sample period.

        Args:
            robot: the robot with nominal masses.
            space: what the coordinates of a point mean.
            contact_bodies: bodies whose wrench is measured.
            timestep_s: sample period [s].
            n_models: size of the bank.
            n_threads: worker threads; 0 for one per processor.
            tangents: whether to compute derivatives; not for who wants output errors alone.
            slopes: whether to compute how the score changes, too; not for who sees a window once.

        Raises:
            ModelError: a contact body is not in the model.
            BadInputError: a measured state is said to have no noise at all.
        """
        model = robot.identification_model(contact_bodies)
        substeps = self.steps or robot.steps_in(timestep_s)
        model.opt.timestep = timestep_s / substeps
        beliefs = InputBelief(
            model,
            robot.layout,
            self.noise,
            timestep_s=timestep_s,
            reach_s=self.reach_s,
            unknown_friction=robot.realise(space, space.nominal, contact_bodies).friction_loss is not None,
            offsets=ForceOffsets.believed(space, contact_bodies, self.noise),
            open_axes=self.open_axes,
        )
        model.dof_frictionloss[:] = 0.0  # the beliefs say what friction was
        lineariser = Lineariser(copy.copy(model), robot.layout, substeps)
        columns = TangentFilter(robot, space, contact_bodies, lineariser) if tangents else None
        shown = None
        if columns is not None and slopes:
            shown = TangentFilter(robot, space, contact_bodies, lineariser, columns.depend_on_inputs)
        return RobotBank(
            robot,
            space,
            contact_bodies,
            n_models,
            KalmanInjection(lineariser, robot.layout, self.noise, beliefs, columns, shown),
            timestep_s=timestep_s,
            substeps=substeps,
            n_threads=n_threads,
            model=model,
        )


SensorModel: TypeAlias = ExactSensors | NoisySensors
