"""Walks as immutable arrays, and the MCAP logs they are read from and written to. The only door to `mcap`."""

from massid.log.reader import read_walk
from massid.log.repair import Repair, repair_log
from massid.log.rewrite import write_walk
from massid.log.summary import LogSummary, TopicSummary, summarise_log
from massid.log.topic_file import load_topics, preset_names
from massid.log.topics import BaseMap, ContactMap, JointMap, Source, TextField, TopicMap
from massid.log.walk import Sample, Segment, Walk
from massid.log.writer import WalkWriter

__all__ = [
    "BaseMap",
    "ContactMap",
    "JointMap",
    "LogSummary",
    "Repair",
    "Sample",
    "Segment",
    "Source",
    "TextField",
    "TopicMap",
    "TopicSummary",
    "Walk",
    "WalkWriter",
    "load_topics",
    "preset_names",
    "read_walk",
    "repair_log",
    "summarise_log",
    "write_walk",
]
