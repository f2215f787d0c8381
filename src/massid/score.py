"""The only reader of truth: compares what was identified with what was hidden in a simulated walk."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from massid.errors import BadInputError, unknown_name
from massid.identify.result import Result
from massid.typing import FloatArray


@dataclass(frozen=True)
class Truth:
    """True masses of a simulated robot's links [kg], as the recorder wrote them."""

    mass_kg: dict[str, float]
    source: str = "truth"

    @classmethod
    def load(cls, path: Path) -> Truth:
        """Read NAME.truth.json.

        Raises:
            BadInputError: the file is missing or does not hold {"links": {"<body>": {"true_kg": ..}}}.
        """
        try:
            document = json.loads(path.read_text())
            masses = {link: float(entry["true_kg"]) for link, entry in document["links"].items()}
        except OSError as error:
            raise BadInputError(f"Truth file {path}: {error.strerror}.") from error
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise BadInputError(
                f'Truth file {path} does not hold {{"links": {{"<body>": {{"true_kg": ..}}}}}} as JSON ({error}).'
            ) from error
        return cls(masses, path.name)


@dataclass(frozen=True)
class Score:
    """Errors of a result.

    Attributes:
        true_kg: true mass of each identified link.
        error_kg: estimate minus truth.
        l2_error_initial_kg: L2 norm of the nominal masses' errors.
        l2_error_kg: L2 norm after each update, shape (n_windows,).
    """

    true_kg: dict[str, float]
    error_kg: dict[str, float]
    l2_error_initial_kg: float
    l2_error_kg: FloatArray


def score(result: Result, truth: Truth) -> Score:
    """Compare a result with the truth.

    Raises:
        BadInputError: the truth file does not have one of the identified links.
    """
    links = list(result.estimate_kg)
    for link in links:
        if link not in truth.mass_kg:
            raise BadInputError(unknown_name("link", link, truth.mass_kg, truth.source))

    def errors(masses_kg: dict[str, float]) -> FloatArray:
        return np.array([masses_kg[link] - truth.mass_kg[link] for link in links])

    final = errors(result.estimate_kg)
    return Score(
        true_kg={link: truth.mass_kg[link] for link in links},
        error_kg=dict(zip(links, final.tolist(), strict=True)),
        l2_error_initial_kg=float(np.linalg.norm(errors(result.nominal_kg))),
        l2_error_kg=np.array([np.linalg.norm(errors(result.masses_kg(window.estimate))) for window in result.windows]),
    )


def with_score(document: dict[str, Any], scored: Score) -> dict[str, Any]:
    """Add true masses and errors to a result's JSON document."""
    links = {
        link: entry
        | {"true_kg": scored.true_kg[link], "error_kg": scored.error_kg[link] if entry["identifiable"] else None}
        for link, entry in document["links"].items()
    }
    iterations = [
        entry | {"l2_error_kg": error}
        for entry, error in zip(document["iterations"], scored.l2_error_kg.tolist(), strict=True)
    ]
    return document | {
        "links": links,
        "l2_error_initial_kg": scored.l2_error_initial_kg,
        "l2_error_kg": float(scored.l2_error_kg[-1]),
        "iterations": iterations,
    }
