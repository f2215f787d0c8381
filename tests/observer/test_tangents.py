"""What tangent columns say must be what identification models of their own would have shown."""

from __future__ import annotations

import numpy as np
import pytest

from massid.log.walk import Segment
from massid.noise import PRESETS
from massid.observer.bank import RobotBank
from massid.observer.inputs import InputBelief
from massid.observer.kalman import KalmanInjection
from massid.observer.linearisation import Lineariser
from massid.observer.replay import replay_block
from massid.observer.tangents import TangentFilter
from massid.parameters import Kind, Parameter, ParameterSpace
from massid.typing import FloatArray
from tests.conftest import Pushed

CASES = [
    (Kind.MASS, "l_calf", 1e-3),
    (Kind.MASS, "torso", 1e-3),
    (Kind.EFFORT_OFFSET, "r_knee", 1e-3),
    (Kind.EFFORT_GAIN, "l_hip_pitch", 1e-4),
    (Kind.WRENCH_OFFSET, "l_foot/2", 1e-2),
    (Kind.WRENCH_OFFSET, "r_foot/4", 1e-3),
    (Kind.WRENCH_GAIN, "r_foot/2", 1e-4),
    (Kind.ENCODER_OFFSET, "l_knee", 1e-5),
]


@pytest.mark.parametrize(("kind", "target", "step"), CASES)
def test_a_tangent_is_the_derivative_that_a_pair_of_models_shows(
    kind: Kind, target: str, step: float, pushed: Pushed
) -> None:
    nominal = pushed.robot.nominal_mass_kg(target) if kind is Kind.MASS else 0.0
    sampled = Parameter(kind, target, nominal, nominal - 1.0, nominal + 1.0, scale=1.0)
    pair = np.array([[nominal], [nominal - step], [nominal + step]])
    errors = _errors(pushed, ParameterSpace((sampled,)), pair)
    expected = (errors.values[2] - errors.values[1]) / (2.0 * step)

    other = Parameter.mass("r_thigh", 4.0)
    tangent = Parameter.nuisance(kind, target, 1.0, nominal)
    space = ParameterSpace((other, tangent))
    column = _errors(pushed, space, np.array([[4.0, nominal]])).tangents[1]
    scale = np.abs(expected).max()
    assert scale > 0.0
    if kind in (Kind.MASS, Kind.EFFORT_GAIN, Kind.WRENCH_GAIN):
        # Made of the motion around a sample, so as to share no noise with it: an instrument, not the derivative itself.
        assert np.sum(column * expected) == pytest.approx(np.sum(column * column), rel=0.1)
    else:
        # The linearisation is held over five samples and taken at the measured state.
        np.testing.assert_allclose(column, expected, atol=0.03 * scale)


def test_sampled_and_tangent_parameters_meet_in_one_quadratic(pushed: Pushed) -> None:
    """Two masses, one sampled and one tangent, lead to the quadratic of two sampled ones."""
    from massid.search.monitoring import MonitoringFilter
    from massid.search.proposal import Proposal, Role

    def quadratic(space: ParameterSpace, points: FloatArray):  # type: ignore[no-untyped-def]
        scores = MonitoringFilter(len(points), 0.001)
        scores.update(_errors(pushed, space, points))
        return scores.result(Proposal(points, (Role.CENTRE, *[Role.SAMPLE] * (len(points) - 1)))).local_quadratic()

    torso, calf = Parameter.mass("torso", 20.0), Parameter.mass("l_calf", 2.5)
    centre = np.array([20.0, 2.5])
    offsets = np.array([[0.0, 0.0], [0.02, 0.0], [-0.02, 0.0], [0.0, 0.01], [0.0, -0.01]])
    both = quadratic(ParameterSpace((torso, calf)), centre + offsets)
    one = quadratic(ParameterSpace((torso, Parameter.nuisance(Kind.MASS, "l_calf", 1.0, 2.5))), centre + offsets[:3])
    np.testing.assert_allclose(one.curvature, both.curvature, rtol=0.02)
    np.testing.assert_allclose(one.gradient, both.gradient, rtol=0.02, atol=0.02 * np.abs(both.gradient).max())


def _errors(pushed: Pushed, space: ParameterSpace, points: FloatArray):  # type: ignore[no-untyped-def]
    contacts = pushed.walk.contact_bodies
    model = pushed.robot.identification_model(contacts)
    lineariser = Lineariser(model, pushed.robot.layout)
    noise = PRESETS["white"]
    inputs = InputBelief(model, pushed.robot.layout, noise)
    injection = KalmanInjection(
        lineariser,
        pushed.robot.layout,
        noise,
        inputs,
        TangentFilter(pushed.robot, space.parameters, contacts, lineariser),
    )
    bank = RobotBank(pushed.robot, space, contacts, len(points), injection)
    bank.place(points)
    block = replay_block(pushed.walk, pushed.robot.layout, Segment(500, 701))
    bank.restart(block)
    return bank.advance(block)
