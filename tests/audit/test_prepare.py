"""From a file to a walk that is ready: lags taken off, slow logs put on the model's step."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massid.audit import prepare_walk
from massid.audit.limits import limit_suspicions
from massid.identify import IdentifyOptions, identify_offline
from massid.identify.prepare import prepare_logs
from massid.identify.sensing import read_noise
from massid.log import WalkWriter
from massid.model.robot import Robot
from massid.walk import Segment, Walk
from massid.walk.conventions import to_world
from massid.walk.noise import PRESETS, Sensors
from massid.walk.refine import refined
from massid.weighing import weigh
from tests.conftest import Pushed
from tests.pushed_robot import LINKS, stamped_late


def write(walk: Walk, path: Path) -> Path:
    names = {"root_body": walk.root_body, "joint_names": walk.joint_names, "contact_bodies": walk.contact_bodies}
    with WalkWriter(path, timestep_s=walk.timestep_s, **names) as writer:
        wrenches = {body: walk.wrench[:, c] for c, body in enumerate(walk.contact_bodies)}
        writer.append_block(walk.stamps_ns, walk.qpos, walk.qvel, walk.effort, wrenches)
    return path


def error_kg(walk: Walk, pushed: Pushed) -> float:
    """Of a walk that is taken as it is."""
    options = IdentifyOptions(noise="clean", passes=6)
    result = identify_offline(prepare_logs([walk], pushed.robot, pushed.space, options), pushed.robot, options)
    return float(np.linalg.norm(result.estimate[: len(pushed.truth)] - pushed.truth))


def test_a_sound_log_is_not_changed(pushed: Pushed, tmp_path: Path) -> None:
    prepared = prepare_walk(write(pushed.walk, tmp_path / "walk.mcap"), pushed.robot)
    np.testing.assert_array_equal(prepared.walk.effort, pushed.walk.effort)
    np.testing.assert_array_equal(prepared.walk.wrench, pushed.walk.wrench)
    assert prepared.walk.warnings == ()
    assert prepared.audit.clean


def test_a_lag_is_found_taken_off_and_said(pushed: Pushed, tmp_path: Path) -> None:
    late = replace(
        pushed.walk, effort=np.roll(pushed.walk.effort, 3, axis=0), wrench=np.roll(pushed.walk.wrench, 3, axis=0)
    )
    prepared = prepare_walk(write(late, tmp_path / "walk.mcap"), pushed.robot)
    assert any("torques are stamped +3.00 ms and wrenches +3.00 ms late" in line for line in prepared.walk.warnings)
    assert error_kg(prepared.walk, pushed) < 1e-3 * error_kg(replace(late, segments=(Segment(3, len(late)),)), pushed)


def test_a_late_walk_in_memory_is_weighed_as_if_it_had_been_in_time(pushed: Pushed) -> None:
    """Whoever calls the library gets what the command line gives."""
    late = stamped_late(pushed.walk, 3e-3, 3e-3)
    result = weigh(late, pushed.robot, list(LINKS), held_out=0.0, checks=False)
    assert np.linalg.norm(result.estimate - pushed.truth) < 1e-9
    assert any("stamped +3.00 ms and wrenches +3.00 ms late" in line for line in result.warnings)


def _slow(pushed: Pushed) -> Walk:
    """Every second state, torques and wrenches averaged."""
    n = len(pushed.walk) // 2 * 2

    def mean(values: np.ndarray) -> np.ndarray:
        return np.asarray(values[:n].reshape(n // 2, 2, *values.shape[1:]).mean(axis=1))

    return replace(
        pushed.walk,
        stamps_ns=pushed.walk.stamps_ns[:n:2],
        qpos=pushed.walk.qpos[:n:2],
        qvel=pushed.walk.qvel[:n:2],
        effort=mean(pushed.walk.effort),
        wrench=mean(pushed.walk.wrench),
        timestep_s=2e-3,
        segments=(),
    )


def test_a_slow_log_is_put_on_the_models_step(pushed: Pushed, tmp_path: Path) -> None:
    """Finer steps make up for most of what is lost."""
    slow = _slow(pushed)
    prepared = prepare_walk(write(slow, tmp_path / "walk.mcap"), pushed.robot)
    assert prepared.walk.timestep_s == pytest.approx(1e-3)
    np.testing.assert_allclose(prepared.walk.qpos[::2], slow.qpos, atol=1e-12)
    assert any("500 Hz is slower than the model's step" in line for line in prepared.walk.warnings)
    assert error_kg(prepared.walk, pushed) < 0.2 * error_kg(slow, pushed)


def test_a_slow_log_with_noise_is_left_as_it_is(pushed: Pushed, tmp_path: Path) -> None:
    """Interpolation would turn its noise into motion, and masses would be given without an interval."""
    slow = _slow(pushed)
    sensors = Sensors(PRESETS["white"], len(slow.joint_names), slow.contact_bodies, np.random.default_rng(0))
    prepared = prepare_walk(write(sensors.measure(slow), tmp_path / "walk.mcap"), pushed.robot)
    assert prepared.walk.timestep_s == pytest.approx(2e-3)
    assert any("nothing was put between its samples" in line for line in prepared.walk.warnings)
    noise = read_noise(prepared.walk, prepared.robot)
    assert noise is not None
    assert noise.joint_velocity == pytest.approx(PRESETS["white"].joint_velocity, rel=0.2)


def test_refining_keeps_samples_segments_and_transfers(pushed: Pushed) -> None:
    walk = replace(pushed.walk, segments=(Segment(0, 10), Segment(12, 40)))
    fine = refined(walk, 4)
    assert fine.segments == (Segment(0, 37), Segment(37, 37 + 109))
    assert fine.timestep_s == pytest.approx(0.25e-3)
    np.testing.assert_allclose(fine.qpos[:37:4], walk.qpos[:10], atol=1e-12)
    np.testing.assert_array_equal(fine.effort[37::4], walk.effort[12:40])
    np.testing.assert_array_equal(fine.effort[37:41], np.repeat(walk.effort[12:13], 4, axis=0))
    assert refined(walk, 1) is walk


def test_steps_between_samples_are_those_of_the_simulation(pushed: Pushed, tmp_path: Path) -> None:
    walk, n = pushed.walk, 1200
    means = {name: getattr(walk, name)[:n].reshape(n // 2, 2, *getattr(walk, name).shape[1:]).mean(axis=1)
             for name in ("effort", "wrench")}  # fmt: skip
    slow = replace(
        walk, stamps_ns=walk.stamps_ns[:n:2], qpos=walk.qpos[:n:2], qvel=walk.qvel[:n:2], timestep_s=0.002,
        segments=(), **means,
    )  # fmt: skip
    ready = prepare_walk(write(slow, tmp_path / "walk.mcap"), pushed.robot).walk
    rows = slice(0, n - 1)
    np.testing.assert_allclose(ready.qpos[rows], walk.qpos[rows], atol=1e-12)
    np.testing.assert_allclose(ready.qvel[rows], walk.qvel[rows], atol=1e-9)
    assert error_kg(ready, pushed) < 1e-3
    qpos = slow.qpos.copy()
    qpos[:, 7:] += 1e-4 * np.random.default_rng(0).normal(size=qpos[:, 7:].shape)
    noisy = replace(slow, qpos=qpos)
    interpolated = prepare_walk(write(noisy, tmp_path / "noisy.mcap"), pushed.robot).walk
    assert np.abs(interpolated.qvel[1:-1:2] - 0.5 * (slow.qvel[:-1] + slow.qvel[1:])).max() < 1e-9


def test_positions_in_degrees_are_suspected_even_if_velocities_agree(pushed: Pushed) -> None:
    spec = pushed.robot.spec.copy()
    spec.joint("l_knee").limited, spec.joint("l_knee").range = 1, np.degrees([-2.0, 0.1])
    robot = Robot(spec)
    assert limit_suspicions(robot, pushed.walk) == []
    qpos = pushed.walk.qpos.copy()
    qpos[:, 7:] = np.degrees(qpos[:, 7:])
    (line,) = limit_suspicions(robot, replace(pushed.walk, qpos=qpos))
    assert re.search(r"l_knee .* \(the model allows -2 \.\. 0\.1\).*degrees", line)


def test_the_pose_may_be_that_of_a_body_that_moves_with_the_base(pushed: Pushed) -> None:
    spec = pushed.robot.spec.copy()
    spec.body(pushed.robot.root_body).add_body(name="mount", pos=[0.1, 0.0, 0.2])
    robot = Robot(spec)
    position = to_world(pushed.walk.qpos[:, 3:7], np.tile([0.1, 0.0, 0.2], (len(pushed.walk), 1)))
    spin = np.cross(pushed.walk.qvel[:, 3:6], [0.1, 0.0, 0.2])
    qpos, qvel = pushed.walk.qpos.copy(), pushed.walk.qvel.copy()
    qpos[:, :3] += position
    qvel[:, :3] += to_world(qpos[:, 3:7], spin)
    ready = prepare_walk(replace(pushed.walk, root_body="mount", qpos=qpos, qvel=qvel), robot).walk
    assert ready.root_body == robot.root_body
    np.testing.assert_allclose(ready.qpos, pushed.walk.qpos, atol=1e-12)
