"""A result on disk: its JSON document, and beside it RESULT.npz with the arrays that its report draws.

The document names the SHA-256 of its sidecar, so that neither the sidecar of another result nor a damaged one is taken
for its own.
"""

from __future__ import annotations

import hashlib
import io
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from massid.errors import BadInputError
from massid.inputs import LARGEST_TEXT, problem_of
from massid.result.document import Document
from massid.result.file import LARGEST, read_document
from massid.result.result import Result
from massid.typing import AnyArray

_AXES = {
    "estimate": ("unknowns",),
    "covariance": ("unknowns", "unknowns"),
    "predicted_covariance": ("foreseen", "foreseen"),
    "torque_time_s": ("samples",),
    "torque_measured": ("samples", "joints"),
    "torque_nominal": ("samples", "joints"),
    "torque_identified": ("samples", "joints"),
    "residual_channels": ("channels",),
    "residual_nominal": ("channels",),
    "residual_identified": ("channels",),
}
"""What each array runs over; those that run over the same have the same size."""
_TEXTS = ("residual_channels",)
_TOGETHER = [[name for name in _AXES if name.startswith(kind)] for kind in ("torque", "residual")]


@dataclass(frozen=True)
class StoredResult:
    """A result as read back.

    Attributes:
        document: what the result was.
        arrays: of the sidecar; empty if there is none.
        warnings: what is missing, one line each.
    """

    document: Document
    arrays: dict[str, AnyArray]
    warnings: tuple[str, ...] = ()


def sidecar_path(result_path: Path) -> Path:
    """Where the sidecar of a result document lies."""
    return result_path.with_suffix(".npz")


def sidecar_of(result: Result) -> Sidecar:
    """What the report draws and the document does not hold."""
    arrays: dict[str, AnyArray] = {"estimate": result.estimate}
    if result.uncertainty is not None:
        arrays["covariance"] = result.uncertainty.covariance
    if result.verdict is not None:
        arrays["predicted_covariance"] = result.verdict.covariance
    if result.validation is not None and result.validation.torques is not None:
        torques = result.validation.torques
        arrays |= {f"torque_{name}": getattr(torques, name) for name in ("time_s", "measured", "nominal", "identified")}
    residuals = None if result.validation is None else result.validation.residuals
    if residuals is not None:
        arrays |= {
            "residual_channels": np.array(residuals.channels),
            "residual_nominal": residuals.nominal,
            "residual_identified": residuals.identified,
        }
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]  # a keyword of savez is no array name
    return Sidecar(stream.getvalue())


@dataclass(frozen=True)
class Sidecar:
    """The content of a sidecar.

    Attributes:
        content: of the file.
    """

    content: bytes

    @property
    def sha256(self) -> str:
        """Its SHA-256, by which the document knows it."""
        return hashlib.sha256(self.content).hexdigest()


def read_result(path: Path) -> StoredResult:
    """Read a result document and its sidecar.

    Raises:
        BadInputError: one of them cannot be read, the document is not what `read_document` expects, or the sidecar is
            not the document's.
    """
    document = read_document(path)
    sidecar = sidecar_path(path)
    if not sidecar.exists():
        missing = f"{sidecar} does not exist: the report lacks correlations, residuals and curves of held-out torques."
        return StoredResult(document, {}, (missing,))
    arrays = _read_arrays(sidecar, document.sidecar_sha256, path)
    _check_arrays(arrays, document, sidecar)
    return StoredResult(document, arrays)


def _read_arrays(sidecar: Path, digest: str | None, path: Path) -> dict[str, AnyArray]:
    """The sidecar's arrays, if they are exactly what was written with the document."""
    if problem := problem_of(sidecar, LARGEST_TEXT):
        raise BadInputError(f"{sidecar} {problem}.")
    try:
        content = sidecar.read_bytes()
    except OSError as error:
        raise BadInputError(f"Cannot read {sidecar}: {error.strerror}.") from error
    found = hashlib.sha256(content).hexdigest()
    if found != digest:
        expected = f"expected {digest[:12]}" if digest else "which names none"
        raise BadInputError(
            f"{sidecar} is not the sidecar that was written with {path} (SHA-256 {found[:12]}, {expected}): it belongs "
            "to another result or is damaged. Remove it for a report without its charts."
        )
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
            if len(entries) != len(archive.infolist()):
                raise ValueError("an array stands in it twice")
            if sum(entry.file_size for entry in entries.values()) > LARGEST_TEXT:
                raise ValueError(f"it inflates to more than {LARGEST_TEXT} bytes")
            return {name: _read_array(archive, entry) for name, entry in entries.items()}
    except Exception as error:  # whatever crafted archives make of the libraries that read them
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise BadInputError(f"{sidecar} holds no arrays that can be read: {said}.") from error


def _read_array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> AnyArray:
    """An array of numbers or texts that claims no more than is there."""
    with archive.open(entry) as stream:
        data = io.BytesIO(stream.read())
    read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    version = np.lib.format.read_magic(data)
    if version not in read_header:
        raise ValueError(f"version {version} of {entry.filename}")
    shape, _, kind = read_header[version](data)
    if kind.kind not in "fU":
        raise ValueError(f"{entry.filename} is of type {kind}, expected numbers or texts")
    if math.prod(shape) * kind.itemsize != len(data.getvalue()) - data.tell():
        raise ValueError(f"{entry.filename} has another size than its shape {shape} says")
    data.seek(0)
    return np.asarray(np.lib.format.read_array(data, allow_pickle=False))


def _check_arrays(arrays: Mapping[str, AnyArray], document: Document, sidecar: Path) -> None:
    """Pass if the arrays have the shapes that belong together, and hold finite numbers.

    Raises:
        BadInputError: one is unknown, lacks its companions, has another type or shape, or a number that is not finite.
    """
    torques = document.validation and document.validation.torques
    sizes = {"joints": len(torques.joints) if torques else 0}
    for name, array in arrays.items():
        axes = _AXES.get(name)
        if axes is None:
            raise BadInputError(f"{sidecar} holds an array '{name}'; expected {', '.join(_AXES)}.")
        if array.ndim != len(axes):
            raise BadInputError(f"{sidecar}: {name} has {array.ndim} axes, expected {len(axes)}.")
        for axis, size in zip(axes, array.shape, strict=True):
            if size == 0 or sizes.setdefault(axis, size) != size:
                raise BadInputError(f"{sidecar}: {name} has {size} {axis}, expected {sizes.get(axis) or 'some'}.")
        if (array.dtype.kind == "U") != (name in _TEXTS):
            raise BadInputError(f"{sidecar}: {name} is of type {array.dtype}.")
        if array.dtype.kind == "f" and not (np.abs(array.astype(np.float64)) <= LARGEST).all():  # nan, too
            raise BadInputError(f"{sidecar}: {name} holds a number that is not finite, or beyond {LARGEST:g}.")
    for group in _TOGETHER:
        lacking = [name for name in group if name not in arrays]
        if 0 < len(lacking) < len(group):
            raise BadInputError(f"{sidecar} lacks {', '.join(lacking)}.")
    if "covariance" in arrays and not (np.diagonal(arrays["covariance"]) > 0.0).all():
        raise BadInputError(f"{sidecar}: covariance has a variance that is not positive.")
