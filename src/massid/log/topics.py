"""Which topic of a log plays which role."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, field


@dataclass(frozen=True)
class OdometrySource:
    """Where the state of the base comes from: a nav_msgs/msg/Odometry topic."""

    topic: str = "/odom"


@dataclass(frozen=True)
class JointSource:
    """Where joint positions, velocities and efforts come from: a sensor_msgs/msg/JointState topic."""

    topic: str = "/joint_states"


@dataclass(frozen=True)
class ContactSource:
    """Where contact wrenches come from: every geometry_msgs/msg/WrenchStamped topic below a prefix."""

    prefix: str = "/contact/"


@dataclass(frozen=True)
class TopicMap:
    """The topic of each role; the defaults are the names that `massid` itself records."""

    odometry: OdometrySource = field(default_factory=OdometrySource)
    joint_states: JointSource = field(default_factory=JointSource)
    contacts: ContactSource = field(default_factory=ContactSource)

    def uses(self, topic: str) -> bool:
        """Tell whether a topic plays any role."""
        return topic in (self.odometry.topic, self.joint_states.topic) or self.is_contact(topic)

    def is_contact(self, topic: str) -> bool:
        """Tell whether a topic carries the contact wrench of a body."""
        return topic.startswith(self.contacts.prefix) and len(topic) > len(self.contacts.prefix)


def contact_topic(prefix: str, body: str, taken: Collection[str]) -> str:
    """Name the topic of a body's wrench: ROS names allow letters, digits and underscores only.

    The true name of the body stands in the messages, so a changed or numbered topic name loses nothing.
    """
    token = re.sub(r"[^A-Za-z0-9_]", "_", body)
    if token[:1].isdigit() or not token:
        token = f"_{token}"
    topic, number = prefix + token, 2
    while topic in taken:
        topic, number = f"{prefix}{token}_{number}", number + 1
    return topic
