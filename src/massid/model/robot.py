"""A floating-base robot from MJCF: its names and masses, its identification model, and what is made of a log for it."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from massid.errors import LogError, ModelError, unknown_name
from massid.model.draft import Draft, realise
from massid.model.edit import bare_spec, identification_spec, no_single_base, unseen_spec, without_joints, write_bodies
from massid.model.file import one_line, save_model
from massid.model.kinematics import wrenches_in_bodies
from massid.model.layout import Channels, JointLayout
from massid.model.realisation import Realisation, write_fields
from massid.model.unknowns.unknown import Unknown, unknowns_of
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Walk

WALKING_LINKS = ("torso", "l_thigh", "r_thigh", "l_calf", "r_calf", "l_foot", "r_foot")
"""The links whose masses matter most to walking: what Section V-D identifies."""


class Robot:
    """A robot model with one floating base.

    Attributes:
        spec: the model as loaded; never written to.
        model: its compiled form, with nominal masses and without what is only seen.
        source: file name or "spec", for messages.
    """

    def __init__(self, spec: mujoco.MjSpec, source: str = "spec") -> None:
        self.spec = spec
        self.source = source
        try:
            self.model = unseen_spec(spec).compile()
        except ValueError as error:
            raise ModelError(f"{source}: MuJoCo cannot compile it: {one_line(error)}") from error
        model = self.model
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        if len(free) != 1:
            raise ModelError(f"{source}: {no_single_base(model, free)}")
        ball = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_BALL)
        if len(ball):
            raise ModelError(
                f"{source}: joint '{model.joint(int(ball[0])).name}' is a ball joint; a joint state holds one number "
                "per joint, so model it as three hinges."
            )
        root = int(free[0])
        self.root_body: str = model.body(int(model.jnt_bodyid[root])).name
        others = [j for j in range(model.njnt) if j != root]
        self.joint_names: tuple[str, ...] = tuple(model.joint(j).name for j in others)
        if "" in self.joint_names or not self.root_body:
            raise ModelError(f"{source}: every joint and the floating base need a name to be matched with a log.")
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
        path = Path(source)
        if not path.is_file():
            what = "is a folder" if path.is_dir() else "does not exist"
            raise ModelError(f"Model file {path} {what}; expected an MJCF (.xml) file.")
        try:
            spec = mujoco.MjSpec.from_file(str(path.resolve()))
        except (ValueError, mujoco.FatalError) as error:
            raise ModelError(f"{path}: not a model that MuJoCo can read: {one_line(error)}") from error
        # Fused bodies lose their names; welded ones keep them and move no differently.
        spec.compiler.fusestatic = False
        return cls(spec, path.name)

    @cached_property
    def drawn(self) -> mujoco.MjModel:
        """The compiled model with all that is seen; it may hold hundreds of megabytes of meshes and textures.

        Raises:
            ModelError: a mesh or a texture cannot be read.
        """
        try:
            return self.spec.copy().compile()
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
        """The body that a link without a joint of its own moves with; None for a link that moves by itself."""
        body = self.model.body(link).id
        moving = int(self.model.body_weldid[body])
        return None if moving == body else str(self.model.body(moving).name)

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
        if walk.root_body != self.root_body:
            raise LogError(
                f"{walk.source}: the base pose is that of '{walk.root_body}', but the floating base of {self.source} "
                f"is '{self.root_body}'."
            )
        bodies = [self.model.body(b).name for b in range(1, self.model.nbody)]
        for name in walk.contact_bodies:
            if name not in bodies:
                raise LogError(f"{unknown_name('body', name, bodies, self.source)} {walk.source} has its wrench.")
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

    def write_mjcf(self, space: ParameterSpace, point: FloatArray, path: Path, remark: str = "") -> None:
        """Save the model with the parameters of one point in it; errors of sensors are no part of it.

        Works whether inertia was given or came from geoms. Include files become part of the new file; meshes and
        textures stay where they are, and the new file says where that is. It is read back before it gets its name.

        Args:
            space: what each coordinate means.
            point: shape (n_p,).
            path: the file.
            remark: a comment at its top; "" for none.

        Raises:
            ModelError: the file cannot be written, or does not give the same robot.
        """
        spec = self.spec.copy()
        unknowns, values = _without_sensors(space, point)
        draft = Draft(self.channels(), unknowns, values[None])
        fields = draft.model_fields()
        write_bodies(spec, self.model, [body.number for body in draft.bodies.values()], fields)
        for unknown, value in zip(unknowns, values.tolist(), strict=True):
            unknown.write_spec(spec, value)
        checked = ("body_mass", *draft.fields_written)  # principal axes may come back in another order
        save_model(spec, path, {name: fields[name][0] for name in checked}, remark)


def _without_sensors(space: ParameterSpace, point: FloatArray) -> tuple[list[Unknown], FloatArray]:
    """Those unknowns that are not errors of a sensor, and their values."""
    unknowns = unknowns_of(space)
    kept = [k for k, unknown in enumerate(unknowns) if not unknown.per_walk]
    return [unknowns[k] for k in kept], np.asarray(point)[kept]
