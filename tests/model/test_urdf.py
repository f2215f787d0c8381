from __future__ import annotations

import difflib
from pathlib import Path

import mujoco
import numpy as np
import pytest

from massid.errors import ModelError
from massid.model.robot import Robot
from massid.model.unknowns.spaces import parameter_space
from massid.model.urdf import find_mesh, nearest_inertia
from massid.typing import FloatArray
from massid.walk import Walk

PELVIS = """
  <link name="pelvis">
    <inertial>
      <origin xyz="0.01 0.02 0.03" rpy="0.3 0.2 0.1"/><mass value="10.123456789"/>
      <inertia ixx="0.3" ixy="0.01" ixz="-0.02" iyy="0.25" iyz="0.03" izz="0.2"/>
    </inertial>
    <collision name="box"><geometry><box size="0.2 0.2 0.2"/></geometry></collision>
    <visual name="box"><geometry><mesh filename="package://walker/meshes/pelvis.obj"/></geometry></visual>
  </link>"""


def link(name: str, mass: float, rest: str = "") -> str:
    return f"""
  <link name="{name}">
    <inertial>
      <!-- as weighed -->
      <origin xyz="0 0 -0.2"/>  <mass value='{mass}'/>
      <inertia ixx="{0.02 * mass}" ixy="0" ixz="0" iyy="{0.03 * mass}" iyz="0" izz="{0.015 * mass}"/>
    </inertial>{rest}
  </link>"""


def joint(name: str, kind: str, parent: str, child: str, rest: str = "") -> str:
    return f"""
  <joint name="{name}" type="{kind}">
    <origin xyz="0 0 -0.4"/><parent link="{parent}"/><child link="{child}"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="50" velocity="9"/>{rest}
  </joint>"""


HIP = joint("hip", "revolute", "pelvis", "thigh", '<dynamics damping="0.3" friction="0.1"/>')
BODY = (
    PELVIS
    + link("thigh", 3.0)
    + HIP
    + link("shank", 2.0)
    + joint("knee", "revolute", "thigh", "shank")
    + link("sole", 0.7)
    + joint("glued", "fixed", "shank", "sole")
)


def urdf(body: str = BODY, before: str = "") -> str:
    return (
        f'<?xml version="1.0" encoding="utf-8"?>\n<!-- from CAD: é -->\n<robot name="walker">{before}{body}\n</robot>\n'
    )


WORLD = '\n  <link name="world"/>'


@pytest.fixture
def walker(tmp_path: Path) -> Path:
    """A package with a URDF in it."""
    path = tmp_path / "walker" / "urdf" / "walker.urdf"
    path.parent.mkdir(parents=True)
    path.write_text(urdf(), encoding="utf-8")
    return path


def inertias(model: mujoco.MjModel) -> FloatArray:
    """In the bodies' frames, whatever axes they are told in."""
    rotation, out = np.empty(9), []
    for moments, quaternion in zip(model.body_inertia, model.body_iquat, strict=True):
        mujoco.mju_quat2Mat(rotation, quaternion)
        out.append(rotation.reshape(3, 3) @ np.diag(moments) @ rotation.reshape(3, 3).T)
    return np.array(out)


@pytest.mark.parametrize(
    ("before", "floats"),
    [
        ("", "link 'pelvis' floats"),
        (WORLD + joint("anchor", "fixed", "world", "pelvis"), "floats instead of being fixed"),
        (WORLD.replace("world", "odom") + joint("anchor", "fixed", "odom", "pelvis"), "floats instead of being fixed"),
        (WORLD + joint("float", "floating", "world", "pelvis"), None),
        (WORLD.replace("world", "odom") + joint("float", "floating", "odom", "pelvis"), None),
    ],
)
def test_whatever_the_base_hangs_on_it_floats(before: str, floats: str | None, walker: Path) -> None:
    walker.write_text(urdf(before=before))
    robot = Robot.load(walker)
    assert robot.root_body == "pelvis"
    assert robot.joint_names == ("hip", "knee")
    assert any(floats in note for note in robot.notes) if floats else not [n for n in robot.notes if "floats" in n]


def test_masses_inertias_and_fixed_links_are_those_of_the_file(walker: Path) -> None:
    robot = Robot.load(walker)
    model = robot.model
    assert {one: model.body(one).mass[0] for one in robot.links} == {
        "pelvis": 10.123456789, "thigh": 3.0, "shank": 2.0, "sole": 0.7,
    }  # fmt: skip
    assert robot.welded_to("sole") == "shank"
    turned = np.empty(9)
    quaternion = np.empty(4)
    mujoco.mju_euler2Quat(quaternion, [0.3, 0.2, 0.1], "XYZ")
    mujoco.mju_quat2Mat(turned, quaternion)
    given = np.array([[0.3, 0.01, -0.02], [0.01, 0.25, 0.03], [-0.02, 0.03, 0.2]])
    expected = turned.reshape(3, 3) @ given @ turned.reshape(3, 3).T
    np.testing.assert_allclose(inertias(model)[model.body("pelvis").id], expected, atol=1e-14)
    assert model.joint("hip").damping[0] == 0.3
    assert model.joint("hip").frictionloss[0] == 0.1


