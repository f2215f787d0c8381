"""The arrays behind a result's JSON document, for its report: RESULT.npz beside RESULT.json."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from massid.errors import BadInputError
from massid.identify.residuals import Residuals
from massid.identify.result import Result
from massid.typing import AnyArray


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
