"""Reference of the divergent component of motion over a sequence of linear pieces of the zero-moment point.

The linear inverted pendulum obeys d(xi)/dt = w (xi - p). While p moves with constant velocity v from p0 to p1 in
time T,

    xi(t) = p(t) + v/w + exp(-w (T - t)) (xi1 - p1 - v/w),

so the reference follows backwards from the last piece's end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from massid.typing import FloatArray


@dataclass(frozen=True)
class ZmpPiece:
    """A straight piece of the zero-moment point's path.

    Attributes:
        duration_s: its duration, > 0.
        start: point at its start [m], shape (2,).
        end: point at its end [m], shape (2,).
    """

    duration_s: float
    start: FloatArray
    end: FloatArray


@dataclass(frozen=True)
class DcmPiece:
    """One piece of the zero-moment point with the DCM at its end.

    Attributes:
        zmp: the piece.
        final_dcm: DCM at the piece's end [m], shape (2,).
        frequency: w of the pendulum [1/s].
    """

    zmp: ZmpPiece
    final_dcm: FloatArray
    frequency: float

    def zmp_at(self, time_s: float) -> FloatArray:
        """Zero-moment point [m], shape (2,), held before the start and after the end."""
        fraction = min(max(time_s / self.zmp.duration_s, 0.0), 1.0)
        return self.zmp.start + fraction * (self.zmp.end - self.zmp.start)

    def dcm_at(self, time_s: float) -> FloatArray:
        """DCM [m], shape (2,), held before the start and after the end."""
        time = min(max(time_s, 0.0), self.zmp.duration_s)
        drift = (self.zmp.end - self.zmp.start) / (self.zmp.duration_s * self.frequency)
        decay = np.exp(-self.frequency * (self.zmp.duration_s - time))
        dcm: FloatArray = self.zmp_at(time) + drift + decay * (self.final_dcm - self.zmp.end - drift)
        return dcm


def plan_dcm(pieces: Sequence[ZmpPiece], frequency: float) -> list[DcmPiece]:
    """Solve the DCM backwards; it comes to rest at the end of the last piece.

    Args:
        pieces: path of the zero-moment point in time order, at least one piece.
        frequency: w of the pendulum [1/s], > 0.

    Returns:
        The same pieces with their DCM, in time order.
    """
    final = pieces[-1].end
    plan = []
    for piece in reversed(pieces):
        plan.append(DcmPiece(zmp=piece, final_dcm=final, frequency=frequency))
        final = plan[-1].dcm_at(0.0)
    return plan[::-1]
