"""Pseudo-inertia of rigid bodies: the matrix of mass moments whose positive definiteness is all that physics asks.

J = [[Sigma, h], [h^T, m]] with Sigma the integral of r r^T dm, h = m c and m the mass (Wensing, Kim and Slotine 2018).
It is additive over parts of a body and positive definite if and only if some distribution of positive mass has it. With
the upper triangular factor of Rucker and Wensing (2022), J = m [[S + c c^T, c], [c^T, 1]] and S = D U U^T D: mass,
centre of mass and the six numbers of log U can then be anything at all (mass being positive), and J stays physical. D
holds the model file's own radii of gyration along the principal axes, so that log U = 0 is the model file.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.typing import FloatArray

LOG_CHOLESKY = ("xx", "yy", "zz", "xy", "xz", "yz")
"""Names of the six numbers: logarithms of U's diagonal, then what stands above it."""
_ABOVE = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}


@dataclass(frozen=True)
class InertialFrame:
    """How a body's mass lies about its origin.

    Attributes:
        mass: shape (N,) [kg].
        centre: of mass, in the body's frame, shape (N, 3) [m].
        moments: principal moments about the centre of mass, shape (N, 3) [kg m^2].
        quaternion: of the principal axes, shape (N, 4).
    """

    mass: FloatArray
    centre: FloatArray
    moments: FloatArray
    quaternion: FloatArray


def spread_of(mass: float, moments: FloatArray) -> FloatArray:
    """Squared radii of gyration along the principal axes, shape (3,) [m^2]: the diagonal of S = Sigma_c / m.

    Negative by rounding, or zero, where a body is flat.
    """
    return np.zeros(3) if mass == 0.0 else (0.5 * moments.sum() - moments) / mass


def log_cholesky_factor(entries: FloatArray) -> FloatArray:
    """U of Rucker and Wensing without its column for the centre of mass.

    Args:
        entries: in the order of `LOG_CHOLESKY`, shape (..., 6).

    Returns:
        Upper triangular with a positive diagonal, shape (..., 3, 3).
    """
    factor = np.zeros((*entries.shape[:-1], 3, 3))
    for axis in range(3):
        factor[..., axis, axis] = np.exp(entries[..., axis])
    for column, name in enumerate(LOG_CHOLESKY[3:], start=3):
        factor[(..., *_ABOVE[name])] = entries[..., column]
    return factor


def pseudo_inertia(mass: FloatArray, centre: FloatArray, spread: FloatArray) -> FloatArray:
    """Assemble J about a body's origin.

    Args:
        mass: shape (...,) [kg].
        centre: of mass, shape (..., 3) [m].
        spread: S = Sigma_c / m about the centre of mass, shape (..., 3, 3) [m^2].

    Returns:
        Shape (..., 4, 4).
    """
    out = np.ones((*mass.shape, 4, 4))
    out[..., :3, :3] = spread + centre[..., :, None] * centre[..., None, :]
    out[..., :3, 3] = out[..., 3, :3] = centre
    return np.asarray(out * mass[..., None, None])


def inertial_frame(pseudo: FloatArray) -> InertialFrame:
    """Read mass, centre of mass and principal inertia off N pseudo-inertias, shape (N, 4, 4)."""
    mass = pseudo[:, 3, 3]
    centre = pseudo[:, :3, 3] / np.where(mass > 0.0, mass, 1.0)[:, None]
    central = pseudo[:, :3, :3] - mass[:, None, None] * centre[:, :, None] * centre[:, None, :]
    along, axes = np.linalg.eigh(central)
    axes[:, :, 2] *= np.linalg.det(axes)[:, None]  # right-handed
    quaternion = np.empty((len(pseudo), 4))
    for row, rotation in zip(quaternion, axes, strict=True):
        mujoco.mju_mat2Quat(row, rotation.ravel())
    return InertialFrame(mass, centre, along.sum(axis=1)[:, None] - along, quaternion)


def spatial_inertia(pseudo: FloatArray, rotation: FloatArray, origin: FloatArray) -> FloatArray:
    """Move pseudo-inertias into another frame, in the engine's layout of spatial inertias.

    Args:
        pseudo: in the frames of bodies, shape (n, 4, 4).
        rotation: of these frames, shape (n, 3, 3).
        origin: of these frames, shape (n, 3) [m].

    Returns:
        Rotational inertia xx, yy, zz, xy, xz, yz about the new origin, m c and m, shape (n, 10).
    """
    transform = np.zeros_like(pseudo)
    transform[:, :3, :3], transform[:, :3, 3], transform[:, 3, 3] = rotation, origin, 1.0
    moved = transform @ pseudo @ transform.transpose(0, 2, 1)
    out = np.empty((len(pseudo), 10))
    second = np.diagonal(moved[:, :3, :3], axis1=1, axis2=2)
    out[:, :3] = second.sum(axis=1)[:, None] - second
    out[:, 3], out[:, 4], out[:, 5] = -moved[:, 0, 1], -moved[:, 0, 2], -moved[:, 1, 2]
    out[:, 6:9], out[:, 9] = moved[:, :3, 3], moved[:, 3, 3]
    return out
