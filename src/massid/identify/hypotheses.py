"""What else may be wrong, when nuisances end far from what was believed of them.

An unknown that nobody asked for has a prior: torque gains of 2 %, masses of other links as the model file has them. Had
there been an error t along some direction d of them that the prior P knows nothing of (one gain alone, all gains
alike), the best fit would have had

    t = d^T P (e - m) / D,      D = d^T P d - d^T P V P d,

for estimates e, prior means m and posterior covariance V; -2 log L would be less by t^2 D, and everything else would
move by V P d t (Lagrange multiplier test). So each hypothesis is tried by the fit itself, without another pass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from massid.model.unknowns.bodies import Mass
from massid.model.unknowns.sensors import EffortGain, EffortScale, WrenchGain, WrenchScale
from massid.model.unknowns.unknown import ALL, Unknown, unknowns_of
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray

SURE = 30.0
"""By how much -2 log L must fall, times what windows scatter more than noise explains: 5.5 standard deviations."""
BELIEVABLE = 30.0
"""Prior deviations beyond which no sensor is off: then something else is, and a single error cannot say what."""
_LEAST_SHARE = 1e-3
"""Of D in d^T P d: below it the log tells nothing that the prior does not."""


@dataclass(frozen=True)
class Hypothesis:
    """An error that priors rule out and the log asks for.

    Attributes:
        name: of the unknown that would find it.
        said: what it is.
        gain: by how much -2 log L would fall.
        change: what it would do to everything that was estimated, shape (n_p,).
        believable: whether an error can be that large.
    """

    name: str
    said: str
    gain: float
    change: FloatArray
    believable: bool = True

    def text(self, space: ParameterSpace) -> str:
        """In one line: what, how surely, what it does to what was asked for, and the setting that cures it."""
        if not self.believable:
            return (
                f"no error that can be explains the log ({self.said} would do best): forces that were not measured, a "
                "rate too low for what moves, or the model itself are wrong."
            )
        asked = self.change[: space.n_sampled] / space.scale[: space.n_sampled]
        worst = int(np.argmax(np.abs(asked)))
        parameter = space.parameters[worst]
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        return (
            f"{self.said} (-2 log likelihood falls by {self.gain:.3g} with it); {parameter.name} would be "
            f"{self.change[worst]:+.2g}{unit} from what was found: {self._cure}"
        )

    @property
    def _cure(self) -> str:
        kind, _, target = self.name.partition("/")
        return f"name {target} in `links`." if kind == Mass.kind else f"ask for it, `unknown={self.name}`."


def hypotheses(
    space: ParameterSpace, estimate: FloatArray, covariance: FloatArray, inflation: float = 1.0
) -> tuple[Hypothesis, ...]:
    """What the log asks for against its priors, the surest first.

    Args:
        space: everything that was estimated; what was asked for comes first.
        estimate: shape (n_p,).
        covariance: of the estimate, shape (n_p, n_p), if windows scatter as noise does.
        inflation: how much more they do.
    """
    precision = space.prior_precision
    found = []
    for name, words, direction in _directions(space):
        pull = precision * direction
        stiffness = float(pull @ direction)
        known = stiffness - float(pull @ covariance @ pull)
        if known < _LEAST_SHARE * stiffness:
            continue
        size = float(pull @ (estimate - space.nominal)) / known
        change = size * (covariance @ pull)
        value = float(direction @ (estimate + change)) / float(direction.sum())
        if size**2 * known > SURE * inflation:
            typical = float(np.sqrt(direction.sum() / stiffness))
            believable = abs(value - float(direction @ space.nominal) / float(direction.sum())) < BELIEVABLE * typical
            found.append(Hypothesis(name, words(value), size**2 * known, change, believable))
    return tuple(sorted(found, key=lambda one: -one.gain))


def _directions(space: ParameterSpace) -> Iterator[tuple[str, Callable[[float], str], FloatArray]]:
    """Name of what would find an error, words for a value of it, and what it would do to the unknowns alike."""
    unknowns = unknowns_of(space)
    for kind, shared, words in _SHARED:
        alike = np.array([isinstance(unknown, kind) for unknown in unknowns], dtype=np.float64)
        if alike.sum() > 1.0:
            yield f"{shared.kind}/{ALL}", words, alike
    for k in np.flatnonzero(space.prior_precision).tolist():
        if k >= space.n_sampled:
            yield unknowns[k].name, partial(_single, unknowns[k]), np.eye(len(space))[k]


def _torques(value: float) -> str:
    return f"all torques read {abs(value):.1%} too {'large' if value > 0.0 else 'small'}"


def _wrenches(value: float) -> str:
    return f"all wrenches read {abs(value):.1%} too {'large' if value > 0.0 else 'small'}"


def _single(unknown: Unknown, value: float) -> str:
    unit = "" if unknown.unit == "1" else f" {unknown.unit}"
    return (
        f"{unknown.name} is {value:.3g}{unit}, believed {unknown.nominal:.3g} +-{2.0 * (unknown.prior_std or 0.0):.2g}"
    )


_SHARED = ((EffortGain, EffortScale, _torques), (WrenchGain, WrenchScale, _wrenches))
"""Errors that sensors may have in common, what asks for them, and what to say."""
