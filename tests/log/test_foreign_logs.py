"""Names and joints of other recorders are matched, and what does not fit is refused by name."""

from __future__ import annotations

import numpy as np
import pytest

from massid.errors import LogError
from massid.log import load_topics, read_walk
from tests.log.samples import JOINTS, STEP_NS, TYPES, assert_bridged, assert_same, make_samples

N = 40


RENAMED = """
preset: massid
base: {topic: /state/base}
joints: {topic: /state/joints}
contacts: [{topic: /ft/*}]
"""


def test_topics_may_have_other_names(foreign, tmp_path):
    log = foreign(N)
    names = {
        "/odom": "/state/base",
        "/joint_states": "/state/joints",
        "/contact/l_foot": "/ft/left",
        "/contact/r_foot": "/ft/right",
    }
    log.messages = {names[topic]: messages for topic, messages in log.messages.items()}
    log.types = {names[topic]: name for topic, name in TYPES.items()}
    (tmp_path / "topics.yaml").write_text(RENAMED)
    walk = read_walk(log.write(), load_topics(tmp_path / "topics.yaml"))
    assert_same(walk, make_samples(N))
    assert walk.contact_bodies == ("l_foot", "r_foot")
    with pytest.raises(LogError, match=r"no base state: topic /odom is not in the log. Could supply it: /state/base"):
        read_walk(log.path)


def test_joints_are_matched_by_name_though_their_order_changes(foreign):
    log = foreign(N)
    for message in log.messages["/joint_states"][11:30:3]:
        order = [2, 0, 3, 1]
        message.name = [message.name[k] for k in order]
        for field in ("position", "velocity", "effort"):
            setattr(message, field, getattr(message, field)[order])
    walk = read_walk(log.write())
    assert_same(walk, make_samples(N))
    assert walk.joint_names == JOINTS


def spoil_value(log):
    log.messages["/joint_states"][17].effort[2] = np.nan


def spoil_wrench(log):
    log.messages["/contact/r_foot"][5].wrench.torque.y = np.inf


def spoil_base(log):
    log.messages["/odom"][3].twist.twist.angular.z = -np.inf


def spoil_quaternion(log):
    q = log.messages["/odom"][9].pose.pose.orientation
    q.x = q.y = q.z = q.w = 0.0


def spoil_child_frame(log):
    log.messages["/odom"][9].child_frame_id = "torso"


def empty_child_frame(log):
    for message in log.messages["/odom"]:
        message.child_frame_id = ""


def no_effort(log):
    for message in log.messages["/joint_states"]:
        message.effort = np.zeros(0)


def no_effort_once(log):
    log.messages["/joint_states"][7].effort = np.zeros(0)


def short_velocity(log):
    for message in log.messages["/joint_states"]:
        message.velocity = message.velocity[:3]


def no_names(log):
    for message in log.messages["/joint_states"]:
        message.name = []


def same_name_twice(log):
    for message in log.messages["/joint_states"]:
        message.name = ["a", "b", "a", "c"]


def other_joints(log):
    log.messages["/joint_states"][8].name[1] = "l_elbow"


def two_topics_of_one_body(log):
    for message in log.messages["/contact/r_foot"]:
        message.header.frame_id = "l_foot"


def no_joint_states(log):
    del log.messages["/joint_states"]


def no_odometry_messages(log):
    log.messages["/odom"] = []


def no_contacts(log):
    del log.messages["/contact/l_foot"], log.messages["/contact/r_foot"]


def wrong_type(log):
    log.messages["/odom"] = log.messages["/joint_states"]
    log.types["/odom"] = TYPES["/joint_states"]


def other_era(log):
    for row in range(N):
        log.set_stamp("/odom", row, row * STEP_NS)


def no_stamps(log):
    for topic in TYPES:
        for row in range(N):
            log.set_stamp(topic, row, 0)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (spoil_child_frame, r"/odom: child_frame_id changes within the log \('pelvis', 'torso'\)"),
        (empty_child_frame, r"/odom: child_frame_id is empty, expected the name of the root body"),
        (no_effort, r"/joint_states: sample 0: effort has 0 values, expected one for each of the 4 joints"),
        (short_velocity, r"/joint_states: sample 0: velocity has 3 values, expected one for each of the 4"),
        (no_names, r"/joint_states: sample 0: no joint names"),
        (same_name_twice, r"/joint_states: joint 'a' occurs 2 times, expected once"),
        (two_topics_of_one_body, r"/contact/l_foot and /contact/r_foot both hold the wrench of body 'l_foot'"),
        (
            no_joint_states,
            r"no joint state: topic /joint_states is not in the log. A topic of sensor_msgs/msg/JointState "
            r"supplies it, or another one whose fields a topic map names. "
            r"The log has: /odom \(nav_msgs/msg/Odometry\), /contact/l_foot",
        ),
        (no_odometry_messages, r"no base state: topic /odom is there but holds no sample"),
        (no_contacts, r"no contact wrench: no topic like /contact/\* holds samples.*WrenchStamped supplies it, or"),
        (
            wrong_type,
            r"/odom \(sensor_msgs/msg/JointState\): sample 0: no field 'pose.pose.position'.*; the fields are",
        ),
        (other_era, r"no stretch of time is covered by all streams"),
        (no_stamps, r"/odom holds 1 usable samples, expected at least 2 \(39 samples repeat.*use `clock: log`"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(foreign, spoil, message):
    log = foreign(N)
    spoil(log)
    with pytest.raises(LogError, match=message) as caught:
        read_walk(log.write())
    assert str(caught.value).startswith(str(log.path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("spoil", "row", "message"),
    [
        (
            spoil_value,
            17,
            "/joint_states: sample 17: effort of joint 'r_hip' is nan, expected a finite number; 1 of 40",
        ),
        (spoil_wrench, 5, "/contact/r_foot: sample 5: wrench.torque.y is inf, expected a finite number; 1 of 40"),
        (spoil_base, 3, "/odom: sample 3: twist.twist.angular[2] is -inf, expected a finite number; 1 of 40"),
        (spoil_quaternion, 9, "/odom: sample 9: orientation has norm 0, expected 1 within 0.001; 1 of 40"),
        (no_effort_once, 7, "/joint_states: sample 7: effort has 0 values, expected one for each of the 4 joints; 1"),
        (other_joints, 8, "/joint_states: sample 8: the joints differ from those of most samples (missing: l_knee; "),
    ],
)
def test_samples_that_cannot_be_used_are_counted_and_bridged(foreign, spoil, row, message):
    log = foreign(N)
    spoil(log)
    walk = read_walk(log.write())
    assert_bridged(walk, make_samples(N), [row])
    assert any(line.startswith(f"{log.path}: {message}") for line in walk.warnings), walk.warnings


def test_a_topic_of_bad_values_only_is_refused(foreign):
    log = foreign(N)
    for message in log.messages["/joint_states"]:
        message.effort[2] = np.nan
    with pytest.raises(LogError, match=r"sample 0: effort of joint 'r_hip' is nan.*\(40 of 40 samples are like that\)"):
        read_walk(log.write())
