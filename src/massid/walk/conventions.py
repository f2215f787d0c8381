"""Where ROS conventions and MuJoCo's meet: quaternion order and the frame of the base velocity."""

from __future__ import annotations

import numpy as np

from massid.typing import FloatArray

NANOSECONDS = 1_000_000_000
LATEST_NS = (1 << 63) - 1
"""The last time that stamps hold, in the year 2262; a log time after it is read as this and never used."""


def wxyz_to_xyzw(quaternion: FloatArray) -> FloatArray:
    """Reorder MuJoCo quaternions for ROS, shape (n, 4); no value changes."""
    return quaternion[:, [1, 2, 3, 0]]


def xyzw_to_wxyz(quaternion: FloatArray) -> FloatArray:
    """Reorder ROS quaternions for MuJoCo, shape (n, 4); no value changes."""
    return quaternion[:, [3, 0, 1, 2]]


def to_world(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """Express body-frame vectors in the world.

    Args:
        quaternion: attitude of the body, wxyz of unit norm, shape (n, 4).
        vector: in the body frame, shape (n, 3).

    Returns:
        The same vectors in the world frame, shape (n, 3).
    """
    scalar, axis = quaternion[:, :1], quaternion[:, 1:]
    twice = 2.0 * np.cross(axis, vector)
    return np.asarray(vector + scalar * twice + np.cross(axis, twice), dtype=np.float64)


def to_body(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """Express world-frame vectors, shape (n, 3), in the body frame of the wxyz attitude, shape (n, 4)."""
    return to_world(quaternion * np.array([1.0, -1.0, -1.0, -1.0]), vector)


def rpy_to_wxyz(angles: FloatArray) -> FloatArray:
    """Quaternions of turns about the fixed x, then y, then z axis [rad], shapes (n, 3) and (n, 4)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(0.5 * angles).T, np.sin(0.5 * angles).T
    return np.column_stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )
