"""What is believed of a sample: hollow averages, certain zeros, and no trace of where a walk was cut into blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest

from massid.model.motion import Motion
from massid.model.unknowns.bodies import Mass
from massid.model.unknowns.lags import EffortLag, WrenchLag
from massid.model.unknowns.sensors import EffortGain, EffortOffset, EncoderOffset, WrenchGain, WrenchOffset
from massid.model.unknowns.spaces import mass_space
from massid.model.unknowns.unknown import Unknown, nuisance
from massid.observer.inputs import BelievedBlock, InputBelief
from massid.observer.replay import ReplayBlock, replay_block
from massid.observer.spans import Spans
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Segment, Walk
from massid.walk.noise import PRESETS, Sensors
from tests.pushed_robot import FEET, LINKS, make_robot, push_about

NOISE = PRESETS["white"]
ROBOT = make_robot(friction_loss=1.0)
TIMESTEP_S = 1e-3
SPANS = Spans.at(TIMESTEP_S)
GAP, REACH = SPANS.gap, SPANS.reach


@pytest.fixture(scope="module")
def walk() -> Walk:
    """A noisy log with friction, of which one foot leaves the ground twice."""
    space = mass_space(ROBOT, LINKS)
    clean = push_about(ROBOT, space, space.nominal, seconds=0.8, amplitude=0.15)
    wrench = clean.wrench.copy()
    wrench[150:300, 0] = wrench[420:560, 0] = 0.0
    return Sensors(NOISE, 8, FEET, np.random.default_rng(0)).measure(replace(clean, wrench=wrench))


def _belief(friction: bool = True) -> InputBelief:
    robot = ROBOT if friction else make_robot()
    return InputBelief(robot.identification_model(FEET), robot.layout, NOISE)


def _believe(walk: Walk, borders: Sequence[int], belief: InputBelief | None = None) -> list[BelievedBlock]:
    """Blocks from border to border, each with as much ahead as a stream waits for."""
    belief = belief or _belief()
    layout = ROBOT.layout
    return [
        belief.believe(
            replay_block(
                walk, layout, Segment(first, last + 1), Segment(last, min(last + SPANS.look_ahead + 1, borders[-1] + 1))
            )
        )
        for first, last in pairwise(borders)
    ]


@pytest.mark.parametrize("lag_s", [-1.7e-3, -1e-3, 3e-4, 2e-3])
def test_inputs_that_are_stamped_late_are_read_later(lag_s: float, walk: Walk) -> None:
    """On a straight line, which linear interpolation keeps, wherever the walk is cut."""
    ramp = np.arange(len(walk)) * TIMESTEP_S
    straight = replace(walk, effort=100.0 * ramp[:, None] + np.zeros(8), wrench=walk.wrench)
    space = ParameterSpace((*mass_space(ROBOT, LINKS).parameters, EffortLag(**nuisance(1e-3))))
    belief = _belief()
    belief.place(ROBOT.realise(space, np.append(space.nominal[:-1], lag_s), FEET))
    blocks = _believe(straight, [100, 150, 171, 300], belief)
    effort = np.concatenate([block.effort[:, ROBOT.layout.joint_dof] for block in blocks])
    own = slice(2, -2)  # nothing is known from before the first block and after the last
    np.testing.assert_allclose(effort[own].T, np.tile(100.0 * (ramp[100:300][own] + lag_s), (8, 1)), atol=1e-12)
    rates = np.concatenate([block.motion.effort_rate[:, ROBOT.layout.joint_dof] for block in blocks])
    np.testing.assert_allclose(rates[REACH + 2 : -REACH - 2], 100.0, rtol=1e-9)


def test_what_a_lag_does_to_the_models_is_what_their_readings_rates_say(walk: Walk) -> None:
    """The slope of the score is made of these rates: with those of impacts, lags would look known that are not."""
    lags = (EffortLag(**nuisance(1e-3)), WrenchLag(**nuisance(1e-3)))
    space = ParameterSpace((*mass_space(ROBOT, LINKS).parameters, *lags))
    blocks = []
    for lag_s in (0.0, 1e-5):
        belief = _belief()
        belief.place(ROBOT.realise(space, np.array([*space.nominal[:-2], lag_s, lag_s]), FEET))
        blocks.append(_believe(walk, [200, 260, 400], belief)[1])
    now, later = blocks
    both = now.motion.loaded * later.motion.loaded
    np.testing.assert_allclose((later.effort - now.effort) / 1e-5, now.readings.effort_rate, rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose(
        both * (later.wrench - now.wrench) / 1e-5, both * now.readings.wrench_rate, rtol=1e-6, atol=1e-3
    )


def _columns(block: BelievedBlock) -> dict[str, FloatArray]:
    own = {name: getattr(block, name) for name in ("wrench", "friction", "friction_loss", "friction_variance")}
    return own | {f"motion.{entry.name}": getattr(block.motion, entry.name) for entry in fields(Motion)}


def _joined(blocks: Sequence[BelievedBlock]) -> dict[str, FloatArray]:
    columns = [_columns(block) for block in blocks]
    return {name: np.concatenate([part[name] for part in columns]) for name in columns[0]}


def _flat(velocity: FloatArray) -> ReplayBlock:
    """Measurements of a robot whose joints and base have given velocities, shape (n + 1, nv)."""
    n = len(velocity) - 1
    return ReplayBlock(np.zeros((n + 1, 15)), velocity, np.zeros((n, 14)), np.full((n, 12), 100.0))


@pytest.mark.parametrize("n_steps", [50, 7, 1])
def test_borders_of_blocks_leave_no_trace(n_steps: int, walk: Walk) -> None:
    last = 299 if n_steps == 1 else 799
    whole, parts = _believe(walk, [0, last]), _believe(walk, [*range(0, last, n_steps), last])
    expected, found = _joined(whole), _joined(parts)
    assert 0.0 < expected["motion.loaded"].mean() < 1.0
    assert 0.0 < np.mean(expected["friction_variance"] > 0.0) < 1.0
    for name, rows in expected.items():
        # What noise does to friction is computed for every tenth sample of a block.
        rtol = 0.05 if name == "friction_variance" else 1e-9
        np.testing.assert_allclose(found[name], rows, rtol=rtol, atol=1e-9 * np.abs(rows).max(), err_msg=name)


def test_the_motion_at_a_sample_is_that_of_its_neighbours_on_both_sides(walk: Walk) -> None:
    """Disturb one sample: the motion changes where it is more than GAP and at most REACH away, and nowhere else."""
    k = 360  # both feet are loaded, and no foot is near leaving
    names = ("qvel", "effort", "wrench")
    steady = {name: np.broadcast_to(getattr(walk, name)[k], getattr(walk, name).shape) for name in names}
    walk = replace(walk, **steady)  # where something jumps, nearer neighbours are asked
    rows = {name: getattr(walk, name).copy() for name in names}
    for values in rows.values():
        values[k] *= 1.001
    before, after = (_columns(_believe(one, [0, 799])[0]) for one in (walk, replace(walk, **rows)))
    distance = np.abs(np.arange(799) - k)
    neighbours = np.flatnonzero((distance > GAP) & (distance <= REACH))
    for name in ("velocity", "acceleration", "effort", "wrench"):
        change = np.abs(after[f"motion.{name}"] - before[f"motion.{name}"]).max(axis=1)
        # The middle of a straight line's support has no weight in its slope.
        tilts = neighbours if name != "acceleration" else neighbours[distance[neighbours] != (GAP + 1 + REACH) / 2]
        np.testing.assert_array_equal(np.flatnonzero(change > 1e-9), tilts, err_msg=name)


@pytest.mark.parametrize("k", [0, 10, 788, 798])
def test_a_sample_has_no_part_in_its_own_motion_at_the_ends_of_a_log_either(k: int, walk: Walk) -> None:
    rows = {name: getattr(walk, name).copy() for name in ("qvel", "effort")}
    for values in rows.values():
        values[k] *= 1.001
    before, after = (_columns(_believe(one, [0, 799])[0]) for one in (walk, replace(walk, **rows)))
    distance = np.abs(np.arange(799) - k)
    for name in ("velocity", "acceleration", "effort"):
        changed = np.abs(after[f"motion.{name}"] - before[f"motion.{name}"]).max(axis=1) > 1e-9
        assert changed.any(), name
        assert set(distance[changed]) <= set(range(min(SPANS.finer)[0] + 1, REACH + 1)), name


def test_velocity_and_acceleration_of_a_smooth_motion_are_exact() -> None:
    """A constant jerk cancels between the two sides; one side alone is exact for a constant acceleration."""
    time_s = TIMESTEP_S * np.arange(201)[:, None]
    rate = np.linspace(-3.0, 3.0, 14)
    motion = _belief(friction=False).believe(_flat(rate * (1.0 + time_s + 10.0 * time_s**2))).motion
    inner = slice(REACH, 200 - REACH)
    np.testing.assert_allclose(motion.acceleration[inner], (rate * (1.0 + 20.0 * time_s[:-1]))[inner], atol=1e-9)
    steady = _belief(friction=False).believe(_flat(rate * (1.0 + time_s))).motion
    np.testing.assert_allclose(steady.velocity[inner], (rate * (1.0 + time_s[:-1]))[inner], atol=1e-12)
    np.testing.assert_allclose(steady.acceleration, np.repeat(rate[None], 200, axis=0), atol=1e-9)


def test_forces_have_no_part_in_the_acceleration(walk: Walk) -> None:
    """Force noise in an acceleration would be the noise of the output error once more."""
    pushed = replace(walk, effort=3.0 * walk.effort, wrench=2.0 * walk.wrench)
    one, other = (_believe(each, [0, 400])[0].motion for each in (walk, pushed))
    np.testing.assert_array_equal(one.acceleration, other.acceleration)
    np.testing.assert_array_equal(one.velocity, other.velocity)


def test_known_errors_of_the_sensors_leave_no_trace_in_the_motion(walk: Walk) -> None:
    """A torque that is only an offset would accelerate a light link in the linearisation, and nowhere else."""
    rng = np.random.default_rng(1)
    sensors = Sensors(PRESETS["realistic"], 8, FEET, rng)
    offset, gain = sensors.wrench_offset, sensors.wrench_gain
    offset[0], gain[0] = 0.0, 1.0  # of the foot that leaves the ground
    qpos = walk.qpos.copy()
    qpos[:, 7:] += sensors.joint_position_offset
    read = replace(
        walk,
        qpos=qpos,
        effort=sensors.effort_gain * walk.effort + sensors.effort_offset,
        wrench=gain * walk.wrench + offset,
    )
    unknowns: list[Unknown] = [
        kind(name, **nuisance(1.0)) for kind in (EffortOffset, EffortGain, EncoderOffset) for name in ROBOT.joint_names
    ]
    values = [*sensors.effort_offset, *(sensors.effort_gain - 1.0), *sensors.joint_position_offset]
    for kind, errors in ((WrenchOffset, offset), (WrenchGain, gain - 1.0)):
        unknowns += [kind(body, axis, **nuisance(1.0)) for body in FEET for axis in range(6)]
        values += errors.ravel().tolist()
    space = ParameterSpace((Mass.of("torso", 20.0), *unknowns))
    point = np.array([[20.0, *values]])
    belief = _belief(friction=False)
    belief.place(ROBOT.realise(space, point, FEET))
    found, expected = (_believe(one, [0, 799], each)[0] for one, each in ((read, belief), (walk, _belief(False))))
    for entry in fields(Motion):
        values = getattr(expected.motion, entry.name)
        np.testing.assert_allclose(getattr(found.motion, entry.name), values, atol=1e-9 * np.abs(values).max())
    assert np.abs(found.effort - expected.effort).max() > 0.1  # models take the errors out of the inputs themselves


def test_the_wrench_of_an_unloaded_foot_is_zero_and_nothing_else_is_touched(walk: Walk) -> None:
    block = _believe(walk, [0, 799])[0]
    inside = slice(190, 290)
    for rows in (block.motion.loaded, block.wrench, block.motion.wrench):
        assert not rows[inside, :6].any()
    assert block.motion.loaded[:, 6:].all()
    loaded = block.motion.loaded > 0.0
    np.testing.assert_array_equal(block.wrench[loaded], walk.wrench[:-1].reshape(799, 12)[loaded])


def test_friction_acts_beside_the_measured_torques_of_joints_alone(walk: Walk) -> None:
    block = _believe(walk, [0, 300])[0]
    assert not block.friction[:, :6].any()
    assert np.abs(block.friction[:, 6:]).max() > 0.5
    np.testing.assert_array_equal(block.generalised_force(100), block.effort[100] + block.friction[100])


def test_a_restart_forgets_what_was_before(walk: Walk) -> None:
    fresh = _joined(_believe(walk, [400, 450]))
    belief = _belief()
    _believe(walk, [200, 330], belief)
    belief.restart()
    for name, rows in _joined(_believe(walk, [400, 450], belief)).items():
        np.testing.assert_allclose(rows, fresh[name], rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("n_steps", [1, 2, REACH - GAP - 1, REACH - GAP, REACH, 2 * REACH])
def test_short_logs_have_a_motion_too(n_steps: int) -> None:
    rate = np.linspace(-1.0, 1.0, 14)
    motion = _belief(friction=False).believe(_flat(np.repeat(rate[None], n_steps + 1, axis=0))).motion
    np.testing.assert_allclose(motion.velocity, np.repeat(rate[None], n_steps, axis=0), atol=1e-12)
    np.testing.assert_allclose(motion.acceleration, 0.0, atol=1e-9)
