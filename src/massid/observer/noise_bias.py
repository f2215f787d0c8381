"""What input noise alone does to the slope of mu, so that it can be taken away.

A model that is heavier, or whose torque sensor is said to read too much, answers less to the noise in its inputs; its
output errors shrink although it is no better. With weights S^-1 that stay those of the centre, mu therefore falls along
such a parameter at the rate tr(S^-1 dS/dp) per sample even at p = p*. In the likelihood, log det S has the opposite
slope: subtracting the rate from the gradient of mu gives the gradient of -2 log-likelihood.

With fixed gains the covariance of the errors obeys dP+ = Phi dP Phi^T + dQ/dp, Phi = A (I - K). All parameters share
one adjoint recursion Lambda = S^-1 + Phi^T Lambda Phi, run backwards over a block, and the rate is tr(Lambda dQ/dp).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from massid.observer.linearisation import Lineariser, StepLinearisation
from massid.parameters import Kind, Parameter
from massid.robot import Robot
from massid.typing import FloatArray


@dataclass(frozen=True)
class InputNoise:
    """Variances of the inputs.

    Attributes:
        effort: of every joint torque, shape (n_joints,) [N^2 m^2].
        wrench: of every wrench component, shape (6 n_contacts,).
    """

    effort: FloatArray
    wrench: FloatArray


class NoiseBias:
    """Slope of mu that input noise causes, by parameter.

    Args:
        robot: the robot.
        parameters: all unknowns, in the order of a point's coordinates.
        contact_bodies: bodies whose wrench is measured.
        lineariser: the model at the current estimate.
        noise: variances of the inputs.
    """

    def __init__(
        self,
        robot: Robot,
        parameters: Sequence[Parameter],
        contact_bodies: Sequence[str],
        lineariser: Lineariser,
        noise: InputNoise,
    ) -> None:
        self._lineariser = lineariser
        self._noise = noise
        self._count = len(parameters)
        masses = [(i, robot.model.body(p.target).id) for i, p in enumerate(parameters) if p.kind is Kind.MASS]
        self._mass_columns = np.array([i for i, _ in masses], dtype=np.int64)
        self._bodies = np.array([body for _, body in masses], dtype=np.int64)
        self._gains = [
            (i, p.kind, robot.sensor_column(p, contact_bodies))
            for i, p in enumerate(parameters)
            if p.kind in (Kind.EFFORT_GAIN, Kind.WRENCH_GAIN)
        ]

    def sensitivity(self, linear: StepLinearisation) -> NoiseSensitivity:
        """Prepare dQ/dp at the sample that was just linearised."""
        matrices = self._lineariser.mass_matrices(self._bodies)
        masses = self._lineariser.model.body_mass[self._bodies]
        return NoiseSensitivity(self, linear, matrices / masses[:, None, None])

    def slope(self, adjoint: FloatArray, linear: StepLinearisation, matrices: FloatArray) -> FloatArray:
        """tr(Lambda dQ/dp) for every parameter, shape (n_p,)."""
        out = np.zeros(self._count)
        nv = linear.from_force.shape[1]
        noisy = np.hstack(
            [linear.from_effort * np.sqrt(self._noise.effort), linear.from_wrench * np.sqrt(self._noise.wrench)]
        )
        if len(self._bodies):
            # dB = -F M_j a with the acceleration a = B_v / h that a unit of noise causes.
            timestep_s = self._lineariser.model.opt.timestep
            mixed = (noisy[nv:] / timestep_s) @ (noisy.T @ (adjoint @ linear.from_force))
            out[self._mass_columns] = -2.0 * np.einsum("jab,ba->j", matrices, mixed)
        for column, kind, source in self._gains:
            effort = kind is Kind.EFFORT_GAIN
            effect = noisy[:, source if effort else source + linear.from_effort.shape[1]]
            out[column] = -2.0 * float(effect @ adjoint @ effect)
        return out


@dataclass(frozen=True)
class NoiseSensitivity:
    """dQ/dp at one linearisation; `slope` contracts it with an adjoint."""

    bias: NoiseBias
    linear: StepLinearisation
    matrices: FloatArray

    def slope(self, adjoint: FloatArray) -> FloatArray:
        """tr(Lambda dQ/dp) for every parameter, shape (n_p,)."""
        return self.bias.slope(adjoint, self.linear, self.matrices)
