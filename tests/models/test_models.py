from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from massid.walking import Morphology, driven_by_servos
from massid.walking.morphology import torque_limits
from massid.walking.stance import sole_pose
from tests.walking.floor import MODELS, SEVEN_LINKS, nominal

MASS_KG = {"atlas": 156.5, "light": 35.0, "heavy": 140.0, "nimble": 35.0, "geared": 68.0}
HEIGHT_M = {"atlas": 1.88, "light": 1.3, "heavy": 1.8, "nimble": 1.42, "geared": 1.84}
MOTORS = {"atlas": 28, "light": 23, "heavy": 22, "nimble": 27, "geared": 23}
TIMESTEP_S = dict.fromkeys(MASS_KG, 0.001) | {"geared": 0.004}
ROBOTS = tuple(MASS_KG)
SERVOED = ("nimble", "geared")

pytestmark = pytest.mark.parametrize("name", ROBOTS)


def at_zero(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = nominal(name)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_mass_height_and_motors_are_as_stated(name: str) -> None:
    model, data = at_zero(name)
    assert_allclose(model.body_mass.sum(), MASS_KG[name], atol=0.05)
    header = (MODELS / f"{name}.xml").read_text(encoding="utf-8").split("-->", 1)[0]
    assert f"{MASS_KG[name]:g} kg" in header
    assert f"{HEIGHT_M[name]:g} m" in header
    tops = [_top(model, data, geom) for geom in range(model.ngeom)]
    assert_allclose(max(tops), HEIGHT_M[name], atol=0.05)
    assert model.nu == MOTORS[name] == model.nv - 6


def _top(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    signs = np.array(list(itertools.product((-1, 1), repeat=3)))
    corners = model.geom_aabb[geom, :3] + signs * model.geom_aabb[geom, 3:]
    world = data.geom_xpos[geom] + corners @ data.geom_xmat[geom].reshape(3, 3).T
    return float(world[:, 2].max())


def test_every_joint_has_an_actuator_with_limits_and_a_range(name: str) -> None:
    model = nominal(name)
    assert int(model.jnt_type[0]) == int(mujoco.mjtJoint.mjJNT_FREE)
    assert model.joint(0).name == "root"
    assert model.body("pelvis").jntadr[0] == 0
    joints = [model.joint(j).name for j in range(1, model.njnt)]
    motors = [model.actuator(a).name for a in range(model.nu)]
    assert sorted(joints) == sorted(motors)
    for actuator in range(model.nu):
        assert model.joint(int(model.actuator_trnid[actuator, 0])).name == motors[actuator]
    assert np.all(model.actuator_gear[:, 0] == 1.0)
    assert np.all(model.actuator_ctrllimited)
    assert driven_by_servos(model, joints) == (name in SERVOED)
    if name in SERVOED:
        assert np.all(model.jnt_actfrclimited[1:])
        assert_allclose(model.jnt_actfrcrange[1:, 1], -model.jnt_actfrcrange[1:, 0])
        assert_allclose(model.actuator_ctrlrange, model.jnt_range[model.actuator_trnid[:, 0]])
        assert np.all(model.dof_frictionloss[6:] > 0.0)
    else:
        assert np.all(model.actuator_forcelimited)
        assert_allclose(model.actuator_ctrlrange[:, 1], -model.actuator_ctrlrange[:, 0])
        assert_allclose(model.actuator_ctrlrange, model.actuator_forcerange)
    limits = torque_limits(model)
    assert np.all((limits > 0.0) & np.isfinite(limits))
    assert np.all(model.jnt_limited[1:])
    low, high = model.jnt_range[1:].T
    assert np.all((low <= 0.0) & (high >= 0.0) & (high - low > 0.3))
    assert np.all(model.dof_armature[6:] > 0.0)
    assert np.all(model.dof_damping[6:] > 0.0)


def test_the_seven_links_weigh_what_the_file_says(name: str) -> None:
    model, spec = nominal(name), mujoco.MjSpec.from_file(str(MODELS / f"{name}.xml"))
    for body in spec.bodies[1:]:
        assert body.explicitinertial, body.name
        assert_allclose(model.body(body.name).mass[0], body.mass)
    for link in SEVEN_LINKS:
        assert model.body(link).mass[0] > 0.2


def test_inertias_are_those_of_solid_bodies(name: str) -> None:
    model = nominal(name)
    principal = np.sort(model.body_inertia[1:], axis=1)
    assert np.all(principal[:, 0] > 0.0)
    assert np.all(principal[:, 0] + principal[:, 1] >= principal[:, 2])


def test_no_link_can_touch_another(name: str) -> None:
    model = nominal(name)
    touching = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0))
    assert all(model.geom(int(g)).name[1:].startswith("_sole") for g in touching)
    assert len(touching) >= 2
    assert np.all(model.geom_contype[touching] == 0)  # the floor's contype meets their conaffinity, nothing else does
    data = mujoco.MjData(model)
    data.qpos[7:] = 0.3 * np.random.default_rng(0).normal(size=model.nq - 7)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


