"""The whole robot on a pair of scales: one more reading, which no log holds.

Without force sensors the scale of all masses rests on the torque sensors, and an error that these have in common goes
into every mass. One number from bathroom scales bounds it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massid.model.unknowns.unknown import adds_mass
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray


@dataclass(frozen=True)
class Scales:
    """What they read.

    Attributes:
        excess_kg: beyond the mass of the model file [kg].
        std_kg: how uncertain that is [kg].
    """

    excess_kg: float
    std_kg: float

    def information(self, space: ParameterSpace) -> FloatArray:
        """About the unknowns of a space, shape (n_p, n_p)."""
        masses = adds_mass(space)
        return np.outer(masses, masses) / self.std_kg**2

    def belief(self, space: ParameterSpace) -> LocalQuadratic:
        """Minus twice the logarithm of the likelihood of what they read."""
        masses = adds_mass(space)
        centre = space.nominal + masses * self.excess_kg / max(float(masses @ masses), np.finfo(float).tiny)
        return replace(LocalQuadratic.belief(centre, np.zeros(len(space))), curvature=2.0 * self.information(space))
