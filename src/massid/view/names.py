"""Names of what is in a recording: entities and timelines."""

from __future__ import annotations

from massid.search.proposal import Role

APPLICATION = "massid"
SIM_TIME = "sim_time"
WORLD = "world"
TARGET = "world/camera_target"
HEADLINE = "headline"
HEADLINE_INTERVAL = "headline/interval"
FORCES = "contact"
PASSES = "passes"
TABLE = "table"
SCALE = "colour_scale"


def body_path(name: str) -> str:
    """Pose of a body."""
    return _path([WORLD, "robot", name])


def estimate_path(link: str) -> str:
    """Change of a link's estimate against the model file."""
    return _path(["mass", "estimate", link])


def truth_path(link: str) -> str:
    """True change of a link's mass against the model file."""
    return _path(["mass", "true", link])


def interval_path(link: str, end: str) -> str:
    """Lower or upper end of the 95 % interval of a link's change."""
    return _path(["mass", "interval", link, end])


def contact_path(name: str) -> str:
    """Vertical force on a contact body."""
    return _path([FORCES, name])


def models_path(role: Role) -> str:
    """Scores of the models with a role."""
    return f"models/{role}"


def _path(parts: list[str]) -> str:
    from rerun import new_entity_path  # here, so that the names alone load nothing heavy

    # Names out of files need not be text; names that differ stay different.
    return str(new_entity_path([part.encode("utf-8", "backslashreplace").decode() for part in parts]))
