from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from massid.errors import BadInputError, ModelError
from massid.log.reader import read_walk
from massid.model.robot import Robot
from massid.plant import HiddenMasses, Integrator, make_environment, record, variant
from massid.plant.parts import RobotParts
from massid.walk import Walk
from tests.plant.replaying import nominal_kg, velocity_errors
from tests.plant.worlds import RandomAgent, crab, drop_crab, suite, suite_humanoid

STEP_TOLERANCE = 1e-9
"""Velocity after one step [rad/s]; what remains is rounding and the constraint solver's tolerance."""


def record_random(environment: Any, path: Path, duration_s: float) -> Walk:
    record(environment, RandomAgent(environment), path, duration_s)
    return read_walk(path)


def humanoid_robot() -> Robot:
    return Robot.load(Path(suite.__file__).parent / "humanoid.xml")


@pytest.mark.parametrize("integrator", [Integrator.EULER, Integrator.IMPLICITFAST])
@pytest.mark.parametrize("friction_loss_nm", [None, 2.0])
def test_our_plant_replays(
    atlas: Robot, tmp_path: Path, integrator: Integrator, friction_loss_nm: float | None
) -> None:
    robot = variant(atlas, integrator, friction_loss_nm)
    hidden = HiddenMasses({"torso": 5.0, "l_thigh": -2.0, "r_foot": 1.0})
    walk = record_random(make_environment(robot, hidden), tmp_path / "fall.mcap", 0.5)
    assert walk.contact_bodies  # it drops onto its soles
    assert velocity_errors(walk, robot, hidden.true_kg(robot)).max() < STEP_TOLERANCE
    # The same log in a model with nominal masses does not: the test can fail.
    assert velocity_errors(walk, robot, nominal_kg(robot)).max() > 1e-4


@pytest.mark.parametrize("legacy_step", [True, False])
def test_suite_humanoid_replays_with_all_its_contacts(tmp_path: Path, legacy_step: bool) -> None:
    environment = suite_humanoid(legacy_step=legacy_step, self_collision=False)
    walk = record_random(environment, tmp_path / "humanoid.mcap", 4.0)
    assert len(walk) == 4.0 / 0.005  # every physics step, not every fifth
    assert len(walk.contact_bodies) > 6
    robot = humanoid_robot()
    assert velocity_errors(walk, robot, nominal_kg(robot)).max() < STEP_TOLERANCE


def test_legacy_and_plain_stepping_make_the_same_log(tmp_path: Path) -> None:
    legacy = record_random(suite_humanoid(legacy_step=True), tmp_path / "legacy.mcap", 2.0)
    plain = record_random(suite_humanoid(legacy_step=False), tmp_path / "plain.mcap", 2.0)
    assert legacy.contact_bodies == plain.contact_bodies
    for field in ("qpos", "qvel", "effort", "wrench"):
        np.testing.assert_array_equal(getattr(legacy, field), getattr(plain, field), err_msg=field)


@pytest.mark.parametrize("legacy_step", [True, False])
def test_recording_does_not_disturb_the_simulation(tmp_path: Path, legacy_step: bool) -> None:
    recorded, free = suite_humanoid(legacy_step=legacy_step), suite_humanoid(legacy_step=legacy_step)
    record_random(recorded, tmp_path / "log.mcap", 1.0)
    agent = RandomAgent(free)
    timestep = free.reset()
    for _ in range(40):
        timestep = free.step(agent(timestep))
    for field in ("qpos", "qacc_warmstart", "xpos", "sensordata"):
        np.testing.assert_array_equal(getattr(recorded.physics.data, field), getattr(free.physics.data, field))
    assert "step" not in vars(recorded.physics)  # the physics is given back as it was


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit"])
@pytest.mark.parametrize("servo", [True, False])
def test_attached_robot_with_servos_on_loose_things_replays(tmp_path: Path, integrator: str, servo: bool) -> None:
    """Velocity servos, torsional contact friction, another floating body."""
    walk = record_random(drop_crab(integrator, servo=servo), tmp_path / "crab.mcap", 3.0)
    assert walk.root_body == "shell"
    assert walk.joint_names == ("left_hip", "left_wrist", "right_hip")
    assert "left_claw" in walk.contact_bodies
    assert "box" not in walk.contact_bodies
    robot = crab(integrator, servo=servo)
    assert velocity_errors(walk, robot, nominal_kg(robot)).max() < STEP_TOLERANCE


