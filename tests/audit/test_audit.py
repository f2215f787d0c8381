"""The audit: silent on a sound log, and each wrong convention, lag, contact or torque is found and named."""

from __future__ import annotations

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from massid.audit import audit_walk
from massid.audit.balance import measure_balance
from massid.audit.kinematics import check_kinematics
from massid.audit.lag import estimate_lag
from massid.audit.self_contact import without_samples
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.plant import without_wrenches
from massid.walk import Segment, Walk
from massid.walk.conventions import to_body
from massid.walk.noise import PRESETS, NoisePreset, Sensors
from tests.conftest import Pushed
from tests.pushed_robot import XML, draw_truth, make_robot, push_about, stamped_late


@pytest.fixture(scope="module")
def log() -> Pushed:
    robot = make_robot()
    space = mass_space(robot, ("torso", "l_thigh", "r_thigh", "l_calf", "r_calf", "l_foot", "r_foot"))
    truth = draw_truth(space, seed=3)
    return Pushed(robot, space, truth, push_about(robot, space, truth, seconds=2.0, amplitude=0.15))


def test_a_sound_log_gives_no_warning_whatever_the_masses(log: Pushed) -> None:
    audit = audit_walk(log.robot, log.walk, thorough=True)
    assert audit.warnings == ()
    assert audit.clean
    assert audit.lag is not None
    assert not audit.lag.believed
    assert audit.weight.measured_kg == pytest.approx(log.truth.sum(), rel=0.02)  # the robot does not stand quite still
    assert audit.one_step is not None
    assert audit.one_step.nominal > 1e-4  # the model's masses are 15 % off
    assert audit.one_step.fitted < 1e-9 * audit.one_step.nominal  # those that fit leave rounding
    assert audit.walk.segments == log.walk.segments


@pytest.mark.parametrize("preset", ["clean", "white"])
def test_a_sound_log_without_force_sensors_gives_no_warning_either(log: Pushed, preset: NoisePreset) -> None:
    """Nothing is said of a weight that nobody measured, and no lag is found of wrenches that are not there."""
    audit = audit_walk(log.robot, without_wrenches(_measured(log.walk, preset)))
    assert audit.warnings == ()
    assert audit.clean is (preset == "clean")
    assert audit.weight.measured_kg is None
    assert audit.lag is not None
    assert not audit.lag.believed
    assert audit.lag.wrench_s == 0.0


def test_late_torques_are_found_without_force_sensors(log: Pushed) -> None:
    late = stamped_late(log.walk, effort_s=4e-3, wrench_s=0.0)
    lag = estimate_lag(log.robot, without_wrenches(late))
    assert lag is not None
    assert lag.believed
    assert lag.effort_s == pytest.approx(4e-3, abs=2e-4)


def test_a_torque_channel_that_is_not_connected_is_named(log: Pushed) -> None:
    effort = log.walk.effort.copy()
    effort[:, 3] = 0.0
    name = log.robot.joint_names[3]
    said = audit_walk(log.robot, replace(log.walk, effort=effort)).warnings
    assert any(f"torque of {name} never changes" in line for line in said)


@pytest.fixture(scope="module")
def standing(log: Pushed) -> Walk:
    return push_about(log.robot, log.space, log.truth, seconds=1.0, amplitude=0.0)


def _measured(walk: Walk, preset: NoisePreset, seed: int = 3) -> Walk:
    return Sensors(PRESETS[preset], len(walk.joint_names), walk.contact_bodies, np.random.default_rng(seed)).measure(
        walk
    )


@pytest.mark.parametrize("preset", ["white", "realistic", "harsh"])
@pytest.mark.parametrize("seed", [3, 4])
def test_sensors_errors_alone_raise_no_suspicion(preset: NoisePreset, seed: int, log: Pushed, standing: Walk) -> None:
    """Offsets are large beside the forces that change while a robot stands still."""
    for walk in (log.walk, standing):
        audit = audit_walk(log.robot, _measured(walk, preset, seed))
        assert audit.warnings == ()
        assert not audit.clean


