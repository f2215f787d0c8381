"""Online against offline on a humanoid whose torso is slowly filled while it walks (Section IV-B's claim)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dm_env
import mujoco
import numpy as np

from massid.errors import FallError
from massid.identify import IdentifyOptions
from massid.log import read_walk
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.paper.setting import Progress, silent
from massid.plant import PlantOptions, WalkerAgent, make_environment, motorised, record
from massid.typing import FloatArray
from massid.walking import Walker, find_gait
from massid.weighing import weigh

LINK = "torso"
RATE_KG_S = 0.25
DURATION_S = 12.0


@dataclass(frozen=True)
class WalkDrift:
    """What came of it.

    Attributes:
        times_s: end of each window, shape (n,).
        true_kg: mass of the torso at those times, shape (n,).
        online_kg: estimate of each window, shape (n,).
        offline_kg: the one estimate from the whole log.
        online_error_kg: L2 error of all links, shape (n,).
        offline_error_kg: the same of the one estimate, against the masses at those times, shape (n,).
    """

    times_s: FloatArray
    true_kg: FloatArray
    online_kg: FloatArray
    offline_kg: float
    online_error_kg: FloatArray
    offline_error_kg: FloatArray


class FillingAgent:
    """Walks, and makes a link heavier before every action.

    Args:
        agent: walks.
        environment: whose robot grows heavier.
        robot: with the masses that it starts with.
        link: the link that is filled; its inertia grows with its mass.
        rate_kg_s: how fast [kg/s].
    """

    def __init__(
        self,
        agent: Callable[[dm_env.TimeStep], FloatArray],
        environment: Any,
        robot: Robot,
        link: str,
        rate_kg_s: float,
    ) -> None:
        self._agent, self._environment, self._robot = agent, environment, robot
        self._space = mass_space(robot, [link])
        self._rate_kg_s = rate_kg_s

    def __call__(self, timestep: dm_env.TimeStep) -> FloatArray:
        """Torques for what the plant shows."""
        physics = self._environment.physics
        prefix = self._environment.task.humanoid.mjcf_model.model
        model: mujoco.MjModel = physics.model.ptr
        (link,) = self._space.parameters
        body = model.body(f"{prefix}/{link.target}").id
        mass_kg = link.nominal + self._rate_kg_s * float(physics.data.time)
        model.body_inertia[body] *= mass_kg / model.body_mass[body]
        model.body_mass[body] = mass_kg
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return self._agent(timestep)


def record_filling(robot: Robot, log: Path, seed: int = 0, progress: Progress = silent) -> None:
    """Record a walk of a robot that has its nominal masses at the beginning and a heavier torso at the end.

    Raises:
        FallError: the robot fell.
    """
    walker = Walker(motorised(robot).model, find_gait("random"), np.random.default_rng(seed))
    environment = make_environment(
        robot, initial_qpos=walker.initial_qpos(), options=PlantOptions(feet=walker.foot_names)
    )
    agent = FillingAgent(WalkerAgent(walker, environment), environment, robot, LINK, RATE_KG_S)
    try:
        recording = record(environment, agent, log, DURATION_S, contact_bodies=walker.foot_names, progress=progress)
    finally:
        environment.close()
    if recording.terminated:
        raise FallError(f"The robot fell after {recording.duration_s:.1f} s; try another --seed.")


def run_walk_drift(robot: Robot, folder: Path, seed: int = 0, progress: Progress = silent) -> WalkDrift:
    """Record the walk and identify the masses of the walking links online and offline.

    Args:
        robot: with nominal masses.
        folder: where the log is written.
        seed: of gait and search.
        progress: told the fraction done.

    Raises:
        FallError: the robot fell.
    """
    log = folder / "filling_walk.mcap"
    record_filling(robot, log, seed, lambda fraction, what: progress(0.7 * fraction, what))
    walk = read_walk(log)
    links = robot.walking_links()
    options = IdentifyOptions(seed=seed)
    progress(0.7, "drift, online")
    online = weigh(walk, robot, links, mode="online", held_out=0.0, checks=False, options=options)
    progress(0.9, "drift, offline")
    offline = weigh(walk, robot, links, mode="offline", held_out=0.0, checks=False, options=options)
    times = np.array([window.time_s for window in online.windows])
    truths = np.tile([robot.nominal_mass_kg(link) for link in links], (len(times), 1))
    column = links.index(LINK)
    truths[:, column] += RATE_KG_S * times
    estimates = np.array([window.estimate for window in online.windows])
    one = np.array([offline.estimate_kg[link] for link in links])
    return WalkDrift(
        times_s=times,
        true_kg=truths[:, column],
        online_kg=estimates[:, column],
        offline_kg=float(one[column]),
        online_error_kg=np.asarray(np.linalg.norm(estimates - truths, axis=1)),
        offline_error_kg=np.asarray(np.linalg.norm(one - truths, axis=1)),
    )
