"""The plant as a dm_env environment: a robot with hidden masses on a floor, moved by joint torques."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from massid.errors import BadInputError
from massid.model.robot import Robot
from massid.plant.backend import composer
from massid.plant.embodiment import motorised
from massid.plant.humanoid import Floor, Humanoid
from massid.plant.masses import HiddenMasses
from massid.typing import FloatArray


@dataclass(frozen=True)
class PlantOptions:
    """Settings of the plant.

    Attributes:
        control_period_s: an action is held at least this long: as many whole physics steps as fit, one at least.
        feet: bodies whose vertical load is observed.
        fallen_height: share of the initial root height below which the robot has fallen.
        fallen_tilt_rad: lean of the root beyond which it has fallen.
    """

    control_period_s: float = 0.002
    feet: tuple[str, ...] = ()
    fallen_height: float = 0.6
    fallen_tilt_rad: float = 1.0

    def __post_init__(self) -> None:
        if not self.control_period_s > 0.0:
            raise BadInputError(f"The control period is {self.control_period_s} s; it must be above zero.")


class StayUp(composer.Task):  # type: ignore[misc]
    """Stay on your feet: the reward is how upright and how high the root is; a fall ends the episode.

    Args:
        humanoid: not attached to anything yet.
        initial_qpos: pose at the beginning, in the order of the robot's own model; None for that of its file.
        options: settings.
    """

    def __init__(self, humanoid: Humanoid, initial_qpos: FloatArray | None, options: PlantOptions) -> None:
        self._floor = Floor()
        self._humanoid = humanoid
        humanoid.place(self._floor.add_free_entity(humanoid))
        self._initial_qpos: FloatArray = np.array(humanoid.robot.model.qpos0 if initial_qpos is None else initial_qpos)
        self._options = options
        self._height, self._uprightness = 1.0, 1.0
        timestep_s = float(humanoid.robot.model.opt.timestep)
        steps = max(1, int(options.control_period_s / timestep_s + 1e-9))
        self.set_timesteps(control_timestep=steps * timestep_s, physics_timestep=timestep_s)

    @property
    def root_entity(self) -> Any:
        """The floor, to which the robot is attached."""
        return self._floor

    @property
    def humanoid(self) -> Humanoid:
        """The robot."""
        return self._humanoid

    def initialize_episode(self, physics: Any, random_state: Any) -> None:
        """Place the robot."""
        del random_state
        physics.data.qpos[:] = self._initial_qpos
        self._assess(physics)

    def after_step(self, physics: Any, random_state: Any) -> None:
        """See how the robot stands."""
        del random_state
        self._assess(physics)

    def get_reward(self, physics: Any) -> float:
        """Between 0 (lying) and 1 (standing)."""
        del physics
        return min(max(self._height, 0.0), 1.0) * max(0.0, self._uprightness)

    def should_terminate_episode(self, physics: Any) -> bool:
        """Whether the robot has fallen."""
        del physics
        return self._height < self._options.fallen_height or self._uprightness < math.cos(self._options.fallen_tilt_rad)

    def get_discount(self, physics: Any) -> float:
        """0 after a fall, else 1."""
        return 0.0 if self.should_terminate_episode(physics) else 1.0

    def _assess(self, physics: Any) -> None:
        """Take the root's height relative to the initial one, and the cosine of its lean."""
        z, _, x, y = map(float, physics.data.qpos[2:6])
        self._height = z / float(self._initial_qpos[2])
        self._uprightness = 1.0 - 2.0 * (x * x + y * y)


def make_environment(
    robot: Robot,
    hidden: HiddenMasses | None = None,
    *,
    initial_qpos: FloatArray | None = None,
    options: PlantOptions | None = None,
    time_limit_s: float = float("inf"),
) -> Any:
    """Build the plant.

    Args:
        robot: with nominal masses, as loaded from its file; its surroundings in that file are left out.
        hidden: mass errors of the simulated robot; None for none.
        initial_qpos: pose at the beginning of an episode, in the order of the robot's own model, shape (nq,).
        options: settings.
        time_limit_s: longest episode [s].

    Returns:
        A `dm_control.composer.Environment`. Actions are joint torques [N m]; `task.humanoid` is the robot. Physics
        does without dm_control's legacy order: forces and contacts in `physics.data` belong to the step just made.

    Raises:
        ModelError: the robot cannot be simulated, or lacks a name.
        BadInputError: a hidden mass is outside Theta.
    """
    alone = motorised(robot)
    options = options or PlantOptions()
    humanoid = Humanoid(alone, (hidden or HiddenMasses()).true_model(alone), options.feet)
    return composer.Environment(
        StayUp(humanoid, initial_qpos, options),
        time_limit=time_limit_s,
        random_state=0,
        strip_singleton_obs_buffer_dim=True,
        recompile_mjcf_every_episode=False,
        legacy_step=False,
    )
