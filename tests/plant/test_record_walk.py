import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

import massid.plant.walk
from massid.assets import shipped_models
from massid.errors import BadInputError, ModelError
from massid.log.reader import read_walk
from massid.model.file import file_sha256
from massid.model.robot import Robot
from massid.plant import HiddenMasses, MassErrors, corrupt_log, record_walk
from massid.plant.walk import Controller
from massid.walking import Walker
from massid.walking.morphology import torque_limits
from tests.plant.conftest import ATLAS, Walked, true_masses
from tests.plant.replaying import nominal_kg, velocity_errors


def test_a_walk_replays_with_the_true_masses_only(walked: Walked, atlas: Robot) -> None:
    assert walked.report.end == "complete"
    assert len(walked.walk) == walked.report.samples == 2500
    assert velocity_errors(walked.walk, atlas, walked.true_kg).max() < 1e-9  # rad/s; rounding
    assert np.median(velocity_errors(walked.walk, atlas, nominal_kg(atlas))) > 1e-4


def test_the_truth_lies_beside_the_log(walked: Walked, atlas: Robot) -> None:
    assert walked.report.truth_path == walked.report.path.with_name("walk.truth.json")
    truth = json.loads(walked.report.truth_path.read_text())
    assert truth["seed"] == 4
    assert set(truth["links"]) == set(atlas.links)
    errors = [walked.true_kg[link] - atlas.nominal_mass_kg(link) for link in atlas.links]
    assert np.linalg.norm(errors) == pytest.approx(6.0)
    assert walked.report.error_norm_kg == pytest.approx(6.0)


def test_the_log_says_what_made_it_and_nothing_of_the_truth(walked: Walked) -> None:
    metadata = walked.walk.metadata
    assert set(metadata) == {
        "root_body",
        "timestep_s",
        "end",
        "model_file",
        "model_sha256",
        "gait",
        "engine",
        "integrator",
        "sensor_noise",
        "self_contact_samples",
    }
    assert metadata["model_file"] == "atlas.xml"
    assert metadata["model_sha256"] == file_sha256(ATLAS)
    assert metadata["sensor_noise"] == "none"
    raw = walked.report.path.read_bytes()
    assert b"true_kg" not in raw
    assert b"seed" not in raw


def test_the_floor_carries_the_true_weight(atlas: Robot, tmp_path: Path) -> None:
    hidden = HiddenMasses({"torso": 8.0, "r_calf": -1.0})
    report = record_walk(ATLAS, tmp_path / "stand.mcap", 1.5, gait="stand", hidden=hidden)
    walk = read_walk(report.path)
    data = mujoco.MjData(atlas.model)
    upward = []
    for qpos, wrench in zip(walk.qpos[1000:], walk.wrench[1000:], strict=True):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(atlas.model, data)
        feet = [data.body(body).xmat.reshape(3, 3) for body in walk.contact_bodies]
        upward.append(sum((foot @ w[:3])[2] for foot, w in zip(feet, wrench, strict=True)))
    # On average over half a second of standing; what is left is the last sway.
    assert np.mean(upward) == pytest.approx((atlas.total_mass_kg + 7.0) * 9.81, rel=2e-3)


