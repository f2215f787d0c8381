"""Where well-known messages other than odometry hold the pose of the base, if the topic map does not say."""

from __future__ import annotations

from dataclasses import replace

from massid.errors import LogError
from massid.log.mcap.container import TopicInfo
from massid.log.topics.map import BaseMap, Source, TextField, TopicMap

POSES = {
    "geometry_msgs/msg/PoseStamped": "pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose",
    "geometry_msgs/msg/TransformStamped": "transform",
    "tf2_msgs/msg/TFMessage": "transforms[child_frame_id={body}].transform",
}
"""Messages that hold a pose, and where."""
_NAMES = {"position": ("position", "translation"), "orientation": ("orientation", "rotation")}
_VELOCITIES = ("linear_velocity", "angular_velocity")


def adapted(topics: TopicMap, info: TopicInfo) -> TopicMap:
    """Return the map with the fields of a base topic that are those of odometry replaced by those of its own type.

    Such messages hold no velocities, so these are derived.

    Raises:
        LogError: the topic is one of transforms, and the map does not name the body.
    """
    base, prefix = topics.base, POSES.get(info.message_type)
    default = TopicMap().base
    if base is None or prefix is None or default is None:
        return topics
    changed: dict[str, Source | str | None] = {}
    for quantity, (plain, of_transform) in _NAMES.items():
        source: Source = getattr(base, quantity)
        if source.topic == info.topic and source.fields == getattr(default, quantity).fields:
            last = of_transform if prefix.endswith("transform") else plain
            changed[quantity] = replace(source, fields=(f"{_filled(prefix, base, info)}.{last}",))
    for quantity in _VELOCITIES:
        velocity: Source | None = getattr(base, quantity)
        if (
            velocity is not None
            and velocity.topic == info.topic
            and velocity.fields == getattr(default, quantity).fields
        ):
            changed[quantity] = None
    if not changed:
        return topics
    return replace(topics, base=replace(base, **changed))  # type: ignore[arg-type]


def _filled(prefix: str, base: BaseMap, info: TopicInfo) -> str:
    if "{body}" not in prefix:
        return prefix
    if isinstance(base.body, TextField):
        raise LogError(
            f"{info.topic} holds transforms of many frames: name the base in the topic map, as in "
            f"`base: {{topic: {info.topic}, body: pelvis}}`."
        )
    return prefix.format(body=base.body)
