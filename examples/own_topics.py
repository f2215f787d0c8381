"""A log whose topics have names of their own: a topic map says which plays which role.

python examples/own_topics.py
"""

import tempfile
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import Writer

import massid

NAMES = {
    "/odom": "/state/base",
    "/joint_states": "/state/joints",
    "/contact/l_foot": "/sole/left",
    "/contact/r_foot": "/sole/right",
}
TOPIC_MAP = """
preset: massid
base: {topic: /state/base}
joints: {topic: /state/joints}
contacts:
  - {topic: /sole/left, body: l_foot}
  - {topic: /sole/right, body: r_foot}
"""


def renamed(source: Path, target: Path) -> Path:
    """The log with other topics, as another recorder might have named them."""
    with source.open("rb") as read, target.open("wb") as written:
        writer, channels = Writer(written), {}
        writer.start(profile="ros2")
        for schema, channel, message in make_reader(read).iter_messages():
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                topic = NAMES.get(channel.topic, channel.topic)
                channels[channel.id] = writer.register_channel(topic, channel.message_encoding, number)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    return target


def main() -> massid.Result:
    """Write such a log and its map, weigh the robot with them."""
    with tempfile.TemporaryDirectory() as folder:
        log = renamed(massid.sample_walk(), Path(folder) / "walk.mcap")
        topics = Path(folder) / "my_robot.yaml"
        topics.write_text(TOPIC_MAP)
        result = massid.weigh(log, robot="atlas", topics=topics, checks=False)
    print({link: round(mass_kg, 2) for link, mass_kg in result.estimate_kg.items()})
    return result


if __name__ == "__main__":
    main()
