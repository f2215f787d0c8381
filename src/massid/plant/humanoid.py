"""The robot and its floor as dm_control composer entities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from massid.errors import ModelError, unknown_name
from massid.model.robot import Robot
from massid.plant.backend import composer, mjcf, observable
from massid.plant.contacts import LoadCells
from massid.plant.parts import RobotParts
from massid.plant.transplant import transplant
from massid.typing import FloatArray

_FLOOR_HALF_SIZE_M = 30.0


class Floor(composer.Arena):  # type: ignore[misc]
    """An endless plane under a light. It brings no engine options: those are the robot's."""

    def _build(self, name: str = "floor") -> None:
        self._mjcf_root = mjcf.RootElement(model=name)
        root = self._mjcf_root
        root.asset.add(
            "texture", name="sky", type="skybox", builtin="gradient", rgb1=(0.5, 0.6, 0.7), rgb2=(0.1, 0.1, 0.15),
            width=256, height=256,
        )  # fmt: skip
        root.asset.add(
            "texture", name="tiles", type="2d", builtin="checker", rgb1=(0.42, 0.44, 0.46), rgb2=(0.36, 0.38, 0.4),
            width=256, height=256,
        )  # fmt: skip
        root.asset.add("material", name="tiles", texture="tiles", texrepeat=(1, 1), texuniform=True, reflectance=0.1)
        half = _FLOOR_HALF_SIZE_M
        root.worldbody.add("geom", name="floor", type="plane", size=(half, half, 0.1), material="tiles")
        root.worldbody.add("light", name="sun", pos=(0, 0, 4), dir=(0.3, 0.4, -1), directional="true")


class Humanoid(composer.Entity):  # type: ignore[misc]
    """A robot whose compiled model has the true masses and, apart from them, the numbers of its own file.

    Its controls are torques [N m] of its joints, in model order.

    Args:
        robot: alone and motorised, with nominal masses; see `massid.plant.embodiment`.
        true_model: the same with true masses, a compiled model.
        feet: bodies whose vertical load is observed.
    """

    def _build(self, robot: Robot, true_model: mujoco.MjModel, feet: Sequence[str] = ()) -> None:
        for foot in feet:
            if foot not in robot.links:
                raise ModelError(unknown_name("link", foot, robot.links, robot.source))
        self._robot, self._true_model, self._feet = robot, true_model, tuple(feet)
        self._mjcf_root = _without_free_joint(robot)
        self._parts: RobotParts | None = None
        self._load_cells: LoadCells | None = None

    def _build_observables(self) -> HumanoidObservables:
        observables = HumanoidObservables(self)
        observables.enable_all()
        return observables

    @property
    def mjcf_model(self) -> Any:
        """The robot without its free joint, for the arena to attach."""
        return self._mjcf_root

    @property
    def robot(self) -> Robot:
        """The robot with nominal masses."""
        return self._robot

    @property
    def parts(self) -> RobotParts:
        """Where the robot is in the compiled world."""
        if self._parts is None:
            raise ModelError("The robot is not in a compiled world yet.")
        return self._parts

    def place(self, frame: Any) -> None:
        """Stand the frame that the arena gave the robot where the robot's file stands its root."""
        root = self._robot.model.body(self._robot.root_body)
        frame.pos, frame.quat = root.pos, root.quat

    def after_compile(self, physics: Any, random_state: Any) -> None:
        """Give the world's model the true masses and the numbers of the robot's own file."""
        del random_state
        model = physics.model.ptr
        transplant(self._true_model, model)
        self._parts = RobotParts.find(model, self._robot.root_body)
        names = list(self._parts.body_names)
        feet = np.array([self._parts.body_ids[names.index(foot)] for foot in self._feet], dtype=np.int64)
        self._load_cells = LoadCells(model, feet)

    def qpos(self, physics: Any) -> FloatArray:
        """Root pose and joint positions in the order of the robot's own model, shape (nq,).

        The world holds nothing else that moves, so its order is the robot's.
        """
        qpos: FloatArray = physics.data.qpos
        return qpos

    def qvel(self, physics: Any) -> FloatArray:
        """Root twist and joint velocities in the order of the robot's own model, shape (nv,)."""
        qvel: FloatArray = physics.data.qvel
        return qvel

    def foot_load(self, physics: Any) -> FloatArray:
        """Vertical force on each foot over the last physics step [N], shape (n_feet,)."""
        if self._load_cells is None:
            raise ModelError("The robot is not in a compiled world yet.")
        return self._load_cells.read(physics.data.ptr)


class HumanoidObservables(composer.Observables):  # type: ignore[misc]
    """What a controller of the robot may sense."""

    @composer.observable  # type: ignore[untyped-decorator]
    def qpos(self) -> Any:
        """Root position [m], attitude (wxyz), joint positions [rad or m]."""
        return observable.Generic(self._entity.qpos)

    @composer.observable  # type: ignore[untyped-decorator]
    def qvel(self) -> Any:
        """Root velocity in the world [m/s] and turn rate in its frame [rad/s], joint velocities."""
        return observable.Generic(self._entity.qvel)

    @composer.observable  # type: ignore[untyped-decorator]
    def foot_load(self) -> Any:
        """Vertical force on each foot [N]."""
        return observable.Generic(self._entity.foot_load)


def _without_free_joint(robot: Robot) -> Any:
    """The robot's MJCF as an attachable composer model: no free joint, no root pose, no options of its own."""
    try:
        root = mjcf.from_xml_string(robot.spec.to_xml(), model_dir=robot.spec.modelfiledir)
        body = root.find("body", robot.root_body)
        for joint in list(body.all_children()):
            if joint.tag == "freejoint" or (joint.tag == "joint" and joint.type == "free"):
                joint.remove()
    except (ValueError, OSError, AttributeError, KeyError) as error:
        text = " ".join(str(error).split())
        raise ModelError(f"{robot.source}: dm_control cannot take the robot into its world: {text}") from error
    body.pos = (0, 0, 0)
    del body.quat
    for element in (root.option, root.statistic, root.visual, root.size):
        element.remove()
    return root