def test_a_root_off_its_frame_is_logged_as_its_own_body_moves(tmp_path: Path) -> None:
    environment = drop_crab("Euler", servo=False, offset=True)
    seen: list[tuple[Any, Any, Any]] = []
    act = RandomAgent(environment)

    def agent(timestep: Any) -> Any:
        model, data = environment.physics.model.ptr, environment.physics.data.ptr
        root, twist = model.body("crab/shell").id, np.zeros(6)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, root, twist, 0)
        turn = data.xmat[root].reshape(3, 3).T @ twist[:3]
        seen.append((data.xpos[root].copy(), data.xmat[root].copy(), np.concatenate([twist[3:], turn])))
        return act(timestep)

    record(environment, agent, tmp_path / "crab.mcap", 1.0)
    walk = read_walk(tmp_path / "crab.mcap")
    for k, (position, axes, twist) in enumerate(seen):
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, walk.qpos[5 * k, 3:7])
        np.testing.assert_allclose(walk.qpos[5 * k, :3], position, atol=1e-12)
        np.testing.assert_allclose(rotation, axes, atol=1e-12)
        np.testing.assert_allclose(walk.qvel[5 * k, :6], twist, atol=1e-11)


def test_runge_kutta_replays_in_free_flight(tmp_path: Path) -> None:
    walk = record_random(drop_crab("RK4", servo=False), tmp_path / "crab.mcap", 1.0)
    robot = crab("RK4", servo=False)
    touched = np.abs(walk.wrench).sum(axis=(1, 2)) > 0
    before_contact = int(np.argmax(touched)) - 1
    assert before_contact > 20
    assert velocity_errors(walk, robot, nominal_kg(robot))[:before_contact].max() < STEP_TOLERANCE


def test_self_contact_is_counted_in_report_and_metadata(tmp_path: Path) -> None:
    environment = suite_humanoid()
    recording = record(environment, RandomAgent(environment), tmp_path / "log.mcap", 2.0)
    assert 0 < recording.self_contact_samples < recording.samples
    assert read_walk(recording.path).metadata["self_contact_samples"] == str(recording.self_contact_samples)


def test_wrenches_carry_the_weight_of_what_lies_still(tmp_path: Path) -> None:
    environment = drop_crab("implicitfast", servo=True)
    record(environment, lambda timestep: np.zeros(3), tmp_path / "still.mcap", 6.0)
    walk = read_walk(tmp_path / "still.mcap")
    robot = crab("implicitfast", servo=True)
    data = mujoco.MjData(robot.model)
    force = np.zeros(3)
    for k in range(-500, 0):
        data.qpos[:] = walk.qpos[k]
        mujoco.mj_kinematics(robot.model, data)
        axes = [data.body(body).xmat.reshape(3, 3) for body in walk.contact_bodies]
        force += sum(a @ wrench[:3] for a, wrench in zip(axes, walk.wrench[k], strict=True)) / 500
    weight = robot.total_mass_kg * 9.81
    np.testing.assert_allclose(force, [0, 0, weight], atol=2e-3 * weight)  # mean of the last second, hardly moving


def test_an_episode_that_ends_ends_the_log(tmp_path: Path) -> None:
    environment = drop_crab("Euler", servo=False, time_limit=0.1)
    recording = record(environment, RandomAgent(environment), tmp_path / "short.mcap", 1.0, contact_bodies=["shell"])
    assert (recording.end, recording.samples) == ("truncated", 50)
    assert read_walk(recording.path).metadata["end"] == "truncated"


