"""A search direction of one's own, handed in as an object: Newton's step, but no mass moves by more than a tenth.

python examples/own_direction.py
"""

import numpy as np

import massid
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic


class CautiousNewton:
    """Newton's step, shortened as a whole until the mass that moves most moves by a tenth of itself."""

    second_order = True  # it goes by the Gram matrix's curvature and gradient

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> np.ndarray:
        """Offset of the next estimate from the quadratic's centre, shape (n_p,)."""
        newton = -np.linalg.solve(quadratic.curvature, quadratic.gradient)
        return newton * min(1.0, 0.1 / np.max(np.abs(newton) / space.scale))


def main() -> massid.Result:
    """Weigh the sample walk's robot along it, and print how the torso gets there."""
    options = massid.IdentifyOptions(search=massid.SearchOptions(direction=CautiousNewton()))
    result = massid.weigh(massid.sample_walk(), robot="atlas", options=options, checks=False)
    for window in result.windows:
        print(f"{window.time_s:.1f} s: torso {window.estimate[0]:.3f} kg")
    return result


if __name__ == "__main__":
    main()