@pytest.mark.parametrize("moving", [True, False])
def test_faults_show_through_the_errors_of_sensors(moving: bool, log: Pushed, standing: Walk) -> None:
    walk = _measured(log.walk if moving else standing, "realistic")
    wrench = walk.wrench.copy()
    wrench[:, 1] = 0.0
    for wrong in (replace(walk, effort=-walk.effort), replace(walk, effort=1.5 * walk.effort)):
        (warning,) = audit_walk(log.robot, wrong).warnings
        assert "explained neither by the log nor by any link masses" in warning
    warnings = audit_walk(log.robot, replace(walk, wrench=wrench)).warnings
    assert any("explained neither by the log nor by any link masses" in line for line in warnings)


@pytest.mark.parametrize("share", [0.7, 1.3])
def test_a_log_without_noise_is_allowed_no_offsets(share: float, log: Pushed) -> None:
    (warning,) = audit_walk(log.robot, replace(log.walk, effort=share * log.walk.effort)).warnings
    assert "explained neither by the log nor by any link masses" in warning


def test_masses_that_fit_the_balance_are_the_true_ones(log: Pushed) -> None:
    balance = measure_balance(log.robot, log.walk)
    assert balance is not None
    relative = balance.fitted_masses(balance.effort(log.walk, log.robot) + balance.wrench(log.walk))
    found = dict(zip(balance.links, relative, strict=True))
    expected = log.truth / log.space.nominal - 1.0
    for parameter, error in zip(log.space.parameters, expected, strict=True):
        assert found[parameter.target] == pytest.approx(error, abs=1e-4)


def _with(walk: Walk, name: str, values: np.ndarray) -> Walk:
    return replace(walk, **{name: values})


def _quaternion(walk: Walk, order: list[int]) -> Walk:
    qpos = walk.qpos.copy()
    qpos[:, 3:7] = qpos[:, 3:7][:, order]
    return replace(walk, qpos=qpos)


def _velocity(walk: Walk, columns: slice) -> Walk:
    """As if a world vector had been taken for one of the body, or the other way round."""
    qvel = walk.qvel.copy()
    qvel[:, columns] = to_body(walk.qpos[:, 3:7], qvel[:, columns])
    return replace(walk, qvel=qvel)


def _joint(walk: Walk, column: int, factor: float) -> Walk:
    qvel = walk.qvel.copy()
    qvel[:, 6 + column] *= factor
    return replace(walk, qvel=qvel)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda w: _with(w, "wrench", -w.wrench),
            "forces look as if they were those on the ground .contacts: on: ground",
        ),
        (
            lambda w: _with(w, "wrench", w.wrench / 9.81),
            "wrenches look as if they were in kgf and kgf m .contacts: force, torque: scale: 9.81",
        ),
        (lambda w: _with(w, "wrench", 10.0 * w.wrench), " times too large .contacts: force, torque: scale: 0"),
        (lambda w: _with(w, "effort", -w.effort), "torques look as if their sign were turned"),
        (lambda w: _with(w, "effort", w.effort[:, ::-1].copy()), "check the torques .* the joint order"),
        (lambda w: _joint(w, 2, -1.0), "position and velocity of l_knee disagree .* the sign"),
        (lambda w: _joint(w, 2, np.degrees(1.0)), "l_knee disagree .* velocities .* degrees per second"),
        (lambda w: _joint(w, 2, np.radians(1.0)), "l_knee disagree .* positions look as if they were in degrees"),
    ],
)
def test_wrong_conventions_are_named(log: Pushed, spoil, message: str) -> None:
    audit = audit_walk(log.robot, spoil(log.walk))
    assert any(re.search(message, line) for line in audit.warnings), audit.warnings


