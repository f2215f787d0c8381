"""What a log can reveal, as said before anything is fitted: a statement about the log, made by `massid.judge`."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from massid.result.combinations import Combination, Sum
from massid.result.document import CombinationEntry, VerdictEntry
from massid.result.excitation import LARGEST_DEVIATION
from massid.result.posterior import INTERVAL_95
from massid.search.parameters import ParameterSpace
from massid.typing import BoolArray, FloatArray

KNOWN_SUM = 0.05
"""Relative standard deviation of a sum of masses that is worth telling."""
VAGUE = 10.0
"""Relative standard deviation of a mass before the log is seen: none to speak of, but the inverse exists."""
_UNSEEN = 0.5 * VAGUE
"""Relative standard deviation beyond which the log says nothing."""


class Motion(enum.StrEnum):
    """What the robot does."""

    IN_THE_AIR = "in the air"
    """No measured contact carries it, and it falls freely."""
    HELD = "held by a force that is not in the log"
    """No measured contact carries it, yet it does not fall."""
    STANDING = "standing still"
    MOVING = "moving on the ground"


@dataclass(frozen=True)
class MotionFacts:
    """The facts behind a verdict.

    Attributes:
        motion: what the robot does.
        excursion_rad: standard deviation of each joint's position, [rad] or [m].
    """

    motion: Motion
    excursion_rad: dict[str, float]

    @classmethod
    def of_all(cls, facts: Sequence[MotionFacts]) -> MotionFacts:
        """Of several logs together: a force that is missing in one spoils all, motion in one helps all."""
        order = (Motion.HELD, Motion.MOVING, Motion.STANDING, Motion.IN_THE_AIR)
        motion = min((one.motion for one in facts), key=order.index)
        names = facts[0].excursion_rad
        return cls(motion, {name: max(one.excursion_rad[name] for one in facts) for name in names})


@dataclass(frozen=True)
class Verdict:
    """What a log can reveal, before anything is fitted to it.

    Attributes:
        space: the masses that were asked for.
        covariance: of these masses, as an identification would report it, shape (n_p, n_p) [kg^2].
        total_std_kg: standard deviation of the whole robot's mass [kg].
        total_known: whether that is worth telling.
        sensors: with what sensors the log was judged, in words.
        facts: what the robot does.
        hidden_others: names of the parameters asked for, other than masses, that the log does not reveal.
        combinations: what cannot be told apart, worst first.
        sums: masses of several links together that are known although not every one of theirs is; a fit puts in what
            it found.
        advice: which motion would help, one line each; empty if nothing is needed.
        wall_s: time it took [s].
    """

    space: ParameterSpace
    covariance: FloatArray
    total_std_kg: float
    total_known: bool
    sensors: str
    facts: MotionFacts
    hidden_others: tuple[str, ...]
    combinations: tuple[Combination, ...]
    sums: tuple[Sum, ...]
    advice: tuple[str, ...]
    wall_s: float

    @cached_property
    def std(self) -> FloatArray:
        """Standard deviation to which each mass can be known [kg], shape (n_p,)."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))

    @cached_property
    def identifiable(self) -> BoolArray:
        """Which masses the log reveals, shape (n_p,)."""
        if self.facts.motion is Motion.HELD:
            return np.zeros(len(self.space), dtype=bool)
        return np.asarray(self.std < LARGEST_DEVIATION * self.space.scale)

    @property
    def links(self) -> tuple[str, ...]:
        """The links that were asked for."""
        return tuple(parameter.target for parameter in self.space.parameters)

    @property
    def hidden(self) -> tuple[str, ...]:
        """The links that the log does not reveal."""
        return tuple(link for link, seen in zip(self.links, self.identifiable, strict=True) if not seen)

    def lines(self) -> list[str]:
        """The verdict in a few lines of text; what follows +- is a 95 % interval."""
        total = f"known to +-{INTERVAL_95 * self.total_std_kg:.2g} kg" if self.total_known else "not known"
        said = f"{self.facts.motion}; whole robot {total} (95 %, {self.sensors})"
        if not self.hidden:
            worst = int(np.argmax(self.std / self.space.scale))
            name, half = self.links[worst], f"+-{INTERVAL_95 * self.std[worst]:.2g} kg"
            shown = f"all {len(self.links)} links, {name} worst for its mass ({half})"
            if len(self.links) == 1:
                shown = f"{name}, to {half}"
            return [
                f"{said}; the motion shows {shown}",
                *(f"what would help: {line}" for line in self.advice),
            ]
        found = [said]
        unseen = [one.text for one in self.combinations if one.std > _UNSEEN]
        if unseen:
            found.append(f"does not show at all: {', '.join(unseen)}")
        found += [
            f"{'cannot be told apart' if one.is_trade else 'cannot be weighed'}: {one.text} "
            f"(known to +-{INTERVAL_95 * one.std:.0%})"
            for one in self.combinations
            if one.std <= _UNSEEN
        ]
        found += [f"known all the same: {one.text}" for one in self.sums]
        found += [f"what would help: {line}" for line in self.advice]
        return found

    def entry(self) -> VerdictEntry:
        """As a document holds it."""
        return VerdictEntry(
            motion=str(self.facts.motion),
            sensors=self.sensors,
            predicted_std_kg=dict(zip(self.links, self.std.tolist(), strict=True)),
            total_std_kg=self.total_std_kg,
            not_identifiable=list(self.hidden + self.hidden_others),
            combinations=[
                CombinationEntry(
                    text=one.text,
                    relative_std=one.std,
                    relative_change=dict(zip(self.links, one.change.tolist(), strict=True)),
                )
                for one in self.combinations
            ],
            sums=[one.entry() for one in self.sums],
            advice=list(self.advice),
        )
