"""A result on disk: its JSON document, and beside it RESULT.npz with the arrays that its report draws.

The document names the SHA-256 of its sidecar, so that neither the sidecar of another result nor a damaged one is taken
for its own.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from massid.errors import BadInputError
from massid.result.result import SCHEMA, Result
from massid.typing import AnyArray

DIGEST = "sidecar_sha256"
"""Entry of the document that names its sidecar."""


@dataclass(frozen=True)
class StoredResult:
    """A result as read back.

    Attributes:
        document: what `Result.to_json` gave.
        arrays: of the sidecar; empty if there is none.
        warnings: what is missing, one line each.
    """

    document: dict[str, Any]
    arrays: dict[str, AnyArray]
    warnings: tuple[str, ...] = ()


def sidecar_path(result_path: Path) -> Path:
    """Where the sidecar of a result document lies."""
    return result_path.with_suffix(".npz")


def write_sidecar(path: Path, result: Result) -> str:
    """Write what the report draws and the document does not hold.

    Returns:
        The file's SHA-256, for the document's entry `DIGEST`.

    Raises:
        BadInputError: the file cannot be written.
    """
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
    content = stream.getvalue()
    try:
        path.write_bytes(content)
    except OSError as error:
        raise BadInputError(f"Cannot write {path}: {error.strerror}.") from error
    return hashlib.sha256(content).hexdigest()


def read_result(path: Path) -> StoredResult:
    """Read a result document and its sidecar.

    Raises:
        BadInputError: one of them cannot be read, is something else or of another schema, holds numbers that are not
            finite, or the sidecar is not the document's.
    """
    try:
        document = json.loads(path.read_text(), parse_constant=_finite, parse_float=_finite)
    except OSError as error:
        raise BadInputError(f"Cannot read {path}: {error.strerror}.") from error
    except _NotFiniteError as error:
        raise BadInputError(f"{path} holds the number {error}; expected finite ones.") from error
    except (ValueError, RecursionError) as error:
        raise BadInputError(f"{path} is not JSON; expected what massid identify --json wrote.") from error
    if not isinstance(document, dict) or not {"links", "iterations", "logs", "status"} <= document.keys():
        raise BadInputError(f"{path} is not a result; expected what massid identify --json wrote.")
    schema = document.get("schema")
    if schema != SCHEMA:
        found = "no schema" if schema is None else f"schema {str(schema)[:40]}"
        raise BadInputError(f"{path} has {found}; expected schema {SCHEMA}, which massid identify --json writes.")
    sidecar = sidecar_path(path)
    if not sidecar.exists():
        missing = f"{sidecar} does not exist: the report lacks correlations, residuals and curves of held-out torques."
        return StoredResult(document, {}, (missing,))
    return StoredResult(document, _read_arrays(sidecar, document.get(DIGEST), path))


class _NotFiniteError(Exception):
    """A number in JSON that is not finite."""


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise _NotFiniteError(text)
    return value


def _read_arrays(sidecar: Path, digest: str | None, path: Path) -> dict[str, AnyArray]:
    """The sidecar's arrays, if they are exactly what was written with the document."""
    try:
        content = sidecar.read_bytes()
    except OSError as error:
        raise BadInputError(f"Cannot read {sidecar}: {error.strerror}.") from error
    found = hashlib.sha256(content).hexdigest()
    if found != digest:
        expected = f"expected {digest[:12]}" if isinstance(digest, str) else "which names none"
        raise BadInputError(
            f"{sidecar} is not the sidecar that was written with {path} (SHA-256 {found[:12]}, {expected}): it belongs "
            "to another result or is damaged. Remove it for a report without its charts."
        )
    with np.load(io.BytesIO(content), allow_pickle=False) as stored:
        return dict(stored)
