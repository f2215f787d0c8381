"""What may be asked for of a robot, by name: the spaces of its unknowns, and refusals of what cannot be told."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from massid.errors import BadInputError
from massid.model.unknowns.bodies import Mass, check_link
from massid.model.unknowns.unknown import KINDS, Unknown
from massid.search.parameters import Parameter, ParameterSpace

if TYPE_CHECKING:
    from massid.model.robot import Robot


def mass_space(robot: Robot, links: Iterable[str], *, welded_too: bool = False) -> ParameterSpace:
    """Span the masses of the named links, each within the default Theta.

    Args:
        robot: the robot with nominal masses.
        links: names of bodies.
        welded_too: also take bodies without a joint of their own, which a log can hardly tell from their parent.

    Raises:
        ModelError: a name is not a link with a mass, or moves with another body.
        BadInputError: no links, or a link named twice.
    """
    links = tuple(links)
    for link in links:
        check_link(robot, link, welded_too=welded_too)
    return ParameterSpace(tuple(Mass.of(link, robot.nominal_mass_kg(link)) for link in links))


def parameter_space(robot: Robot, links: Iterable[str], unknowns: Iterable[str | Unknown] = ()) -> ParameterSpace:
    """Span masses, and what else is unknown of the robot.

    Args:
        robot: the robot with nominal values.
        links: whose mass is unknown.
        unknowns: what else is: KIND/TARGET, such as "com/torso", "inertia/torso", "payload/l_hand@0,0,0.1",
            "friction/l_knee" or "damping/l_knee", or unknowns themselves, of whatever class; those that enter by their
            derivative come last.

    Raises:
        ModelError: the robot has no such link, body or joint, or nothing about it can be told.
        BadInputError: nothing is unknown or something twice, no such kind, or a target that it cannot have.
    """
    links, unknowns = tuple(links), tuple(unknowns)
    found: list[Parameter] = list(mass_space(robot, links).parameters) if links or not unknowns else []
    for one in unknowns:
        found += ask(robot, one) if isinstance(one, str) else [one]
    return ParameterSpace(tuple(sorted(found, key=lambda one: one.tangent)))


def ask(robot: Robot, text: str) -> Sequence[Unknown]:
    """The unknowns that a text of the form KIND/TARGET asks for.

    Raises:
        ModelError: the robot has no such target, or nothing about it can be told.
        BadInputError: no such kind, or a target that it cannot have.
    """
    kind, _, target = text.partition("/")
    if kind not in KINDS or not target:
        raise BadInputError(f"Unknown '{text}': expected KIND/TARGET, with a kind out of {', '.join(kinds())}.")
    return KINDS[kind].ask(robot, target)


def kinds() -> list[str]:
    """The kinds of unknowns that can be asked for by name: those with an `ask` of their own."""
    own = {kind: cls.__mro__[: cls.__mro__.index(Unknown)] for kind, cls in KINDS.items()}
    return [kind for kind, classes in own.items() if any("ask" in vars(cls) for cls in classes)]
