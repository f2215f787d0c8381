from __future__ import annotations

import numpy as np
import pytest

from massid.errors import BadInputError
from massid.search.parameters import Parameter, ParameterSpace


def _number(name: str, nominal: float) -> Parameter:
    return Parameter(name, nominal=nominal, lower=0.3 * nominal, upper=2.5 * nominal, scale=nominal)


def test_projection_ends_in_theta_and_leaves_inner_points_alone() -> None:
    space = ParameterSpace((_number("a", 1.0), _number("b", 2.0)))
    points = np.array([[0.0, 99.0], [1.1, 2.2]])
    assert not space.contains(points)
    assert space.contains(space.project(points))
    np.testing.assert_array_equal(space.project(points)[1], points[1])


def test_a_parameter_named_twice_is_refused() -> None:
    with pytest.raises(BadInputError, match="more than once: a"):
        ParameterSpace((_number("a", 1.0), _number("a", 1.0)))


def test_a_nominal_value_outside_theta_is_refused() -> None:
    with pytest.raises(BadInputError, match=r"a: nominal 3.0 1 must lie in \[0.0, 2.0\]"):
        Parameter("a", nominal=3.0, lower=0.0, upper=2.0, scale=1.0)


def test_an_empty_space_is_refused() -> None:
    with pytest.raises(BadInputError, match="at least one link"):
        ParameterSpace(())
