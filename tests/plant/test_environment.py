import copy
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from massid.assets import shipped_models
from massid.errors import BadInputError, ModelError
from massid.model.robot import Robot
from massid.plant import HiddenMasses, Integrator, PlantOptions, make_environment, motorised, variant

WORLD = """
<mujoco model="desk">
  <compiler meshdir="shapes" inertiafromgeom="true" boundmass="0.01"/>
  <option timestep="0.002" integrator="implicitfast" gravity="0 0 -3.7" noslip_iterations="4"/>
  <size njmax="500"/>
  <default><motor ctrlrange="-1 1" ctrllimited="true"/><geom density="700"/></default>
  <asset><mesh name="wedge" file="wedge.obj"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="ground" type="plane" size="1 1 1"/>
    <body name="ball" pos="1 0 1"><geom size="0.1"/></body>
    <body name="trunk" pos="0 0 0.5" euler="0 0 90">
      <freejoint/>
      <geom type="mesh" mesh="wedge"/>
      <body name="arm" pos="0.2 0 0">
        <joint name="elbow" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.04"/>
        <body name="tail" pos="0.3 0 0"><joint name="wag" axis="0 0 1"/><geom size="0.05"/></body>
      </body>
    </body>
  </worldbody>
  <actuator><position name="bend" joint="elbow" kp="10" gear="3"/></actuator>
  <sensor><framepos objtype="body" objname="ball"/></sensor>
  <keyframe><key name="home" qpos="0 0 1 1 0 0 0 0 0"/></keyframe>
</mujoco>
"""
WEDGE = "v 0 0 0\nv 0.2 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def desk(tmp_path: Path) -> Robot:
    (tmp_path / "shapes").mkdir()
    (tmp_path / "shapes" / "wedge.obj").write_text(WEDGE)
    (tmp_path / "desk.xml").write_text(WORLD)
    return Robot.load(tmp_path / "desk.xml")


def test_timesteps_agree_with_the_specs(atlas: Robot) -> None:
    environment = make_environment(atlas, options=PlantOptions(feet=("l_foot", "r_foot")))
    actions, seen, discount = environment.action_spec(), environment.observation_spec(), environment.discount_spec()
    assert actions.shape == (28,)
    assert {name: spec.shape for name, spec in seen.items()} == {
        "atlas/qpos": (35,),
        "atlas/qvel": (34,),
        "atlas/foot_load": (2,),
    }
    timestep = environment.reset()
    assert timestep.first()
    assert timestep.reward is None
    for _ in range(5):
        timestep = environment.step(actions.generate_value())
        assert timestep.mid()
        environment.reward_spec().validate(timestep.reward)
        discount.validate(timestep.discount)
        for name, spec in seen.items():
            spec.validate(timestep.observation[name])
    assert environment.physics.time() == pytest.approx(5 * environment.control_timestep())


def test_a_robot_without_torques_falls_and_can_be_reset(atlas: Robot) -> None:
    environment = make_environment(atlas)
    timestep = environment.reset()
    rewards = []
    while not timestep.last():
        timestep = environment.step(np.zeros(28))
        rewards.append(timestep.reward)
    assert timestep.discount == 0.0
    assert rewards[0] == pytest.approx(1.0, abs=1e-3)
    assert rewards[-1] < 0.6
    assert environment.step(np.zeros(28)).first()


@pytest.mark.parametrize("name", sorted(shipped_models()))
def test_the_world_has_the_numbers_of_the_robots_file(name: str) -> None:
    robot = Robot.load(shipped_models()[name])
    environment = make_environment(robot)
    world = environment.physics.model.ptr
    ours, theirs = _moving(robot.with_all_seen()), _moving(world)
    assert ours["names"] == theirs["names"]
    for field in ours.keys() - {"names"}:
        np.testing.assert_array_equal(theirs[field], ours[field], err_msg=field)
    for option in ("timestep", "integrator", "cone", "impratio", "solver"):
        assert getattr(world.opt, option) == getattr(robot.model.opt, option), option
    assert world.opt.noslip_iterations == 0
    # The free joint's frame is a body of its own, but the root sits in it without an offset.
    np.testing.assert_array_equal(world.body(f"{_prefix(world)}{robot.root_body}").pos, 0.0)
    np.testing.assert_allclose(world.body_invweight0[-1], robot.model.body_invweight0[-1], rtol=1e-12)


def test_the_world_has_the_true_masses_also_after_a_reset(atlas: Robot) -> None:
    environment = make_environment(atlas, HiddenMasses({"torso": 3.0, "l_foot": -1.0}))
    for _ in range(2):
        environment.reset()
        model = environment.physics.model.ptr
        assert model.body("atlas/torso").mass[0] == atlas.nominal_mass_kg("torso") + 3.0
        assert model.body("atlas/l_foot").mass[0] == atlas.nominal_mass_kg("l_foot") - 1.0
        assert model.body_subtreemass[0] == pytest.approx(atlas.total_mass_kg + 2.0)