FRAMES = '<link name="base"/><link name="imu"/>' + "".join(
    joint(f"{one}_fixed", "fixed", "base", one) for one in ("pelvis", "imu")
)


def test_a_link_that_is_fixed_to_a_base_without_mass_can_be_weighed(walker: Path) -> None:
    walker.write_text(urdf(before=FRAMES))
    robot = Robot.load(walker)
    assert robot.root_body == "base"
    assert len(parameter_space(robot, ["pelvis"])) == 1
    with pytest.raises(ModelError, match="has no mass"):
        parameter_space(robot, ["base"])


def test_a_log_may_have_the_pose_of_any_link_that_is_fixed_to_the_base(walker: Path) -> None:
    """Poses and twists of `pelvis`, which is below `base` and turned against it."""
    walker.write_text(
        urdf(before=FRAMES).replace(
            'xyz="0 0 -0.4"/><parent link="base"/>', 'xyz="0.1 0.2 -0.4" rpy="0.3 0.2 0.1"/><parent link="base"/>'
        )
    )
    robot = Robot.load(walker)
    model, data = robot.model, mujoco.MjData(robot.model)
    rng = np.random.default_rng(0)
    expected = {"qpos": np.zeros((3, model.nq)), "qvel": rng.normal(size=(3, model.nv))}
    logged = {name: values.copy() for name, values in expected.items()}
    velocity = np.empty(6)
    for k in range(3):
        data.qpos[:] = expected["qpos"][k] = rng.normal(size=model.nq)
        mujoco.mj_normalizeQuat(model, data.qpos)
        expected["qpos"][k], data.qvel[:] = data.qpos, expected["qvel"][k]
        mujoco.mj_forward(model, data)
        logged["qpos"][k] = data.qpos
        logged["qpos"][k, :7] = [*data.body("pelvis").xpos, *data.body("pelvis").xquat]
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, model.body("pelvis").id, velocity, 1)
        turn = data.body("pelvis").xmat.reshape(3, 3)
        logged["qvel"][k, :3], logged["qvel"][k, 3:6] = turn @ velocity[3:], velocity[:3]
    walk = Walk(
        root_body="pelvis",
        joint_names=robot.joint_names,
        contact_bodies=("sole",),
        timestep_s=0.001,
        stamps_ns=np.arange(3, dtype=np.int64) * 1_000_000,
        effort=np.zeros((3, 2)),
        wrench=np.zeros((3, 1, 6)),
        **logged,
    )
    aligned = robot.align(walk)
    assert aligned.root_body == "base"
    np.testing.assert_allclose(aligned.qpos[:, :3], expected["qpos"][:, :3], atol=1e-12)
    overlap = np.abs(np.einsum("ki,ki->k", aligned.qpos[:, 3:7], expected["qpos"][:, 3:7]))
    np.testing.assert_allclose(overlap, 1.0, atol=1e-12)
    np.testing.assert_allclose(aligned.qvel, expected["qvel"], atol=1e-12)


def test_links_without_inertia_get_none_from_their_shapes(walker: Path) -> None:
    box = "<collision><geometry><box size='1 1 1'/></geometry></collision>"
    flag = f'<link name="flag">{box}</link>' + joint("pole", "fixed", "pelvis", "flag")
    antenna = f'<link name="antenna">{box}</link>' + joint("whip", "continuous", "pelvis", "antenna")
    walker.write_text(urdf(BODY + flag + antenna))
    robot = Robot.load(walker)
    assert "flag" not in robot.links
    assert robot.total_mass_kg == pytest.approx(10.123456789 + 5.7, abs=1e-5)
    assert any("no mass got 1 mg: antenna" in note for note in robot.notes)


def test_meshes_of_packages_are_found_and_lost_ones_are_told(walker: Path) -> None:
    assert any("package://walker/meshes/pelvis.obj cannot be read" in note for note in Robot.load(walker).notes)
    mesh = walker.parents[1] / "meshes" / "pelvis.obj"
    mesh.parent.mkdir()
    mesh.write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    robot = Robot.load(walker)
    assert not [note for note in robot.notes if "mesh" in note]
    assert robot.with_all_seen().nmesh == 1
    assert robot.with_all_seen().body("pelvis").mass[0] == 10.123456789
    for name in ("package://walker/meshes/pelvis.obj", "../meshes/pelvis.obj", f"file://{mesh}"):
        found = find_mesh(name, walker)
        assert found is not None
        assert found.samefile(mesh)


