"""Names of a log that are those of the robot but for a prefix, as namespaces and several robots in one world add."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from massid.model.robot import Robot
from massid.walk import Walk


def without_prefix(walk: Walk, robot: Robot) -> Walk:
    """The walk with the robot's names, if all of its own that the robot lacks are these with one prefix before them.

    Args:
        walk: as read.
        robot: whose bodies and joints are meant.
    """
    bodies = {robot.model.body(b).name for b in range(1, robot.model.nbody)}
    joints = set(robot.joint_names)
    logged = [(walk.root_body, bodies), *((name, bodies) for name in walk.contact_bodies)]
    logged += [(name, joints) for name in walk.joint_names]
    strange = [(name, known) for name, known in logged if name not in known]
    if not strange:
        return walk
    prefixes = Counter(
        name[: -len(own)] for name, known in strange for own in known if name.endswith(own) and name[: -len(own)]
    )
    fitting = [
        prefix
        for prefix, _ in prefixes.most_common()
        if prefix.endswith(_ENDS) and all(name.removeprefix(prefix) in known for name, known in strange)
    ]
    if not fitting:
        return walk
    prefix = fitting[0]

    def plain(name: str, known: set[str]) -> str:
        return name if name in known else name.removeprefix(prefix)

    contacts = tuple(plain(name, bodies) for name in walk.contact_bodies)
    names = tuple(plain(name, joints) for name in walk.joint_names)
    if len(set(contacts)) < len(contacts) or len(set(names)) < len(names):
        return walk
    return replace(
        walk,
        root_body=plain(walk.root_body, bodies),
        contact_bodies=contacts,
        joint_names=names,
        world_wrenches=tuple(plain(name, bodies) for name in walk.world_wrenches),
        warnings=(*walk.warnings, f"{walk.source}: names begin with '{prefix}', which the robot's do not; taken off."),
    )


_ENDS = ("/", "::", ".", "_", "-")
"""What a prefix ends with."""
