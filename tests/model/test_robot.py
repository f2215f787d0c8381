from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from massid.assets import shipped_models
from massid.errors import LogError, ModelError
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space, parameter_space
from massid.search.parameters import ParameterSpace
from tests.conftest import Pushed
from tests.pushed_robot import LINKS, make_robot

FROM_GEOMS = """
<mujoco><compiler inertiafromgeom="true"/><worldbody><body name="base"><freejoint/>
  <inertial pos="0 0 0" mass="99" diaginertia="1 1 1"/><geom size="0.1" mass="3"/>
  <body name="arm" pos="0 0 0.3"><joint name="j" axis="1 0 0"/><geom type="capsule" size="0.05 0.1" mass="2"/>
    <body name="welded"><geom size="0.02" mass="0.5" pos="0 0 0.3"/></body></body>
</body></worldbody></mujoco>"""


@pytest.mark.parametrize("source", ["given", "geoms"])
def test_saved_model_has_the_masses_and_inertias_really_changed(source: str, tmp_path: Path) -> None:
    if source == "geoms":
        robot, links = Robot(mujoco.MjSpec.from_string(FROM_GEOMS)), ("base", "arm")
    else:
        robot, links = Robot.load(shipped_models()["atlas"]), ("torso", "l_foot")
    space = mass_space(robot, links)
    point = space.nominal * np.array([1.2, 0.8])
    robot.write_model(space, point, tmp_path / "identified.xml")

    saved = Robot.load(tmp_path / "identified.xml").model
    for link, mass, nominal in zip(links, point, space.nominal, strict=True):
        np.testing.assert_allclose(saved.body(link).mass, mass, rtol=1e-6)  # MJCF text keeps 6 digits or more
        before = robot.model.body(link).inertia
        np.testing.assert_allclose(saved.body(link).inertia, before * mass / nominal, rtol=1e-5)
    others = [b for b in range(saved.nbody) if saved.body(b).name not in links]
    np.testing.assert_allclose(saved.body_mass[others], robot.model.body_mass[others], rtol=1e-6)
    np.testing.assert_allclose(saved.body_ipos, robot.model.body_ipos, atol=1e-6)


def test_an_inertia_scales_by_one_factor_and_leaves_mass_and_frame() -> None:
    robot = make_robot()
    space = parameter_space(robot, ["l_thigh"], ["inertia_scale/l_thigh"])
    both = space.nominal * [2.0, 0.0] + [0.0, np.log(1.3)]
    thick = robot.model_at(space, both)
    np.testing.assert_allclose(thick.body("l_thigh").inertia, 2.6 * robot.model.body("l_thigh").inertia)
    assert thick.body("l_thigh").mass[0] == pytest.approx(2.0 * robot.nominal_mass_kg("l_thigh"))
    np.testing.assert_array_equal(thick.body("l_thigh").iquat, robot.model.body("l_thigh").iquat)
    # The general way, by pseudo-inertias, agrees.
    space = ParameterSpace((*parameter_space(robot, ["l_thigh"], ["com/l_thigh"]).parameters, space.parameters[1]))
    point = np.array([both[0], *robot.model.body("l_thigh").ipos, both[1]])
    general = robot.model_at(space, point).body("l_thigh")
    np.testing.assert_allclose(np.sort(general.inertia), np.sort(thick.body("l_thigh").inertia), rtol=1e-9)


def test_a_mass_scales_the_inertia_and_leaves_the_centre_of_mass() -> None:
    robot = make_robot()
    space = mass_space(robot, ["l_thigh"])
    heavy = robot.model_at(space, 2.0 * space.nominal)
    np.testing.assert_allclose(heavy.body("l_thigh").inertia, 2.0 * robot.model.body("l_thigh").inertia)
    np.testing.assert_array_equal(heavy.body("l_thigh").ipos, robot.model.body("l_thigh").ipos)
    assert heavy.body("l_thigh").subtreemass == pytest.approx(robot.model.body("l_thigh").subtreemass[0] + 4.0)


def test_nominal_model_is_never_written_to(pushed: Pushed) -> None:
    before = pushed.robot.model.body_mass.copy()
    pushed.robot.model_at(pushed.space, pushed.truth)
    np.testing.assert_array_equal(pushed.robot.model.body_mass, before)


