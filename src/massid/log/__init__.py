"""The logs that walks are read from and written to: files, messages, topic maps, reader and writer."""

from massid.log.reader import read_walk
from massid.log.repair import Repair, repair_log
from massid.log.rewrite import write_walk
from massid.log.summary import LogSummary, TopicSummary, summarise_log
from massid.log.topics.file import load_topics, preset_names
from massid.log.topics.map import BaseMap, ContactMap, JointMap, Source, TextField, TopicMap
from massid.log.writer import WalkWriter

__all__ = [
    "BaseMap",
    "ContactMap",
    "JointMap",
    "LogSummary",
    "Repair",
    "Source",
    "TextField",
    "TopicMap",
    "TopicSummary",
    "WalkWriter",
    "load_topics",
    "preset_names",
    "read_walk",
    "repair_log",
    "summarise_log",
    "write_walk",
]
