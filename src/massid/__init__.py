"""massid: weighs the links of a humanoid robot while the robot walks.

    import massid

    result = massid.weigh("walk.mcap", "robot.xml", ["torso", "l_thigh", "r_thigh"])

Nothing heavy is imported until it is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from massid.lazy import lazy_names

if TYPE_CHECKING:
    from massid.assets import sample_walk, shipped_models
    from massid.errors import MassidError
    from massid.identify import IdentifyOptions, OnlineIdentifier
    from massid.log import TopicMap, load_topics, read_walk, write_walk
    from massid.model import unknowns
    from massid.model.robot import Robot
    from massid.model.unknowns.spaces import mass_space, parameter_space
    from massid.model.unknowns.unknown import Effect, Unknown
    from massid.observer.sensors import ExactSensors, NoisySensors
    from massid.plant import record_walk
    from massid.result import Result, Status, WindowResult
    from massid.search.guided import SearchOptions
    from massid.walk import Sample, Segment, Walk
    from massid.weighing import Weighing, weigh

_HOMES = {
    "Effect": "model.unknowns.unknown",
    "ExactSensors": "observer.sensors",
    "IdentifyOptions": "identify",
    "MassidError": "errors",
    "NoisySensors": "observer.sensors",
    "OnlineIdentifier": "identify",
    "Result": "result",
    "Robot": "model.robot",
    "Sample": "walk",
    "SearchOptions": "search.guided",
    "Segment": "walk",
    "Status": "result",
    "TopicMap": "log",
    "Unknown": "model.unknowns.unknown",
    "Walk": "walk",
    "Weighing": "weighing",
    "WindowResult": "result",
    "load_topics": "log",
    "mass_space": "model.unknowns.spaces",
    "parameter_space": "model.unknowns.spaces",
    "read_walk": "log",
    "record_walk": "plant",
    "sample_walk": "assets",
    "shipped_models": "assets",
    "unknowns": "model",
    "weigh": "weighing",
    "write_walk": "log",
}
"""Where each name of the package's face lives."""

__all__ = [
    "Effect",
    "ExactSensors",
    "IdentifyOptions",
    "MassidError",
    "NoisySensors",
    "OnlineIdentifier",
    "Result",
    "Robot",
    "Sample",
    "SearchOptions",
    "Segment",
    "Status",
    "TopicMap",
    "Unknown",
    "Walk",
    "Weighing",
    "WindowResult",
    "__version__",
    "load_topics",
    "mass_space",
    "parameter_space",
    "read_walk",
    "record_walk",
    "sample_walk",
    "shipped_models",
    "unknowns",
    "weigh",
    "write_walk",
]

_find = lazy_names(__name__, _HOMES)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("massid")
    return _find(name)


def __dir__() -> list[str]:
    return sorted(__all__)