def test_identification_model_has_neither_contacts_nor_the_robots_own_motors() -> None:
    model = make_robot().identification_model(("l_foot",))
    assert model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    assert [model.actuator(i).name for i in range(model.nu)] == [f"massid_wrench/l_foot/{i}" for i in range(6)]


@pytest.mark.parametrize(
    ("link", "message"),
    [
        ("l_tigh", "no link named 'l_tigh'. Did you mean l_thigh"),
        ("world", "The world has no mass"),
    ],
)
def test_unknown_links_are_named_with_the_nearest_ones(link: str, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        mass_space(make_robot(), [link])


def test_a_model_without_free_joint_is_refused() -> None:
    xml = '<mujoco><worldbody><body name="a"><joint name="j"/><geom size="1"/></body></worldbody></mujoco>'
    with pytest.raises(ModelError, match=r"expected one body with a free joint .* found 0 \(none\)"):
        Robot(mujoco.MjSpec.from_string(xml))


@pytest.mark.parametrize(
    ("content", "message"),
    [("not xml", "not a model that MuJoCo can read"), (None, "does not exist")],
)
def test_an_unreadable_model_file_is_named(content: str | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "robot.xml"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ModelError, match=message):
        Robot.load(path)


def test_joints_are_matched_by_name_not_by_position(pushed: Pushed) -> None:
    shuffled = pushed.walk.with_joint_order(tuple(reversed(pushed.walk.joint_names)))
    aligned = pushed.robot.align(shuffled)
    np.testing.assert_array_equal(aligned.qpos, pushed.walk.qpos)
    np.testing.assert_array_equal(aligned.effort, pushed.walk.effort)


def test_a_missing_joint_is_named(pushed: Pushed) -> None:
    fewer = pushed.walk.with_joint_order(pushed.walk.joint_names[1:])
    with pytest.raises(LogError, match="no joint named 'l_hip_roll'"):
        pushed.robot.align(fewer)


def test_shipped_robots_have_the_links_of_the_paper() -> None:
    for path in shipped_models().values():
        assert Robot.load(path).walking_links() == LINKS


MESH = "v 0 0 0\nv 0.3 0 0\nv 0 0.3 0\nv 0 0 0.3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
WITH_MESHES = """
<mujoco><compiler meshdir="parts/meshes"/><include file="parts/assets.xml"/><worldbody>
  <body name="base"><freejoint/><geom type="mesh" mesh="tet" mass="3"/>
    <body name="arm"><joint name="j"/><geom type="mesh" mesh="tet" mass="1"/></body></body>
</worldbody></mujoco>"""


def test_a_model_with_includes_and_meshes_is_saved_into_another_folder(tmp_path: Path) -> None:
    home, other = tmp_path / "robots & co", tmp_path / "results" / "today"
    (home / "parts" / "meshes").mkdir(parents=True)
    other.mkdir(parents=True)
    (home / "parts" / "meshes" / "tet.obj").write_text(MESH)
    (home / "parts" / "assets.xml").write_text('<mujoco><asset><mesh name="tet" file="tet.obj"/></asset></mujoco>')
    (home / "robot.xml").write_text(WITH_MESHES)
    robot = Robot.load(home / "robot.xml")
    space = mass_space(robot, ["arm"])
    robot.write_model(space, np.array([1.7]), other / "identified.xml")
    saved = Robot.load(other / "identified.xml")
    assert saved.nominal_mass_kg("arm") == pytest.approx(1.7)
    np.testing.assert_allclose(saved.model.body("arm").inertia, 1.7 * robot.model.body("arm").inertia, rtol=1e-5)
    assert [path.name for path in other.iterdir()] == ["identified.xml"]
    assert str(home) not in (other / "identified.xml").read_text()  # both folders may move together


def test_a_model_that_cannot_be_saved_leaves_the_old_file(tmp_path: Path) -> None:
    (tmp_path / "parts" / "meshes").mkdir(parents=True)
    (tmp_path / "parts" / "meshes" / "tet.obj").write_text(MESH)
    (tmp_path / "parts" / "assets.xml").write_text('<mujoco><asset><mesh name="tet" file="tet.obj"/></asset></mujoco>')
    (tmp_path / "robot.xml").write_text(WITH_MESHES)
    robot = Robot.load(tmp_path / "robot.xml")
    (tmp_path / "parts" / "meshes" / "tet.obj").unlink()
    (tmp_path / "old.xml").write_text("old")
    with pytest.raises(ModelError, match=r"old\.xml: the saved model does not load"):
        robot.write_model(mass_space(robot, ["arm"]), np.array([1.7]), tmp_path / "old.xml")
    assert (tmp_path / "old.xml").read_text() == "old"


@pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass'")
def test_rescaled_masses_are_saved_as_they_are(tmp_path: Path) -> None:
    xml = FROM_GEOMS.replace('inertiafromgeom="true"', 'settotalmass="50" boundmass="0.7"')
    robot = Robot(mujoco.MjSpec.from_string(xml))
    space = mass_space(robot, ["arm"])
    robot.write_model(space, 1.5 * space.nominal, tmp_path / "saved.xml")
    saved = Robot.load(tmp_path / "saved.xml").model
    expected = robot.model_at(space, 1.5 * space.nominal)
    np.testing.assert_allclose(saved.body_mass, expected.body_mass, rtol=1e-5)


SPOILED_DEFAULTS = """
<mujoco><option iterations="3" solver="PGS"><flag sleep="disable"/></option>
<default><general dyntype="filter" dynprm="0.01" gaintype="affine" gainprm="3 4 5" biastype="affine"
  biasprm="0 -100 -2" gear="50" ctrllimited="true" ctrlrange="-1 1" forcelimited="true" forcerange="-2 2"
  actlimited="true" actrange="-1 1" armature="0.3" damping="0.4" group="2" actearly="true"/></default>
<worldbody><body name="base"><freejoint/><geom size="0.1" mass="3"/>
  <body name="arm" pos="0 0 0.3"><joint name="j" axis="1 0 0" damping="0.1"/><geom size="0.1" mass="2"/></body>
</body></worldbody>
<actuator><general joint="j"/></actuator></mujoco>"""


def test_default_classes_do_not_reach_the_wrench_motors() -> None:
    spec = mujoco.MjSpec.from_string(SPOILED_DEFAULTS)
    spec.option.disableactuator = 0b101
    robot = Robot(spec)
    model = robot.identification_model(["base"])
    data = mujoco.MjData(model)
    data.ctrl[:] = [10.0, 20.0, 30.0, 1.0, 2.0, 3.0]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator[:6], data.ctrl, atol=1e-12)  # the base frame is the world's here
    assert model.opt.iterations >= 100
    assert model.opt.solver == mujoco.mjtSolver.mjSOL_NEWTON
    # armature and damping of the joint's own actuator stay with the joint
    assert model.dof_armature[6] == pytest.approx(0.3 * 50**2)
    assert model.dof_damping[6] == pytest.approx(0.1 + 0.4 * 50**2)


