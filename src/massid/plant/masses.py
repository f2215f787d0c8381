"""Hidden masses: what the simulated robot weighs and carries, and nobody but the score may know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

from massid.errors import BadInputError
from massid.model.robot import WALKING_LINKS, Robot
from massid.model.unknowns.spaces import ask, mass_space
from massid.model.unknowns.unknown import Unknown
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray

PAPER_ROBOT, PAPER_NORM_KG = "atlas", 6.0
"""The paper's full-scale humanoid and its initial error; other robots get a quarter of the norm of their masses."""

_DRAWS = 100
_BISECTIONS = 200
_ROUNDING = 1e-12


@dataclass(frozen=True)
class HiddenMasses:
    """True minus nominal mass of some links, and what any link carries besides.

    Attributes:
        error_kg: by link; the other links weigh what the model file says.
        payload_kg: point masses by where they are, LINK (the origin of its frame) or LINK@X,Y,Z in its frame [m].
    """

    error_kg: Mapping[str, float] = field(default_factory=dict)
    payload_kg: Mapping[str, float] = field(default_factory=dict)

    @property
    def norm_kg(self) -> float:
        """L2 norm of the errors [kg]."""
        return float(np.linalg.norm(list(self.error_kg.values())))

    def true_kg(self, robot: Robot) -> dict[str, float]:
        """True mass of every link, without what it carries [kg].

        Raises:
            ModelError: a name is not a link with a mass.
            BadInputError: a true mass lies outside Theta.
        """
        masses = {link: robot.nominal_mass_kg(link) for link in robot.links}
        for parameter in self._space(robot).parameters if self.error_kg else ():
            link = parameter.target
            mass_kg = masses[link] + self.error_kg[link]
            masses[link] = float(np.clip(mass_kg, parameter.lower, parameter.upper))
            if not abs(mass_kg - masses[link]) <= _ROUNDING * parameter.nominal:  # nan, too
                raise BadInputError(
                    f"A mass error of {self.error_kg[link]:+g} kg on '{link}' makes it {mass_kg:.4g} kg, outside "
                    f"[{parameter.lower:.4g}, {parameter.upper:.4g}] kg (0.3 to 2.5 times its nominal mass)."
                )
        return masses

    def true_model(self, robot: Robot) -> mujoco.MjModel:
        """Compile the robot with its true masses; inertias scale with them, centres of mass stay but for payloads.

        Raises:
            ModelError: a name is not a link with a mass, or of what carries a payload.
            BadInputError: a true mass lies outside Theta, or a payload is not heavier than nothing.
        """
        masses, payloads = self.true_kg(robot), self.payloads(robot)
        if not (self.error_kg or payloads):
            return robot.spec.copy().compile()
        links = self._space(robot).parameters if self.error_kg else ()
        space = ParameterSpace((*links, *(payload for payload, _ in payloads)))
        values = [*(masses[parameter.target] for parameter in links), *(kg for _, kg in payloads)]
        return robot.model_at(space, np.array(values))

    def payloads(self, robot: Robot) -> list[tuple[Unknown, float]]:
        """What is carried, as the unknown that it is to identification, and its mass [kg].

        Raises:
            ModelError: no such body, or one that does not move.
            BadInputError: a payload is not heavier than nothing, or nowhere near the robot.
        """
        found = []
        for where, mass_kg in self.payload_kg.items():
            if not 0.0 < mass_kg < np.inf:
                raise BadInputError(f"The payload on '{where}' is {mass_kg:g} kg; expected a finite mass above 0.")
            (payload,) = ask(robot, f"payload/{where}")
            found.append((payload, mass_kg))
        return found

    def _space(self, robot: Robot) -> ParameterSpace:
        return mass_space(robot, self.error_kg, welded_too=True)