def test_the_walker_knows_only_nominal_masses(atlas: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[mujoco.MjModel] = []

    class Spy(Walker):
        def __init__(self, model: mujoco.MjModel, *args: object) -> None:
            seen.append(model)
            super().__init__(model, *args)  # type: ignore[arg-type]

    monkeypatch.setattr(massid.plant.walk, "Walker", Spy)
    record_walk(atlas, tmp_path / "walk.mcap", 0.05)
    (model,) = seen
    assert true_masses(tmp_path / "walk.truth.json") != nominal_kg(atlas)
    for link in atlas.links:
        assert model.body(link).mass[0] == atlas.nominal_mass_kg(link)
        np.testing.assert_array_equal(model.body(link).inertia, atlas.model.body(link).inertia)


def test_what_servos_really_exerted_is_logged(tmp_path: Path) -> None:
    robot = Robot.load(shipped_models()["geared"])
    report = record_walk(robot, tmp_path / "walk.mcap", 2.0, gait="stamp", seed=2)
    walk = read_walk(report.path)
    assert report.end == "complete"
    assert velocity_errors(walk, robot, true_masses(report.truth_path)).max() < 1e-9  # rad/s; rounding
    assert np.median(velocity_errors(walk, robot, nominal_kg(robot))) > 1e-4
    share = np.abs(robot.align(walk).effort) / torque_limits(robot.model)
    assert 0.3 < share.max() <= 1.0


def test_a_robot_is_driven_as_its_file_says_unless_told_otherwise(tmp_path: Path) -> None:
    controllers: tuple[Controller, ...] = ("auto", "servo", "torque")
    auto, servo, torque = (
        read_walk(record_walk(shipped_models()["geared"], tmp_path / f"{c}.mcap", 0.2, controller=c, seed=1).path)
        for c in controllers
    )
    np.testing.assert_array_equal(auto.effort, servo.effort)
    assert not np.array_equal(auto.effort, torque.effort)
    with pytest.raises(ModelError, match="Actuator 'back_bkz' of the model is no position servo"):
        record_walk(ATLAS, tmp_path / "walk.mcap", 0.2, controller="servo")
    with pytest.raises(BadInputError, match=r"no controller named 'servos'\. Did you mean servo"):
        record_walk(ATLAS, tmp_path / "walk.mcap", 0.2, controller="servos")  # type: ignore[arg-type]


def test_a_seed_makes_one_walk(tmp_path: Path) -> None:
    logs = {}
    for name, seed in (("first", 1), ("again", 1), ("other", 2)):
        logs[name] = record_walk(ATLAS, tmp_path / f"{name}.mcap", 0.3, seed=seed)
    first, again, other = (read_walk(report.path) for report in logs.values())
    np.testing.assert_array_equal(first.qpos, again.qpos)
    np.testing.assert_array_equal(first.stamps_ns, again.stamps_ns)
    assert logs["first"].truth_path.read_text() == logs["again"].truth_path.read_text()
    assert not np.array_equal(first.qpos, other.qpos)
    # The gait does not change the masses that a seed stands for.
    turned = record_walk(ATLAS, tmp_path / "turn.mcap", 0.05, seed=1, gait="turn")
    assert true_masses(turned.truth_path) == true_masses(logs["first"].truth_path)


def test_a_fall_leaves_an_honest_log(tmp_path: Path) -> None:
    spec = mujoco.MjSpec.from_file(str(ATLAS))
    for motor in spec.actuators:
        if motor.name.endswith("kny"):  # knees too weak to carry the robot
            motor.ctrlrange = motor.forcerange = [-20.0, 20.0]
    report = record_walk(Robot(spec), tmp_path / "fall.mcap", 6.0, hidden=HiddenMasses({"torso": 3.0}))
    assert report.fell
    assert report.samples < 6000
    walk = read_walk(report.path)
    assert walk.metadata["end"] == "fell"
    assert len(walk) == report.samples
    assert json.loads(report.truth_path.read_text())["end"] == "fell"


def test_an_interrupted_walk_keeps_log_and_truth(tmp_path: Path) -> None:
    def interrupt(fraction: float, what: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record_walk(ATLAS, tmp_path / "walk.mcap", 2.0, progress=interrupt)
    walk = read_walk(tmp_path / "walk.mcap")
    assert 0 < len(walk) < 2000
    assert walk.metadata["end"].startswith("KeyboardInterrupt")
    assert json.loads((tmp_path / "walk.truth.json").read_text())["end"] == "interrupted"


def test_a_noisy_recording_is_the_clean_one_with_sensors(tmp_path: Path) -> None:
    record_walk(ATLAS, tmp_path / "clean.mcap", 0.3, seed=1)
    corrupted = corrupt_log(tmp_path / "clean.mcap", tmp_path / "corrupted.mcap", "realistic", seed=1)
    recorded = record_walk(ATLAS, tmp_path / "recorded.mcap", 0.3, noise="realistic", seed=1)
    first, second = read_walk(recorded.path), read_walk(corrupted.path)
    for name in ("qpos", "qvel", "effort", "wrench"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert first.metadata == second.metadata
    assert recorded.truth_path.read_text() == corrupted.truth_path.read_text()
    assert len(list(tmp_path.iterdir())) == 6  # three logs with their truth; the hidden clean one is gone


def test_an_interrupted_noisy_walk_leaves_no_clean_one(tmp_path: Path) -> None:
    def interrupt(fraction: float, what: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record_walk(ATLAS, tmp_path / "walk.mcap", 2.0, noise="white", progress=interrupt)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["walk.mcap", "walk.truth.json"]
    walk = read_walk(tmp_path / "walk.mcap")
    assert walk.metadata["end"].startswith("KeyboardInterrupt")
    assert walk.metadata["sensor_noise"] == "simulated"


def test_progress_reaches_the_end(tmp_path: Path) -> None:
    told: list[float] = []
    record_walk(ATLAS, tmp_path / "walk.mcap", 0.45, progress=lambda fraction, what: told.append(fraction))
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_bad_requests_leave_no_files(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="no gait named 'moonwalk'"):
        record_walk(ATLAS, tmp_path / "walk.mcap", 1.0, gait="moonwalk")
    with pytest.raises(BadInputError, match="massid has no sensor noise named 'loud'"):
        record_walk(ATLAS, tmp_path / "walk.mcap", 1.0, noise="loud")  # type: ignore[arg-type]
    with pytest.raises(BadInputError, match="do not fit"):
        record_walk(ATLAS, tmp_path / "walk.mcap", 1.0, hidden=MassErrors(links=("l_foot",), norm_kg=50.0))
    with pytest.raises(BadInputError, match="shorter than one physics step"):
        record_walk(ATLAS, tmp_path / "walk.mcap", 0.0)
    assert not list(tmp_path.iterdir())