def test_links_that_cannot_be_weighed_are_named_with_those_that_can() -> None:
    robot = Robot(mujoco.MjSpec.from_string(FROM_GEOMS))
    with pytest.raises(ModelError, match=r"'welded' .* moves with 'arm'.* so weigh 'arm'"):
        mass_space(robot, ["welded"])
    assert len(mass_space(robot, ["welded"], welded_too=True)) == 1
    massless = FROM_GEOMS.replace('<body name="welded">', '<body name="arm_frame"/><body name="welded">')
    with pytest.raises(ModelError, match=r"'arm_frame' of spec has no mass. Did you mean arm"):
        mass_space(Robot(mujoco.MjSpec.from_string(massless)), ["arm_frame"])


def test_several_floating_bodies_and_none_say_what_to_do() -> None:
    xml = '<mujoco><worldbody><body name="a"><joint name="j"/><geom size="1"/></body></worldbody></mujoco>'
    with pytest.raises(ModelError, match="Add <freejoint/> to body 'a'"):
        Robot(mujoco.MjSpec.from_string(xml))
    two = "".join(f'<body name="{name}"><freejoint/><geom size="1"/></body>' for name in "ab")
    with pytest.raises(ModelError, match=r"found 2 \(a, b\). Take the others out of the file"):
        Robot(mujoco.MjSpec.from_string(f"<mujoco><worldbody>{two}</worldbody></mujoco>"))


