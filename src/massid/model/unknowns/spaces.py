"""What may be asked for of a robot, by name: the spaces of its unknowns, and refusals of what cannot be told."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from massid.errors import BadInputError, ModelError, unknown_name
from massid.model.robot import Robot
from massid.model.unknowns.bodies import centre_parameters, inertia_parameters, parse_payload, payload_parameter
from massid.model.unknowns.joints import passive_parameter
from massid.search.parameters import Kind, Parameter, ParameterSpace


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
        _check_link(robot, link, welded_too)
    return ParameterSpace(tuple(Parameter.mass(link, robot.nominal_mass_kg(link)) for link in links))


def parameter_space(
    robot: Robot,
    links: Iterable[str],
    unknowns: Iterable[str | Parameter] = (),
) -> ParameterSpace:
    """Span masses, and what else is unknown of the robot's bodies and joints.

    Args:
        robot: the robot with nominal values.
        links: whose mass is unknown.
        unknowns: what else is, as KIND/TARGET: com/LINK for its centre of mass, inertia/LINK for its rotational inertia
            beyond its scaling with the mass, payload/BODY or payload/BODY@X,Y,Z for a point mass of unknown size in the
            frame of the body [m], friction/JOINT and damping/JOINT for friction loss and viscous damping.

    Raises:
        ModelError: a name is not a link with a mass, or moves with another body; a payload on what does not move;
            an inertia without thickness; no such joint, or actuators that damp joints, too.
        BadInputError: no links, something named twice, or a point that is not three numbers.
    """
    links, unknowns = tuple(links), tuple(unknowns)
    parameters = list(mass_space(robot, links).parameters) if links or not unknowns else []
    parameters += [one for one in unknowns if isinstance(one, Parameter)]
    groups: dict[str, list[str]] = {kind: [] for kind in ("com", "inertia", "payload", "friction", "damping")}
    for one in unknowns:
        if isinstance(one, Parameter):
            continue
        kind, _, target = one.partition("/")
        if kind not in groups or not target:
            raise BadInputError(f"Unknown '{one}': expected KIND/TARGET with a kind of {', '.join(groups)}.")
        groups[kind].append(target)
    com, inertia, payload, friction, damping = groups.values()
    for group, make in ((com, centre_parameters), (inertia, inertia_parameters)):
        for link in group:
            _check_link(robot, link)
            parameters += make(robot.model, link)
    for text in payload:
        _check_carrier(robot, parse_payload(text)[0])
        parameters.append(payload_parameter(robot.model, text, robot.total_mass_kg))
    weight_n = robot.total_mass_kg * float(np.linalg.norm(robot.model.opt.gravity))
    for kind, joints in ((Kind.FRICTION, friction), (Kind.DAMPING, damping)):
        for joint in joints:
            _check_joint(robot, joint)
            parameters.append(passive_parameter(robot.model, kind, joint, weight_n))
    return ParameterSpace(tuple(parameters))


def _check_link(robot: Robot, link: str, welded_too: bool = False) -> None:
    """Refuse what has no mass of its own or moves with another body."""
    nominal_kg = robot.nominal_mass_kg(link)
    other = robot.welded_to(link)
    if other is not None and not welded_too:
        raise ModelError(
            f"Body '{link}' of {robot.source} ({nominal_kg:.3g} kg) moves with '{other}': there is no joint "
            f"between them, so weigh '{other}'.{robot.suggestion(link)}"
        )


def _check_joint(robot: Robot, joint: str) -> None:
    """Refuse what is no joint, and dampers that are not the joints' own."""
    if joint not in robot.joint_names:
        raise ModelError(unknown_name("joint", joint, robot.joint_names, robot.source))
    if not np.array_equal(robot.identification_model(()).dof_damping, robot.model.dof_damping):
        raise ModelError(
            f"{robot.source}: actuators damp joints, too; give that damping to the joints to have it identified."
        )


def _check_carrier(robot: Robot, name: str) -> None:
    """Refuse bodies that carry nothing through a walk."""
    model = robot.model
    moving = [model.body(b).name for b in range(1, model.nbody) if model.body_dofnum[model.body_weldid[b]] > 0]
    if name not in moving:
        raise ModelError(unknown_name("moving body", name, moving, robot.source))
