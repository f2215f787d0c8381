"""Fisher information of the parameters of a linear system with white noise on its inputs and on its measured states."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from massid.errors import BadInputError
from massid.typing import FloatArray

_LEAST_DIRECTION = 1e-6
"""Share of the largest effect of unknown inputs below which a combination of them does nothing."""


class SensitivityRecursion:
    """Kalman recursion of the state estimate's derivatives by the parameters p.

    The system is x_{k+1} = A_k x_k + C_k p + w_k and y_k = x_k + D p + v_k. The innovations e_k of its Kalman filter
    are independent, with a covariance S_k that does not depend on p, so the information of y_0 .. y_n about p is
    exactly sum (de_k/dp)^T S_k^-1 (de_k/dp). Nothing is known of x_0 but its measurement.

    Attributes:
        information: what the measurements so far say about p, shape (n_p, n_p).

    Args:
        from_output: D, shape (n_x, n_p).
        variance: of v_k, shape (n_x,), positive.
    """

    def __init__(self, from_output: FloatArray, variance: FloatArray) -> None:
        self._from_output = from_output
        self._variance = variance
        n_x, n_p = from_output.shape
        self._diagonal = np.diag_indices(n_x)
        self.information: FloatArray = np.zeros((n_p, n_p))
        self.restart()

    def restart(self) -> None:
        """Take the next measurement as all that is known of the state."""
        self._covariance = np.diag(self._variance)
        self._sensitivity = -self._from_output

    def step(
        self,
        transition: FloatArray,
        process_noise: FloatArray,
        from_parameters: FloatArray,
        from_unknown: FloatArray | None = None,
    ) -> None:
        """Predict over one step and take the measurement after it.

        An input d of which nothing is known adds B d to the state. With S = L L^T, U = L^-1 B and F = (1 - K) B, its
        best estimate is (U^T U)^-1 U^T L^-1 e: the part of the innovation that it explains tells nothing of p, and its
        error adds F (U^T U)^-1 F^T to the covariance.

        Args:
            transition: A, shape (n_x, n_x).
            process_noise: covariance of w, shape (n_x, n_x).
            from_parameters: C, shape (n_x, n_p).
            from_unknown: B, shape (n_x, m); None for no such input.

        Raises:
            BadInputError: the covariance of the innovation is not positive definite.
        """
        predicted = transition @ self._covariance @ transition.T + process_noise
        predicted = 0.5 * (predicted + predicted.T)  # rounding must not grow into asymmetry
        sensitivity = transition @ self._sensitivity + from_parameters
        innovation = predicted.copy()
        innovation[self._diagonal] += self._variance
        factor, info = lapack.dpotrf(innovation, lower=1, clean=1)
        if info != 0:
            raise BadInputError("The innovation covariance is not positive definite: check the noise levels.")
        root, _ = lapack.dtrtrs(factor, predicted, lower=1)
        whitened, _ = lapack.dtrtrs(factor, sensitivity + self._from_output, lower=1)
        self._covariance = predicted - root.T @ root
        self._sensitivity = sensitivity - root.T @ whitened
        if from_unknown is not None and from_unknown.shape[1]:
            seen, _ = lapack.dtrtrs(factor, from_unknown, lower=1)
            basis, size, turn = np.linalg.svd(seen, full_matrices=False)
            rank = np.count_nonzero(size > _LEAST_DIRECTION * size[0])  # what moves nothing does no harm
            basis, size, turn = basis[:, :rank], size[:rank], turn[:rank]
            left = (turn / size[:, None]) @ (from_unknown - root.T @ seen).T
            along = basis.T @ whitened
            self._covariance += left.T @ left
            self._sensitivity -= left.T @ along
            whitened -= basis @ along
        self.information += whitened.T @ whitened
