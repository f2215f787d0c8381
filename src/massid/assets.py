"""Where the shipped robots and the sample walk are, in a clone and in an installed wheel."""

from __future__ import annotations

import hashlib
from importlib import resources
from pathlib import Path

from massid.errors import ModelError, unknown_name


def _folder(name: str) -> Path:
    packaged = Path(str(resources.files("massid"))) / "_assets" / name
    if packaged.is_dir():
        return packaged
    return Path(__file__).resolve().parents[2] / name


def shipped_models() -> dict[str, Path]:
    """MJCF files that come with massid, by name."""
    return {path.stem: path for path in sorted(_folder("models").glob("*.xml"))}


def sample_walk() -> Path:
    """The recorded walk that comes with massid; its truth file lies beside it."""
    return _folder("data") / "atlas_walk.mcap"


def resolve_model(name_or_path: str) -> Path:
    """Find a model file by path, or a shipped robot by name.

    Raises:
        ModelError: neither exists.
    """
    path = Path(name_or_path)
    models = shipped_models()
    if path.exists() or path.suffix:
        if not path.exists() and path.stem in models and path.parent in (Path(), Path("models")):
            return models[path.stem]  # models/atlas.xml, asked for outside the clone
        return path
    if name_or_path in models:
        return models[name_or_path]
    raise ModelError(
        unknown_name("robot", name_or_path, models, "massid") + " A path to an MJCF or URDF file works as well."
    )


def find_model_by_hash(sha256: str) -> Path | None:
    """The shipped model with these contents, if there is one."""
    for path in shipped_models().values():
        if hashlib.sha256(path.read_bytes()).hexdigest() == sha256:
            return path
    return None
