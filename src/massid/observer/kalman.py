"""Kalman-gain output injection: innovations that are white if the sensor noise is what it is said to be.

With the gain of its noise an identification model is the optimal filter for its parameters. Its innovations are
independent, with a known covariance S; weighted by S^-1/2 and squared, their sum is minus twice the log-likelihood of
the parameters, so the minimum of mu is the maximum-likelihood estimate and half its Hessian the Fisher information.

The error state (q, qd) in the tangent space of the measurement follows x+ = A x + B_f w_f + B_tau w_tau with wrench
noise w_f and torque noise w_tau; the matrices come from finite differences of the engine's own step, at the measured
states.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from scipy.linalg import lapack

from massid.errors import BadInputError
from massid.noise import SensorNoise
from massid.observer.injection import InjectionGains
from massid.observer.linearisation import Lineariser, StepLinearisation
from massid.observer.noise_bias import NoiseBias, NoiseSensitivity
from massid.observer.replay import ReplayBlock
from massid.observer.tangents import TangentFilter
from massid.robot import JointLayout, Realisation
from massid.typing import FloatArray


class KalmanInjection:
    """Time-varying Kalman gain along the measured motion.

    Args:
        lineariser: the identification model at the current estimate.
        layout: addresses of the free joint and the one-axis joints.
        noise: standard deviations of the sensors.
        bias: what input noise does to the slope of mu.
        tangents: parameters that enter by their derivative; None for none.
        hold_steps: samples for which a linearisation is kept.

    Raises:
        BadInputError: a measured state is said to have no noise at all.
    """

    carries_belief: ClassVar[bool] = True

    def __init__(
        self,
        lineariser: Lineariser,
        layout: JointLayout,
        noise: SensorNoise,
        bias: NoiseBias,
        tangents: TangentFilter | None = None,
        hold_steps: int = 5,
    ) -> None:
        self._lineariser = lineariser
        self._hold_steps = hold_steps
        self._tangents = tangents
        n_joints = len(layout.joint_dof)
        std = noise.state_std(n_joints)
        if not np.all(std > 0.0):
            raise BadInputError("A Kalman gain needs noise on every measured state; a log without noise is `clean`.")
        n_v = 6 + n_joints
        self._variance = np.concatenate([layout.to_qvel(std[:n_v] ** 2), layout.to_qvel(std[n_v:] ** 2)])
        self._wrench_std = np.tile(noise.wrench_std(), lineariser.model.nu // 6)
        self._effort_std = noise.effort
        self._covariance: FloatArray = np.diag(self._variance)
        self._gain: FloatArray = np.zeros_like(self._covariance)
        self._bias = bias
        self._adjoint: FloatArray = np.zeros_like(self._covariance)

    def place(self, realisation: Realisation) -> None:
        """Linearise at the centre, the first of the models."""
        self._lineariser.place(realisation)

    def restart(self) -> None:
        """Believe the first measurement, with the noise it has."""
        self._covariance = np.diag(self._variance)
        self._gain = np.zeros_like(self._covariance)
        self._adjoint = np.zeros_like(self._covariance)
        if self._tangents:
            self._tangents.restart()

    def state_shift(self, tangent_change: FloatArray) -> FloatArray:
        """By how much the state would differ, had the tangent parameters been different, shape (2 nv,)."""
        if self._tangents is None:
            return np.zeros_like(self._variance)
        return self._tangents.state @ tangent_change

    def gains(self, block: ReplayBlock) -> InjectionGains:
        """Gains for the samples of a block; whiteners, tangents and noise slope for the errors after its steps.

        The correction at sample k uses the measurement of sample k; the innovation after the step is that of sample
        k + 1, whose covariance is S = P + R.
        """
        n, n_x = len(block), len(self._variance)
        gains = np.empty((n, n_x, n_x))
        whiteners = np.empty((n, n_x, n_x))
        tangents = np.empty((n, self._tangents.count, n_x)) if self._tangents else None
        sensitivities = []
        root_h = np.sqrt(self._lineariser.model.opt.timestep)
        for k in range(n):
            if k % self._hold_steps == 0:
                linear = self._lineariser.step(block, k)
                process = self._process_noise(linear)
                sensitivities.append(self._bias.sensitivity(linear))
            gains[k] = self._gain
            predicted = linear.transition @ self._covariance @ linear.transition.T + process
            predicted = 0.5 * (predicted + predicted.T)
            innovation = predicted.copy()
            innovation[np.diag_indices(n_x)] += self._variance
            factor, info = lapack.dpotrf(innovation, lower=1, clean=1)
            if info != 0:
                raise BadInputError("The innovation covariance is not positive definite: check the noise levels.")
            inverse_factor, _ = lapack.dtrtri(factor, lower=1)
            # mu integrates over time; dividing by the period makes it a sum over samples.
            whiteners[k] = inverse_factor / root_h
            if self._tangents and tangents is not None:
                tangents[k] = (whiteners[k] @ self._tangents.step(block, k, self._gain, linear)).T
            scaled = inverse_factor @ predicted
            self._gain = scaled.T @ inverse_factor
            self._covariance = predicted - scaled.T @ scaled
        slope = self._noise_slope(gains, whiteners * root_h, sensitivities)
        return InjectionGains(force=None, state=gains, whitener=whiteners, tangents=tangents, noise_slope=slope)

    def _noise_slope(
        self, gains: FloatArray, inverse_factors: FloatArray, sensitivities: Sequence[NoiseSensitivity]
    ) -> FloatArray:
        """Sum of tr(Lambda dQ/dp) over a block, shape (n_p,).

        The recursion runs backwards; what lies behind the block is taken to be like what lay before it.
        """
        n = len(gains)
        adjoint = self._adjoint
        total = np.zeros_like(adjoint)
        slope = None
        for k in reversed(range(n)):
            adjoint = inverse_factors[k].T @ inverse_factors[k] + adjoint
            total += adjoint
            if k % self._hold_steps == 0:
                found = sensitivities[k // self._hold_steps].slope(total)
                slope = found if slope is None else slope + found
                total = np.zeros_like(adjoint)
            # What an error before this step becomes after it.
            transition = sensitivities[k // self._hold_steps].linear.transition
            forward = transition - transition @ gains[k]
            adjoint = forward.T @ adjoint @ forward
        self._adjoint = adjoint
        return np.asarray(slope)

    def _process_noise(self, linear: StepLinearisation) -> FloatArray:
        """Covariance that noisy inputs add in one step, shape (2 nv, 2 nv)."""
        from_wrench = linear.from_wrench * self._wrench_std
        from_effort = linear.from_effort * self._effort_std
        return np.asarray(from_wrench @ from_wrench.T + from_effort @ from_effort.T)
