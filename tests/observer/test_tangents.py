"""What tangent columns say must be what identification models of their own would have shown."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest

from massid.errors import BadInputError
from massid.model.realisation import write_fields
from massid.model.robot import Robot
from massid.model.unknowns.bodies import Inertia, InertiaScale, Mass
from massid.model.unknowns.joints import Armature, Damping, FrictionLoss, Stiffness
from massid.model.unknowns.lags import Lag
from massid.model.unknowns.sensors import EffortOffset, EncoderOffset, WrenchOffset
from massid.model.unknowns.spaces import parameter_space
from massid.model.unknowns.unknown import Unknown, nuisance
from massid.observer.bank import RobotBank
from massid.observer.inputs import BelievedBlock, InputBelief
from massid.observer.kalman import KalmanInjection
from massid.observer.linearisation import Lineariser
from massid.observer.replay import replay_block
from massid.observer.tangents import TangentFilter
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Segment, Walk
from massid.walk.noise import PRESETS
from tests.conftest import Pushed
from tests.pushed_robot import make_robot
from tests.unknown_examples import GyroscopeBias, examples

EXACT = (EffortOffset, WrenchOffset, FrictionLoss)
"""Unknowns whose effect does not depend on how the robot moves."""
STATES = (Damping, Stiffness, EncoderOffset, GyroscopeBias)
"""Those whose effect depends on states alone, which are much better known than what changes them."""


def _driven(robot: Robot) -> list[Unknown]:
    """Unknowns whose effect depends on readings that drive the models; lags are the same in all models of a bank."""
    return [one for one in examples(robot) if not isinstance(one, (*EXACT, *STATES, Lag))]


@pytest.mark.parametrize("unknown", examples(make_robot()), ids=lambda unknown: unknown.name)
def test_a_tangent_is_the_derivative_that_models_show(unknown: Unknown, pushed: Pushed) -> None:
    other, nominal, step = Mass.of("r_thigh", 4.0), unknown.nominal, 1e-3 * unknown.scale
    tangent = replace(unknown, requested=False, tangent=True)
    column = _errors(pushed, ParameterSpace((other, tangent)), np.array([[4.0, nominal]])).tangents[1]
    if isinstance(unknown, Lag):  # all models of a bank have the same
        space, step = ParameterSpace((other, unknown)), 0.2 * unknown.scale
        before, after = (_errors(pushed, space, np.array([[4.0, sign * step]])).values[0] for sign in (-1, 1))
    else:
        pair = np.array([[nominal], [nominal - step], [nominal + step]])
        _, before, after = _errors(pushed, ParameterSpace((unknown,)), pair).values
    expected = (after - before) / (2.0 * step)
    scale = np.abs(expected).max()
    assert scale > 0.0
    if isinstance(unknown, EXACT):
        # The linearisation is held over five samples and taken at the measured state.
        np.testing.assert_allclose(column, expected, atol=0.03 * scale)
        return
    # Made of the motion around a sample, so as to share no noise with it: an instrument, not the derivative itself.
    # What shows in angular accelerations alone keeps least of itself in an average, slopes of readings keep most.
    tolerance = (
        0.3 if isinstance(unknown, Inertia | InertiaScale | Armature) else 0.02 if isinstance(unknown, Lag) else 0.1
    )
    assert np.sum(column * expected) == pytest.approx(np.sum(column * column), rel=tolerance)
    if isinstance(unknown, Lag):
        assert np.sum(column * expected) == pytest.approx(np.sum(expected * expected), rel=tolerance)


@pytest.mark.parametrize("unknown", _driven(make_robot()), ids=lambda unknown: unknown.name)
def test_what_the_centre_shows_is_the_derivative_that_models_show(unknown: Unknown, pushed: Pushed) -> None:
    """Readings and the centre's own accelerations, noise and all: the slope of the score, not an instrument."""
    other, nominal, step = Mass.of("r_thigh", 4.0), unknown.nominal, 1e-3 * unknown.scale
    rng, walk = np.random.default_rng(3), pushed.walk
    noisy = replace(walk, effort=rng.normal(walk.effort, 0.3), wrench=rng.normal(walk.wrench, 1.0))
    space = ParameterSpace((other, replace(unknown, requested=False, tangent=True)))
    errors = _errors(pushed, space, np.array([[4.0, nominal]]), noisy)
    pair = np.array([[nominal], [nominal - step], [nominal + step]])
    _, before, after = _errors(pushed, ParameterSpace((unknown,)), pair, noisy).values
    expected = (after - before) / (2.0 * step)
    found = errors.shown.values[errors.shown.columns.tolist().index(1)]
    # The linearisation is held over five samples and taken at the measured state.
    np.testing.assert_allclose(found, expected, atol=0.03 * np.abs(expected).max())


