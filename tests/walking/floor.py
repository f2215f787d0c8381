"""A plain simulation for the walker's tests: a robot on a plane, nothing else."""

from pathlib import Path

import mujoco
import numpy as np

from massid.typing import FloatArray
from massid.walking import ServoWalker, Walker

MODELS = Path(__file__).parents[2] / "models"
SEVEN_LINKS = ("torso", "l_thigh", "r_thigh", "l_calf", "r_calf", "l_foot", "r_foot")


def nominal(name: str) -> mujoco.MjModel:
    """The robot alone, as its file says."""
    return mujoco.MjModel.from_xml_path(str(MODELS / f"{name}.xml"))


def on_floor(name: str, mass_factors: dict[str, float] | None = None) -> mujoco.MjModel:
    """The robot on a plane; the masses and inertias of some bodies multiplied."""
    spec = mujoco.MjSpec.from_file(str(MODELS / f"{name}.xml"))
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    for body, factor in (mass_factors or {}).items():
        spec.body(body).mass *= factor
        spec.body(body).fullinertia = np.array(spec.body(body).fullinertia) * factor
        spec.body(body).inertia = np.array(spec.body(body).inertia) * factor
    return spec.compile()


def error_factors(model: mujoco.MjModel, norm_kg: float, rng: np.random.Generator) -> dict[str, float]:
    """Mass factors of the seven links for an error of a given norm in a random direction, within [0.3, 2.5]."""
    masses = np.array([model.body(b).mass[0] for b in SEVEN_LINKS])
    while True:
        direction = rng.normal(size=len(masses))
        factors = 1 + norm_kg * direction / np.linalg.norm(direction) / masses
        if np.all((factors > 0.3) & (factors < 2.5)):
            return dict(zip(SEVEN_LINKS, factors.tolist(), strict=True))


class Plant:
    """A robot on a plane, stepped with torques in joint order."""

    def __init__(self, model: mujoco.MjModel, walker: Walker | ServoWalker) -> None:
        self.model, self.walker = model, walker
        self.data = mujoco.MjData(model)
        self.data.qpos[:] = walker.initial_qpos()
        self._motors = np.array([model.actuator(name).id for name in walker.joint_names])
        feet = [model.body(name).id for name in walker.foot_names]
        moving = model.body_weldid[model.geom_bodyid]
        self._side = {int(g): i for i, b in enumerate(feet) for g in np.flatnonzero(moving == b)}
        self._force = np.zeros(6)
        self.foot_load_n = np.zeros(2)

    def step(self) -> None:
        """One time step: torques from the present state and the foot loads of the last step."""
        data = self.data
        data.ctrl[self._motors] = self.walker.control(data.time, data.qpos, data.qvel, self.foot_load_n)
        mujoco.mj_step(self.model, data)
        self.foot_load_n = self._foot_load()

    def run(self, duration_s: float) -> bool:
        """Walk until the duration is over or the robot falls; True if it did not fall."""
        while self.data.time < duration_s:
            self.step()
            if self.walker.has_fallen(self.data.qpos):
                return False
        return True

    def _foot_load(self) -> FloatArray:
        """Vertical force on each foot [N]."""
        load = np.zeros(2)
        for i in range(self.data.ncon):
            mujoco.mj_contactForce(self.model, self.data, i, self._force)
            load[self._side[int(self.data.contact[i].geom2)]] += self._force[0]
        return load