def _tumbling(seconds: float = 1.0) -> Walk:
    """A thrown box with two motorless joints: attitudes far from upright, so that frames can be told apart."""
    robot = make_robot()
    model = robot.identification_model(())
    data = mujoco.MjData(model)
    data.qpos[3:7] = [0.5, 0.5, -0.5, 0.5]
    data.qvel[:6] = [1.0, -0.5, 2.0, 1.5, -1.0, 0.7]
    rows = []
    for _ in range(round(seconds / 1e-3)):
        rows.append((data.qpos.copy(), data.qvel.copy()))
        mujoco.mj_step(model, data)
    n = len(rows)
    return Walk(
        root_body=robot.root_body,
        joint_names=robot.joint_names,
        contact_bodies=("l_foot",),
        stamps_ns=np.arange(n, dtype=np.int64) * 1_000_000,
        qpos=np.array([row[0] for row in rows]),
        qvel=np.array([row[1] for row in rows]),
        effort=np.zeros((n, len(robot.joint_names))),
        wrench=np.zeros((n, 1, 6)),
        timestep_s=1e-3,
    )


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda w: _quaternion(w, [3, 0, 1, 2]), "stored as wxyz .orientation: order: wxyz"),
        (lambda w: _quaternion(w, [1, 2, 3, 0]), "stored as xyzw .orientation: order: xyzw"),
        (lambda w: _velocity(w, slice(3, 6)), "turn rate .* given in the body .angular_velocity: frame: body"),
        (lambda w: _velocity(w, slice(0, 3)), "velocity .* given in the body .linear_velocity: frame: body"),
    ],
)
def test_wrong_frames_of_the_base_are_named(spoil, message: str) -> None:
    walk = _tumbling()
    from massid.audit.kinematics import check_kinematics

    assert check_kinematics(walk).suspicions == ()
    suspicions = check_kinematics(spoil(walk)).suspicions
    assert any(re.search(message, line) for line in suspicions), suspicions


@pytest.mark.parametrize(("effort", "wrench"), [(3, 0), (0, -2), (4, 4), (-1, 5)])
def test_whole_samples_of_lag_are_found(log: Pushed, effort: int, wrench: int) -> None:
    late = replace(
        log.walk, effort=np.roll(log.walk.effort, effort, axis=0), wrench=np.roll(log.walk.wrench, wrench, axis=0)
    )
    lag = estimate_lag(log.robot, late)
    assert lag is not None
    assert lag.believed
    assert lag.effort_s == pytest.approx(effort * 1e-3, abs=5e-5)
    assert lag.wrench_s == pytest.approx(wrench * 1e-3, abs=5e-5)
    assert lag.rest_after < 1e-3 * lag.rest_before


@pytest.mark.parametrize(("integrator", "believed"), [("Euler", True), ("RK4", False)])
def test_half_a_step_of_lag_is_not_believed_where_a_step_has_no_single_force(
    integrator: str, believed: bool, log: Pushed
) -> None:
    """The mean force of a step of RK4 acts half a step late."""
    robot = make_robot(integrator)
    half, whole = (estimate_lag(robot, stamped_late(log.walk, lag_s, lag_s)) for lag_s in (0.5e-3, 4e-3))
    assert half is not None
    assert whole is not None
    assert half.believed is believed
    assert whole.believed


def test_a_log_that_is_too_short_has_no_lag(log: Pushed) -> None:
    short = replace(log.walk, segments=(Segment(0, 30),))
    assert estimate_lag(log.robot, short) is None
    assert audit_walk(log.robot, short).rest is None


