"""Where and when the feet shall land: a queue of steps, each relative to the foot that actually stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massid.typing import FloatArray
from massid.walking.gait import REFERENCE_LEG_M, Gait
from massid.walking.morphology import Morphology

LEFT, RIGHT = 0, 1
_CLEARANCE_M = 0.04


@dataclass(frozen=True)
class FootPose:
    """Where a level foot stands.

    Attributes:
        position: centre of the sole [m], shape (3,).
        yaw_rad: heading of the sole.
    """

    position: FloatArray
    yaw_rad: float

    def ahead(self, forward_m: float, left_m: float, turn_rad: float) -> FootPose:
        """The pose at an offset in axes half-way through the turn, turned by turn_rad."""
        heading = self.yaw_rad + turn_rad / 2
        c, s = np.cos(heading), np.sin(heading)
        offset = np.array([c * forward_m - s * left_m, s * forward_m + c * left_m, 0.0])
        return FootPose(position=self.position + offset, yaw_rad=self.yaw_rad + turn_rad)


@dataclass(frozen=True)
class Step:
    """One step, relative to the stance foot.

    Attributes:
        side: the foot that swings, LEFT or RIGHT.
        forward_m: advance of the swinging foot's sole beyond the stance foot's.
        left_m: lateral offset, positive for the left foot.
        turn_rad: turn to the left.
        single_support_s: planned time in the air.
        double_support_s: time of the weight's transfer after touchdown.
        apex_m: height of the swing.
        landing_m_s: speed at which the foot comes down.
    """

    side: int
    forward_m: float
    left_m: float
    turn_rad: float
    single_support_s: float
    double_support_s: float
    apex_m: float
    landing_m_s: float = 0.0

    def landing(self, stance: FootPose) -> FootPose:
        """Where the swinging foot lands if the other stands at stance."""
        return stance.ahead(self.forward_m, self.left_m, self.turn_rad)


class FootstepPlanner:
    """Draws steps in order; the same generator gives the same steps.

    Args:
        gait: what the steps are like.
        morphology: the robot, for its size.
        rng: source of the gait's randomness.
        first_side: foot of the first step.

    Attributes:
        scale: factor on the gait's lengths.
        clock: factor on the gait's durations.
        narrowest_m: smallest lateral distance between the soles' centres that leaves room between the feet.
    """

    def __init__(self, gait: Gait, morphology: Morphology, rng: np.random.Generator, first_side: int = LEFT) -> None:
        self._gait = gait
        self._rng = rng
        self.scale = morphology.leg_length_m / REFERENCE_LEG_M
        self.clock = float(np.sqrt(self.scale))
        self._spacing_m = morphology.foot_spacing_m
        self.narrowest_m = _CLEARANCE_M + sum(sole.half_width_m for sole in morphology.soles)
        self._first_side = first_side
        self._queue: list[Step] = []
        self._taken = 0

    def upcoming(self, count: int) -> list[Step]:
        """The next steps without taking them; fewer than count when the gait ends."""
        while len(self._queue) < count and self._remaining():
            self._queue.append(self._draw(self._taken + len(self._queue)))
        return self._queue[:count]

    def take(self) -> Step:
        """Remove the next step from the queue and return it: it has begun.

        Raises:
            IndexError: the gait has no steps left.
        """
        self.upcoming(1)
        step = self._queue.pop(0)
        self._taken += 1
        return step

    def _remaining(self) -> bool:
        steps = self._gait.steps
        return steps is None or self._taken + len(self._queue) < steps

    def _draw(self, index: int) -> Step:
        gait, scale = self._gait, self.scale
        side = (self._first_side + index) % 2
        draws = self._rng.uniform(-1.0, 1.0, size=5)
        sign = 1.0 if side == LEFT else -1.0
        forward = gait.forward_m + gait.random_forward_m * draws[0]
        if index == 0:
            forward /= 2
        widening = max(sign * gait.sideways_m, 0.0) + gait.random_sideways_m * abs(draws[1])
        width = max(self._spacing_m + scale * widening, self.narrowest_m)
        return Step(
            side=side,
            forward_m=float(scale * forward),
            left_m=float(sign * width),
            turn_rad=float(gait.turn_rad + gait.random_turn_rad * draws[2]),
            single_support_s=float(self.clock * gait.single_support_s * (1 + gait.random_duration * draws[3])),
            double_support_s=float(self.clock * gait.double_support_s),
            apex_m=float(scale * (gait.apex_m + gait.random_apex_m * abs(draws[4]))),
            landing_m_s=float(scale / self.clock * gait.landing_m_s),
        )
