"""Kalman-gain output injection: innovations that are white if the sensor noise is what it is said to be.

With the gain of its noise an identification model is the optimal filter for its parameters. Its innovations are
independent, with a known covariance S; weighted by S^-1/2 and squared, their sum is minus twice the log-likelihood of
the parameters, so the minimum of mu is the maximum-likelihood estimate and its Hessian the Fisher information.

The error state (q, qd) in the tangent space of the measurement follows x+ = A x + B_f w_f + B_tau w_tau with wrench noise
w_f and torque noise w_tau; both matrices come from finite differences of the engine's own step, at the measured states.
"""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.linalg import lapack

from massid.errors import MassidError
from massid.noise import SensorNoise
from massid.observer.injection import InjectionGains
from massid.observer.replay import ReplayBlock
from massid.robot import JointLayout
from massid.typing import FloatArray

FINITE_DIFFERENCE = 1e-6


class KalmanInjection:
    """Time-varying Kalman gain along the measured motion.

    Args:
        model: the nominal identification model; wrenches enter through its controls.
        layout: addresses of the free joint and the one-axis joints.
        noise: standard deviations of the sensors; all white ones must be positive.
        hold_steps: samples for which a linearisation is kept.
        unloaded: contact columns whose sensor is known to read zero get no wrench noise; see `gate`.
    """

    def __init__(self, model: mujoco.MjModel, layout: JointLayout, noise: SensorNoise, hold_steps: int = 5) -> None:
        self._model = model
        self._layout = layout
        self._hold_steps = hold_steps
        self._data = mujoco.MjData(model)
        n_joints = len(layout.joint_dof)
        std = noise.state_std(n_joints)
        if not np.all(std > 0.0):
            raise MassidError("A Kalman gain needs noise on every measured state; use --noise clean for a clean log.")
        columns = 6 + n_joints
        self._measurement_variance = np.concatenate(
            [layout.to_qvel(std[:columns] ** 2), layout.to_qvel(std[columns:] ** 2)]
        )
        self._wrench_std = np.tile(noise.wrench_std(), model.nu // 6)
        self._effort_std = noise.effort
        self._covariance: FloatArray = np.diag(self._measurement_variance)
        self._gain: FloatArray = np.zeros_like(self._covariance)

    def restart(self) -> None:
        """Believe the first measurement, with the noise it has."""
        self._covariance = np.diag(self._measurement_variance)
        self._gain = np.zeros_like(self._covariance)

    def gains(self, block: ReplayBlock) -> InjectionGains:
        """Gains for the samples of a block, and whiteners for the errors after each of its steps.

        The correction at sample k uses the measurement of sample k; the innovation after the step is that of sample
        k + 1, whose covariance is S = P + R.
        """
        n, n_x = len(block), 2 * self._model.nv
        gains = np.empty((n, n_x, n_x))
        whiteners = np.empty((n, n_x, n_x))
        identity = np.eye(n_x)
        transition, process = identity, identity
        variance = np.diag(self._measurement_variance)
        root_h = np.sqrt(self._model.opt.timestep)
        for k in range(n):
            if k % self._hold_steps == 0:
                transition, process = self._linearise(block, k)
            gains[k] = self._gain
            predicted = transition @ self._covariance @ transition.T + process
            predicted = 0.5 * (predicted + predicted.T)
            innovation = predicted + variance
            factor, info = lapack.dpotrf(innovation, lower=1, clean=1)
            if info != 0:
                raise MassidError("The innovation covariance is not positive definite; are the noise levels positive?")
            inverse_factor, _ = lapack.dtrtri(factor, lower=1)
            # mu integrates over time; dividing by the period makes it a sum over samples.
            whiteners[k] = inverse_factor / root_h
            scaled = inverse_factor @ predicted
            self._gain = scaled.T @ inverse_factor
            self._covariance = predicted - scaled.T @ scaled
        return InjectionGains(force=None, state=gains, whitener=whiteners)

    def _linearise(self, block: ReplayBlock, k: int) -> tuple[FloatArray, FloatArray]:
        """State transition and process noise covariance of one step at a measured sample, shape (2 nv, 2 nv) each."""
        model, data, nv = self._model, self._data, self._model.nv
        data.qpos[:], data.qvel[:] = block.qpos[k], block.qvel[k]
        data.qfrc_applied[:], data.ctrl[:] = block.effort[k], block.wrench[k]
        transition = np.zeros((2 * nv, 2 * nv))
        from_wrench = np.zeros((2 * nv, model.nu))
        mujoco.mjd_transitionFD(model, data, FINITE_DIFFERENCE, False, transition, from_wrench, None, None)
        mujoco.mj_forward(model, data)
        inertia = np.zeros((nv, nv))
        mujoco.mj_fullM(model, data, inertia)
        velocity = np.linalg.inv(inertia)[:, self._layout.joint_dof] * model.opt.timestep * self._effort_std
        from_effort = np.vstack([model.opt.timestep * velocity, velocity])
        noisy_wrench = from_wrench * self._wrench_std
        return transition, noisy_wrench @ noisy_wrench.T + from_effort @ from_effort.T