@dataclass(frozen=True)
class MassErrors:
    """Mass errors to draw: in a random direction, of a given length.

    Attributes:
        links: links that get an error; empty for torso, thighs, calves and feet if the robot names its links so,
            else for its seven heaviest links.
        norm_kg: L2 norm of the errors [kg]; None for 6 kg on the Atlas-like robot, a quarter of the norm of the links'
            masses on others.
    """

    links: tuple[str, ...] = ()
    norm_kg: float | None = None

    def draw(self, robot: Robot, rng: np.random.Generator) -> HiddenMasses:
        """Draw errors that keep every link in Theta and have exactly the norm asked for.

        Raises:
            ModelError: a name is not a link with a mass.
            BadInputError: the norm is negative, or larger than Theta allows.
        """
        space = mass_space(robot, self.links or default_links(robot), welded_too=True)
        norm_kg = default_norm_kg(robot, space) if self.norm_kg is None else self.norm_kg
        if not 0.0 <= norm_kg < np.inf:
            raise BadInputError(f"The norm of the mass errors is {norm_kg} kg; it must be a finite number, at least 0.")
        errors = _draw(space, norm_kg, rng)
        links = [parameter.target for parameter in space.parameters]
        return HiddenMasses(dict(zip(links, errors.tolist(), strict=True)))


def default_links(robot: Robot) -> tuple[str, ...]:
    """Torso, thighs, calves and feet if the robot names its links so, else its seven heaviest links in model order."""
    if robot.walking_links() == WALKING_LINKS:
        return WALKING_LINKS
    heaviest = sorted(robot.links, key=robot.nominal_mass_kg, reverse=True)[: len(WALKING_LINKS)]
    return tuple(link for link in robot.links if link in heaviest)


def default_norm_kg(robot: Robot, space: ParameterSpace) -> float:
    """6 kg for the Atlas-like robot, a quarter of the norm of the links' nominal masses for others [kg]."""
    if robot.spec.modelname == PAPER_ROBOT:
        return PAPER_NORM_KG
    return float(np.linalg.norm(space.nominal)) / 4.0


def _draw(space: ParameterSpace, norm_kg: float, rng: np.random.Generator) -> FloatArray:
    """Draw a point of Theta at a given distance from the nominal one; returns the difference, shape (n_p,)."""
    lower, upper = space.lower - space.nominal, space.upper - space.nominal
    largest = float(np.linalg.norm(np.maximum(-lower, upper)))
    if norm_kg > largest:
        links = ", ".join(parameter.target for parameter in space.parameters)
        raise BadInputError(
            f"Mass errors of norm {norm_kg:g} kg do not fit into 0.3 to 2.5 times the nominal masses of {links}: at "
            f"most {largest:.4g} kg."
        )
    for _ in range(_DRAWS):
        direction = rng.normal(size=len(space))
        inside = direction * (norm_kg / np.linalg.norm(direction))
        if np.all((inside >= lower) & (inside <= upper)):
            return np.asarray(inside)
    for _ in range(_DRAWS):  # a norm that few directions reach inside the box: follow its faces
        direction = rng.normal(size=len(space))
        errors = _stretch(direction, norm_kg, lower, upper)
        if errors is not None:
            return errors
    # Only few directions reach this far: those in which most masses grow.
    errors = _stretch(np.abs(rng.normal(size=len(space))), norm_kg, lower, upper)
    return errors if errors is not None else np.where(upper >= -lower, upper, lower) * (norm_kg / largest)


def _stretch(direction: FloatArray, norm_kg: float, lower: FloatArray, upper: FloatArray) -> FloatArray | None:
    """Scale a direction, clipped to the box, until it has the norm; None if the box ends before."""

    def length(scale: float) -> float:
        return float(np.linalg.norm(np.clip(scale * direction, lower, upper)))

    near, far = 0.0, norm_kg / float(np.linalg.norm(direction))
    far_limit = float(np.max(np.maximum(-lower, upper) / np.maximum(np.abs(direction), 1e-12)))
    if length(far_limit) < norm_kg:
        return None
    while length(far) < norm_kg:
        near, far = far, min(2.0 * far, far_limit)
        if far == far_limit:
            break
    for _ in range(_BISECTIONS):
        middle = 0.5 * (near + far)
        if not near < middle < far:
            break
        near, far = (middle, far) if length(middle) < norm_kg else (near, middle)
    return np.clip(far * direction, lower, upper)
