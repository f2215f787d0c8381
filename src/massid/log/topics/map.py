"""Which topic and field of a log plays which role, and in which convention it is written."""

from __future__ import annotations

import enum
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

BASE_STATE, JOINT_STATE, WRENCH = "base state", "joint state", "contact wrench"


class Order(enum.StrEnum):
    """What the numbers of an attitude are, in the order in which they are stored."""

    XYZW = "xyzw"
    WXYZ = "wxyz"
    RPY = "rpy"
    """Roll, pitch and yaw [rad]: turns about the fixed x, y and z axes in this order."""


class Frame(enum.StrEnum):
    """The frame in which a vector is expressed."""

    BODY = "body"
    WORLD = "world"


class On(enum.StrEnum):
    """What a measured force acts on."""

    ROBOT = "robot"
    GROUND = "ground"


class Silence(enum.StrEnum):
    """What it means that a contact topic holds no message while the log goes on."""

    AUTO = "auto"
    """No force if the readings before every silence fade and the sensor never reads zero, else loss."""
    ZERO = "zero"
    LOST = "lost"


class Rate(enum.StrEnum):
    """The clock of a walk whose topics have clocks of their own."""

    AUTO = "auto"
    """That of the joint states: base and wrenches that are slower are interpolated, faster ones averaged. In a log with
    sensor noise that of the slowest topic: faster states are averaged, too."""
    SLOWEST = "slowest"
    FASTEST = "fastest"


class Seldom(enum.StrEnum):
    """What becomes of joints whose messages come far less often than those of most."""

    LEAVE = "leave"
    """They are left out, as a gripper's that no model has, and said."""
    KEEP = "keep"
    """They are interpolated."""


class Clock(enum.StrEnum):
    """Where the time of a sample comes from."""

    AUTO = "auto"
    """Header stamps if every topic in use has them, else log time."""
    HEADER = "header"
    LOG = "log"


@dataclass(frozen=True)
class Source:
    """Where one quantity comes from.

    Attributes:
        topic: name of the topic.
        fields: dotted paths in its messages; a path that ends in a message stands for its x, y, z (and w), `[:]`
            stands for all elements of an array, `[0:29]` for some.
        scale: the numbers times this are in SI units.
    """

    topic: str
    fields: tuple[str, ...]
    scale: float = 1.0


@dataclass(frozen=True)
class TimeColumn:
    """The column of a table that holds the time of its rows, and its unit [s]."""

    field: str
    scale: float = 1.0


@dataclass(frozen=True)
class TextField:
    """A name that the messages themselves hold, at this path."""

    path: str


@dataclass(frozen=True)
class BaseMap:
    """Where the state of the floating base comes from.

    Attributes:
        body: name of the base body, or where the messages of `position` hold it.
        position: origin of the body in the world [m].
        orientation: attitude of the body in the world.
        linear_velocity: velocity of that origin [m/s]; None if it is to be derived from the positions.
        angular_velocity: turn rate of the body [rad/s]; None if it is to be derived from the attitudes.
        order: of the attitude's numbers.
        linear_frame: in which frame the linear velocity is expressed.
        angular_frame: in which frame the angular velocity is expressed.
    """

    body: str | TextField
    position: Source
    orientation: Source
    linear_velocity: Source | None
    angular_velocity: Source | None
    order: Order = Order.XYZW
    linear_frame: Frame = Frame.BODY
    angular_frame: Frame = Frame.BODY

    @property
    def sources(self) -> dict[str, Source]:
        """Source of each quantity that is logged, by name."""
        names = ("position", "orientation", "linear_velocity", "angular_velocity")
        return {name: source for name in names if (source := getattr(self, name)) is not None}


@dataclass(frozen=True)
class JointMap:
    """Where the states and torques of the joints come from.

    Attributes:
        names: joint names in the order of the arrays ("-" for a place that no joint uses), or where the messages of
            `position` hold them.
        position: [rad] or [m].
        velocity: [rad/s] or [m/s].
        effort: torque that each joint's actuator exerted [N m] or [N].
        rename: from the log's name of a joint to the model's.
        ignore: patterns of joints of the log that the model does not have.
        locked: by pattern, joints of the model that the log does not show, and where they were held [rad or m].
        passive: patterns of joints without an actuator: their effort is zero whatever the log says.
        gears: by pattern, what the logged torque of a joint is to be multiplied by, such as the ratio of its gear.
        seldom: what becomes of joints that come less than half as often as most.
    """

    names: tuple[str, ...] | TextField
    position: Source
    velocity: Source
    effort: Source
    rename: Mapping[str, str] = field(default_factory=dict)
    ignore: tuple[str, ...] = ()
    locked: Mapping[str, float] = field(default_factory=dict)
    passive: tuple[str, ...] = ()
    gears: Mapping[str, float] = field(default_factory=dict)
    seldom: Seldom = Seldom.LEAVE

    @property
    def sources(self) -> dict[str, Source]:
        """Source of each quantity by name."""
        return {name: getattr(self, name) for name in ("position", "velocity", "effort")}