def test_locked_joints_leave_the_rest_where_it_was() -> None:
    robot = make_robot()
    held = {"l_knee": 0.4, "r_ankle": 0.0}
    locked = robot.locked(held)
    assert set(robot.joint_names) - set(locked.joint_names) == set(held)
    full, fewer = mujoco.MjData(robot.model), mujoco.MjData(locked.model)
    rng = np.random.default_rng(0)
    for name in robot.joint_names:
        value = held.get(name, rng.uniform(-0.5, 0.5))
        full.qpos[robot.model.joint(name).qposadr[0]] = value
        if name not in held:
            fewer.qpos[locked.model.joint(name).qposadr[0]] = value
    mujoco.mj_kinematics(robot.model, full)
    mujoco.mj_kinematics(locked.model, fewer)
    np.testing.assert_allclose(fewer.xpos, full.xpos, atol=1e-12)
    np.testing.assert_allclose(fewer.xmat, full.xmat, atol=1e-12)
    with pytest.raises(ModelError, match=r"no joint named 'l_kne'. Did you mean l_knee"):
        robot.locked({"l_kne": 0.0})
    with pytest.raises(ModelError, match="'l_hip_roll' shares its body with another joint"):
        robot.locked({"l_hip_roll": 0.1})


def test_world_wrenches_are_turned_into_their_bodies(pushed: Pushed) -> None:
    data = mujoco.MjData(pushed.robot.model)
    world = pushed.walk.wrench.copy()
    for k in range(len(pushed.walk)):
        data.qpos[:] = pushed.robot.layout.to_qpos(pushed.walk.qpos[k])
        mujoco.mj_kinematics(pushed.robot.model, data)
        rotation = data.body("l_foot").xmat.reshape(3, 3)
        world[k, 0, :3], world[k, 0, 3:] = rotation @ world[k, 0, :3], rotation @ world[k, 0, 3:]
    walk = replace(pushed.walk, wrench=world, world_wrenches=("l_foot",))
    aligned = pushed.robot.align(walk)
    assert aligned.world_wrenches == ()
    np.testing.assert_allclose(
        aligned.wrench, pushed.walk.wrench, atol=1e-9
    )  # forces of some 100 N, a rotation and back


def test_force_limits_of_joints_do_not_cut_off_measured_wrenches() -> None:
    """Commercial models limit the force of all actuators on a joint; the ground pushes as hard as it was measured."""
    robot = make_robot()
    spec = robot.spec.copy()
    for joint in spec.joints[1:]:
        joint.actfrclimited, joint.actfrcrange = mujoco.mjtLimited.mjLIMITED_TRUE, [-5.0, 5.0]
    models = [one.identification_model(["l_foot"]) for one in (robot, Robot(spec))]
    accelerations = []
    for model in models:
        data = mujoco.MjData(model)
        data.ctrl[0] = 100.0  # N, along the foot's x axis
        mujoco.mj_forward(model, data)
        assert np.abs(data.qfrc_actuator[6:]).max() > 5.0  # N m
        accelerations.append(data.qacc.copy())
    np.testing.assert_array_equal(*accelerations)


def test_identification_models_hold_no_shapes_and_keep_the_inertia_that_follows_from_them() -> None:
    cube = " ".join(f"{x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 2))
    robot = Robot(
        mujoco.MjSpec.from_string(
            f"""
            <mujoco>
              <asset>
                <mesh name="cube" vertex="{cube}" scale="0.1 0.1 0.1"/>
                <texture name="t" type="2d" builtin="flat" width="512" height="512"/><material name="m" texture="t"/>
              </asset>
              <worldbody><body name="base"><freejoint/><geom type="mesh" mesh="cube" material="m"/>
                <body name="arm"><joint name="j" axis="0 1 0"/><geom type="capsule" size="0.02 0.1"/></body>
              </body></worldbody>
            </mujoco>"""
        )
    )
    bare = robot.identification_model(["base"])
    assert (bare.ngeom, bare.nmesh, bare.ntex, bare.nmat) == (0, 0, 0, 0)
    for name in ("body_mass", "body_inertia", "body_ipos", "body_iquat"):
        np.testing.assert_array_equal(getattr(bare, name), getattr(robot.model, name))
    assert bare.nbuffer < 0.1 * robot.with_all_seen().nbuffer
    assert (robot.model.nmesh, robot.model.ntex) == (1, 0)  # the cube collides, nobody sees its texture