def test_meshes_of_packages_elsewhere_are_found_as_ros_finds_them(
    walker: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = walker.parents[2] / "install" / "share" / "hands" / "hand.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_text("solid")
    assert find_mesh("package://hands/hand.stl", walker) is None
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(walker.parents[2] / "install"))
    assert find_mesh("package://hands/hand.stl", walker) == mesh


def test_impossible_inertias_become_the_nearest_possible_ones(walker: Path) -> None:
    walker.write_text(urdf(BODY.replace('izz="0.03"', 'izz="0.3"')))  # of the shank: 0.04, 0.06, 0.3
    robot = Robot.load(walker)
    assert any("no body has the inertia of shank" in note for note in robot.notes)
    moments = np.sort(robot.model.body("shank").inertia)
    assert moments[2] <= moments[0] + moments[1]
    assert nearest_inertia(np.diag([0.2, 0.3, 0.4]), 1.0) is None
    point = nearest_inertia(np.zeros((3, 3)), 1.0)
    assert point is not None
    assert np.linalg.eigvalsh(point).min() > 0.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (urdf(BODY.replace('value="10.123456789"', 'value="${m}"')), "is a xacro file"),
        (urdf(BODY.replace(HIP, "")), "has 2 links without a parent \\(pelvis, thigh\\), not one"),
        (urdf(BODY.replace('child link="thigh"', 'child link="thihg"')), "tied to link 'thihg', which is not there"),
        ('<robot name="none"/>', "a URDF without links"),
        (urdf(BODY.replace('ixx="0.06"', 'ixx="six"')), "inertia of link 'thigh' is not six numbers"),
    ],
)
def test_what_is_no_urdf_of_a_robot_is_told_in_a_line(text: str, message: str, walker: Path) -> None:
    walker.write_text(text)
    with pytest.raises(ModelError, match=message) as told:
        Robot.load(walker)
    assert "\n" not in str(told.value)


UNKNOWNS = ("com/pelvis", "inertia/shank", "payload/thigh@0,0,0.1")


@pytest.mark.parametrize("suffix", [".urdf", ".xml"])
@pytest.mark.parametrize("unknowns", [(), UNKNOWNS], ids=["masses", "bodies"])
def test_a_saved_urdf_is_the_robot_that_was_found(
    suffix: str, unknowns: tuple[str, ...], walker: Path, tmp_path: Path
) -> None:
    robot = Robot.load(walker)
    space = parameter_space(robot, ["pelvis", "thigh", "shank"], unknowns)
    point = space.nominal + 0.1 * space.scale
    robot.write_model(space, point, tmp_path / f"weighed{suffix}", remark="found")
    saved, expected = Robot.load(tmp_path / f"weighed{suffix}").model, robot.model_at(space, point)
    np.testing.assert_allclose(saved.body_mass, expected.body_mass, rtol=1e-15)
    np.testing.assert_allclose(saved.body_ipos, expected.body_ipos, atol=1e-15)
    np.testing.assert_allclose(inertias(saved), inertias(expected), atol=1e-15)


def test_the_rest_of_a_saved_urdf_is_the_users_text(walker: Path, tmp_path: Path) -> None:
    robot = Robot.load(walker)
    space = parameter_space(robot, ["thigh"], ["damping/hip", "friction/knee"])
    robot.write_model(space, np.array([3.5, 0.4, 0.05]), tmp_path / "weighed.urdf")
    before, after = (path.read_text(encoding="utf-8").splitlines() for path in (walker, tmp_path / "weighed.urdf"))
    changed = [line for line in difflib.ndiff(before, after) if line.startswith("+ ")]
    assert len(changed) == 4  # mass, inertia, two joints
    assert any('<mass value="3.5"/>' in line for line in changed)
    saved = Robot.load(tmp_path / "weighed.urdf").model
    assert saved.joint("hip").damping[0] == 0.4
    assert saved.joint("hip").frictionloss[0] == 0.1
    assert saved.joint("knee").frictionloss[0] == 0.05


def test_what_a_urdf_cannot_hold_is_saved_as_xml(walker: Path, tmp_path: Path) -> None:
    robot = Robot.load(walker)
    space = parameter_space(robot, (), ["stiffness/hip"])
    with pytest.raises(ModelError, match=r"a URDF has no place for all that was found; save it as \.xml"):
        robot.write_model(space, np.array([3.5]), tmp_path / "weighed.urdf")
    assert not list(tmp_path.glob("*weighed*"))
    robot.write_model(space, np.array([3.5]), tmp_path / "weighed.xml")
    assert Robot.load(tmp_path / "weighed.xml").model.joint("hip").stiffness[0] == 3.5
    with pytest.raises(ModelError, match="was not read from a URDF"):
        Robot.load(tmp_path / "weighed.xml").write_model(space, np.array([3.5]), tmp_path / "weighed.urdf")
