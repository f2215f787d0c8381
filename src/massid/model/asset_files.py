"""Meshes, textures and other files that a model refers to, when its text moves into another folder."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import mujoco

from massid.model.urdf import find_mesh
from massid.model.xml_text import Element, XmlText, tag
from massid.outputs import drafts

_KINDS = {"mesh": "meshdir", "hfield": "meshdir", "skin": "meshdir", "texture": "texturedir"}
"""Element of MJCF -> attribute of <compiler> that says where its files are."""
_FOLDERS = ("meshdir", "texturedir")


def with_absolute_files(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy of a spec whose assets are named by where they are; those of a model within it are elsewhere."""
    spec = spec.copy()
    model = spec.copy().compile()
    addresses = (
        (spec.meshes, model.mesh_pathadr),
        (spec.textures, model.tex_pathadr),
        (spec.hfields, model.hfield_pathadr),
        (spec.skins, model.skin_pathadr),
    )
    for elements, paths in addresses:
        for element, address in zip(elements, paths, strict=True):
            if address >= 0 and element.file not in spec.assets:
                found = model.paths[address : model.paths.index(b"\0", address)].decode()
                if Path(found).is_file():
                    element.file = str(Path(found).resolve())
    if any(Path(element.file).is_absolute() for elements, _ in addresses for element in elements if element.file):
        spec.compiler.meshdir = spec.compiler.texturedir = ""
    return spec


def move_assets(text: XmlText, home: Path, folder: Path) -> None:
    """Let a text that moves into another folder refer to files where they are, relative to that folder.

    Args:
        text: changed.
        home: the folder that it refers from.
        folder: the folder that it will lie in.
    """
    if home == folder:
        for element, name, source in _files(text, home):
            if source is not None and Path(element.attributes[name]).is_absolute():
                text.set(element, {name: os.path.relpath(source, folder)})
    elif text.root.tag == "robot":
        for element in text.root.all("mesh"):
            if "://" not in element.attributes.get("filename", "://"):
                _move(text, element, "filename", home, folder)
    else:
        for element in text.root.all("model"):
            _move(text, element, "file", home, folder)
        given: set[str] = set()
        for compiler in text.root.all("compiler"):
            for name in (*_FOLDERS, "assetdir"):
                if name in compiler.attributes:
                    given |= set(_FOLDERS) if name == "assetdir" else {name}
                    _move(text, compiler, name, home, folder)
        missing = [name for name in _FOLDERS if name not in given]
        if missing and any(True for _ in _files(text, home)):
            text.insert_first(text.root, tag("compiler", dict.fromkeys(missing, os.path.relpath(home, folder))))


def _move(text: XmlText, element: Element, name: str, home: Path, folder: Path) -> None:
    """Let an attribute that names a file or a folder relative to one folder name it relative to another."""
    value = element.attributes.get(name)
    if value is not None and not Path(value).is_absolute():
        text.set(element, {name: os.path.relpath(home / value, folder)})


def copy_assets(text: XmlText, home: Path, path: Path) -> None:
    """Copy the files that a text refers to into a folder beside the file that it becomes, and refer to them there.

    Args:
        text: changed.
        home: the folder that it refers from.
        path: where it will lie; NAME.xml has its files in NAME_assets.
    """
    folder = path.resolve().parent / f"{path.stem}_assets"
    taken: dict[str, Path] = {}
    for element, name, source in _files(text, home):
        if source is None:
            continue
        copy, number = source.name, 1
        while taken.get(copy, source) != source:
            number += 1
            copy = f"{source.stem}_{number}{source.suffix}"
        taken[copy] = source
        text.set(element, {name: f"{folder.name}/{copy}"})
    for copy, source in taken.items():
        folder.mkdir(exist_ok=True)
        if source != folder / copy:
            with drafts(folder / copy) as (draft,):
                shutil.copyfile(source, draft)
    for compiler in text.root.all("compiler"):
        text.set(compiler, dict.fromkeys((*_FOLDERS, "assetdir", "strippath")))


def _files(text: XmlText, home: Path) -> Iterator[tuple[Element, str, Path | None]]:
    """Elements with the attribute that names a file, and where that is; None if it is not there."""
    if text.root.tag == "robot":
        for element in text.root.all("mesh"):
            if "filename" in element.attributes:
                yield element, "filename", find_mesh(element.attributes["filename"], home / "robot.urdf")
        return
    folders = dict.fromkeys(_FOLDERS, "")
    for compiler in text.root.all("compiler"):
        both = compiler.attributes.get("assetdir")
        for name in _FOLDERS:
            folders[name] = compiler.attributes.get(name, folders[name] if both is None else both)
    for asset in text.root.all("asset"):
        for element in asset.children:
            for name in element.attributes:
                if element.tag in _KINDS and name.startswith("file"):
                    place = home / folders[_KINDS[element.tag]] / element.attributes[name]
                    yield element, name, place.resolve() if place.is_file() else None
