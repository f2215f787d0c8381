"""Model files: reading MJCF and URDF, saving a robot so that it loads where it lies, and recognising a file."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from massid.errors import ModelError
from massid.inputs import LARGEST_TEXT, problem_of
from massid.model.asset_files import copy_assets, move_assets, with_absolute_files
from massid.model.bounds import check_size
from massid.model.changes import Changes
from massid.model.mjcf import has_inertial, inlined, write_mjcf_body, write_mjcf_joint
from massid.model.urdf import SUFFIX, is_urdf, read_urdf
from massid.model.urdf_text import write_urdf_body, write_urdf_joint
from massid.model.xml_text import XmlText, comment
from massid.outputs import drafts, write_file
from massid.typing import FloatArray

ROUNDING = 2e-5
"""MuJoCo's own text keeps six digits; a mass that comes from geoms is made of several such numbers."""


@dataclass(frozen=True)
class ModelFile:
    """A model file as it was read.

    Attributes:
        path: where it lies.
        content: what was in it.
        is_urdf: whether it is a URDF, not an MJCF.
        notes: what was added to it or left out, one line each.
    """

    path: Path
    content: bytes
    is_urdf: bool
    notes: tuple[str, ...] = ()


def read_model(path: Path) -> tuple[mujoco.MjSpec, ModelFile]:
    """Read an MJCF or a URDF file.

    Raises:
        ModelError: it is missing, or no model.
    """
    if problem := problem_of(path, LARGEST_TEXT):
        raise ModelError(f"Model file {path} {problem}; expected an MJCF (.xml) or a URDF (.urdf) file.")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ModelError(f"Model file {path} cannot be read: {error.strerror}.") from error
    check_size(content, path)
    if is_urdf(content):
        spec, notes = read_urdf(content, path)
        return spec, ModelFile(path, content, True, notes)
    try:
        if path.suffix.lower() == ".xml":
            spec = mujoco.MjSpec.from_file(str(path.resolve()))
        else:  # MuJoCo goes by the suffix
            spec = mujoco.MjSpec.from_string(inlined(content, path).decode())
            spec.modelfiledir = str(path.resolve().parent)
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"{path}: not a model that MuJoCo can read: {one_line(error)}") from error
    # Fused bodies lose their names; welded ones keep them and move no differently.
    spec.compiler.fusestatic = False
    return spec, ModelFile(path, content, False)


def save_model(
    spec: mujoco.MjSpec,
    file: ModelFile | None,
    path: Path,
    changes: Changes,
    load: Callable[[Path], mujoco.MjModel],
    *,
    remark: str = "",
    with_assets: bool = False,
) -> None:
    """Write a robot with changes, in its own file's text if that can hold them, and check that it can be read back.

    Args:
        spec: the robot.
        file: what it was read from; None for a spec.
        path: where to write; replaced if it exists, left alone if the check fails.
        changes: to the robot.
        load: reads a file as robots are read.
        remark: a comment at the top; "" for none.
        with_assets: copy meshes and textures beside the new file.

    Raises:
        ModelError: the file cannot be written, cannot be read back, or gives other values.
    """
    wants_urdf = path.suffix.lower() == SUFFIX
    if wants_urdf and (file is None or not file.is_urdf):
        raise ModelError(f"Cannot write {path}: the robot was not read from a URDF; save it as .xml.")
    folder = path.resolve().parent
    try:
        text = _own_text(file, changes, wants_urdf, with_assets) if file is not None else None
        if text is None and wants_urdf:
            raise ModelError(f"Cannot write {path}: a URDF has no place for all that was found; save it as .xml.")
        home = folder if file is None else file.path.resolve().parent
        if text is None:
            text, home = _engines_text(spec, changes), folder
        if with_assets:
            copy_assets(text, home, path)
        else:
            move_assets(text, home, folder)
        if remark:
            text.insert_before_root(comment(f"massid: {remark}"))
        for name, content in spec.assets.items():
            asset = folder / name
            if not asset.exists():
                asset.parent.mkdir(parents=True, exist_ok=True)
                write_file(asset, content if isinstance(content, bytes) else str(content).encode())
        with drafts(path) as (draft,):
            draft.write_bytes(text.render())
            found = _loaded(load, draft, path)
            for name, values in changes.expected.items():
                _check_field(path, name, getattr(found, name), values)
    except OSError as error:
        raise ModelError(f"Cannot write {path}: {error.strerror}.") from error
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"Cannot write {path}: the saved model does not load: {one_line(error)}") from error


def _loaded(load: Callable[[Path], mujoco.MjModel], draft: Path, path: Path) -> mujoco.MjModel:
    try:
        return load(draft)
    except ModelError as error:
        raise ModelError(f"Cannot write {path}: the saved model does not load: {error}") from error


def _own_text(file: ModelFile, changes: Changes, as_urdf: bool, with_assets: bool) -> XmlText | None:
    """The file's own text with the changes in it; None if it cannot hold them."""
    if changes.joints is None or file.is_urdf != as_urdf:
        return None
    if as_urdf:
        text = XmlText(file.content, file.path.name)
        done = [write_urdf_body(text, body) for body in changes.bodies]
        return text if all(done + [write_urdf_joint(text, joint) for joint in changes.joints]) else None
    text = XmlText(inlined(file.content, file.path), file.path.name)
    if with_assets and any(text.root.all("model")):
        return None  # models within the model have asset folders of their own
    bodies = changes.every_body if _ignores_inertials(text) else changes.bodies
    done = [write_mjcf_body(text, body) for body in bodies]
    return text if all(done + [write_mjcf_joint(text, joint) for joint in changes.joints]) else None


def _ignores_inertials(text: XmlText) -> bool:
    """Let the compiler take inertia as it is given; whether it did not."""
    found = False
    off = {"settotalmass": "-1", "boundmass": "0", "boundinertia": "0", "inertiafromgeom": "auto"}
    for compiler in text.root.all("compiler"):
        given = {name: compiler.attributes[name] for name in off if name in compiler.attributes}
        found = found or any(value not in (off[name], "false") for name, value in given.items())
        text.set(compiler, {name: off[name] for name, value in given.items() if value != "false"})
    return found


def _engines_text(spec: mujoco.MjSpec, changes: Changes) -> XmlText:
    """MuJoCo's text of the robot with the changes in it, and all digits of its inertia."""
    spec = with_absolute_files(spec)
    changes.write_spec(spec)
    text = XmlText(str(spec.to_xml()).encode(), spec.modelname)
    changed = {body.name for body in changes.bodies}
    for body in changes.every_body:
        if body.name in changed or has_inertial(text, body.name):
            write_mjcf_body(text, body)
    for joint in changes.joints or ():
        write_mjcf_joint(text, joint)
    return text


def _check_field(path: Path, name: str, found: FloatArray, expected: FloatArray) -> None:
    if found.shape == expected.shape and np.allclose(found, expected, rtol=ROUNDING, atol=1e-12):
        return
    if name == "body_mass":
        raise ModelError(f"Cannot write {path}: the text form of this model has other masses than the model.")
    raise ModelError(
        f"Cannot write {path}: the text form of this model has another {name} than what was found; an unknown "
        "that writes it must write it into specs, too (`write_spec`)."
    )


def one_line(error: Exception) -> str:
    """Text of an error on one line."""
    return " ".join(str(error).split())


def file_sha256(path: Path) -> str:
    """SHA-256 of a model file, to recognise it in a log's metadata."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
