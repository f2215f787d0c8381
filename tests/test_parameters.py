from __future__ import annotations

import numpy as np
import pytest

from massid.errors import BadInputError
from massid.parameters import Parameter, ParameterSpace


def test_mass_lies_in_the_default_theta() -> None:
    mass = Parameter.mass("torso", 10.0)
    assert (mass.lower, mass.upper, mass.unit, mass.name) == (3.0, 25.0, "kg", "mass/torso")


def test_projection_ends_in_theta_and_leaves_inner_points_alone() -> None:
    space = ParameterSpace((Parameter.mass("a", 1.0), Parameter.mass("b", 2.0)))
    points = np.array([[0.0, 99.0], [1.1, 2.2]])
    assert not space.contains(points)
    assert space.contains(space.project(points))
    np.testing.assert_array_equal(space.project(points)[1], points[1])


def test_a_link_named_twice_is_refused() -> None:
    with pytest.raises(BadInputError, match="more than once: mass/a"):
        ParameterSpace((Parameter.mass("a", 1.0), Parameter.mass("a", 1.0)))


def test_an_empty_space_is_refused() -> None:
    with pytest.raises(BadInputError, match="at least one link"):
        ParameterSpace(())
