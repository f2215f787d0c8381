"""A result on disk: its JSON document, and beside it RESULT.npz with the arrays that its report draws."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from massid.errors import BadInputError
from massid.identify.residuals import Residuals
from massid.identify.result import Result
from massid.typing import AnyArray


@dataclass(frozen=True)
class StoredResult:
    """A result as read back.

    Attributes:
        document: what `Result.to_json` gave.
        arrays: of the sidecar; empty if there is none.
    """

    document: dict[str, Any]
    arrays: dict[str, AnyArray]


def sidecar_path(result_path: Path) -> Path:
    """Where the sidecar of a result document lies."""
    return result_path.with_suffix(".npz")


def write_sidecar(path: Path, result: Result, residuals: Residuals | None) -> None:
    """Write what the report draws and the document does not hold.

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
    if residuals is not None:
        arrays |= {
            "residual_channels": np.array(residuals.channels),
            "residual_nominal": residuals.nominal,
            "residual_identified": residuals.identified,
        }
    try:
        with path.open("wb") as stream:
            np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]  # a keyword of savez is no array name
    except OSError as error:
        raise BadInputError(f"Cannot write {path}: {error.strerror}.") from error


def read_result(path: Path) -> StoredResult:
    """Read a result document and its sidecar.

    Raises:
        BadInputError: one of them cannot be read, or is something else.
    """
    try:
        document = json.loads(path.read_text())
    except OSError as error:
        raise BadInputError(f"Cannot read {path}: {error.strerror}.") from error
    except ValueError as error:
        raise BadInputError(f"{path} is not JSON; expected what massid identify --json wrote.") from error
    if not isinstance(document, dict) or not {"links", "iterations", "logs", "status"} <= document.keys():
        raise BadInputError(f"{path} is not a result; expected what massid identify --json wrote.")
    sidecar = sidecar_path(path)
    if not sidecar.is_file():
        return StoredResult(document, {})
    try:
        with np.load(sidecar, allow_pickle=False) as stored:
            return StoredResult(document, dict(stored))
    except (OSError, ValueError) as error:
        raise BadInputError(f"Cannot read {sidecar}: {error}.") from error
