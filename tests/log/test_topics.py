"""Topic maps: conventions of other recorders are undone exactly; what is wrong with a map is named with its place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from massid.errors import LogError
from massid.log import TopicMap, WalkWriter, load_topics, preset_names, read_walk
from tests.log.protobuf_samples import write_protobuf
from tests.log.samples import FEET, JOINTS, ROOT, STEP_NS, TYPES, Foreign, assert_same, make_samples, rotation

N = 40


def load(tmp_path: Path, text: str) -> TopicMap:
    (tmp_path / "topics.yaml").write_text(text)
    return load_topics(tmp_path / "topics.yaml")


def test_the_default_map_is_the_preset_of_this_project() -> None:
    assert load_topics("massid") == TopicMap()


def test_every_preset_loads_and_says_what_can_supply_a_role() -> None:
    assert {"massid", "ros2", "unitree_g1", "unitree_h1", "booster_t1", "pal"} <= set(preset_names())
    for name in preset_names():
        topics = load_topics(name)
        assert topics.base is not None
        assert topics.joints is not None
        assert name == "massid" or topics.supply


def test_a_file_changes_only_what_it_names(tmp_path: Path) -> None:
    topics = load(tmp_path, "preset: unitree_g1\nbase: {position: {topic: /mocap}}\nclock: header\n")
    preset = load_topics("unitree_g1")
    assert topics.base is not None
    assert preset.base is not None
    assert topics.base.position.topic == "/mocap"
    assert topics.base.position.fields == preset.base.position.fields
    assert topics.base.orientation == preset.base.orientation
    assert topics.joints == preset.joints


def test_conventions_are_undone(foreign: Any, tmp_path: Path) -> None:
    """A recorder with wxyz, world velocities, forces on the ground and degrees gives the walk that was written."""
    samples = make_samples(N)
    log: Foreign = foreign(N)
    for k, message in enumerate(log.messages["/odom"]):
        q = message.pose.pose.orientation
        q.x, q.y, q.z, q.w = q.w, q.x, q.y, q.z
        twist = message.twist.twist
        for axis, linear, angular in zip("xyz", samples.qvel[k, :3], _turned(samples, k), strict=True):
            setattr(twist.linear, axis, float(linear))
            setattr(twist.angular, axis, float(angular))
    for message in log.messages["/joint_states"]:
        message.position = np.degrees(message.position)
    for message in log.messages["/contact/l_foot"]:
        for vector in (message.wrench.force, message.wrench.torque):
            vector.x, vector.y, vector.z = -vector.x, -vector.y, -vector.z
    for message in log.messages["/contact/r_foot"]:  # in units of 1024 N and 0.25 N m: powers of two lose nothing
        force, moment = message.wrench.force, message.wrench.torque
        force.x, force.y, force.z = force.x / 1024.0, force.y / 1024.0, force.z / 1024.0
        moment.x, moment.y, moment.z = 4.0 * moment.x, 4.0 * moment.y, 4.0 * moment.z
    text = """
preset: massid
base:
  orientation: {order: wxyz}
  linear_velocity: {frame: world}
  angular_velocity: {frame: world}
joints:
  position: {field: position, scale: 0.017453292519943295}
contacts:
  - {topic: /contact/l_foot, on: ground}
  - {topic: /contact/r_foot, force: {field: wrench.force, scale: 1024}, torque: {scale: 0.25}}
