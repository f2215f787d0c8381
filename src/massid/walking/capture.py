"""What a stance foot can still do about the divergent component of motion, and what only the next landing can.

With a constant point p under the stance foot the DCM ends, after the remaining time T, at

    exp(w T) xi - (exp(w T) - 1) p.

The sole bounds p; what it cannot remove of the error is left to the landing.
"""

from __future__ import annotations

import numpy as np

from massid.typing import FloatArray


def uncorrectable(dcm: FloatArray, wanted_dcm: FloatArray, growth: float, reach: FloatArray) -> FloatArray:
    """Error of the final DCM that no point of the sole can remove.

    Args:
        dcm: present DCM in the sole's axes, from its centre [m], shape (2,).
        wanted_dcm: DCM wanted at the end, likewise.
        growth: exp(w T), > 1.
        reach: half extents of the sole that may be used [m], shape (2,).

    Returns:
        Final DCM minus the wanted one under the best constant point [m], shape (2,); zero if the sole suffices.
    """
    zmp = np.clip((growth * dcm - wanted_dcm) / (growth - 1.0), -reach, reach)
    excess: FloatArray = growth * dcm - (growth - 1.0) * zmp - wanted_dcm
    return excess


def possible_shift(
    shift: FloatArray, landing_left_m: float, outward: float, limit_m: float, narrowest_m: float
) -> FloatArray:
    """The part of a landing's shift that legs and feet leave room for.

    Args:
        shift: wanted shift, forward and to the left, in the stance sole's axes [m], shape (2,).
        landing_left_m: lateral position of the planned landing in those axes [m].
        outward: 1 if the left foot lands, -1 if the right one does.
        limit_m: farthest shift along each axis.
        narrowest_m: least lateral distance between the soles' centres.

    Returns:
        A shift no larger than the wanted one, shape (2,).
    """
    possible = np.clip(shift, -limit_m, limit_m)
    room = max(outward * landing_left_m - narrowest_m, 0.0)
    possible[1] = outward * max(outward * possible[1], -room)
    return possible
