"""Model files: saving a robot into another folder so that it loads there, and recognising a file."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np

from massid.errors import ModelError
from massid.typing import FloatArray

ROUNDING = 2e-5
"""MJCF text keeps six digits; a mass that comes from geoms is made of several such numbers."""


def save_model(spec: mujoco.MjSpec, path: Path, expected: Mapping[str, FloatArray], remark: str = "") -> None:
    """Write a spec as an MJCF file that loads from where it lies, and check that it does.

    Args:
        spec: changed: its asset folders become those of the new file.
        path: where to write; replaced if it exists, left alone if the check fails.
        expected: fields of MjModel that the file must give when it is read back, masses among them.
        remark: a comment at the top; "" for none.

    Raises:
        ModelError: the file cannot be written, cannot be read back, or gives other values.
    """
    folder = path.resolve().parent
    draft = folder / f".{path.name}.partial"
    try:
        comment = f"<!-- massid: {remark.replace('--', '- -')} -->\n" if remark else ""
        draft.write_text(comment + _text(spec, folder))
        for name, content in spec.assets.items():
            asset = folder / name
            if not asset.exists():
                asset.parent.mkdir(parents=True, exist_ok=True)
                asset.write_bytes(content if isinstance(content, bytes) else str(content).encode())
        found = mujoco.MjModel.from_xml_path(str(draft))
        for name, values in expected.items():
            _check_field(path, name, getattr(found, name), values)
        draft.replace(path)
    except OSError as error:
        raise ModelError(f"Cannot write {path}: {error.strerror}.") from error
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"Cannot write {path}: the saved model does not load: {one_line(error)}") from error
    finally:
        draft.unlink(missing_ok=True)


def _check_field(path: Path, name: str, found: FloatArray, expected: FloatArray) -> None:
    if found.shape == expected.shape and np.allclose(found, expected, rtol=ROUNDING, atol=1e-12):
        return
    if name == "body_mass":
        raise ModelError(f"Cannot write {path}: MuJoCo's text form of this model has other masses than the model.")
    raise ModelError(
        f"Cannot write {path}: MuJoCo's text form of this model has another {name} than what was found; an unknown "
        "that writes it must write it into specs, too (`write_spec`)."
    )


def _text(spec: mujoco.MjSpec, folder: Path) -> str:
    """The spec as MJCF whose asset folders are relative to the folder it will lie in."""
    has_files = any(
        element.file for group in (spec.meshes, spec.textures, spec.hfields, spec.skins) for element in group
    )
    if not has_files or not spec.modelfiledir:  # assets given in memory keep their names
        return str(spec.to_xml())
    home = Path(spec.modelfiledir).resolve()
    relative = {}
    for name in ("meshdir", "texturedir"):
        # Writing the text reads the assets, from where they are now.
        present = str((home / getattr(spec.compiler, name)).resolve())
        setattr(spec.compiler, name, present)
        relative[f"{name}={quoteattr(present)}"] = f"{name}={quoteattr(os.path.relpath(present, folder))}"
    text = str(spec.to_xml())
    for found, wanted in relative.items():
        text = text.replace(found, wanted, 1)
    return text


def one_line(error: Exception) -> str:
    """Text of an error on one line."""
    return " ".join(str(error).split())


def file_sha256(path: Path) -> str:
    """SHA-256 of a model file, to recognise it in a log's metadata."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