def test_the_right_side_mirrors_the_left(name: str) -> None:
    model, data = at_zero(name)
    limits = torque_limits(model)
    mirror = np.diag([1.0, -1.0, 1.0])
    for body in range(1, model.nbody):
        left = model.body(body).name
        if left.startswith("r_"):
            continue
        if not left.startswith("l_"):
            assert_allclose(data.xipos[body][1], 0.0, atol=1e-12)
            continue
        twin = model.body("r_" + left[2:]).id
        assert_allclose(model.body_mass[twin], model.body_mass[body])
        assert_allclose(data.xipos[twin], mirror @ data.xipos[body], atol=1e-9)
        turned, other = _inertia(model, data, body), _inertia(model, data, twin)
        assert_allclose(other, mirror @ turned @ mirror, atol=1e-6)
    for joint in range(1, model.njnt):
        left = model.joint(joint).name
        if left.startswith("l_"):
            twin = model.joint("r_" + left[2:]).id
            sideways = abs(model.jnt_axis[joint, 1]) > 0.5
            expected = model.jnt_range[joint] if sideways else -model.jnt_range[joint][::-1]
            assert_allclose(model.jnt_range[twin], expected)
            assert limits[twin - 1] == limits[joint - 1]


def _inertia(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> np.ndarray:
    axes = data.ximat[body].reshape(3, 3)
    inertia: np.ndarray = axes @ np.diag(model.body_inertia[body]) @ axes.T
    return inertia


def test_the_soles_are_level_and_on_the_floor(name: str) -> None:
    model, data = at_zero(name)
    for sole in Morphology.from_model(model).soles:
        centre, axes = sole_pose(data, sole)
        assert_allclose(axes, np.eye(3), atol=1e-9)
        assert_allclose(centre, data.site(f"{sole.body_name[0]}_sole_centre").xpos, atol=1e-9)
        assert_allclose(centre[2], 0.0, atol=1e-9)
    for geom in np.flatnonzero(model.geom_conaffinity):
        box, axes = model.geom_type[geom] == int(mujoco.mjtGeom.mjGEOM_BOX), data.geom_xmat[geom].reshape(3, 3)
        lying = axes[2, 2] == 1.0 if box else abs(axes[2, 2]) < 1e-9  # a capsule lies on its side
        assert lying
        assert_allclose(data.geom_xpos[geom, 2] - model.geom_size[geom, 2 if box else 0], 0.0, atol=1e-9)


def test_the_simulation_is_set_up_as_the_plant_wants_it(name: str) -> None:
    option = nominal(name).opt
    assert option.timestep == TIMESTEP_S[name]
    assert int(option.integrator) == int(mujoco.mjtIntegrator.mjINT_EULER)
    assert int(option.cone) == int(mujoco.mjtCone.mjCONE_ELLIPTIC)
    assert option.impratio == 10


def test_dm_control_reads_the_file(name: str) -> None:
    mjcf = pytest.importorskip("dm_control.mjcf", exc_type=ImportError)
    root = mjcf.from_path(str(MODELS / f"{name}.xml"))
    assert len(root.find_all("actuator")) == MOTORS[name]
