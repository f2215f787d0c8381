"""A floating-base robot from MJCF or URDF: names, masses, its identification model, what is made of a log for it."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from massid.errors import LogError, ModelError, unknown_name
from massid.model.anatomy import default_links
from massid.model.changes import changes_of
from massid.model.draft import realise
from massid.model.edit import bare_spec, identification_spec, unseen_spec, without_joints
from massid.model.file import ModelFile, one_line, read_model, save_model
from massid.model.kinematics import compensation_torques, moved_to_root, wrenches_in_bodies
from massid.model.layout import Channels, JointLayout
from massid.model.realisation import Realisation, write_fields
from massid.model.scenery import find_base, hold_scenery, name_bodies, without_lost_meshes
from massid.model.unknowns.unknown import Unknown, unknowns_of
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Walk

WALKING_LINKS = ("torso", "l_thigh", "r_thigh", "l_calf", "r_calf", "l_foot", "r_foot")
"""The links whose masses matter most to walking: what Section V-D identifies."""


class Robot:
    """A robot model with one floating base.

    Attributes:
        spec: the robot alone, with everything else held still; never written to.
        model: its compiled form, with nominal masses and without what is only seen.
        source: file name or "spec", for messages.
        notes: what of the model is not as its file has it, one line each.

    Args:
        spec: as loaded, or made; not written to.
        source: its name.
        file: what it was read from.
    """

    def __init__(self, spec: mujoco.MjSpec, source: str = "spec", file: ModelFile | None = None) -> None:
        self.source = source
        self._file = file
        base = find_base(spec, source).name
        if not base:
            raise ModelError(
                f"{source}: the floating base has no name: give its <body> the name that the log has for it."
            )
        self._whole = spec.copy()
        notes = [*(file.notes if file else ()), *name_bodies(self._whole, base)]
        self.spec = self._whole.copy()
        notes += hold_scenery(self.spec, base)
        try:
            self.model = unseen_spec(self.spec).compile()
        except ValueError:
            self.spec, lost = without_lost_meshes(self.spec, source)
            self._whole, _ = without_lost_meshes(self._whole, source)
            notes += lost
            try:
                self.model = unseen_spec(self.spec).compile()
            except ValueError as error:
                raise ModelError(f"{source}: MuJoCo cannot compile it: {one_line(error)}") from error
        self.notes: tuple[str, ...] = tuple(f"{source}: {note}" for note in notes)
        model = self.model
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        ball = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_BALL)
        if len(ball):
            joint = model.joint(int(ball[0]))
            body, name = model.body(int(model.jnt_bodyid[ball[0]])).name, joint.name or "neck"
            raise ModelError(
                f"{source}: joint '{joint.name}' of '{body}' is a ball joint; a log holds one number per joint: "
                f'put three hinges in its place, with the names that the log has, such as <joint name="{name}_x" '
                f'axis="1 0 0"/>, {name}_y and {name}_z, or none if it is held still.'
            )
        root = int(free[0])
        self.root_body: str = model.body(int(model.jnt_bodyid[root])).name
        others = [j for j in range(model.njnt) if j != root]
        self.joint_names: tuple[str, ...] = tuple(model.joint(j).name for j in others)
        if "" in self.joint_names:
            body = model.body(int(model.jnt_bodyid[others[self.joint_names.index("")]])).name
            raise ModelError(
                f"{source}: a joint of body '{body}' has no name: give it the one that the log has for it."
            )
        self.layout = JointLayout(
            root_qpos=int(model.jnt_qposadr[root]),
            root_dof=int(model.jnt_dofadr[root]),
            joint_qpos=np.asarray(model.jnt_qposadr[others], dtype=np.int64),
            joint_dof=np.asarray(model.jnt_dofadr[others], dtype=np.int64),
        )

    @classmethod
    def load(cls, source: str | Path | mujoco.MjSpec) -> Robot:
        """Load a robot from an MJCF or URDF file, or take an MjSpec.

        Raises:
            ModelError: the file is missing, does not parse or compile, or has no single floating base.
        """
        if isinstance(source, mujoco.MjSpec):
            return cls(source)
        spec, file = read_model(Path(source))
        return cls(spec, Path(source).name, file)

    def with_all_seen(self, dress: Callable[[mujoco.MjSpec], None] | None = None) -> mujoco.MjModel:
        """Compile it with all that is seen; that may take hundreds of megabytes for meshes and textures.

        Shapes whose files cannot be read are left out.

        Args:
            dress: changes a copy of the spec before it is compiled.

        Raises:
            ModelError: it does not compile.
        """
        try:
            return _compiled(self.spec, dress)
        except ValueError:
            without, _ = without_lost_meshes(self.spec, self.source)
        try:
            return _compiled(without, dress)
        except ValueError as error:
            raise ModelError(f"{self.source}: MuJoCo cannot compile it: {one_line(error)}") from error

    @cached_property
    def _bare(self) -> mujoco.MjSpec:
        """What all identification models are made of; meshes are read for it once."""
        return bare_spec(self.spec)

    @cached_property
    def links(self) -> tuple[str, ...]:
        """Names of the bodies that have a mass of their own and move, in model order."""
        model = self.model
        return tuple(
            model.body(b).name
            for b in range(1, model.nbody)
            if model.body_mass[b] > 0 and model.body_dofnum[model.body_weldid[b]] > 0
        )

    def walking_links(self) -> tuple[str, ...]:
        """Those of torso, thighs, calves and feet that the robot has under these names."""
        return tuple(link for link in WALKING_LINKS if link in self.links)

    def default_links(self) -> tuple[str, ...]:
        """The links to weigh if nobody says: trunk, thighs, shanks and feet, by their usual names or by the tree."""
        usual = self.walking_links()
        if len(usual) == len(WALKING_LINKS):
            return usual
        moving = [link for link in self.links if self.welded_to(link) is None]
        return default_links(self.model, self.root_body, moving) or usual

    @property
    def total_mass_kg(self) -> float:
        """Nominal mass of all moving links [kg]."""
        return float(sum(self.nominal_mass_kg(link) for link in self.links))

    def steps_in(self, period_s: float) -> int:
        """How many of the model's time steps a sample period [s] holds, at least 1."""
        return max(1, round(period_s / float(self.model.opt.timestep)))

    def nominal_mass_kg(self, link: str) -> float:
        """Mass that the model file gives a link [kg].

        Raises:
            ModelError: no such link, or a body without mass, or one that does not move.
        """
        if link in self.links:
            return float(self.model.body(link).mass[0])
        bodies = [self.model.body(b).name for b in range(self.model.nbody)]
        if link == "world":
            raise ModelError(f"The world has no mass to identify. {self.source} has: {', '.join(self.links)}.")
        if link in bodies:
            why = "does not move" if self.model.body(link).mass[0] > 0 else "has no mass"
            raise ModelError(
                f"Body '{link}' of {self.source} {why}.{self.suggestion(link)} "
                f"Links with a mass: {', '.join(self.links)}."
            )
        raise ModelError(unknown_name("link", link, self.links, self.source))

    def welded_to(self, link: str) -> str | None:
        """The body that a link without a joint of its own moves with; None for a link that moves by itself.

        Of links that are fixed to a body without mass, as to a frame, the heaviest counts as moving by itself.
        """
        model = self.model
        moving = int(model.body_weldid[model.body(link).id])
        if model.body_mass[moving] == 0.0:
            moving = int(np.argmax(np.where(model.body_weldid == moving, model.body_mass, 0.0)))
        name = str(model.body(moving).name)
        return None if name == link else name

    def suggestion(self, link: str) -> str:
        """A question that names the links which come closest, by name and up the tree; "" for none."""
        own = [name for name in self.links if self.welded_to(name) is None]
        near = difflib.get_close_matches(link, own, n=2, cutoff=0.5)
        body = self.model.body(link).id
        while body:
            body = int(self.model.body_parentid[body])
            if self.model.body(body).name in own:
                near.append(self.model.body(body).name)
                break
        return f" Did you mean {', '.join(dict.fromkeys(near))}?" if near else ""

    def realise(self, space: ParameterSpace, points: FloatArray, contact_bodies: Sequence[str] = ()) -> Realisation:
        """Translate parameter vectors into model fields and sensor errors.

        Args:
            space: what each coordinate means.
            points: shape (N, n_p).
            contact_bodies: bodies whose wrench is measured, in the order of the identification model's controls.

        Raises:
            BadInputError: a coordinate is not an unknown of a robot, or belongs to a sensor that is not there.
        """
        return realise(self.channels(contact_bodies), unknowns_of(space), np.atleast_2d(points))

    def channels(self, contact_bodies: Sequence[str] = ()) -> Channels:
        """Where its joints, and the sensors on some bodies, stand among the columns of a motion."""
        return Channels(self.model, self.layout, self.joint_names, tuple(contact_bodies))

    def require_joint(self, name: str) -> None:
        """Refuse what is none of its one-axis joints.

        Raises:
            ModelError: no such joint; it names those that there are.
        """
        if name not in self.joint_names:
            raise ModelError(unknown_name("joint", name, self.joint_names, self.source))

    def model_at(self, space: ParameterSpace, point: FloatArray) -> mujoco.MjModel:
        """Compile a copy of the full model (actuators, contacts) with the parameters of one point in it."""
        model = self.spec.copy().compile()
        unknowns, values = _without_sensors(space, point)
        write_fields(model, realise(self.channels(), unknowns, values[None]))
        return model

    def identification_model(self, contact_bodies: Sequence[str]) -> mujoco.MjModel:
        """Compile the model of Eq. (22) that is driven by measured torques and wrenches.

        Contacts and the robot's own actuators are off. Friction, damping, armature, springs, joint limits and the
        integrator stay in the engine. Each contact body carries six motors at its frame's origin, so that a measured
        wrench acts in its own sensor frame and turns with the model.

        Args:
            contact_bodies: bodies whose wrench was measured; controls are ordered like them, six each
                (force [N], moment [N m]).

        Raises:
            ModelError: a contact body is not in the model.
        """
        bodies = [self.model.body(b).name for b in range(1, self.model.nbody)]
        for name in contact_bodies:
            if name not in bodies:
                raise ModelError(unknown_name("contact body", name, bodies, self.source))
        try:
            return identification_spec(self._bare, contact_bodies).compile()
        except ValueError as error:
            raise ModelError(f"{self.source}: no identification model can be made of it: {one_line(error)}") from error

    @property
    def compensated_links(self) -> tuple[str, ...]:
        """Links whose weight joints' actuators take off (`gravcomp` with `actuatorgravcomp`)."""
        model = self.model
        if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY or not model.jnt_actgravcomp.any():
            return ()
        return tuple(link for link in self.links if model.body_gravcomp[model.body(link).id] != 0.0)

    def lifted_kg(self, masses_kg: Mapping[str, float]) -> float:
        """Mass that the ground does not carry, because the model compensates its weight (`gravcomp`) [kg].

        Args:
            masses_kg: by link, where they are not the model file's.
        """
        share = {link: float(self.model.body_gravcomp[self.model.body(link).id]) for link in self.links}
        return sum(share[link] * masses_kg.get(link, self.nominal_mass_kg(link)) for link in self.links)

    def without_compensation(self, walk: Walk) -> Walk:
        """Return an aligned walk whose torques lack what actuators added to compensate gravity, at nominal masses.

        A joint's torque is that of all its actuators, of this one, too. The identification models have it as a passive
        force, for the base feels what the joints do not.
        """
        if not self.compensated_links:
            return walk
        torques = compensation_torques(self.model, self.layout.to_qpos(walk.qpos))
        return replace(walk, effort=walk.effort - torques[:, self.layout.joint_dof])

    def without_gravcomp(self) -> Robot:
        """Return the robot with all of its weight."""
        spec = self.spec.copy()
        for body in spec.bodies:
            body.gravcomp = 0.0
        return Robot(spec, self.source)

    def stepping(self, timestep_s: float) -> Robot:
        """Return the robot with another time step [s]."""
        spec = self.spec.copy()
        spec.option.timestep = timestep_s
        return Robot(spec, self.source)

    def locked(self, positions: Mapping[str, float]) -> Robot:
        """Return the robot with some joints held still, as for fingers that a log does not show.

        Args:
            positions: by joint, where it is held [rad or m].

        Raises:
            ModelError: no such joint, or one of several joints of a body held away from the model's own position.
        """
        for name in positions:
            self.require_joint(name)
        return Robot(without_joints(self.spec, self.model, positions), self.source) if positions else self

    def align(self, walk: Walk) -> Walk:
        """Return the walk with its joints in the model's order and its wrenches in their bodies' frames.

        Raises:
            LogError: another root body, a missing joint, or a contact body that the model does not have.
        """
        self.require_bodies(walk)
        if walk.root_body != self.root_body:
            walk = moved_to_root(walk, self.model, self.root_body)
        for name in walk.joint_names:
            if name not in self.joint_names:
                raise LogError(
                    f"{unknown_name('joint', name, self.joint_names, self.source)} {walk.source} has it; `ignore` in a "
                    "topic map leaves it out."
                )
        for name in self.joint_names:
            if name not in walk.joint_names:
                raise LogError(
                    f"{unknown_name('joint', name, walk.joint_names, walk.source)} {self.source} has it; `locked` in a "
                    "topic map says where it was held."
                )
        walk = walk.with_joint_order(self.joint_names)
        if not walk.world_wrenches:
            return walk
        qpos = self.layout.to_qpos(walk.qpos)
        wrench = wrenches_in_bodies(self.model, qpos, walk.wrench, walk.contact_bodies, walk.world_wrenches)
        return replace(walk, wrench=wrench, world_wrenches=())

    def require_bodies(self, walk: Walk) -> None:
        """Pass if a log is of the robot's base, or of what moves with it, and of wrenches on its bodies.

        Raises:
            LogError: it is not; names the settings that say which body is meant.
        """
        if walk.root_body != self.root_body and not self._moves_with_base(walk.root_body):
            raise LogError(
                f"{walk.source}: the base pose is that of '{walk.root_body}', but the floating base of {self.source} "
                f"is '{self.root_body}'. If they are one body, `base: {{body: {self.root_body}}}` in a topic map says "
                "so."
            )
        bodies = [self.model.body(b).name for b in range(1, self.model.nbody)]
        for name in walk.contact_bodies:
            if name not in bodies:
                raise LogError(
                    f"{unknown_name('body', name, bodies, self.source)} {walk.source} has its wrench; `body` under "
                    "contacts in a topic map says which body it acts on."
                )

    def _moves_with_base(self, name: str) -> bool:
        model = self.model
        weld = {model.body(b).name: int(model.body_weldid[b]) for b in range(1, model.nbody)}
        return weld.get(name) == weld[self.root_body]

    def write_model(
        self, space: ParameterSpace, point: FloatArray, path: Path, remark: str = "", *, with_assets: bool = False
    ) -> None:
        """Save the model with the parameters of one point in it; errors of sensors are no part of it.

        The text of the robot's own file is kept but for what was found, and include files become part of it. Where that
        cannot hold it, the file is MuJoCo's text of the same robot. A robot from a URDF is saved as a URDF if the path
        ends so. Meshes and textures stay where they are, and the new file says where that is. It is read back before it
        gets its name.

        Args:
            space: what each coordinate means.
            point: shape (n_p,).
            path: the file.
            remark: a comment at its top; "" for none.
            with_assets: copy meshes and textures into a folder beside it.

        Raises:
            ModelError: the file cannot be written, or does not give the same robot.
        """
        unknowns, values = _without_sensors(space, point)
        changes = changes_of(self.channels(), unknowns, values)
        save_model(
            self._whole, self._file, path, changes, lambda saved: Robot.load(saved).model,
            remark=remark, with_assets=with_assets,
        )  # fmt: skip


def _compiled(spec: mujoco.MjSpec, dress: Callable[[mujoco.MjSpec], None] | None) -> mujoco.MjModel:
    """A copy of a spec, compiled, which may be changed before."""
    copied = spec.copy()
    if dress is not None:
        dress(copied)
    return copied.compile()


def _without_sensors(space: ParameterSpace, point: FloatArray) -> tuple[list[Unknown], FloatArray]:
    """Those unknowns that are not errors of a sensor, and their values."""
    unknowns = unknowns_of(space)
    kept = [k for k, unknown in enumerate(unknowns) if not unknown.per_walk]
    return [unknowns[k] for k in kept], np.asarray(point)[kept]
