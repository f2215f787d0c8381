"""Several publishers, channels or bodies on one topic: all that is there is used, and matched by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from massid.errors import LogError
from massid.log import load_topics, read_walk
from massid.walk.resampling import multiply
from tests.log.samples import (
    JOINTS,
    START_NS,
    STEP_NS,
    TYPES,
    Foreign,
    assert_same,
    make_samples,
    rotation,
    smooth_samples,
)

N = 60
LEFT, RIGHT = JOINTS[:2], JOINTS[2:]


def split_joints(log: Foreign, *, later_ns: int = 0) -> None:
    """Let two publishers send the joints of either side."""
    both = []
    for message in log.messages["/joint_states"]:
        for side, late in ((LEFT, 0), (RIGHT, later_ns)):
            places = [JOINTS.index(name) for name in side]
            fields = {name: getattr(message, name)[places] for name in ("position", "velocity", "effort")}
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec + late
            header = log.make(
                "std_msgs/msg/Header",
                stamp=log.make("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9),
                frame_id="",
            )
            both.append(log.make("sensor_msgs/msg/JointState", header=header, name=list(side), **fields))
    log.messages["/joint_states"] = both


def test_joints_of_two_publishers_are_joined(foreign) -> None:
    log = foreign(N)
    split_joints(log)
    walk = read_walk(log.write())
    assert walk.joint_names == JOINTS
    assert_same(walk, make_samples(N))
    assert walk.warnings == ()


def test_joints_of_two_publishers_may_be_stamped_apart(foreign) -> None:
    log = Foreign(foreign(1).path, smooth_samples(N))
    split_joints(log, later_ns=STEP_NS // 2)
    walk = read_walk(log.write())
    assert walk.joint_names == JOINTS
    time_s = (walk.stamps_ns - START_NS)[:, None] * 1e-9
    late_s = np.array([0.0, 0.0, 0.5e-3, 0.5e-3])  # the samples of the right side were taken, and stamped, later
    error = walk.qpos[:, 7:] - np.sin(10.0 * (time_s - late_s) + np.arange(7, 11))
    assert np.abs(error).max() < 1e-6  # a cubic over 1 ms of a motion of 10 rad/s


@pytest.mark.parametrize("how", ["one after the other", "in turns"])
def test_a_topic_may_have_two_channels(foreign, how) -> None:
    log = foreign(N)
    log.channel = lambda topic, row: (
        (row >= N // 2 if how == "one after the other" else row % 2) * (topic == "/joint_states")
    )
    walk = read_walk(log.write(order=[(topic, row) for row in range(N) for topic in TYPES]))
    assert_same(walk, make_samples(N))
    assert walk.warnings == ()


def test_a_publisher_that_was_restarted_may_name_joints_in_another_order(foreign) -> None:
    log = foreign(N)
    for message in log.messages["/joint_states"][N // 2 :]:
        message.name = list(reversed(message.name))
        for field in ("position", "velocity", "effort"):
            setattr(message, field, getattr(message, field)[::-1].copy())
    log.channel = lambda topic, row: int(topic == "/joint_states" and row >= N // 2)
    assert_same(read_walk(log.write()), make_samples(N))


def test_both_feet_on_one_topic_are_told_by_their_frame(foreign) -> None:
    log = foreign(N)
    log.messages["/contact/feet"] = [
        message
        for pair in zip(log.messages.pop("/contact/l_foot"), log.messages.pop("/contact/r_foot"), strict=True)
        for message in pair
    ]
    log.types["/contact/feet"] = TYPES["/contact/l_foot"]
    walk = read_walk(log.write())
    assert walk.contact_bodies == ("l_foot", "r_foot")
    assert_same(walk, make_samples(N))


ONE_MESSAGE = """
preset: massid
contacts:
  - {topic: /feet, body: l_foot, force: "twist.twist.linear", torque: "twist.twist.angular"}
  - {topic: /feet, body: r_foot, force: "pose.pose.position", torque: ["covariance[0:3]"]}
