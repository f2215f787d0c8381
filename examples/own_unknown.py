"""An unknown of one's own: a wrong torque constant that all drives share. Its class says what it writes and does.

python examples/own_unknown.py
"""

from dataclasses import dataclass, replace

import numpy as np

import massid
from massid.model.draft import Draft
from massid.model.layout import Channels
from massid.model.motion import Motion
from massid.model.unknowns.unknown import Effect, Unknown


@dataclass(frozen=True)
class TorqueConstant(Unknown):
    """Relative error of all torque readings alike."""

    kind = "torque_constant"
    title = "error of the torque constant"
    per_walk = True  # an error of sensors, not of the robot

    def write(self, draft: Draft, values: np.ndarray) -> None:
        """Into the gains of all joints' torque sensors, one value for each model."""
        draft.sensors.effort_gain[:] += values[:, None]

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """What a unit more of it does along a motion: for noisy logs, and for least squares."""
        return Effect(force=-motion.effort)


def main() -> massid.Result:
    """Weigh a robot whose drives report 5 % too much torque."""
    walk = massid.read_walk(massid.sample_walk())
    spoilt = replace(walk, effort=1.05 * walk.effort)
    constant = TorqueConstant(nominal=0.0, lower=-0.5, upper=0.5, scale=0.05)
    result = massid.weigh(spoilt, "atlas", unknowns=[constant], checks=False)
    print({link: round(mass_kg, 2) for link, mass_kg in result.estimate_kg.items()})
    print(f"torque constant: {result.quantities[0].estimate:+.4f}")
    return result


if __name__ == "__main__":
    main()