def test_actions_may_come_from_an_iterator(tmp_path: Path) -> None:
    environment = drop_crab("Euler", servo=False)
    recording = record(environment, iter([np.zeros(3)] * 7), tmp_path / "log.mcap", 1.0)
    assert (recording.end, recording.samples) == ("truncated", 35)


def test_the_number_of_samples_is_exact_within_a_control_step(tmp_path: Path) -> None:
    environment = drop_crab("Euler", servo=False)
    recording = record(environment, RandomAgent(environment), tmp_path / "log.mcap", 0.026, contact_bodies=["shell"])
    walk = read_walk(recording.path)
    assert (recording.end, recording.samples, len(walk)) == ("complete", 13, 13)
    assert set(np.diff(walk.stamps_ns)) == {2_000_000}


def test_a_slower_log_has_every_so_many_states_and_the_means_of_what_acted(tmp_path: Path) -> None:
    every, third = (tmp_path / f"{name}.mcap" for name in ("every", "third"))
    for path, period_s in ((every, None), (third, 0.006)):
        environment = drop_crab("Euler", servo=False)
        recording = record(
            environment, RandomAgent(environment), path, 1.0, contact_bodies=["shell"], period_s=period_s
        )
    assert (recording.samples, recording.duration_s) == (167, pytest.approx(1.002))
    fast, slow = read_walk(every), read_walk(third)
    assert slow.timestep_s == pytest.approx(3 * fast.timestep_s)
    for name in ("stamps_ns", "qpos", "qvel"):
        np.testing.assert_array_equal(getattr(slow, name)[:166], getattr(fast, name)[:498:3])
    assert slow.contact_bodies == fast.contact_bodies
    for name in ("effort", "wrench"):
        acted = getattr(fast, name)[:498]
        means = acted.reshape(166, 3, *acted.shape[1:]).mean(axis=1)
        np.testing.assert_allclose(getattr(slow, name)[:166], means, atol=1e-9)  # N m, N; rounding


@pytest.mark.parametrize("period_s", [0.003, 0.0, -0.002, float("nan")])
def test_a_period_of_other_than_whole_steps_is_refused(period_s: float, tmp_path: Path) -> None:
    environment = drop_crab("Euler", servo=False)
    with pytest.raises(BadInputError, match=r"no whole number of physics steps: the robot's take 0\.002 s"):
        record(environment, RandomAgent(environment), tmp_path / "log.mcap", 1.0, period_s=period_s)
    assert not list(tmp_path.iterdir())


def test_divergence_ends_the_log_and_is_told(tmp_path: Path) -> None:
    environment = drop_crab("Euler", servo=False)
    environment.reset()

    def agent(timestep: Any) -> Any:
        if environment.physics.time() > 0.05:
            environment.physics.data.qvel[-1] = 1e12
        return np.zeros(3)

    recording = record(environment, agent, tmp_path / "log.mcap", 1.0)
    assert recording.end == "diverged"
    assert 25 <= recording.samples < 40


def test_unusable_worlds_are_refused(tmp_path: Path) -> None:
    environment = drop_crab("Euler", servo=False)
    agent = RandomAgent(environment)
    with pytest.raises(BadInputError, match="shorter than one physics step"):
        record(environment, agent, tmp_path / "log.mcap", 1e-4)
    with pytest.raises(ModelError, match=r"no floating body named 'lobster'.*box"):
        record(environment, agent, tmp_path / "log.mcap", 0.1, root_body="lobster")
    with pytest.raises(ModelError, match="no body with a free joint"):
        record(suite.load("cartpole", "swingup"), agent, tmp_path / "log.mcap", 0.1)
    assert not list(tmp_path.iterdir())


def test_a_named_root_is_found_by_own_and_full_name() -> None:
    environment = drop_crab("Euler", servo=False)
    model = environment.physics.model.ptr
    assert RobotParts.find(model).prefix == "crab/"
    assert RobotParts.find(model, "crab/shell").root_body == "shell"
    assert RobotParts.find(model, "box").joint_names == ()