"""


def test_two_contacts_of_a_map_may_name_one_topic(foreign, tmp_path: Path) -> None:
    """As where one message holds the wrenches of both feet."""
    log = foreign(N)
    samples = make_samples(N)
    log.messages["/feet"] = []
    log.types["/feet"] = TYPES["/odom"]
    covariance = np.zeros(36)
    for row, message in enumerate(log.messages["/odom"]):
        left, right = (samples.wrenches[foot][row] for foot in ("l_foot", "r_foot"))
        twist = log.make("geometry_msgs/msg/Twist", linear=log._vector(left[:3]), angular=log._vector(left[3:]))
        point = log.make("geometry_msgs/msg/Point", **dict(zip("xyz", map(float, right[:3]), strict=True)))
        pose = log.make("geometry_msgs/msg/Pose", position=point, orientation=message.pose.pose.orientation)
        covariance = np.concatenate([right[3:], np.zeros(33)])
        log.messages["/feet"].append(
            log.make(
                "nav_msgs/msg/Odometry",
                header=message.header,
                child_frame_id="",
                pose=log.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance),
                twist=log.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=covariance),
            )
        )
    del log.messages["/contact/l_foot"], log.messages["/contact/r_foot"]
    (tmp_path / "map.yaml").write_text(ONE_MESSAGE.replace('"covariance', '"pose.covariance'))
    walk = read_walk(log.write(), load_topics(tmp_path / "map.yaml"))
    assert walk.contact_bodies == ("l_foot", "r_foot")
    assert_same(walk, samples)


def test_one_body_twice_says_what_settles_it(foreign, tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(
        "preset: massid\ncontacts: [{topic: /contact/l_foot, body: foot}, {topic: /contact/r_foot, body: foot}]\n"
    )
    with pytest.raises(LogError, match=r"both hold the wrench of body 'foot'; `body` under contacts .* says which"):
        read_walk(foreign(N).write(), load_topics(tmp_path / "map.yaml"))


def as_transforms(log: Foreign, others: int = 0) -> None:
    """Put the pose of the base into /tf, among other frames, and no velocity anywhere."""
    log.types["/tf"] = "tf2_msgs/msg/TFMessage"
    log.messages["/tf"] = []
    for message in log.messages.pop("/odom"):
        pose = message.pose.pose
        translation = log._vector([pose.position.x, pose.position.y, pose.position.z])
        frames = ["camera"] * others + ["pelvis"] + ["lidar"] * others
        transform = log.make("geometry_msgs/msg/Transform", translation=translation, rotation=pose.orientation)
        nowhere = log.make("geometry_msgs/msg/Transform", translation=log._vector([9.0] * 3), rotation=pose.orientation)
        log.messages["/tf"].append(
            log.make(
                "tf2_msgs/msg/TFMessage",
                transforms=[
                    log.make(
                        "geometry_msgs/msg/TransformStamped",
                        header=message.header,
                        child_frame_id=frame,
                        transform=transform if frame == "pelvis" else nowhere,
                    )
                    for frame in frames
                ],
            )
        )
    log.stamp_of = lambda message: (message.transforms[0] if hasattr(message, "transforms") else message).header.stamp


@pytest.mark.parametrize("others", [0, 2])
def test_the_base_may_be_a_transform_and_its_velocities_are_derived(foreign, tmp_path: Path, others) -> None:
    log = Foreign(foreign(1).path, smooth_samples(N))
    as_transforms(log, others)
    (tmp_path / "map.yaml").write_text("preset: massid\nbase: {topic: /tf, body: pelvis}\n")
    walk = read_walk(log.write(), load_topics(tmp_path / "map.yaml"))
    true = smooth_samples(N)
    np.testing.assert_array_equal(walk.qpos, true.qpos)
    # central differences at 1 ms of a motion of 10 rad/s: a sixth of the square of 0.01
    np.testing.assert_allclose(walk.qvel[1:-1, :6], true.qvel[1:-1, :6], atol=10 * 1e-4 / 6)
    assert any("/tf has no linear_velocity and no angular_velocity".replace("_", " ") in w for w in walk.warnings)


def corrected(log: Foreign, link: Any, row: int) -> Any:
    """The frame that links start from, in a map that is corrected now and then: it jumps."""
    away = log.make(
        "geometry_msgs/msg/Transform",
        translation=log._vector([float(row // 7), 0.0, 0.0]),
        rotation=log.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
    )
    header = log.make("std_msgs/msg/Header", stamp=link.header.stamp, frame_id="map")
    return log.make("geometry_msgs/msg/TransformStamped", header=header, child_frame_id="odom", transform=away)


@pytest.mark.parametrize("above", ["in the same messages", "in others", "static"])
def test_transforms_are_followed_to_a_frame_that_nothing_moves(foreign, tmp_path: Path, above: str) -> None:
    """odom -> base_footprint -> pelvis: the pelvis alone would be known in a frame that moves with the robot."""
    log = Foreign(foreign(1).path, smooth_samples(N))
    as_transforms(log)
    half = np.array([np.cos(0.3), 0.0, 0.0, np.sin(0.3)])  # a turn of the footprint, which the pelvis turns back
    to_odom = rotation(half)
    messages = []
    for row, message in enumerate(log.messages["/tf"]):
        footprint = np.array([0.1 * row if above != "static" else 2.0, -1.0, 0.5])
        (pelvis,) = message.transforms
        pelvis.header.frame_id = "base_footprint"
        place = pelvis.transform.translation
        inside = to_odom.T @ (np.array([place.x, place.y, place.z]) - footprint)
        pelvis.transform.translation = log._vector(inside.tolist())
        q = pelvis.transform.rotation
        w, x, y, z = multiply(half[None] * [1.0, -1.0, -1.0, -1.0], np.array([[q.w, q.x, q.y, q.z]]))[0].tolist()
        turned = {"x": x, "y": y, "z": z, "w": w}
        pelvis.transform.rotation = log.make("geometry_msgs/msg/Quaternion", **turned)
        w, x, y, z = half.tolist()
        link = log.make(
            "geometry_msgs/msg/TransformStamped",
            header=log.make("std_msgs/msg/Header", stamp=pelvis.header.stamp, frame_id="/odom"),
            child_frame_id="/base_footprint",
            transform=log.make(
                "geometry_msgs/msg/Transform",
                translation=log._vector(footprint.tolist()),
                rotation=log.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
            ),
        )
        if above == "in the same messages":
            message.transforms = [link, pelvis]
            messages.append(message)
        else:
            messages += [message, log.make("tf2_msgs/msg/TFMessage", transforms=[link, corrected(log, link, row)])]
    log.messages["/tf"] = messages
    if above == "static":
        log.types["/tf_static"] = "tf2_msgs/msg/TFMessage"
        log.messages["/tf_static"] = [messages[1]]
        log.messages["/tf"] = messages[::2]
    (tmp_path / "map.yaml").write_text("preset: massid\nbase: {topic: /tf, body: pelvis}\n")
    walk = read_walk(log.write(), load_topics(tmp_path / "map.yaml"))
    true = smooth_samples(N)
    np.testing.assert_allclose(walk.qpos[:, :3], true.qpos[:, :3], atol=1e-12)
    np.testing.assert_allclose(rotation(walk.qpos[7, 3:7]), rotation(true.qpos[7, 3:7]), atol=1e-12)
    assert any("followed through the transforms of pelvis, base_footprint" in line for line in walk.warnings)


def test_transforms_without_a_name_for_the_base_are_refused(foreign, tmp_path: Path) -> None:
    log = foreign(N)
    as_transforms(log)
    (tmp_path / "map.yaml").write_text("preset: massid\nbase: {topic: /tf}\n")
    with pytest.raises(LogError, match=r"/tf holds transforms of many frames: name the base.*body: pelvis"):
        read_walk(log.write(), load_topics(tmp_path / "map.yaml"))


def test_torques_before_gears_are_multiplied(foreign, tmp_path: Path) -> None:
    log = foreign(N)
    for message in log.messages["/joint_states"]:
        message.effort = message.effort / np.array([100.0, 100.0, 1.0, -1.0])
    (tmp_path / "map.yaml").write_text("preset: massid\njoints: {gears: {'l_*': 100, r_knee: -1}}\n")
    walk = read_walk(log.write(), load_topics(tmp_path / "map.yaml"))
    np.testing.assert_allclose(walk.effort, make_samples(N).effort, rtol=1e-14)


def test_joints_without_a_torque_are_named_with_what_to_do(foreign) -> None:
    log = foreign(N)
    for message in log.messages["/joint_states"]:
        message.effort[1:3] = np.nan
    with pytest.raises(
        LogError, match=r"so in most samples: effort of joint 'l_knee', effort of joint 'r_hip'.*passive"
    ):
        read_walk(log.write())
