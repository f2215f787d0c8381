"""Lags of logs: how much later than the joint states other readings are stamped, all of a kind alike.

All models read at the same times, so a lag is estimated by its derivative alone: what acts is what is read later.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from massid.errors import BadInputError
from massid.model.layout import Channels
from massid.model.motion import Motion
from massid.model.unknowns.unknown import Effect, Unknown
from massid.typing import FloatArray

if TYPE_CHECKING:
    from massid.model.draft import Draft


@dataclass(frozen=True)
class Lag(Unknown):
    """How much later some readings are stamped."""

    per_walk = True
    unit = "s"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.tangent:
            raise BadInputError(f"{self.name}: all models read at the same times, so a lag must be a tangent.")


@dataclass(frozen=True)
class EffortLag(Lag):
    """How much later than the joint states the joint torques are stamped."""

    kind = "effort_lag"
    title = "lag of the torques"

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As an error of the torque sensors."""
        draft.sensors.effort_lag[:, 0] += values

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """What the torques gain in a second."""
        return Effect(force=motion.effort_rate)


@dataclass(frozen=True)
class WrenchLag(Lag):
    """How much later than the joint states the contact wrenches are stamped."""

    kind = "wrench_lag"
    title = "lag of the wrenches"

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As an error of the contact sensors."""
        draft.sensors.wrench_lag[:, 0] += values

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """What the wrenches gain in a second."""
        return Effect(wrench=motion.wrench_rate)
