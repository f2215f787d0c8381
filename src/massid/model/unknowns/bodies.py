"""Unknowns of rigid bodies: mass, centre of mass, rotational inertia, payload.

What they do to a motion follows from the pseudo-inertia of the body that they write, so none has an effect of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from massid.errors import BadInputError, ModelError, unknown_name
from massid.model.inertia import LOG_CHOLESKY, spread_of
from massid.model.unknowns.unknown import Unknown
from massid.typing import FloatArray

if TYPE_CHECKING:
    from massid.model.draft import Draft
    from massid.model.robot import Robot

THETA_LOWER, THETA_UPPER = 0.3, 2.5
"""Default bounds of a mass, as multiples of its nominal value."""
AXES = ("x", "y", "z")
CENTRE_REACH = 4.0
"""Theta of a centre of mass, in radii of gyration to either side of the model file's."""
SMALLEST_REACH_M = 0.01
"""Taken for the radius of gyration of a body that is next to a point."""
SHAPE_SCALE, SHAPE_REACH = 0.5, 1.5
"""Typical change and bound of the logarithm of a radius of gyration: a factor of 4.5 to either side."""
FARTHEST_PAYLOAD = 3.0
"""Times the size of the robot."""
PAYLOAD_REACH = 0.5
"""Largest payload, as a share of the whole robot's mass."""
SMALLEST_PAYLOAD_SCALE = 0.01
"""Typical payload of a link that weighs next to nothing, as a share of the whole robot's mass."""
_FLAT = 1e-9
"""Smallest square of a radius of gyration, relative to the largest, of a body that has three extents."""


@dataclass(frozen=True)
class BodyUnknown(Unknown):
    """An unknown of one body.

    Attributes:
        body: its name.
    """

    body: str


@dataclass(frozen=True)
class Mass(BodyUnknown):
    """Mass of a link; its rotational inertia scales with it, its centre of mass stays."""

    kind = "mass"
    title = "masses of other links"
    adds_mass: ClassVar[float] = 1.0
    unit = "kg"

    @classmethod
    def of(cls, link: str, nominal_kg: float) -> Mass:
        """Within the default Theta."""
        lower, upper = THETA_LOWER * nominal_kg, THETA_UPPER * nominal_kg
        return cls(link, nominal=nominal_kg, lower=lower, upper=upper, scale=nominal_kg)

    @classmethod
    def ask(cls, robot: Robot, target: str) -> Sequence[Mass]:
        """Of one link.

        Raises:
            ModelError: not a link with a mass, or one that moves with another body.
        """
        check_link(robot, target)
        return (cls.of(target, robot.nominal_mass_kg(target)),)

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As the mass of the body itself."""
        draft.body(self.body).mass[:] = values


@dataclass(frozen=True)
class CentreOfMass(BodyUnknown):
    """Centre of mass of a link in the frame of its body.

    Attributes:
        axis: x, y or z.
    """

    kind = "com"
    title = "centres of mass"
    unit = "m"
    axis: str

    @classmethod
    def ask(cls, robot: Robot, target: str) -> Sequence[CentreOfMass]:
        """Of BODY, one an axis, or of BODY/AXIS.

        Raises:
            ModelError: not a link with a mass, or one that moves with another body.
        """
        link, axes = _with_entries(robot, target, AXES)
        check_link(robot, link)
        body = robot.model.body(link)
        spread = spread_of(float(body.mass[0]), body.inertia)
        radius = max(float(np.sqrt(max(spread.sum(), 0.0) / 3.0)), SMALLEST_REACH_M)
        reach = CENTRE_REACH * radius
        return [
            cls(link, axis, nominal=nominal, lower=nominal - reach, upper=nominal + reach, scale=radius)
            for axis, nominal in zip(AXES, body.ipos.tolist(), strict=True)
            if axis in axes
        ]

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As one coordinate of the body's own centre of mass."""
        draft.body(self.body).centre[:, AXES.index(self.axis)] = values


@dataclass(frozen=True)
class Inertia(BodyUnknown):
    """Rotational inertia of a link about its centre of mass, in log-Cholesky numbers of its pseudo-inertia.

    They are zero for the model file's inertia, and any value belongs to a body that can exist.

    Attributes:
        entry: one of `LOG_CHOLESKY`.
    """

    kind = "inertia"
    title = "shapes of rotational inertias"
    entry: str

    @classmethod
    def ask(cls, robot: Robot, target: str) -> Sequence[Inertia]:
        """Of BODY, all six numbers, or of BODY/ENTRY.

        Raises:
            ModelError: not a link with a mass, or one that moves with another body; or the model file's inertia is that
                of a body without thickness, from which no thickness can be scaled.
        """
        link, entries = _with_entries(robot, target, LOG_CHOLESKY)
        check_link(robot, link)
        body = robot.model.body(link)
        spread = spread_of(float(body.mass[0]), body.inertia)
        if spread.min() <= _FLAT * spread.max():
            moments = ", ".join(f"{moment:.4g}" for moment in body.inertia)
            raise ModelError(
                f"Body '{link}' has principal moments {moments} kg m^2, those of a body without thickness: its inertia "
                "cannot be identified; give the model a physical one (each moment less than the sum of the other two)."
            )
        return [
            cls(link, entry, nominal=0.0, lower=-SHAPE_REACH, upper=SHAPE_REACH, scale=SHAPE_SCALE) for entry in entries
        ]

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As one number of the body's shape."""
        draft.body(self.body).shape[:, LOG_CHOLESKY.index(self.entry)] = values


