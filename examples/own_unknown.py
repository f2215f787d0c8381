"""An unknown of one's own, handed in as an object: one gain that all torque sensors share, beside the links' masses.

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
class CommonGain(Unknown):
    """Relative error of all torque sensors alike, as of a wrong torque constant in the drivers."""

    kind = "common_gain"
    title = "common gain of the torque sensors"
    per_walk = True

    def write(self, draft: Draft, values: np.ndarray) -> None:
        """Into the sensors of N models, shape (N,)."""
        draft.sensors.effort_gain[:] += values[:, None]

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """The same readings mean less torque; not needed where logs have no noise and nothing is judged before."""
        return Effect(force=-motion.effort)


def main() -> massid.Result:
    """Weigh the sample walk's robot with torques that read 3 % too much."""
    walk = massid.read_walk(massid.sample_walk())
    walk = replace(walk, effort=1.03 * walk.effort)
    gain = CommonGain(nominal=0.0, lower=-0.2, upper=0.2, scale=0.02)
    result = massid.weigh(walk, robot="atlas", unknowns=[gain])
    print(f"torso {result.estimate_kg['torso']:.3f} kg, gain {result.quantities[0].estimate:+.4f}")
    return result


if __name__ == "__main__":
    main()