def test_what_no_log_with_noise_can_tell_of_is_refused(pushed: Pushed) -> None:
    @dataclass(frozen=True)
    class Mystery(Unknown):
        kind = "mystery"
        title = "mysteries"

        def write(self, draft, values):  # type: ignore[no-untyped-def]
            draft.field("dof_armature")[:] += values[:, None]

    mystery = Mystery(**nuisance(0.1))
    with pytest.raises(BadInputError, match=r"mystery/all: what it does to a motion is not known.*needs an `effect`"):
        _errors(pushed, ParameterSpace((*pushed.space.parameters, mystery)), pushed.truth[None])


def test_sampled_and_tangent_parameters_meet_in_one_quadratic(pushed: Pushed) -> None:
    """Two masses, one sampled and one tangent, lead to the quadratic of two sampled ones."""
    from massid.search.monitoring import MonitoringFilter
    from massid.search.proposal import Proposal, Role

    def quadratic(space: ParameterSpace, points: FloatArray):  # type: ignore[no-untyped-def]
        scores = MonitoringFilter(len(points), 0.001)
        scores.update(_errors(pushed, space, points))
        roles = (Role.CENTRE, *[Role.SAMPLE] * (len(points) - 1))
        n_tangents = len(space) - space.n_sampled
        return scores.result(Proposal(points, roles, n_tangents=n_tangents)).local_quadratic()

    torso, calf = Mass.of("torso", 20.0), Mass.of("l_calf", 2.5)
    centre = np.array([20.0, 2.5])
    offsets = np.array([[0.0, 0.0], [0.02, 0.0], [-0.02, 0.0], [0.0, 0.01], [0.0, -0.01]])
    both = quadratic(ParameterSpace((torso, calf)), centre + offsets)
    one = quadratic(ParameterSpace((torso, Mass("l_calf", **nuisance(1.0, 2.5)))), centre + offsets[:3])
    np.testing.assert_allclose(one.curvature, both.curvature, rtol=0.02)
    np.testing.assert_allclose(one.gradient, both.gradient, rtol=0.02, atol=0.02 * np.abs(both.gradient).max())


def test_inertial_forces_are_derivatives_of_the_inverse_dynamics(pushed: Pushed) -> None:
    """Of several unknowns of one body at a time, away from the model file's values."""
    robot, contacts = pushed.robot, pushed.walk.contact_bodies
    wanted = ["com/l_thigh", "inertia/torso", "payload/torso@0.1,0.2,0.3", "inertia_scale/r_thigh"]
    space = parameter_space(robot, ["torso"], [*wanted, "inertia_scale/l_thigh"])
    point = space.nominal + 0.1 * space.scale
    lineariser = Lineariser(robot.identification_model(contacts), robot.layout)
    lineariser.place(robot.realise(space, point))
    belief = InputBelief(lineariser.model, robot.layout, PRESETS["white"])
    block = belief.believe(replay_block(pushed.walk, robot.layout, Segment(500, 551)))
    assert sorted(lineariser.changing) == list(range(len(space)))
    for column, found in zip(lineariser.changing, lineariser.inertial_forces(block.motion)[25].T, strict=True):
        step = 1e-4 * space.scale[column] * np.eye(len(space))[column]
        before, after = (_inverse(robot, space, point + sign * step, block) for sign in (-1, 1))
        expected = (after - before) / (2.0 * step[column])
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(found).max())


def _inverse(robot: Robot, space: ParameterSpace, point: FloatArray, block: BelievedBlock) -> FloatArray:
    """Generalised forces that the estimated motion takes at sample 25, without constraints."""
    model = robot.identification_model(())
    write_fields(model, robot.realise(space, point))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = block.qpos[25], block.motion.velocity[25]
    data.qacc[:] = block.motion.acceleration[25]
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse.copy()


def _errors(pushed: Pushed, space: ParameterSpace, points: FloatArray, walk: Walk | None = None):  # type: ignore[no-untyped-def]
    contacts = pushed.walk.contact_bodies
    model = pushed.robot.identification_model(contacts)
    lineariser = Lineariser(model, pushed.robot.layout)
    noise = PRESETS["white"]
    inputs = InputBelief(model, pushed.robot.layout, noise, unknown_friction=True)
    columns = TangentFilter(pushed.robot, space, contacts, lineariser)
    slopes = TangentFilter(pushed.robot, space, contacts, lineariser, columns.depend_on_inputs)
    injection = KalmanInjection(lineariser, pushed.robot.layout, noise, inputs, columns, slopes)
    bank = RobotBank(pushed.robot, space, contacts, len(points), injection)
    bank.place(points)
    block = replay_block(walk or pushed.walk, pushed.robot.layout, Segment(500, 701))
    bank.restart(block)
    return bank.advance(block)
