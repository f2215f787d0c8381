"""Every unknown there is: its name, what it does to a motion, and what a saved model has of it."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from massid.errors import BadInputError, LogError, ModelError
from massid.model.draft import realise
from massid.model.motion import Motion
from massid.model.realisation import SensorErrors, write_fields
from massid.model.robot import Robot
from massid.model.unknowns.bodies import Mass
from massid.model.unknowns.lags import EffortLag
from massid.model.unknowns.sensors import WrenchOffset
from massid.model.unknowns.spaces import ask, kinds, parameter_space
from massid.model.unknowns.unknown import KINDS, Unknown, adds_mass, nuisance, unknowns_of
from massid.observer.linearisation import Lineariser
from massid.search.parameters import Parameter, ParameterSpace
from massid.typing import FloatArray
from tests.pushed_robot import FEET, make_robot
from tests.unknown_examples import COMMON_GAIN, LAGS, NAMED, OWN, TWIN_CALVES, CommonGain, examples, package_kinds

ROBOT = make_robot()
CHANNELS = ROBOT.channels(FEET)
ALL = examples(ROBOT)


def test_there_is_an_example_of_every_kind() -> None:
    assert {unknown.kind for unknown in ALL if unknown not in OWN} == package_kinds()
    assert set(kinds()) & package_kinds() == package_kinds() - {lag.kind for lag in LAGS}


@pytest.mark.parametrize("name", NAMED)
def test_what_is_asked_for_by_its_name_has_it(name: str) -> None:
    (unknown,) = ask(ROBOT, name)
    assert unknown.name == name
    assert list(ask(ROBOT, unknown.name)) == [unknown]
    assert unknown.of_log(2).name == f"{name}@2"
    assert unknown.of_log(2).of_log(None) == unknown


def test_a_users_own_kind_is_asked_for_like_the_others() -> None:
    assert CommonGain.kind in kinds()
    assert parameter_space(ROBOT, ["torso"], ["shared_gain/all"]).parameters[-1] == COMMON_GAIN


@pytest.mark.parametrize(("text", "count"), [("com/torso", 3), ("inertia/torso", 6), ("wrench_gain/l_foot", 6)])
def test_a_body_stands_for_all_that_is_unknown_of_it(text: str, count: int) -> None:
    found = ask(ROBOT, text)
    assert len({unknown.name for unknown in found}) == count
    assert all(list(ask(ROBOT, unknown.name)) == [unknown] for unknown in found)


def test_names_of_bodies_may_hold_slashes() -> None:
    spec = ROBOT.spec.copy()
    spec.body("torso").name, spec.body("l_foot").name = "atlas/torso", "atlas/x"
    robot = Robot(spec)
    assert [unknown.name for unknown in ask(robot, "com/atlas/torso/z")] == ["com/atlas/torso/z"]
    assert [unknown.name for unknown in ask(robot, "com/atlas/x")] == [f"com/atlas/x/{axis}" for axis in "xyz"]
    assert ask(robot, "wrench_gain/atlas/x/5")[0].label == "atlas/x moment z"


def test_units_are_those_of_the_axis() -> None:
    units = [ask(ROBOT, f"wrench_offset/l_foot/{axis}")[0].unit for axis in (2, 3)]
    assert units == ["N", "N m"]
    assert WrenchOffset("l_foot", 0, **nuisance(1.0)).of_log(2).unit == "N"


def test_a_mass_lies_in_the_default_theta() -> None:
    mass = Mass.of("torso", 10.0)
    assert (mass.lower, mass.upper, mass.unit, mass.name) == (3.0, 25.0, "kg", "mass/torso")


@pytest.mark.parametrize("unknown", ALL, ids=lambda unknown: unknown.name)
def test_an_effect_is_the_derivative_of_the_inverse_dynamics(unknown: Unknown) -> None:
    """At a model that is off already; of sensors with errors it is the first order, in which gains are small."""
    point = np.array([unknown.nominal + (0.0 if unknown.per_walk else 0.1 * unknown.scale)])
    motion = _motion(seed=1)
    plant = _Plant(unknown, point)
    effect = unknown.effect(motion, CHANNELS)
    expected = np.zeros_like(motion.velocity)
    if effect.force is not None:
        expected -= effect.force
    if effect.wrench is not None:
        expected -= np.einsum("kvw,kw->kv", plant.jacobians(motion), effect.wrench)
    if effect.measured is not None:
        step = 1e-6
        before, after = (plant.unexplained(_moved(motion, sign * step * effect.measured)) for sign in (1, -1))
        expected += (after - before) / (2.0 * step)
    lineariser = Lineariser(ROBOT.identification_model(FEET), ROBOT.layout)
    lineariser.place(realise(CHANNELS, (unknown,), point[None]))
    expected += lineariser.inertial_forces(motion).sum(axis=2)

    step = 1e-4 * unknown.scale
    before, after = (_Plant(unknown, point + sign * step).unexplained(plant.read(motion)) for sign in (-1, 1))
    found = (after - before) / (2.0 * step)
    assert np.abs(found).max() > 0.0
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * np.abs(found).max())


@pytest.mark.parametrize("unknown", ALL, ids=lambda unknown: unknown.name)
def test_a_saved_model_moves_like_the_one_that_was_written(unknown: Unknown, tmp_path: Path) -> None:
    space = ParameterSpace((unknown,))
    point = space.nominal + 0.2 * space.scale
    if unknown is TWIN_CALVES or not unknown.per_walk:
        assert not _same_motion(ROBOT.model_at(space, point), ROBOT.model)
    ROBOT.write_model(space, point, tmp_path / "saved.xml")
    assert _same_motion(Robot.load(tmp_path / "saved.xml").model, ROBOT.model_at(space, point))
    if unknown.per_walk:  # the robot is not what its sensors read
        assert _same_motion(ROBOT.model_at(space, point), ROBOT.model)


def test_a_model_that_would_be_saved_without_what_was_found_is_refused(tmp_path: Path) -> None:
    @dataclass(frozen=True)
    class Rest(Unknown):
        kind = "rest"
        title = "rests of springs"
        joint: str

        def write(self, draft, values):  # type: ignore[no-untyped-def]
            address = draft.channels.model.joint(self.joint).qposadr[0]
            draft.field("qpos_spring")[:, address] = values

    rest = Rest("l_knee", nominal=0.01, lower=0.0, upper=1.0, scale=0.01)
    with pytest.raises(ModelError, match=r"another qpos_spring than what was found.*write_spec"):
        ROBOT.write_model(ParameterSpace((rest,)), np.array([0.3]), tmp_path / "saved.xml")
    assert not list(tmp_path.iterdir())


def test_the_unknown_in_the_guide_is_one(tmp_path: Path) -> None:
    guide = (Path(__file__).resolve().parents[2] / "docs" / "your_robot.md").read_text()
    (block,) = re.findall(r"```python\n(.*?)```", guide, flags=re.DOTALL)
    names: dict[str, Any] = {"__name__": __name__}
    exec(block, names)
    test_an_effect_is_the_derivative_of_the_inverse_dynamics(names["rotor"])
    test_a_saved_model_moves_like_the_one_that_was_written(names["rotor"], tmp_path)


def test_errors_of_one_sensor_add_up() -> None:
    both = (*ask(ROBOT, "effort_gain/l_knee"), COMMON_GAIN)
    sensors = realise(CHANNELS, both, np.array([[0.01, 0.02], [0.0, 0.03]])).sensors
    assert sensors is not None
    expected = np.repeat([[0.02], [0.03]], 8, axis=1)
    expected[0, ROBOT.joint_names.index("l_knee")] += 0.01
    np.testing.assert_allclose(sensors.effort_gain, expected)


def test_the_whole_robots_mass_counts_every_part() -> None:
    space = parameter_space(ROBOT, ["torso"], ["com/torso/x", "payload/l_foot", TWIN_CALVES])
    np.testing.assert_array_equal(adds_mass(space), [1.0, 0.0, 1.0, 2.0])
    before, after = (ROBOT.model_at(space, space.nominal + change).body_mass.sum() for change in (0.0, 0.1))
    assert after - before == pytest.approx(0.1 * adds_mass(space).sum())


def test_a_sensor_that_is_not_there_is_named() -> None:
    space = ParameterSpace(tuple(ask(ROBOT, "wrench_offset/torso/0")))
    with pytest.raises(LogError, match=r"The log has no contact sensor named 'torso'.* It has: l_foot, r_foot"):
        ROBOT.realise(space, space.nominal, FEET)


def test_a_number_without_a_meaning_for_a_robot_is_named() -> None:
    space = ParameterSpace((Mass.of("torso", 20.0), Parameter("x", **nuisance(1.0))))
    with pytest.raises(BadInputError, match="A robot has no x: its unknowns are of the kinds mass, com"):
        unknowns_of(space)


def test_a_lag_of_models_that_share_a_clock_is_no_sample() -> None:
    with pytest.raises(BadInputError, match="effort_lag/all: all models read at the same times"):
        EffortLag(nominal=0.0, lower=-1.0, upper=1.0, scale=1e-3)


def test_a_kind_has_one_meaning() -> None:
    with pytest.raises(BadInputError, match="unknowns of kind 'mass' are Mass already"):
        type("Weight", (Unknown,), {"kind": "mass", "title": "weights"})
    assert KINDS["mass"] is Mass


def _motion(seed: int, n: int = 5) -> Motion:
    """Some instants with readings that have nothing to do with each other; at some of them a foot is in the air."""
    rng, model = np.random.default_rng(seed), ROBOT.model
    position = rng.normal(size=(n, model.nq))
    position[:, 3:7] /= np.linalg.norm(position[:, 3:7], axis=1, keepdims=True)
    velocity, acceleration = 5.0 * rng.normal(size=(2, n, model.nv))
    effort, effort_rate = np.zeros((2, n, model.nv))
    effort[:, ROBOT.layout.joint_dof], effort_rate[:, ROBOT.layout.joint_dof] = rng.normal(size=(2, n, 8))
    loaded = np.ones((n, 12))
    loaded[1, :6] = loaded[2, 6:] = 0.0
    wrench, wrench_rate = loaded * rng.normal(size=(2, n, 12))
    sliding = np.zeros_like(velocity)
    sliding[:, ROBOT.layout.joint_dof] = -np.sign(velocity[:, ROBOT.layout.joint_dof])
    return Motion(position, velocity, acceleration, effort, wrench, effort_rate, wrench_rate, loaded, sliding)


def _moved(motion: Motion, change: FloatArray) -> Motion:
    """The motion with every state moved along a tangent vector."""
    position = motion.position.copy()
    for row in position:
        mujoco.mj_integratePos(ROBOT.model, row, change[: ROBOT.model.nv], 1.0)
    return replace(motion, position=position, velocity=motion.velocity + change[ROBOT.model.nv :])


class _Plant:
    """Inverse dynamics written down once more, of a robot with one unknown and with the sensors that go with it."""

    def __init__(self, unknown: Unknown, point: FloatArray) -> None:
        realisation = realise(CHANNELS, (unknown,), point[None])
        self._model = ROBOT.identification_model(FEET)
        write_fields(self._model, realisation)
        self._data = mujoco.MjData(self._model)
        self._sensors = realisation.sensors or SensorErrors.none(1, CHANNELS)

    def read(self, motion: Motion) -> Motion:
        """What the sensors read of a motion, but for lags."""
        sensors, dof = self._sensors, ROBOT.layout.joint_dof
        effort = motion.effort.copy()
        effort[:, dof] = (1.0 + sensors.effort_gain) * effort[:, dof] + sensors.effort_offset
        wrench = (1.0 + sensors.wrench_gain) * motion.wrench + sensors.wrench_offset
        return replace(_moved(motion, sensors.state_offset[0]), effort=effort, wrench=wrench)

    def unexplained(self, read: Motion) -> FloatArray:
        """Generalised force that what was read leaves unexplained, shape (n, nv)."""
        sensors, dof = self._sensors, ROBOT.layout.joint_dof
        motion = _moved(read, -sensors.state_offset[0])
        effort = read.effort + sensors.effort_lag[0, 0] * read.effort_rate
        effort[:, dof] = (effort[:, dof] - sensors.effort_offset) / (1.0 + sensors.effort_gain)
        wrench = read.wrench + sensors.wrench_lag[0, 0] * read.wrench_rate
        wrench = read.loaded * (wrench - sensors.wrench_offset) / (1.0 + sensors.wrench_gain)
        return self.inverse(motion) - effort - np.einsum("kvw,kw->kv", self.jacobians(motion), wrench)

    def inverse(self, motion: Motion) -> FloatArray:
        model, data = self._model, self._data
        out = np.empty_like(motion.velocity)
        for k in range(len(motion)):
            data.qpos[:], data.qvel[:], data.qacc[:] = motion.position[k], motion.velocity[k], motion.acceleration[k]
            mujoco.mj_inverse(model, data)
            out[k] = data.qfrc_inverse
        return out

    def jacobians(self, motion: Motion) -> FloatArray:
        """Generalised force per unit of each wrench, which acts by a motor: shape (n, nv, 12)."""
        model, data = self._model, self._data
        out = np.empty((len(motion), model.nv, model.nu))
        data.qvel[:] = 0.0
        for k in range(len(motion)):
            data.qpos[:] = motion.position[k]
            for column in range(model.nu):
                data.ctrl[:] = np.eye(model.nu)[column]
                mujoco.mj_forward(model, data)
                out[k, :, column] = data.qfrc_actuator
        return out


def _same_motion(model: mujoco.MjModel, other: mujoco.MjModel) -> bool:
    """Whether two models of the robot take the same forces, to what MJCF text keeps."""
    motion, forces = _motion(seed=2), []
    for each in (model, other):
        data = mujoco.MjData(each)
        for k in range(len(motion)):
            data.qpos[:], data.qvel[:], data.qacc[:] = motion.position[k], motion.velocity[k], motion.acceleration[k]
            mujoco.mj_inverse(each, data)
            forces.append(data.qfrc_inverse.copy())
    first, second = np.array(forces).reshape(2, -1)
    return bool(np.allclose(first, second, rtol=1e-4, atol=1e-6 * np.abs(first).max()))