def test_the_surroundings_in_a_users_file_are_left_out(desk: Robot) -> None:
    environment = make_environment(desk)
    model = environment.physics.model.ptr
    assert [model.body(b).name for b in range(model.nbody)] == [
        "world",
        "desk/",
        "desk/trunk",
        "desk/arm",
        "desk/tail",
    ]
    assert model.opt.gravity[2] == -3.7
    assert model.opt.timestep == 0.002
    assert model.opt.noslip_iterations == 0  # they change velocities behind the back of the logged forces
    assert environment.action_spec().name == "desk/elbow"  # the joint without an actuator gets none
    # A position servo without a force limit of its own: gain x control range x gear, as a torque.
    assert environment.action_spec().maximum == 10 * 1 * 3
    np.testing.assert_array_equal(model.body("desk/trunk").inertia, desk.model.body("trunk").inertia)
    np.testing.assert_array_equal(environment.reset().observation["desk/qpos"], desk.model.qpos0)


def test_a_control_is_a_joint_torque(atlas: Robot) -> None:
    spec = atlas.spec.copy()
    for actuator in spec.actuators:
        actuator.gear[0], actuator.ctrlrange = 50.0, np.array(actuator.ctrlrange) / 50.0
    robot = motorised(Robot(spec))
    environment = make_environment(robot)
    np.testing.assert_allclose(environment.action_spec().maximum[:3], [106, 445, 300])
    environment.reset()
    action = np.linspace(-20.0, 20.0, 28)
    environment.step(action)
    np.testing.assert_allclose(environment.physics.data.qfrc_actuator[6:], action, rtol=1e-14)


def test_variant_changes_integrator_and_friction(atlas: Robot) -> None:
    changed = variant(atlas, Integrator.IMPLICITFAST, friction_loss_nm=1.5)
    assert changed.model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    np.testing.assert_array_equal(changed.model.dof_frictionloss, [0] * 6 + [1.5] * 28)
    assert not atlas.model.dof_frictionloss.any()
    environment = make_environment(changed)
    world = environment.physics.model.ptr
    assert world.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    np.testing.assert_array_equal(world.dof_frictionloss, changed.model.dof_frictionloss)


def test_variant_takes_friction_by_joint(atlas: Robot) -> None:
    some = variant(variant(atlas, friction_loss_nm=1.0), friction_loss_nm={"l_leg_kny": 5.0})
    assert some.model.joint("l_leg_kny").frictionloss[0] == 5.0
    assert some.model.joint("r_leg_kny").frictionloss[0] == 1.0
    with pytest.raises(ModelError, match="no joint named 'l_leg_knee'"):
        variant(atlas, friction_loss_nm={"l_leg_knee": 5.0})


def test_foot_loads_are_those_of_the_engine(atlas: Robot) -> None:
    environment = make_environment(atlas, options=PlantOptions(feet=("l_foot", "r_foot")))
    environment.reset()
    loads = environment.step(np.zeros(28)).observation["atlas/foot_load"]
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    expected = np.zeros(2)
    force = np.zeros(6)
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, force)
        foot = model.body(int(model.geom_bodyid[data.contact[i].geom2])).name
        expected[("atlas/l_foot", "atlas/r_foot").index(foot)] += force[0]  # the floor is level
    assert data.ncon > 0
    np.testing.assert_allclose(loads, expected, rtol=1e-12)


def test_bad_requests_are_named(atlas: Robot) -> None:
    with pytest.raises(ModelError, match="no link named 'l_hoof'"):
        make_environment(atlas, options=PlantOptions(feet=("l_hoof",)))
    with pytest.raises(BadInputError, match="must be above zero"):
        PlantOptions(control_period_s=0.0)
    spec = atlas.spec.copy()
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    with pytest.raises(ModelError, match="no joint has an actuator"):
        make_environment(Robot(spec, "limp.xml"))


def test_importing_the_plant_leaves_warning_filters_alone() -> None:
    code = "before = list(warnings.filters); import massid.plant; sys.exit(before != list(warnings.filters))"
    done = subprocess.run(  # without DISPLAY and MUJOCO_GL
        [sys.executable, "-W", "error", "-c", f"import sys, warnings, mujoco, massid.walking, massid.log; {code}"],
        capture_output=True,
        text=True,
        check=False,
        env={"PATH": "/usr/bin:/bin"},
    )
    assert (done.returncode, done.stderr) == (0, "")


def _moving(model: mujoco.MjModel) -> dict[str, Any]:
    """Names and numbers of everything that moves and collides."""
    prefix = _prefix(model)
    bodies = [b for b in range(1, model.nbody) if model.body_mass[b] > 0]
    geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] in bodies]
    fields: dict[str, Any] = {"names": [model.body(b).name.removeprefix(prefix) for b in bodies]}
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_gravcomp"):
        fields[field] = copy.copy(getattr(model, field)[bodies])
    for field in ("body_pos", "body_quat"):
        fields[field] = getattr(model, field)[bodies[1:]]
    for field in ("dof_armature", "dof_damping", "dof_frictionloss", "dof_solref", "dof_solimp", "jnt_range"):
        fields[field] = getattr(model, field)
    for field in ("jnt_axis", "jnt_pos", "jnt_stiffness", "jnt_limited", "jnt_solref", "jnt_solimp", "qpos_spring"):
        fields[field] = getattr(model, field)
    for field in ("geom_pos", "geom_quat", "geom_size", "geom_friction", "geom_contype", "geom_conaffinity"):
        fields[field] = getattr(model, field)[geoms]
    for field in ("geom_condim", "geom_solref", "geom_solimp", "geom_margin"):
        fields[field] = getattr(model, field)[geoms]
    return fields


def _prefix(model: mujoco.MjModel) -> str:
    name = model.body(1).name
    return name if name.endswith("/") else ""
