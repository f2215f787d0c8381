from __future__ import annotations

import numpy as np
import pytest

from massid.errors import BadInputError
from massid.search.parameters import Kind, Parameter, ParameterSpace


def test_mass_lies_in_the_default_theta() -> None:
    mass = Parameter.mass("torso", 10.0)
    assert (mass.lower, mass.upper, mass.unit, mass.name) == (3.0, 25.0, "kg", "mass/torso")


def test_offsets_of_a_contact_sensor_have_the_unit_of_their_axis() -> None:
    units = [Parameter.nuisance(Kind.WRENCH_OFFSET, target, 1.0).unit for target in ("sole/2", "sole/3", "sole/0@2")]
    assert units == ["N", "N m", "N"]


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
