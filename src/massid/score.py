"""The only reader of truth: compares what was identified with what was hidden in a simulated walk."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from massid.errors import BadInputError, unknown_name
from massid.identify.result import Result
from massid.typing import FloatArray


@dataclass(frozen=True)
class Truth:
    """What is true of a robot, as the recorder, or whoever put a payload on it, wrote it down.

    Attributes:
        mass_kg: by link.
        quantities: of what else may be asked for, by its name in a result, such as "payload/torso@-0.1,0,0.3".
        source: name of the file.
    """

    mass_kg: dict[str, float]
    quantities: dict[str, float] = field(default_factory=dict)
    source: str = "truth"

    @classmethod
    def load(cls, path: Path) -> Truth:
        """Read NAME.truth.json.

        Raises:
            BadInputError: the file is missing or does not hold {"links": {"<body>": {"true_kg": ..}}}, and, if it has
                them, {"quantities": {"<name>": ..}}.
        """
        try:
            document = json.loads(path.read_text())
            masses = {link: float(entry["true_kg"]) for link, entry in document["links"].items()}
            quantities = {name: float(value) for name, value in document.get("quantities", {}).items()}
        except OSError as error:
            raise BadInputError(f"Truth file {path}: {error.strerror}.") from error
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise BadInputError(
                f'Truth file {path} does not hold {{"links": {{"<body>": {{"true_kg": ..}}}}}} as JSON ({error}).'
            ) from error
        return cls(masses, quantities, path.name)


@dataclass(frozen=True)
class Score:
    """Errors of a result.

    Attributes:
        true_kg: true mass of each identified link.
        error_kg: estimate minus truth.
        l2_error_initial_kg: L2 norm of the nominal masses' errors.
        l2_error_kg: L2 norm after each update, shape (n_windows,).
        true_quantities: of what was asked for besides masses, as far as the truth file knows it.
        quantity_errors: estimate minus truth, likewise.
    """

    true_kg: dict[str, float]
    error_kg: dict[str, float]
    l2_error_initial_kg: float
    l2_error_kg: FloatArray
    true_quantities: dict[str, float] = field(default_factory=dict)
    quantity_errors: dict[str, float] = field(default_factory=dict)


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
    known = [one for one in result.quantities if one.name in truth.quantities]
    return Score(
        true_kg={link: truth.mass_kg[link] for link in links},
        error_kg=dict(zip(links, final.tolist(), strict=True)),
        l2_error_initial_kg=float(np.linalg.norm(errors(result.nominal_kg))),
        l2_error_kg=np.array([np.linalg.norm(errors(result.masses_kg(window.estimate))) for window in result.windows]),
        true_quantities={one.name: truth.quantities[one.name] for one in known},
        quantity_errors={one.name: one.estimate - truth.quantities[one.name] for one in known},
    )


def with_score(document: dict[str, Any], scored: Score) -> dict[str, Any]:
    """Add true values and errors to a result's JSON document."""
    links = {
        link: entry
        | {"true_kg": scored.true_kg[link], "error_kg": scored.error_kg[link] if entry["identifiable"] else None}
        for link, entry in document["links"].items()
    }
    quantities = {
        name: entry
        if name not in scored.true_quantities
        else entry
        | {
            "true": scored.true_quantities[name],
            "error": scored.quantity_errors[name] if entry["identifiable"] else None,
        }
        for name, entry in document["quantities"].items()
    }
    iterations = [
        entry | {"l2_error_kg": error}
        for entry, error in zip(document["iterations"], scored.l2_error_kg.tolist(), strict=True)
    ]
    return document | {
        "links": links,
        "quantities": quantities,
        "l2_error_initial_kg": scored.l2_error_initial_kg,
        "l2_error_kg": float(scored.l2_error_kg[-1]),
        "iterations": iterations,
    }
