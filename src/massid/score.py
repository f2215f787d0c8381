"""The only reader of truth: compares what was identified with what was hidden in a simulated walk."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
from msgspec.structs import replace

from massid.errors import BadInputError, unknown_name
from massid.inputs import LARGEST_TEXT, problem_of
from massid.result.document import Document
from massid.result.result import Result
from massid.typing import FloatArray

_SAME_NOMINAL = 1e-3
"""Share of a nominal mass by which two model files of one robot may differ: MJCF text is rounded."""
_LISTED = 3
_PAYLOAD = "payload"
_EXPECTED = '{"links": {"<body>": {"true_kg": NUMBER}}} with finite numbers as JSON'


class _TrueLink(msgspec.Struct, frozen=True):
    true_kg: float
    nominal_kg: float | None = None


class _TruthFile(msgspec.Struct, frozen=True):
    links: dict[str, _TrueLink]
    quantities: dict[str, float] = {}


@dataclass(frozen=True)
class Truth:
    """What is true of a robot, as the recorder, or whoever put a payload on it, wrote it down.

    Attributes:
        mass_kg: by link.
        quantities: of what else may be asked for, by its name in a result, such as "payload/torso@-0.1,0,0.3".
        nominal_kg: by link, of the model that the truth was made from; empty if the file does not say.
        source: name of the file.
    """

    mass_kg: dict[str, float]
    quantities: dict[str, float] = field(default_factory=dict)
    nominal_kg: dict[str, float] = field(default_factory=dict)
    source: str = "truth"

    @classmethod
    def load(cls, path: Path) -> Truth:
        """Read NAME.truth.json.

        Raises:
            BadInputError: the file is missing or does not hold {"links": {"<body>": {"true_kg": ..}}}, and, if it has
                them, {"quantities": {"<name>": ..}}.
        """
        if problem := problem_of(path, LARGEST_TEXT):
            raise BadInputError(f"Truth file {path} {problem}.")
        try:
            found = msgspec.convert(json.loads(path.read_text(encoding="utf-8")), type=_TruthFile)
        except OSError as error:
            raise BadInputError(f"Truth file {path}: {error.strerror}.") from error
        except ValueError as error:  # no text, no JSON, or not of this shape (msgspec.ValidationError)
            raise BadInputError(f"Truth file {path}: {error}; expected {_EXPECTED}.") from error
        numbers = {f"links.{link}.true_kg": entry.true_kg for link, entry in found.links.items()}
        numbers |= {f"links.{link}.nominal_kg": entry.nominal_kg or 0.0 for link, entry in found.links.items()}
        numbers |= {f"quantities.{name}": value for name, value in found.quantities.items()}
        for where, value in numbers.items():
            if not math.isfinite(value):
                raise BadInputError(f"Truth file {path}: {where} is {value} and not finite; expected {_EXPECTED}.")
        return cls(
            {link: entry.true_kg for link, entry in found.links.items()},
            found.quantities,
            {link: entry.nominal_kg for link, entry in found.links.items() if entry.nominal_kg is not None},
            path.name,
        )

    def weighed_kg(self, link: str, apart: Collection[str] = ()) -> float:
        """What a link weighs with what is fixed to it [kg].

        Args:
            link: its name.
            apart: quantities that are weighed by themselves, such as "payload/torso@-0.1,0,0.3".
        """
        carried = (kg for name, kg in self.quantities.items() if name not in apart and _carrier(name) == link)
        return self.mass_kg[link] + sum(carried)

    def check_robot(self, nominal_kg: Mapping[str, float]) -> tuple[str, ...]:
        """Compare the robot that the truth is about with the one whose masses are asked for.

        Args:
            nominal_kg: by link that is asked for.

        Returns:
            A warning if nominal masses differ: errors then say nothing, unless the model was changed on purpose.

        Raises:
            BadInputError: the truth file does not have one of the links.
        """
        for link in nominal_kg:
            if link not in self.mass_kg:
                raise BadInputError(unknown_name("link", link, self.mass_kg, self.source))
        other = [
            f"{link} {self.nominal_kg[link]:.4g} kg, here {here_kg:.4g} kg"
            for link, here_kg in nominal_kg.items()
            if abs(self.nominal_kg.get(link, here_kg) - here_kg) > _SAME_NOMINAL * here_kg
        ]
        if not other:
            return ()
        more = f" and {len(other) - _LISTED} more" if len(other) > _LISTED else ""
        return (
            f"{self.source} is of a robot with other nominal masses ({'; '.join(other[:_LISTED])}{more}): if it is not "
            "the truth of this log, the errors mean nothing.",
        )


def _carrier(quantity: str) -> str | None:
    """The body that a payload is on; None for another quantity."""
    kind, _, where = quantity.partition("/")
    return where.partition("@")[0] if kind == _PAYLOAD else None


@dataclass(frozen=True)
class Score:
    """Errors of a result.

    Attributes:
        true_kg: true mass of each identified link, with what it carries unless that was asked for by itself.
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
    truth.check_robot(result.nominal_kg)
    apart = [one.name for one in result.quantities]
    true_kg = {link: truth.weighed_kg(link, apart) for link in links}

    def errors(masses_kg: dict[str, float]) -> FloatArray:
        return np.array([masses_kg[link] - true_kg[link] for link in links])

    final = errors(result.estimate_kg)
    known = [one for one in result.quantities if one.name in truth.quantities]
    return Score(
        true_kg=true_kg,
        error_kg=dict(zip(links, final.tolist(), strict=True)),
        l2_error_initial_kg=float(np.linalg.norm(errors(result.nominal_kg))),
        l2_error_kg=np.array([np.linalg.norm(errors(result.masses_kg(window.estimate))) for window in result.windows]),
        true_quantities={one.name: truth.quantities[one.name] for one in known},
        quantity_errors={one.name: one.estimate - truth.quantities[one.name] for one in known},
    )


def with_score(document: Document, scored: Score) -> Document:
    """Add true values and errors to a result's document; those of what is not identifiable have no errors."""
    links = {
        link: replace(
            entry,
            true_kg=scored.true_kg[link],
            error_kg=scored.error_kg[link] if entry.identifiable else None,
        )
        for link, entry in document.links.items()
    }
    quantities = {
        name: replace(
            entry,
            true=scored.true_quantities[name],
            error=scored.quantity_errors[name] if entry.identifiable else None,
        )
        if name in scored.true_quantities
        else entry
        for name, entry in document.quantities.items()
    }
    iterations = [
        replace(entry, l2_error_kg=error)
        for entry, error in zip(document.iterations, scored.l2_error_kg.tolist(), strict=True)
    ]
    return replace(
        document,
        links=links,
        quantities=quantities,
        iterations=iterations,
        l2_error_initial_kg=scored.l2_error_initial_kg,
        l2_error_kg=float(scored.l2_error_kg[-1]),
    )