@dataclass(frozen=True)
class InertiaScale(BodyUnknown):
    """Rotational inertia of a link about its centre of mass, all of it by one factor: its natural logarithm."""

    kind = "inertia_scale"
    title = "rotational inertias"

    @classmethod
    def ask(cls, robot: Robot, target: str) -> Sequence[InertiaScale]:
        """Of one link; an inertia is a radius of gyration squared.

        Raises:
            ModelError: not a link with a mass, or one that moves with another body.
        """
        check_link(robot, target)
        reach = 2.0 * SHAPE_REACH
        return (cls(target, nominal=0.0, lower=-reach, upper=reach, scale=2.0 * SHAPE_SCALE),)

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As a factor."""
        draft.body(self.body).gain *= np.exp(values)


@dataclass(frozen=True)
class Payload(BodyUnknown):
    """A point mass carried by a body.

    Attributes:
        point: in the frame of the body [m].
    """

    kind = "payload"
    title = "payloads"
    adds_mass: ClassVar[float] = 1.0
    unit = "kg"
    point: tuple[float, float, float]

    @property
    def where(self) -> str:
        """BODY@X,Y,Z."""
        return f"{self.body}@{','.join(f'{x:g}' for x in self.point)}"

    @classmethod
    def ask(cls, robot: Robot, target: str) -> Sequence[Payload]:
        """At BODY, the origin of its frame, or at BODY@X,Y,Z in the frame of the body [m]; nominally none.

        Raises:
            ModelError: no such body, or one that does not move.
            BadInputError: the point is not three finite numbers, or nowhere near the robot.
        """
        body, point = _parse_payload(target)
        _check_carrier(robot, body)
        away_m, size_m = float(np.linalg.norm(point)), float(robot.model.stat.extent)
        if away_m > FARTHEST_PAYLOAD * size_m:
            raise BadInputError(
                f"Payload '{target}' is {away_m:.3g} m from the origin of {body}; expected a point on the robot, which "
                f"is {size_m:.2g} m across, in metres and in the frame of the body."
            )
        total_kg = robot.total_mass_kg
        scale = max(float(robot.model.body(body).mass[0]), SMALLEST_PAYLOAD_SCALE * total_kg)
        return (cls(body, point, nominal=0.0, lower=0.0, upper=max(PAYLOAD_REACH * total_kg, scale), scale=scale),)

    def write(self, draft: Draft, values: FloatArray) -> None:
        """On top of the body itself."""
        draft.body(self.body).carry(values, self.point)


def check_link(robot: Robot, link: str, *, welded_too: bool = False) -> None:
    """Refuse what has no mass of its own or moves with another body.

    Raises:
        ModelError: see there.
    """
    nominal_kg = robot.nominal_mass_kg(link)
    other = robot.welded_to(link)
    if other is not None and not welded_too:
        raise ModelError(
            f"Body '{link}' of {robot.source} ({nominal_kg:.3g} kg) moves with '{other}': there is no joint "
            f"between them, so weigh '{other}'.{robot.suggestion(link)}"
        )


def _check_carrier(robot: Robot, name: str) -> None:
    """Refuse bodies that carry nothing through a walk."""
    model = robot.model
    moving = [model.body(b).name for b in range(1, model.nbody) if model.body_dofnum[model.body_weldid[b]] > 0]
    if name not in moving:
        raise ModelError(unknown_name("moving body", name, moving, robot.source))


def _with_entries(robot: Robot, target: str, entries: Sequence[str]) -> tuple[str, Sequence[str]]:
    """Take BODY for all entries and BODY/ENTRY for one of them; names of bodies may hold slashes, too."""
    body, _, entry = target.rpartition("/")
    return (body, (entry,)) if entry in entries and target not in robot.links else (target, entries)


def _parse_payload(text: str) -> tuple[str, tuple[float, float, float]]:
    """Body and point of BODY@X,Y,Z; without a point it is the origin of the body's frame.

    Raises:
        BadInputError: the point is not three finite numbers.
    """
    body, at, numbers = text.rpartition("@")
    if not at:
        return text, (0.0, 0.0, 0.0)
    try:
        x, y, z = (float(number) for number in numbers.split(","))
    except ValueError:
        x = y = z = np.nan
    if not np.all(np.isfinite((x, y, z))):
        raise BadInputError(
            f"Payload '{text}': expected BODY or BODY@X,Y,Z with a point in metres, such as hand@0,0,0.1."
        )
    return body, (x, y, z)
