"""A result on disk: its JSON document, and beside it RESULT.npz with the arrays that its report draws.

The document names the SHA-256 of its sidecar, so that neither the sidecar of another result nor a damaged one is taken
for its own.
"""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from massid.errors import BadInputError
from massid.result.document import Document
from massid.result.file import read_document
from massid.result.result import Result
from massid.typing import AnyArray


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
    return StoredResult(document, _read_arrays(sidecar, document.sidecar_sha256, path))


def _read_arrays(sidecar: Path, digest: str | None, path: Path) -> dict[str, AnyArray]:
    """The sidecar's arrays, if they are exactly what was written with the document."""
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
    with np.load(io.BytesIO(content), allow_pickle=False) as stored:
        return dict(stored)
