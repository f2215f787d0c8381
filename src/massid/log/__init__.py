"""Walks as immutable arrays, and the MCAP logs they are read from and written to. The only door to `mcap`."""

from massid.log.reader import read_walk
from massid.log.topics import ContactSource, JointSource, OdometrySource, TopicMap
from massid.log.walk import Sample, Segment, Walk
from massid.log.writer import WalkWriter

__all__ = [
    "ContactSource",
    "JointSource",
    "OdometrySource",
    "Sample",
    "Segment",
    "TopicMap",
    "Walk",
    "WalkWriter",
    "read_walk",
]
