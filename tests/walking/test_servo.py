"""Walking by position servos: it stays up, and has what walks of commercial humanoids have."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from massid.errors import BadInputError, ModelError
from massid.model.robot import Robot
from massid.plant import motorised
from massid.typing import FloatArray
from massid.walking import GAITS, Gait, ServoOptions, Servos, ServoWalker
from massid.walking.footsteps import FootPose
from massid.walking.morphology import torque_limits
from massid.walking.swing import SwingTrajectory
from tests.walking.floor import MODELS, SEVEN_LINKS, Plant, error_factors

ROBOTS = ("nimble", "geared")
SECONDS = 5.0
_RATES = ("position", "velocity", "acceleration")


def walker(name: str, gait: Gait, seed: int = 0, options: ServoOptions | None = None) -> ServoWalker:
    robot = Robot.load(MODELS / f"{name}.xml")
    alone = motorised(robot)
    servos = Servos.from_model(robot.model, alone.joint_names)
    return ServoWalker(alone.model, gait, np.random.default_rng(seed), servos, options)


def plant(name: str, gait: Gait, seed: int) -> Plant:
    """The robot on a floor, moved by motors; its masses are others than its walker thinks."""
    spec = motorised(Robot.load(MODELS / f"{name}.xml")).spec.copy()
    masses = np.array([spec.body(link).mass for link in SEVEN_LINKS])
    factors = error_factors(spec.compile(), float(np.linalg.norm(masses)) / 4, np.random.default_rng(seed))
    for link, factor in factors.items():
        spec.body(link).mass *= factor
        spec.body(link).inertia = np.array(spec.body(link).inertia) * factor
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    return Plant(spec.compile(), walker(name, gait, seed))


@dataclass(frozen=True)
class Stamped:
    """A walk of the stamping gait, step by step.

    Attributes:
        model: the true robot.
        torque: that acted, shape (n, n_j).
        position: of the joints, shape (n, n_j).
        load: on both feet, in weights of the robot, shape (n, 2).
        steps: of the feet.
        fell: whether it did.
    """

    model: mujoco.MjModel
    torque: FloatArray
    position: FloatArray
    load: FloatArray
    steps: int
    fell: bool

    def jumps(self) -> tuple[float, float]:
        """Root mean square change of the torques from one step to the next: at the policy's ticks, and elsewhere."""
        every = round(0.02 / float(self.model.opt.timestep))
        change = np.diff(self.torque, axis=0) ** 2
        at_ticks = np.arange(1, len(self.torque)) % every == 0
        return float(np.sqrt(change[at_ticks].mean())), float(np.sqrt(change[~at_ticks].mean()))


@pytest.fixture(scope="module", params=ROBOTS)
def stamped(request: pytest.FixtureRequest) -> Iterator[Stamped]:
    world = plant(request.param, GAITS["stamp"], seed=0)
    torque, position, load = [], [], []
    while world.data.time < SECONDS and not world.walker.has_fallen(world.data.qpos):
        world.step()
        torque.append(world.data.qfrc_actuator[6:].copy())
        position.append(world.data.qpos[7:].copy())
        load.append(world.foot_load_n / (world.model.body_mass.sum() * 9.81))
    assert isinstance(world.walker, ServoWalker)
    yield Stamped(
        world.model,
        np.array(torque),
        np.array(position),
        np.array(load),
        world.walker.policy.steps_taken,
        world.data.time < SECONDS,
    )


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("gait", ["random", "stamp"])
def test_it_walks_with_masses_it_does_not_know(name: str, gait: str) -> None:
    for seed in (1, 2):
        world = plant(name, GAITS[gait], seed)
        assert world.run(SECONDS)
        assert world.walker.failed_solves == 0


def test_no_torque_exceeds_the_joints_limits_and_some_reach_far(stamped: Stamped) -> None:
    assert not stamped.fell
    share = np.abs(stamped.torque) / torque_limits(stamped.model)
    assert share.max() <= 1.0
    assert share.max() > 0.5


def test_torques_step_with_every_new_target(stamped: Stamped) -> None:
    at_ticks, elsewhere = stamped.jumps()
    assert at_ticks > 4.0 * elsewhere
    assert at_ticks > 0.2 * np.sqrt(np.mean(stamped.torque**2))


def test_feet_come_down_hard(stamped: Stamped) -> None:
    assert stamped.steps > 6
    landings = [
        float(foot[k : k + 20].max())
        for foot in stamped.load.T
        for k in np.flatnonzero((foot[50:-20] > 0.0) & (foot[49:-21] == 0.0)) + 50
        if not foot[k - 25 : k].any()
    ]
    assert len(landings) > 4
    assert np.median(landings) > 1.5  # weights of the robot; who stands on one foot carries 1