"""
    walk = read_walk(log.write(), load(tmp_path, text))
    np.testing.assert_array_equal(walk.qpos[:, :7], samples.qpos[:, :7])
    np.testing.assert_allclose(walk.qpos[:, 7:], samples.qpos[:, 7:], rtol=1e-14)  # degrees and back
    np.testing.assert_allclose(walk.qvel, samples.qvel, atol=1e-14)  # a rotation and back
    for column, body in enumerate(walk.contact_bodies):
        np.testing.assert_array_equal(walk.wrench[:, column], samples.wrenches[body])


def _turned(samples: Any, k: int) -> np.ndarray:
    return rotation(samples.qpos[k, 3:7]) @ samples.qvel[k, 3:6]


def test_a_sensor_pose_moves_the_moment_to_the_bodys_origin(foreign: Any, tmp_path: Path) -> None:
    text = "preset: massid\ncontacts: [{topic: /contact/*, position: [0, 0, -0.1], rotation: [0, 1, 0, 0]}]\n"
    walk = read_walk(foreign(N).write(), load(tmp_path, text))
    for column, body in enumerate(walk.contact_bodies):
        wrench = make_samples(N).wrenches[body]
        flipped = np.array([1.0, -1.0, -1.0])  # half a turn about x
        force, moment = wrench[:, :3] * flipped, wrench[:, 3:] * flipped
        np.testing.assert_allclose(walk.wrench[:, column, :3], force, rtol=1e-14)
        np.testing.assert_allclose(walk.wrench[:, column, 3:], moment + np.cross([0, 0, -0.1], force), atol=1e-11)


def test_joints_are_ignored_renamed_and_passive(foreign: Any, tmp_path: Path) -> None:
    log = foreign(N)
    for message in log.messages["/joint_states"]:
        message.name = ["l_hip", "finger_1", "r_hip_joint", "r_knee"]
        message.effort[3] = np.nan
    text = "preset: massid\njoints: {ignore: [finger_*], rename: {r_hip_joint: r_hip}, passive: r_knee}\n"
    walk = read_walk(log.write(), load(tmp_path, text))
    samples = make_samples(N)
    assert walk.joint_names == ("l_hip", "r_hip", "r_knee")
    np.testing.assert_array_equal(walk.qpos[:, 7:], samples.qpos[:, [7, 9, 10]])
    np.testing.assert_array_equal(walk.effort[:, :2], samples.effort[:, [0, 2]])
    assert not walk.effort[:, 2].any()
    assert walk.warnings == ()


def test_other_joint_messages_on_the_topic_are_left_out(foreign: Any) -> None:
    """A gripper's driver that publishes on /joint_states as well."""
    log = foreign(N)
    for k in range(30, 2, -7):
        other = log.make(
            "sensor_msgs/msg/JointState",
            header=log.messages["/joint_states"][k].header,
            name=["gripper"],
            position=np.zeros(1),
            velocity=np.zeros(1),
            effort=np.zeros(1),
        )
        log.messages["/joint_states"].insert(k, other)
    walk = read_walk(log.write())
    assert_same(walk, make_samples(N))
    assert "missing: l_hip, l_knee, r_hip, r_knee; new: gripper" in walk.warnings[0]
    assert "4 of 44 samples" in walk.warnings[0]