@dataclass(frozen=True)
class ContactMap:
    """Where the contact wrench of one body, or of several bodies, comes from.

    Attributes:
        topic: name of the topic; `*` stands for anything, as in /contact/*. "" for a body whose wrench has no
            sensor.
        body: name of the body, or where the messages hold it.
        force: path of the force [N], or of each of its components.
        torque: path of the moment [N m], or of each of its components.
        force_scale: the forces times this are in newtons.
        torque_scale: the moments times this are in newton metres.
        on: what the force acts on.
        frame: in which frame the wrench is expressed.
        position: origin of the sensor in the body's frame [m].
        rotation: attitude of the sensor in the body's frame (wxyz).
        silence: what it means that there is no message for a while.
    """

    topic: str = "/contact/*"
    body: str | TextField = TextField("header.frame_id")
    force: tuple[str, ...] = ("wrench.force",)
    torque: tuple[str, ...] = ("wrench.torque",)
    force_scale: float = 1.0
    torque_scale: float = 1.0
    on: On = On.ROBOT
    frame: Frame = Frame.BODY
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    silence: Silence = Silence.AUTO

    def matches(self, topic: str) -> bool:
        """Tell whether a topic is one of these."""
        if not self.topic:
            return False
        pattern = ".+".join(re.escape(part) for part in self.topic.split("*"))
        return re.fullmatch(pattern, topic) is not None


def _odometry(topic: str) -> BaseMap:
    return BaseMap(
        body=TextField("child_frame_id"),
        position=Source(topic, ("pose.pose.position",)),
        orientation=Source(topic, ("pose.pose.orientation",)),
        linear_velocity=Source(topic, ("twist.twist.linear",)),
        angular_velocity=Source(topic, ("twist.twist.angular",)),
    )


def _joint_states(topic: str) -> JointMap:
    position, velocity, effort = (Source(topic, (name,)) for name in ("position", "velocity", "effort"))
    return JointMap(TextField("name"), position, velocity, effort)


@dataclass(frozen=True)
class TopicMap:
    """Where each role of a log is found; the defaults are what `massid` itself records.

    Attributes:
        base: state of the floating base; None if nothing supplies it.
        joints: states and torques of the joints; None if nothing supplies them.
        contacts: contact wrenches.
        clock: where time comes from.
        rate: which topic's rate a walk gets if they differ.
        lag_s: by stream ("joints", "effort", "wrench"), how much later than the base's its samples are stamped [s].
        time: of a table, the column of time; None for one with a usual name.
        supply: by role, what can supply it on this robot: said when it is missing.
        name: of the preset or file, for messages.
    """

    base: BaseMap | None = field(default_factory=lambda: _odometry("/odom"))
    joints: JointMap | None = field(default_factory=lambda: _joint_states("/joint_states"))
    contacts: tuple[ContactMap, ...] = (ContactMap(),)
    clock: Clock = Clock.AUTO
    rate: Rate = Rate.AUTO
    lag_s: Mapping[str, float] = field(default_factory=dict)
    time: TimeColumn | None = None
    supply: Mapping[str, str] = field(default_factory=dict)
    name: str = "massid"

    def sources(self) -> Iterator[tuple[str, str, Source]]:
        """Yield role, quantity and source of every single-topic quantity."""
        for role, group in ((BASE_STATE, self.base), (JOINT_STATE, self.joints)):
            if group is not None:
                for quantity, source in group.sources.items():
                    yield role, quantity, source

    def topics(self) -> tuple[str, ...]:
        """Every topic that the map names, patterns as they are."""
        names = [source.topic for _, _, source in self.sources()] + [contact.topic for contact in self.contacts]
        return tuple(dict.fromkeys(name for name in names if name))

    def contacts_of(self, topic: str) -> dict[str, ContactMap]:
        """Return the contact maps that a topic belongs to, by a key of their own.

        Those that name the topic go before patterns, and the first pattern before the others.
        """
        fitting = [contact for contact in self.contacts if contact.matches(topic)]
        named = [contact.topic for contact in fitting if contact.topic == topic] or [c.topic for c in fitting[:1]]
        return {f"wrench {k}": contact for k, contact in enumerate(self.contacts) if contact.topic in named}

    def uses(self, topic: str) -> bool:
        """Tell whether a topic plays any role."""
        return any(source.topic == topic for _, _, source in self.sources()) or bool(self.contacts_of(topic))

    def fields(self, topic: str) -> dict[str, tuple[str, ...]]:
        """Return the fields that are wanted from a topic, by a key of their own."""
        wanted = {f"{role} {quantity}": s.fields for role, quantity, s in self.sources() if s.topic == topic}
        return wanted | {key: (*c.force, *c.torque) for key, c in self.contacts_of(topic).items()}


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