def test_a_geared_robot_hits_the_stops_of_its_ankles(stamped: Stamped) -> None:
    ankles = [stamped.model.joint(f"{side}_ankle_pitch").id for side in "lr"]
    at_stop = stamped.position[:, [ankle - 1 for ankle in ankles]] < stamped.model.jnt_range[ankles, 0]
    hits = int((np.diff(at_stop.astype(int), axis=0) == 1).sum())
    assert (hits > stamped.steps / 2) == (stamped.model.opt.timestep == 0.004)  # the nimble one has room


def test_a_joint_that_moves_as_planned_gets_the_planned_torque_half_way() -> None:
    robot = walker("nimble", GAITS["stamp"])
    qpos, load, rng = robot.initial_qpos(), np.full(2, 170.0), np.random.default_rng(0)
    qvel = np.concatenate([np.zeros(6), rng.normal(scale=0.5, size=len(qpos) - 7)])
    robot.control(0.0, qpos, qvel, load)
    policy, half_s = robot.policy, ServoOptions().policy_period_s / 2
    planned = policy.control(0.0, qpos, qvel, load)
    later, rate = qpos.copy(), qvel.copy()
    later[7:] += half_s * qvel[6:] + half_s**2 / 2 * policy.accelerations
    rate[6:] += half_s * policy.accelerations
    friction = motorised(Robot.load(MODELS / "nimble.xml")).model.dof_frictionloss[6:]
    expected = planned + friction * np.tanh(rate[6:] / ServoOptions().slip_rad_s)
    limits = policy.morphology.torque_limits_nm
    assert_allclose(robot.control(half_s, later, rate, load), np.clip(expected, -limits, limits), atol=1e-9)


def test_targets_are_held_for_the_policys_period() -> None:
    robot = walker("nimble", GAITS["stamp"], options=ServoOptions(policy_period_s=0.01))
    qpos, qvel, load = robot.initial_qpos(), np.zeros(33), np.full(2, 170.0)
    robot.control(0.0, qpos, qvel, load)
    first = robot.target
    for time_s in (0.001, 0.009):
        robot.control(time_s, qpos, qvel, load)
        assert robot.target is first
    robot.control(0.01, qpos, qvel, load)
    assert robot.target is not first


SERVO = """<mujoco><worldbody><body><freejoint/><geom size='1'/><body><joint name='j'/><geom size='1'/></body></body>
</worldbody><actuator>{}</actuator></mujoco>"""


def test_servos_are_read_through_their_gears() -> None:
    model = mujoco.MjModel.from_xml_string(SERVO.format("<position joint='j' kp='5' kv='2' gear='3'/>"))
    servos = Servos.from_model(model, ["j"])
    assert (servos.stiffness, servos.damping) == (45.0, 18.0)
    data = mujoco.MjData(model)
    data.qpos[7], data.qvel[6], data.ctrl[0] = 0.1, 0.2, 0.0
    mujoco.mj_forward(model, data)
    assert_allclose(data.qfrc_actuator[6], -servos.stiffness * 0.1 - servos.damping * 0.2)


@pytest.mark.parametrize("actuator", ["<motor joint='j'/>", "<velocity joint='j' kv='2'/>"])
def test_other_drives_are_no_servos(actuator: str) -> None:
    model = mujoco.MjModel.from_xml_string(SERVO.format(actuator))
    with pytest.raises(ModelError, match="is no position servo"):
        Servos.from_model(model, ["j"])
    undriven = mujoco.MjModel.from_xml_string(SERVO.format(""))
    with pytest.raises(ModelError, match="No joint of the model has a position servo"):
        Servos.from_model(undriven, ["j"])


def test_a_swing_ends_at_the_landing_speed_and_else_as_without_it() -> None:
    start, end = FootPose(np.zeros(3), 0.0), FootPose(np.array([0.3, 0.0, -0.01]), 0.0)
    soft, hard = (SwingTrajectory(start, end, 0.4, 0.08, speed) for speed in (0.0, 0.8))
    assert_allclose(hard.at(0.4).velocity, [0.0, 0.0, -0.8], atol=1e-9)
    assert_allclose(hard.at(0.4).position, soft.at(0.4).position, atol=1e-12)
    assert hard.at(0.3).position[2] > soft.at(0.3).position[2]
    assert_allclose(hard.at(0.5).velocity, [0.0, 0.0, -0.8])
    times_s = np.linspace(0.0, 0.4, 4001)
    targets = [hard.at(time_s) for time_s in times_s]
    height, rate, second = (np.array([getattr(target, name)[2] for target in targets]) for name in _RATES)
    assert_allclose(np.gradient(height, times_s)[1:-1], rate[1:-1], atol=1e-4)
    assert_allclose(np.gradient(rate, times_s)[1:-1], second[1:-1], atol=0.05)  # it has a kink at the apex


def test_a_foot_cannot_land_upwards() -> None:
    with pytest.raises(BadInputError, match=r"landing_m_s is -0\.1; it must not be negative"):
        replace(GAITS["stamp"], landing_m_s=-0.1)