def test_log_time_is_used_where_there_are_no_header_stamps(tmp_path: Path) -> None:
    samples = make_samples(N)
    with (tmp_path / "log.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("state", "jsonschema", b"{}")
        channel = writer.register_channel("/state", "json", schema)
        for k in range(N):
            message = {
                "base": {"p": samples.qpos[k, :3].tolist(), "q": samples.qpos[k, 3:7].tolist()},
                "v": samples.qvel[k, :6].tolist(),
                "motors": [
                    {"q": samples.qpos[k, 7 + j], "dq": samples.qvel[k, 6 + j], "tau": samples.effort[k, j]}
                    for j in range(len(JOINTS))
                ],
                "feet": {body: samples.wrenches[body][k].tolist() for body in FEET},
            }
            stamp = int(samples.stamps[k])
            writer.add_message(channel, stamp, json.dumps(message).encode(), stamp)
        writer.finish()
    text = f"""
base:
  topic: /state
  body: {ROOT}
  position: base.p
  orientation: {{field: base.q, order: wxyz}}
  linear_velocity: {{field: "v[0:3]", frame: world}}
  angular_velocity: {{field: "v[3:6]", frame: body}}
joints:
  topic: /state
  names: [{", ".join(JOINTS)}]
  position: "motors[:].q"
  velocity: "motors[:].dq"
  effort: "motors[:].tau"
contacts:
  - {{topic: /state, body: l_foot, force: "feet.l_foot[0:3]", torque: "feet.l_foot[3:6]"}}
"""
    walk = read_walk(tmp_path / "log.mcap", load(tmp_path, text))
    np.testing.assert_array_equal(walk.qpos, samples.qpos)
    np.testing.assert_array_equal(walk.qvel, samples.qvel)
    np.testing.assert_array_equal(walk.effort, samples.effort)
    np.testing.assert_array_equal(walk.wrench[:, 0], samples.wrenches["l_foot"])
    assert walk.timestep_s == STEP_NS * 1e-9
    assert any("no header stamps on /state, so time is that of recording" in line for line in walk.warnings)


def test_protobuf_channels_are_read(tmp_path: Path) -> None:
    samples = make_samples(N)
    walk = read_walk(write_protobuf(tmp_path / "log.mcap", samples))
    assert_same(walk, samples)


def test_a_known_lag_is_taken_off(foreign: Any, tmp_path: Path) -> None:
    """Wrenches stamped two samples late are put back without changing a number."""
    log = foreign(N)
    for foot in ("/contact/l_foot", "/contact/r_foot"):
        for row in range(N):
            log.set_stamp(foot, row, int(make_samples(N).stamps[row]) + 2 * STEP_NS)
    walk = read_walk(log.write(), load(tmp_path, "preset: massid\nlag_s: {wrench: 0.002}\n"))
    assert_same(walk, make_samples(N))


def test_half_a_sample_of_lag_blends_neighbours(foreign: Any, tmp_path: Path) -> None:
    walk = read_walk(foreign(N).write(), load(tmp_path, "preset: massid\nlag_s: {effort: 0.0005}\n"))
    effort = make_samples(N).effort
    np.testing.assert_allclose(walk.effort, 0.5 * (effort[: len(walk)] + effort[1 : len(walk) + 1]), atol=1e-11)


@pytest.mark.parametrize("name", sorted(set(preset_names()) - {"massid", "ros2"}))
def test_a_preset_without_its_topics_names_the_role_and_what_can_supply_it(name: str, foreign: Any) -> None:
    log = foreign(N)
    log.messages = {f"/other{topic}": messages for topic, messages in log.messages.items()}
    log.types = {f"/other{topic}": kind for topic, kind in TYPES.items()}
    with pytest.raises(LogError, match=rf"no .*base state: topic .* is not in the log. For {name}: .*Could supply it"):
        read_walk(log.write(), load_topics(name))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("preset: ros3\n", "no preset named 'ros3'. Did you mean ros2"),
        ("bsae: {}\n", "no setting named 'bsae'. Did you mean base"),
        ("preset: massid\nbase: {orientation: {order: zyxw}}\n", "orientation: order has no choice named 'zyxw'"),
        ("preset: massid\nclock: [1]\n", r"clock has no choice named '\[1\]'. It has: auto, header, log"),
        ("preset: massid\nlag_s: {effort: soon}\n", "lag_s: effort is soon, expected a number"),
        ("preset: massid\nlag_s: {effort: .nan}\n", "lag_s: effort is nan, expected a finite number"),
        ("preset: massid\njoints: {effort: []}\n", r"joints: effort is \[\], expected at least one field"),
        ("preset: massid\ncontacts: {topic: /x}\n", "contacts is .* expected a list"),
        ("preset: massid\ncontacts: [{}]\n", r"contacts\[0\]: topic is missing, expected a name"),
        ("preset: massid\ncontacts: [{topic: /x, rotation: [1, 1, 0, 0]}]\n", "rotation has norm 1.414"),
        ("base: {topic: /odom}\n", "base: body is missing, expected a name"),
        ("a: &x [1]\nb: *x\n", "line 2: aliases .* are not allowed"),
        ("[" * 5000, "nested more than 12 levels deep"),
        ("a: [", "not YAML"),
        ("just text", "is just text, expected settings"),
        ("", "is missing, expected settings"),
    ],
)
def test_what_is_wrong_with_a_map_is_named(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=message) as caught:
        load(tmp_path, text)
    assert "topics.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_map_lists_the_presets() -> None:
    with pytest.raises(LogError, match=r"no topic map named 'ros'. Did you mean ros2.*unitree_g1.*YAML file works"):
        load_topics("ros")


def test_a_field_that_is_not_there_is_named_with_those_that_are(foreign: Any, tmp_path: Path) -> None:
    topics = load(tmp_path, "preset: massid\njoints: {effort: torque}\n")
    with pytest.raises(LogError, match=r"/joint_states .*: sample 0: no field 'torque'; the fields are: .*effort"):
        read_walk(foreign(N).write(), topics)


def test_bodies_without_a_sensor_are_named_alone(samples: Any, tmp_path: Path) -> None:
    log = tmp_path / "blind.mcap"
    with WalkWriter(log, root_body=ROOT, joint_names=JOINTS, timestep_s=1e-3) as writer:
        writer.append_block(samples.stamps, samples.qpos, samples.qvel, samples.effort, {})
    with pytest.raises(LogError, match="name the bodies that touch the ground: `contacts:"):
        read_walk(log)
    topics = tmp_path / "blind.yaml"
    topics.write_text("preset: massid\ncontacts: [{body: l_foot}, {body: r_foot}]\n")
    walk = read_walk(log, load_topics(topics))
    assert walk.contact_bodies == ("l_foot", "r_foot")
    assert walk.open_axes == tuple(range(12))


def test_one_foot_may_have_a_sensor_and_the_other_none(foreign: Any, tmp_path: Path) -> None:
    topics = tmp_path / "half.yaml"
    topics.write_text("preset: massid\ncontacts: [{topic: /contact/*}, {body: toe}]\n")
    walk = read_walk(foreign().write(), load_topics(topics))
    assert walk.contact_bodies[-1] == "toe"
    np.testing.assert_array_equal(walk.measured, [[name != "toe"] * 6 for name in walk.contact_bodies])
