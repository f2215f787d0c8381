"""A floating-base robot from MJCF: names, identification model, and the only writer of parameters into a model."""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from massid.bodies import (
    body_fields,
    centre_parameters,
    inertia_parameters,
    inertia_slopes,
    parse_payload,
    payload_parameter,
    unknown_bodies,
)
from massid.errors import LogError, ModelError, unknown_name
from massid.joints import FIELDS, joint_fields, passive_parameter
from massid.kinematics import wrenches_in_bodies
from massid.log.walk import Walk
from massid.model_edit import keep_actuator_dynamics, make_plain_motor, no_single_base, set_options, without_joints
from massid.model_file import one_line, save_model
from massid.parameters import Kind, Parameter, ParameterSpace
from massid.typing import FloatArray, IntArray

WALKING_LINKS = ("torso", "l_thigh", "r_thigh", "l_calf", "r_calf", "l_foot", "r_foot")
"""The links whose masses matter most to walking: what Section V-D identifies."""
WRENCH_SITE_PREFIX = "massid_wrench/"


@dataclass(frozen=True)
class SensorErrors:
    """Slow errors of N models' sensors: reading = (1 + gain) quantity + offset; every leading axis is N.

    Attributes:
        effort_offset: shape (N, n_joints) [N m].
        effort_gain: shape (N, n_joints).
        wrench_offset: shape (N, 6 n_contacts) [N, N m].
        wrench_gain: shape (N, 6 n_contacts).
        encoder_offset: shape (N, n_joints) [rad].
    """

    effort_offset: FloatArray
    effort_gain: FloatArray
    wrench_offset: FloatArray
    wrench_gain: FloatArray
    encoder_offset: FloatArray

    @classmethod
    def none(cls, n: int, n_joints: int, n_contacts: int) -> SensorErrors:
        """Perfect sensors."""
        per_joint, per_axis = (n, n_joints), (n, 6 * n_contacts)
        return cls(
            np.zeros(per_joint), np.zeros(per_joint), np.zeros(per_axis), np.zeros(per_axis), np.zeros(per_joint)
        )


@dataclass(frozen=True)
class Realisation:
    """What N parameter vectors mean for N identification models; every leading axis is N.

    Attributes:
        model_fields: MjModel field name -> values, shape (N, *field shape).
        sensors: what the sensors do wrong; None for nothing.
        inertia_slopes: derivative of its body's pseudo-inertia by each parameter, at the first of the models and in the
            frame of the body, shape (n_p, 4, 4).
    """

    model_fields: Mapping[str, FloatArray]
    sensors: SensorErrors | None
    inertia_slopes: FloatArray


@dataclass(frozen=True)
class JointLayout:
    """Where the free joint and the one-axis joints stand in the model's qpos and qvel."""

    root_qpos: int
    root_dof: int
    joint_qpos: IntArray
    joint_dof: IntArray

    def to_qpos(self, columns: FloatArray) -> FloatArray:
        """Reorder walk columns [base pose, joints] into the model's qpos, shape (..., nq)."""
        qpos = np.empty_like(columns)
        qpos[..., self.root_qpos : self.root_qpos + 7] = columns[..., :7]
        qpos[..., self.joint_qpos] = columns[..., 7:]
        return qpos

    def to_qvel(self, columns: FloatArray) -> FloatArray:
        """Reorder walk columns [base twist, joints] into the model's qvel, shape (..., nv)."""
        qvel = np.empty_like(columns)
        qvel[..., self.root_dof : self.root_dof + 6] = columns[..., :6]
        qvel[..., self.joint_dof] = columns[..., 6:]
        return qvel


