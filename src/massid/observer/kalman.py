"""Kalman-gain output injection: innovations that are white if the sensor noise is what it is said to be.

With the gain of its noise an identification model is the optimal filter for its parameters. Its innovations are
independent, with a known covariance S; weighted by S^-1/2 and squared, their sum is minus twice the log-likelihood of
the parameters, so the minimum of mu is the maximum-likelihood estimate and half its Hessian the Fisher information.

Inputs of which nothing is known, such as the wrench on a foot without a sensor, are projected out of the innovation.

The error state (q, qd) in the tangent space of the measurement follows x+ = A x + B_f w_f + B_tau w_tau with wrench
noise w_f and torque noise w_tau; the matrices come from finite differences of the engine's own step, at the measured
states.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
from scipy.linalg import lapack

from massid.errors import BadInputError
from massid.model.layout import JointLayout
from massid.model.realisation import Realisation
from massid.observer.injection import InjectionGains, Trajectory
from massid.observer.inputs import BelievedBlock, InputBelief
from massid.observer.linearisation import Lineariser, StepLinearisation
from massid.observer.replay import ReplayBlock
from massid.observer.tangents import ClosedLoop, TangentFilter
from massid.search.bank import Shown
from massid.typing import FloatArray
from massid.walk.noise import SensorNoise

HOLD_S = 0.01
"""A linearisation is kept for so long: a leg that swings turns by a few degrees meanwhile [s]."""
LEAST_DIRECTION = 1e-6
"""Share of the largest effect of unknown inputs below which a combination of them does nothing: straight legs, and legs
with few joints, share some wrenches between the feet in ways that move nothing."""


class KalmanInjection:
    """Time-varying Kalman gain along the measured motion.

    Args:
        lineariser: the identification model at the current estimate.
        layout: addresses of the free joint and the one-axis joints.
        noise: standard deviations of the sensors.
        inputs: what is known of the inputs besides their readings.
        tangents: parameters that enter by their derivative; None for none.
        slopes: of those whose columns are not what the models show, what these do show; None for none.
        hold_s: how long a linearisation, taken in the middle, is kept [s].

    Raises:
        BadInputError: a measured state is said to have no noise at all.
    """

    carries_belief: ClassVar[bool] = True
    judges_friction: ClassVar[bool] = True

    def __init__(
        self,
        lineariser: Lineariser,
        layout: JointLayout,
        noise: SensorNoise,
        inputs: InputBelief,
        tangents: TangentFilter | None = None,
        slopes: TangentFilter | None = None,
        hold_s: float = HOLD_S,
    ) -> None:
        self._lineariser = lineariser
        self._hold_steps = max(1, round(hold_s / lineariser.period_s))
        self._tangents = tangents
        self._slopes = slopes
        self._steps: list[tuple[ClosedLoop, StepLinearisation]] = []
        n_joints = len(layout.joint_dof)
        std = noise.state_std(n_joints)
        if not np.all(std > 0.0):
            raise BadInputError("A Kalman gain needs noise on every measured state; a log without noise is `clean`.")
        n_v = 6 + n_joints
        self._variance = np.concatenate([layout.to_qvel(std[:n_v] ** 2), layout.to_qvel(std[n_v:] ** 2)])
        self._wrench_variance = np.tile(noise.wrench_std() ** 2, lineariser.model.nu // 6)
        self._wrench_variance[inputs.open_axes] = 0.0
        self._effort_variance = np.full(n_joints, noise.effort**2)
        self._inputs = inputs
        self._covariance: FloatArray = np.diag(self._variance)
        self._corrected = False
        self._gain: FloatArray = np.zeros_like(self._covariance)

    @property
    def look_ahead(self) -> int:
        """Samples after a block that bear upon it: the motion at its end is told by those that follow."""
        return self._inputs.look_ahead

    def place(self, realisation: Realisation) -> None:
        """Linearise at the centre, the first of the models."""
        self._lineariser.place(realisation.without_friction())
        self._inputs.place(realisation)

    def restart(self, *, follows: bool) -> None:
        """Believe the first measurement, with the noise it has; samples before it tell of its inputs if it follows."""
        self._covariance = np.diag(self._variance)
        self._gain, self._corrected = np.zeros_like(self._covariance), False
        if not follows:
            self._inputs.restart()
        for filtered in (self._tangents, self._slopes):
            if filtered:
                filtered.restart()

    def state_shift(self, tangent_changes: FloatArray) -> FloatArray:
        """By how much states would differ, had the tangent parameters been different.

        Args:
            tangent_changes: one row for each model, shape (n_models, n_tangents).

        Returns:
            Shape (n_models, 2 nv).
        """
        n_tangents = tangent_changes.shape[1]
        if self._tangents is None or n_tangents == 0:
            return np.zeros((len(tangent_changes), len(self._variance)))
        return np.asarray(tangent_changes @ self._tangents.state[:, -n_tangents:].T)

    def gains(self, block: ReplayBlock) -> InjectionGains:
        """Gains for the samples of a block; whiteners and tangents for the errors after its steps.

        The correction at sample k uses the measurement of sample k; the innovation after the step is that of sample
        k + 1, whose covariance is S = P + R.
        """
        n, n_x = len(block), len(self._variance)
        inputs = self._inputs.believe(block)
        gains, whiteners = np.empty((2, n, n_x, n_x))
        tangents = np.empty((n, self._tangents.count, n_x)) if self._tangents else None
        explained = np.zeros(n, dtype=np.int64)
        root_h = np.sqrt(self._lineariser.period_s)
        if self._tangents:
            self._tangents.enter(inputs.motion)
        self._steps, diagonal = [], np.diag_indices(n_x)
        for k in range(n):
            if k % self._hold_steps == 0:
                held = slice(k, min(k + self._hold_steps, n))
                linear = self._lineariser.step(inputs, (held.start + held.stop - 1) // 2)
                process = self._process_noise(linear, inputs, held)
            gains[k] = self._gain
            moved = linear.transition @ self._covariance
            innovation = moved @ linear.transition.T + process
            innovation[diagonal] += self._variance
            factor, info = lapack.dpotrf(innovation, lower=1, clean=1)
            if info != 0:
                raise BadInputError("The innovation covariance is not positive definite: check the noise levels.")
            inverse_factor, _ = lapack.dtrtri(factor, lower=1)
            unknown = inputs.unknown[k]
            if unknown.any():
                basis = directions(inverse_factor @ linear.from_wrench[:, unknown])
                # Of L^-1, the limit of noise without bounds leaves (1 - Q Q^T) L^-1, whose square is the inverse of
                # the innovation covariance in that limit: gain and covariance follow from it as ever.
                inverse_factor -= basis @ (basis.T @ inverse_factor)
                explained[k] = basis.shape[1]
            # mu integrates over time; dividing by the period makes it a sum over samples.
            whiteners[k] = inverse_factor / root_h
            if self._tangents and tangents is not None:
                # After a correction P = K R, so A K = A P R^-1.
                injection = moved / self._variance if self._corrected else np.zeros_like(moved)
                loop = ClosedLoop(linear.transition - injection, injection)
                self._steps.append((loop, linear))
                tangents[k] = (whiteners[k] @ self._tangents.step(k, loop, linear)).T
            # K = P S^-1 = 1 - R S^-1, and the covariance it leaves is K R = R - R S^-1 R.
            precision = inverse_factor.T @ inverse_factor
            self._gain = -self._variance[:, None] * precision
            self._gain[diagonal] += 1.0
            self._covariance, self._corrected = self._gain * self._variance, True
        return InjectionGains(
            force=None, state=gains, whitener=whiteners, tangents=tangents, inputs=inputs, explained=explained
        )

    def shown(self, gains: InjectionGains, centre: Trajectory) -> Shown | None:
        """What the centre showed along a block that it has run through, where columns of the Jacobian do not.

        Args:
            gains: of the block.
            centre: how it went.

        Returns:
            None if nobody wants to know.
        """
        if self._slopes is None or gains.inputs is None or gains.state is None:
            return None
        readings = gains.inputs.readings
        motion = replace(readings, position=centre.position, velocity=centre.velocity, acceleration=centre.acceleration)
        self._slopes.enter(motion)
        out = np.empty((self._slopes.count, len(motion), len(self._variance)))
        for k, (loop, linear) in enumerate(self._steps):
            out[:, k] = (gains.whitener[k] @ self._slopes.step(k, loop, linear)).T
        return Shown(self._slopes.columns, out)

    def _process_noise(self, linear: StepLinearisation, inputs: BelievedBlock, held: slice) -> FloatArray:
        """Covariance that noisy inputs and unknown friction add in one step of some, shape (2 nv, 2 nv)."""
        unknown = inputs.friction_variance[held].max(axis=0)
        from_wrench = linear.from_wrench * np.sqrt(self._wrench_variance * inputs.motion.loaded[held].max(axis=0))
        from_effort = linear.from_effort * np.sqrt(self._effort_variance + unknown)
        return np.asarray(from_wrench @ from_wrench.T + from_effort @ from_effort.T)


def directions(effects: FloatArray) -> FloatArray:
    """Orthonormal basis of what some inputs can do, shape (n, rank); fewer than m where some of them do the same.

    Args:
        effects: a column for each input, shape (n, m).
    """
    left, values, _ = np.linalg.svd(effects, full_matrices=False)
    return np.asarray(left[:, values > LEAST_DIRECTION * values[0]])