def test_samples_with_self_contact_are_left_out_and_the_pair_is_named() -> None:
    spec = mujoco.MjSpec.from_string(XML)
    for side in ("l", "r"):  # calves that touch each other, and nothing else
        geom = spec.body(f"{side}_calf").geoms[0]
        geom.contype = geom.conaffinity = 2
    robot = Robot(spec)
    roll = robot.joint_names.index("l_hip_roll")
    n = 100
    qpos = np.tile(robot.model.qpos0, (n, 1))
    qpos[40:50, 7 + roll] = -0.35  # the left leg swings into the right one
    walk = Walk(
        root_body="torso",
        joint_names=robot.joint_names,
        contact_bodies=("l_foot",),
        stamps_ns=np.arange(n, dtype=np.int64) * 1_000_000,
        qpos=qpos,
        qvel=np.zeros((n, 6 + len(robot.joint_names))),
        effort=np.zeros((n, len(robot.joint_names))),
        wrench=np.zeros((n, 1, 6)),
        timestep_s=1e-3,
    )
    audit = audit_walk(robot, walk)
    np.testing.assert_array_equal(np.flatnonzero(audit.self_contact.samples), np.arange(40, 50))
    assert audit.walk.segments == (Segment(0, 40), Segment(50, n))
    assert any("10 of 100 samples, left out: l_calf and r_calf (10)" in line for line in audit.warnings)
    always = replace(walk, qpos=np.tile(qpos[45], (n, 1)))
    audit = audit_walk(robot, always)
    assert not audit.self_contact.samples.any()
    assert any("l_calf and r_calf overlap nearly all the time" in line for line in audit.warnings)


def test_no_window_crosses_a_sample_that_was_left_out(log: Pushed) -> None:
    bad = np.zeros(len(log.walk), dtype=bool)
    bad[[3, 4, 6, 1000]] = True
    cut = without_samples(log.walk, bad)
    assert cut.segments == (Segment(0, 3), Segment(7, 1000), Segment(1001, len(log.walk)))
    for window in cut.windows(0.1):
        assert not bad[window.start : window.stop].any()


def test_a_servo_under_an_implicit_integrator_is_named() -> None:
    """The torque that the engine reports before the step is not what acted over it."""
    spec = mujoco.MjSpec.from_string(XML)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for actuator in spec.actuators:
        actuator.set_to_position(kp=600.0, kv=60.0)
    servo = Robot(spec)
    space = mass_space(servo, ["torso"])
    floor = spec.copy()
    floor.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1], contype=1, conaffinity=0)
    model = floor.compile()
    data = mujoco.MjData(model)
    torque_free = push_about(make_robot(), mass_space(make_robot(), ["torso"]), space.nominal, seconds=1.0)
    rows = {"qpos": [], "qvel": [], "effort": []}
    for k in range(1000):
        for actuator in range(model.nu):
            data.ctrl[actuator] = 0.3 * np.sin(20.0 * k * 1e-3 + actuator)
        rows["qpos"].append(data.qpos.copy())
        rows["qvel"].append(data.qvel.copy())
        mujoco.mj_step(model, data)
        rows["effort"].append(data.qfrc_actuator[6:].copy())
    arrays = {name: np.array(values) for name, values in rows.items()}
    walk = replace(torque_free, wrench=np.zeros_like(torque_free.wrench), **arrays)
    audit = audit_walk(servo, replace(walk, segments=(Segment(0, 300),)))
    assert any("is a servo whose torque depends on velocity" in line for line in audit.warnings), audit.warnings


def test_a_robot_that_shakes_moves_as_its_velocities_say(pushed: Pushed) -> None:
    # A simulator moves with the velocity at the end of a step; the trapezoidal rule is off by as much as it changes.
    shaking = 3.0 * np.random.default_rng(0).normal(size=(len(pushed.walk), 8))
    qpos, qvel = pushed.walk.qpos.copy(), pushed.walk.qvel.copy()
    qvel[:, 6:] = shaking - np.cumsum(shaking, axis=0) / np.arange(1, len(shaking) + 1)[:, None]
    qpos[:, 7:] = np.cumsum(0.001 * qvel[:, 6:], axis=0)
    found = check_kinematics(replace(pushed.walk, qpos=qpos, qvel=qvel))
    assert max(found.joints.values()) < 1e-6
    assert not found.suspicions
