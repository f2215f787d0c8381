"""How the floating base moved, as a log has it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from massid.typing import FloatArray
from massid.walk import Segment, Walk
from massid.walk.conventions import to_body, to_world


@dataclass(frozen=True)
class BaseMotion:
    """Motion of the base alone, which is little to hold in several conventions.

    Attributes:
        position: of the base [m], shape (n, 3).
        attitude: unit quaternions wxyz, shape (n, 4).
        linear: velocity in the world [m/s], shape (n, 3).
        angular: turn rate in the body [rad/s], shape (n, 3).
        step_s: sample period [s].
        segments: runs without a gap.
    """

    position: FloatArray
    attitude: FloatArray
    linear: FloatArray
    angular: FloatArray
    step_s: float
    segments: tuple[Segment, ...]

    @classmethod
    def of(cls, walk: Walk) -> BaseMotion:
        """That of a walk."""
        qpos, qvel = walk.qpos, walk.qvel
        return cls(qpos[:, :3], qpos[:, 3:7], qvel[:, :3], qvel[:, 3:6], walk.timestep_s, walk.segments)

    def reordered(self, order: list[int]) -> BaseMotion:
        """With the attitude's four numbers in another order; the velocity was turned by the attitude as it was read."""
        attitude = self.attitude[:, order]
        return replace(self, attitude=attitude, linear=to_world(attitude, to_body(self.attitude, self.linear)))
