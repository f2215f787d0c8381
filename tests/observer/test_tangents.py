"""What tangent columns say must be what identification models of their own would have shown."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from massid.model.realisation import write_fields
from massid.model.robot import Robot
from massid.model.unknowns.spaces import parameter_space
from massid.observer.bank import RobotBank
from massid.observer.inputs import BelievedBlock, InputBelief
from massid.observer.kalman import KalmanInjection
from massid.observer.linearisation import Lineariser
from massid.observer.replay import replay_block
from massid.observer.tangents import TangentFilter
from massid.search.parameters import ALL, Kind, Parameter, ParameterSpace
from massid.typing import FloatArray
from massid.walk import Segment
from massid.walk.noise import PRESETS
from tests.conftest import Pushed

CASES = [
    (Kind.MASS, "l_calf", 1e-3),
    (Kind.MASS, "torso", 1e-3),
    (Kind.COM, "torso/x", 1e-5),
    (Kind.INERTIA_SCALE, "torso", 1e-3),
    (Kind.INERTIA_SCALE, "l_calf", 1e-3),
    (Kind.PAYLOAD, "l_calf@0.1,0,-0.2", 1e-3),
    (Kind.EFFORT_OFFSET, "r_knee", 1e-3),
    (Kind.EFFORT_GAIN, "l_hip_pitch", 1e-4),
    (Kind.WRENCH_OFFSET, "l_foot/2", 1e-2),
    (Kind.WRENCH_OFFSET, "r_foot/4", 1e-3),
    (Kind.WRENCH_GAIN, "r_foot/2", 1e-4),
    (Kind.ENCODER_OFFSET, "l_knee", 1e-5),
    (Kind.FRICTION, "r_hip_pitch", 1e-3),
    (Kind.DAMPING, "l_knee", 1e-4),
]


@pytest.mark.parametrize(("kind", "target", "step"), CASES)
def test_a_tangent_is_the_derivative_that_a_pair_of_models_shows(
    kind: Kind, target: str, step: float, pushed: Pushed
) -> None:
    nominal = 0.0
    if kind is Kind.MASS:
        nominal = pushed.robot.nominal_mass_kg(target)
    elif kind is Kind.COM:
        nominal = float(pushed.robot.model.body("torso").ipos[0])
    elif kind is Kind.DAMPING:
        nominal = float(pushed.robot.model.joint(target).damping[0])
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
    if kind is Kind.INERTIA_SCALE:  # shows in angular accelerations alone, of which an average keeps least
        assert np.sum(column * expected) == pytest.approx(np.sum(column * column), rel=0.3)
    elif sampled.is_inertial or kind in (Kind.EFFORT_GAIN, Kind.WRENCH_GAIN, Kind.ENCODER_OFFSET, Kind.DAMPING):
        # Made of the motion around a sample, so as to share no noise with it: an instrument, not the derivative itself.
        assert np.sum(column * expected) == pytest.approx(np.sum(column * column), rel=0.1)
    else:
        # The linearisation is held over five samples and taken at the measured state.
        np.testing.assert_allclose(column, expected, atol=0.03 * scale)


@pytest.mark.parametrize("kind", [Kind.EFFORT_LAG, Kind.WRENCH_LAG])
def test_a_lags_tangent_is_the_derivative_that_later_readings_show(kind: Kind, pushed: Pushed) -> None:
    """An instrument, too: slopes of the samples around against those between a sample and the next."""
    space, step = ParameterSpace((Parameter.mass("r_thigh", 4.0), Parameter.nuisance(kind, ALL, 1e-3))), 1e-4
    before, after = (_errors(pushed, space, np.array([[4.0, sign * step]])).values[0] for sign in (-1, 1))
    expected = (after - before) / (2.0 * step)
    column = _errors(pushed, space, np.array([[4.0, 0.0]])).tangents[1]
    assert np.abs(column).max() > 0.0
    assert np.sum(column * expected) == pytest.approx(np.sum(column * column), rel=0.02)
    assert np.sum(column * expected) == pytest.approx(np.sum(expected * expected), rel=0.02)


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


@pytest.mark.parametrize("column", range(13))
def test_inertial_forces_are_derivatives_of_the_inverse_dynamics(column: int, pushed: Pushed) -> None:
    robot, contacts = pushed.robot, pushed.walk.contact_bodies
    space = parameter_space(robot, ["torso"], ["com/l_thigh", "inertia/torso", "payload/torso@0.1,0.2,0.3"])
    scales = [Parameter.nuisance(Kind.INERTIA_SCALE, link, 0.1) for link in ("r_thigh", "l_thigh")]
    space = ParameterSpace((*space.parameters, *scales))
    point = space.nominal + 0.1 * space.scale
    lineariser = Lineariser(robot.identification_model(contacts), robot.layout)
    lineariser.place(robot.realise(space, point[None]))
    belief = InputBelief(lineariser.model, robot.layout, PRESETS["white"])
    block = belief.believe(replay_block(pushed.walk, robot.layout, Segment(500, 551)))
    body = np.array([robot.model.body(space.parameters[column].body).id])
    found = lineariser.inertial_forces(block, 25, body, np.array([column]))[:, 0]

    step = 1e-4 * space.scale[column] * np.eye(len(space))[column]
    before, after = (_inverse(robot, space, point + sign * step, block) for sign in (-1, 1))
    np.testing.assert_allclose(
        found, (after - before) / (2.0 * step[column]), rtol=1e-6, atol=1e-6 * np.abs(found).max()
    )


def _inverse(robot: Robot, space: ParameterSpace, point: FloatArray, block: BelievedBlock) -> FloatArray:
    """Generalised forces that the estimated motion takes at sample 25, without constraints."""
    model = robot.identification_model(())
    write_fields(model, robot.realise(space, point[None]))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = block.qpos[25], block.motion.velocity[25]
    data.qacc[:] = block.motion.acceleration[25]
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse.copy()


def _errors(pushed: Pushed, space: ParameterSpace, points: FloatArray):  # type: ignore[no-untyped-def]
    contacts = pushed.walk.contact_bodies
    model = pushed.robot.identification_model(contacts)
    lineariser = Lineariser(model, pushed.robot.layout)
    noise = PRESETS["white"]
    inputs = InputBelief(model, pushed.robot.layout, noise, unknown_friction=True)
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
