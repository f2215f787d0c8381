"""Models as they come: what is not the robot, what has no name, what is tied to the world, what is gone."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from massid.errors import ModelError
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from tests.pushed_robot import XML, make_robot

SPHERE = '<geom size="0.1" mass="3" contype="0" conaffinity="0"/>'
NECK = f'<body pos="0 0 0.4"><joint name="neck"/>{SPHERE}</body>'
BALL = f'<body name="ball" pos="3 0 1"><freejoint/>{SPHERE}</body>'
DOOR = f'<body name="door" pos="3 0 1"><joint name="hinge"/>{SPHERE}</body>'
LAMP = f'<body pos="3 0 2"><joint type="ball"/>{SPHERE}</body>'
BELT = f'<body name="belt"><joint name="belt" type="slide"/>{SPHERE}</body>'
ROOT = '<freejoint name="root"/>'
SHELL = '<asset><mesh name="shell" file="gone/shell.stl"/></asset>'


def biped(in_world: str = "", in_torso: str = "", after: str = "", base: str = ROOT) -> Robot:
    """The biped with something more in its file."""
    text = XML.replace("<worldbody>", f"<worldbody>{in_world}").replace(ROOT, base + in_torso)
    return Robot(mujoco.MjSpec.from_string(text.replace("</mujoco>", f"{after}</mujoco>")), "robot.xml")


def test_a_moving_body_without_a_name_is_called_by_its_joint_and_can_be_weighed() -> None:
    robot = biped(in_torso=NECK)
    assert "neck_body" in robot.links
    assert len(mass_space(robot, ["neck_body"])) == 1
    assert any("bodies without a name" in note and "neck_body" in note for note in robot.notes)


@pytest.mark.parametrize("thing", [BALL, DOOR, LAMP, BALL.replace(' name="ball"', "")])
def test_what_moves_and_is_not_the_robot_is_held_still(thing: str) -> None:
    robot, alone = biped(in_world=thing), make_robot()
    assert robot.joint_names == alone.joint_names
    assert robot.links == alone.links
    assert robot.model.nq == alone.model.nq
    assert any("not the robot: held still" in note for note in robot.notes)
    bare = robot.identification_model(["l_foot"])
    assert bare.nv == alone.model.nv


def test_motors_and_couplings_of_what_is_held_still_go_with_it() -> None:
    after = (
        '<actuator><motor joint="belt"/></actuator>'
        '<equality><joint joint1="belt" joint2="l_knee" name="tie"/></equality>'
        '<tendon><fixed name="rope"><joint joint="belt" coef="1"/><joint joint="l_knee" coef="1"/></fixed></tendon>'
    )
    robot = biped(in_world=BELT, after=after)
    assert (robot.model.neq, robot.model.ntendon, robot.model.nu) == (0, 0, make_robot().model.nu)
    assert any("equality 'tie'" in note for note in robot.notes)
    assert any("tendon 'rope'" in note for note in robot.notes)


def test_of_several_floating_bodies_the_one_with_the_most_joints_is_the_robot() -> None:
    assert biped(in_world=BALL).root_body == "torso"
    twin = BALL.replace("ball", "twin")
    two = f"<mujoco><worldbody>{BALL}{twin}</worldbody></mujoco>"
    with pytest.raises(ModelError, match=r"found 2 \(ball, twin\).*which is the robot cannot be told"):
        Robot(mujoco.MjSpec.from_string(two))


TO_WORLD = '<weld name="hung" body1="torso"/>'
TO_HAND = '<connect name="held" body1="hand" body2="torso" anchor="0 0 0"/>'
OFF = TO_WORLD.replace("<weld", '<weld active="false"')
HAND = '<body name="hand" mocap="true"/>'


@pytest.mark.parametrize(("tie", "said"), [(TO_WORLD, "to world"), (TO_HAND, "to hand"), (OFF, None)])
def test_ties_to_the_world_bear_nothing_and_are_told(tie: str, said: str | None) -> None:
    robot = biped(in_world=HAND, after=f"<equality>{tie}</equality>")
    assert robot.identification_model([]).neq == 0
    told = [note for note in robot.notes if "ties torso" in note]
    assert bool(told) == bool(said)
    assert all("contact of torso that must be logged" in note and str(said) in note for note in told)


def test_a_closed_loop_of_the_robot_stays() -> None:
    loop = '<equality><connect body1="l_foot" body2="r_foot" anchor="0 0.1 0"/></equality>'
    robot = biped(after=loop)
    assert robot.identification_model([]).neq == 1
    assert robot.notes == ()


SLIDES = "".join(f'<joint name="{axis}" type="slide"/>' for axis in "xyz")
HINGES = "".join(f'<joint name="r{axis}"/>' for axis in "xyz")


@pytest.mark.parametrize("joints", [SLIDES + '<joint name="turn" type="ball"/>', SLIDES + HINGES])
def test_a_base_of_slides_is_told_to_become_a_free_joint(joints: str) -> None:
    with pytest.raises(ModelError, match=r"joints of body 'torso' \(x, y, z.*put <freejoint/> in their place"):
        biped(base=joints)


def test_a_ball_joint_is_told_which_hinges_to_become() -> None:
    ball = f'<body name="head"><joint name="neck" type="ball"/>{SPHERE}</body>'
    with pytest.raises(ModelError, match=r"'neck' of 'head' is a ball joint.*three hinges.*neck_x.*neck_z"):
        biped(in_torso=ball)


def test_what_lacks_a_name_that_a_log_needs_is_told_where_it_is() -> None:
    with pytest.raises(ModelError, match="a joint of body 'l_foot' has no name"):
        Robot(mujoco.MjSpec.from_string(XML.replace('joint name="l_ankle"', "joint").replace(
            '<motor joint="l_ankle"/>', "")))  # fmt: skip
    with pytest.raises(ModelError, match="the floating base has no name"):
        Robot(mujoco.MjSpec.from_string(XML.replace('body name="torso"', "body")))


INERTIAL = '<inertial pos="0 0 0.1" mass="20" diaginertia="0.4 0.3 0.2"/>'
DRAWN = '<geom type="mesh" mesh="shell" contype="0" conaffinity="0"/>'


@pytest.mark.parametrize("touches", [False, True])
def test_a_lost_mesh_is_not_needed_to_weigh(touches: bool) -> None:
    geom = DRAWN.replace('contype="0"', 'contype="1"') if touches else DRAWN
    robot = biped(in_torso=INERTIAL + geom, after=SHELL)
    assert robot.nominal_mass_kg("torso") == 20.0
    (note,) = robot.notes
    assert "mesh shell cannot be read" in note
    assert ("contact with it is not looked for" in note) == touches
    assert robot.with_all_seen().nbody == robot.model.nbody


def test_a_lost_mesh_that_a_mass_follows_from_is_an_error() -> None:
    with pytest.raises(ModelError, match=r"shell\.stl.*the mass of torso follows from it"):
        biped(in_torso=DRAWN.replace("/>", ' mass="1"/>'), after=SHELL)


def test_armature_and_damping_of_actuators_stay_with_what_they_drive() -> None:
    after = (
        '<tendon><fixed name="rope" actuatorfrclimited="true" actuatorfrcrange="-1 1"><joint joint="l_knee" coef="1"/>'
        '<joint joint="l_ankle" coef="1"/></fixed></tendon>'
        '<actuator><general tendon="rope" armature="0.3" damping="0.1" gear="2"/>'
        '<general jointinparent="r_knee" armature="0.2" gear="3"/></actuator>'
    )
    robot = biped(after=after)
    bare = robot.identification_model([])
    assert bare.tendon_armature[0] == pytest.approx(0.3 * 4)
    assert bare.tendon_damping[0] == pytest.approx(0.1 * 4)
    assert not bare.tendon_actfrclimited.any()
    knee = bare.joint("r_knee").dofadr[0]
    assert bare.dof_armature[knee] == pytest.approx(0.01 + 0.2 * 9)
    data, full = mujoco.MjData(bare), mujoco.MjData(robot.model)
    mujoco.mj_forward(bare, data)
    mujoco.mj_forward(robot.model, full)
    inertia, expected = np.zeros((2, bare.nv, bare.nv))
    mujoco.mj_fullM(bare, data, inertia)
    mujoco.mj_fullM(robot.model, full, expected)
    np.testing.assert_allclose(inertia, expected, atol=1e-12)