class Robot:
    """A robot model with one floating base.

    Attributes:
        spec: the model as loaded; never written to.
        model: its compiled form, with nominal masses.
        source: file name or "spec", for messages.
    """

    def __init__(self, spec: mujoco.MjSpec, source: str = "spec") -> None:
        self.spec = spec
        self.source = source
        try:
            self.model = spec.compile()
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
                f"Body '{link}' of {self.source} {why}.{self._nearest(link)} "
                f"Links with a mass: {', '.join(self.links)}."
            )
        raise ModelError(unknown_name("link", link, self.links, self.source))

    def welded_to(self, link: str) -> str | None:
        """The body that a link without a joint of its own moves with; None for a link that moves by itself."""
        body = self.model.body(link).id
        moving = int(self.model.body_weldid[body])
        return None if moving == body else str(self.model.body(moving).name)

    def _nearest(self, link: str) -> str:
        """Point at the links that come closest: by name, and up the tree."""
        own = [name for name in self.links if self.welded_to(name) is None]
        near = difflib.get_close_matches(link, own, n=2, cutoff=0.5)
        body = self.model.body(link).id
        while body:
            body = int(self.model.body_parentid[body])
            if self.model.body(body).name in own:
                near.append(self.model.body(body).name)
                break
        return f" Did you mean {', '.join(dict.fromkeys(near))}?" if near else ""

    def mass_space(self, links: Iterable[str], *, welded_too: bool = False) -> ParameterSpace:
        """Span the masses of the named links, each within the default Theta.

        Args:
            links: names of bodies.
            welded_too: also take bodies without a joint of their own, which a log can hardly tell from their parent.

        Raises:
            ModelError: a name is not a link with a mass, or moves with another body.
            BadInputError: no links, or a link named twice.
        """
        links = tuple(links)
        for link in links:
            self._check_link(link, welded_too)
        return ParameterSpace(tuple(Parameter.mass(link, self.nominal_mass_kg(link)) for link in links))

    def parameter_space(
        self,
        links: Iterable[str],
        *,
        com: Iterable[str] = (),
        inertia: Iterable[str] = (),
        payload: Iterable[str] = (),
        friction: Iterable[str] = (),
        damping: Iterable[str] = (),
    ) -> ParameterSpace:
        """Span masses, and what else is unknown of the robot's bodies and joints.

        Args:
            links: whose mass is unknown.
            com: links whose centre of mass is unknown.
            inertia: links whose rotational inertia is unknown beyond its scaling with the mass.
            payload: point masses of unknown size, BODY or BODY@X,Y,Z in the frame of the body [m].
            friction: joints whose friction loss is unknown.
            damping: joints whose viscous damping is unknown.

        Raises:
            ModelError: a name is not a link with a mass, or moves with another body; a payload on what does not move;
                an inertia without thickness; no such joint, or actuators that damp joints, too.
            BadInputError: no links, something named twice, or a point that is not three numbers.
        """
        parameters = list(self.mass_space(links).parameters)
        for group, make in ((com, centre_parameters), (inertia, inertia_parameters)):
            for link in group:
                self._check_link(link)
                parameters += make(self.model, link)
        for text in payload:
            self._check_carrier(parse_payload(text)[0])
            parameters.append(payload_parameter(self.model, text, self.total_mass_kg))
        weight_n = self.total_mass_kg * float(np.linalg.norm(self.model.opt.gravity))
        for kind, joints in ((Kind.FRICTION, friction), (Kind.DAMPING, damping)):
            for joint in joints:
                self._check_joint(joint)
                parameters.append(passive_parameter(self.model, kind, joint, weight_n))
        return ParameterSpace(tuple(parameters))

    def _check_link(self, link: str, welded_too: bool = False) -> None:
        """Refuse what has no mass of its own or moves with another body."""
        nominal_kg = self.nominal_mass_kg(link)
        other = self.welded_to(link)
        if other is not None and not welded_too:
            raise ModelError(
                f"Body '{link}' of {self.source} ({nominal_kg:.3g} kg) moves with '{other}': there is no joint "
                f"between them, so weigh '{other}'.{self._nearest(link)}"
            )

    def _check_joint(self, joint: str) -> None:
        """Refuse what is no joint, and dampers that are not the joints' own."""
        if joint not in self.joint_names:
            raise ModelError(unknown_name("joint", joint, self.joint_names, self.source))
        if not np.array_equal(self.identification_model(()).dof_damping, self.model.dof_damping):
            raise ModelError(
                f"{self.source}: actuators damp joints, too; give that damping to the joints to have it identified."
            )

    def _check_carrier(self, name: str) -> None:
        """Refuse bodies that carry nothing through a walk."""
        model = self.model
        moving = [model.body(b).name for b in range(1, model.nbody) if model.body_dofnum[model.body_weldid[b]] > 0]
        if name not in moving:
            raise ModelError(unknown_name("moving body", name, moving, self.source))

    def realise(self, space: ParameterSpace, points: FloatArray, contact_bodies: Sequence[str] = ()) -> Realisation:
        """Translate parameter vectors into model fields and sensor errors.

        A mass scales the rotational inertia of its link with it and leaves the centre of mass, as for a link whose
        density is uncertain. Inertia is that about the centre of mass, wherever it is; payloads come on top.

        Args:
            space: what each coordinate means.
            points: shape (N, n_p).
            contact_bodies: bodies whose wrench is measured, in the order of the identification model's controls.
        """
        points = np.atleast_2d(points)
        bodies = unknown_bodies(self.model, space)
        sensors: SensorErrors | None = None
        for parameter, values in zip(space.parameters, points.T, strict=True):
            if parameter.is_inertial or parameter.is_passive:
                continue
            sensors = sensors or SensorErrors.none(len(points), len(self.joint_names), len(contact_bodies))
            errors: FloatArray = getattr(sensors, parameter.kind.value)
            errors[:, self.sensor_column(parameter, contact_bodies)] = values
        fields = {**body_fields(self.model, bodies, points), **joint_fields(self.model, space, points)}
        return Realisation(fields, sensors, inertia_slopes(bodies, space, points[0]))

    def sensor_column(self, parameter: Parameter, contact_bodies: Sequence[str]) -> int:
        """Column of a sensor error: the joint's number, or six times the contact body's number plus the axis."""
        if parameter.kind in (Kind.WRENCH_OFFSET, Kind.WRENCH_GAIN):
            body, _, axis = parameter.target.rpartition("/")
            return 6 * list(contact_bodies).index(body) + int(axis)
        return self.joint_names.index(parameter.target)

    def model_at(self, space: ParameterSpace, point: FloatArray) -> mujoco.MjModel:
        """Compile a copy of the full model (actuators, contacts) with the parameters of one point in it."""
        model = self.spec.copy().compile()
        write_fields(model, self.realise(space, point))
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
        spec = self.spec.copy()
        keep_actuator_dynamics(spec)
        for group in (spec.keys, spec.actuators, spec.sensors, spec.tuples):
            for element in list(group):
                spec.delete(element)
        for body_name in contact_bodies:
            body = spec.body(body_name)
            if body is None:
                bodies = (self.model.body(b).name for b in range(1, self.model.nbody))
                raise ModelError(unknown_name("contact body", body_name, bodies, self.source))
            site = body.add_site(name=f"{WRENCH_SITE_PREFIX}{body_name}")
            for axis in range(6):
                gear = np.zeros(6)
                gear[axis] = 1.0
                motor = spec.add_actuator(
                    name=f"{site.name}/{axis}", trntype=mujoco.mjtTrn.mjTRN_SITE, target=site.name, gear=gear
                )
                make_plain_motor(motor)
        set_options(spec.option)
        try:
            return spec.compile()
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
            if name not in self.joint_names:
                raise ModelError(unknown_name("joint", name, self.joint_names, self.source))
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
        """Save the model with the parameters of one point in its masses and inertias.

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
        fields = self.realise(space, point).model_fields
        compiler = spec.compiler
        rescaled = compiler.settotalmass > 0 or compiler.boundmass > 0 or compiler.boundinertia > 0
        if rescaled or compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
            targets = list(range(1, self.model.nbody))
            compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
            compiler.settotalmass, compiler.boundmass, compiler.boundinertia = -1.0, 0.0, 0.0
        else:
            targets = [self.model.body(p.body).id for p in space.parameters if p.is_inertial]
        ipos = fields.get("body_ipos", self.model.body_ipos[None])
        iquat = fields.get("body_iquat", self.model.body_iquat[None])
        for body_id in targets:
            name = self.model.body(body_id).name
            body = spec.body(name) if name else spec.bodies[body_id]
            body.explicitinertial = True
            body.mass = float(fields["body_mass"][0, body_id])
            body.ipos = ipos[0, body_id]
            body.iquat = iquat[0, body_id]
            body.inertia = fields["body_inertia"][0, body_id]
            body.fullinertia = np.full(6, np.nan)
        for parameter in space.parameters:
            if parameter.is_passive:
                joint = spec.joint(parameter.target)
                value = float(fields[FIELDS[parameter.kind]][0, self.model.joint(parameter.target).dofadr[0]])
                if parameter.kind is Kind.FRICTION:
                    joint.frictionloss = value
                else:
                    joint.damping = np.eye(len(joint.damping))[0] * value
        save_model(spec, path, fields["body_mass"][0], remark)


def write_fields(model: mujoco.MjModel, realisation: Realisation, index: int = 0) -> None:
    """Write one row of a realisation into a compiled model and refresh what the engine derives from it."""
    for name, values in realisation.model_fields.items():
        getattr(model, name)[:] = values[index]
    mujoco.mj_setConst(model, mujoco.MjData(model))


def file_sha256(path: Path) -> str:
    """SHA-256 of a model file, to recognise it in a log's metadata."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
