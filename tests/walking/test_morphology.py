from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from massid.errors import ModelError
from massid.walking import Morphology
from massid.walking.morphology import torque_limits
from massid.walking.stance import sole_pose, standing_qpos
from tests.walking.floor import nominal

ROBOTS = ("atlas", "light", "heavy", "nimble", "geared")


@pytest.mark.parametrize("name", ROBOTS)
def test_parts_are_found(name: str) -> None:
    model = nominal(name)
    parts = Morphology.from_model(model)
    assert model.body(parts.root_id).name == "pelvis"
    assert model.body(parts.torso_id).name == "torso"
    assert parts.foot_names == ("l_foot", "r_foot")
    knees = [model.joint(int(model.dof_jntid[dof])).name for dof in parts.knee_dofs]
    assert all("kn" in knee for knee in knees)
    assert [len(leg) for leg in parts.leg_dofs] == [6, 6]
    everything = np.concatenate([*parts.leg_dofs, parts.back_dofs, parts.arm_dofs])
    assert sorted(everything.tolist()) == list(range(6, model.nv))


@pytest.mark.parametrize("name", ROBOTS)
def test_a_bent_knee_lowers_the_robot(name: str) -> None:
    model = nominal(name)
    parts = Morphology.from_model(model)
    heights = [standing_qpos(model, parts, bend)[2] for bend in (0.4, 0.6, 0.8)]
    assert heights[0] > heights[1] > heights[2]


@pytest.mark.parametrize("name", ROBOTS)
def test_the_standing_pose_is_level_and_balanced(name: str) -> None:
    model = nominal(name)
    parts = Morphology.from_model(model)
    data = mujoco.MjData(model)
    data.qpos[:] = standing_qpos(model, parts, 0.8)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    for sole, side in zip(parts.soles, (1.0, -1.0), strict=True):
        position, rotation = sole_pose(data, sole)
        assert_allclose(position, [0.0, side * parts.foot_spacing_m / 2, 0.0], atol=1e-9)
        assert_allclose(rotation, np.eye(3), atol=1e-9)
    assert_allclose(data.subtree_com[parts.root_id][:2], 0.0, atol=1e-9)
    assert_allclose(data.qpos[3:7], [1, 0, 0, 0], atol=1e-12)
    low, high = model.jnt_range[1:].T
    assert np.all(data.qpos[7:] > low)
    assert np.all(data.qpos[7:] < high)


def test_toe_and_heel_belong_to_the_foot_that_they_are_welded_to() -> None:
    model = nominal("nimble")
    sole = Morphology.from_model(model).soles[0]
    assert sole.body_name == "l_foot"
    own = [g for g in range(model.ngeom) if model.geom(g).name == "l_sole_ball"]
    assert sole.half_length_m > 2 * float(model.geom_size[own[0], 0])


@pytest.mark.parametrize(
    ("joint", "actuator", "expected_nm"),
    [
        ("", "<motor joint='j' gear='2' ctrlrange='-3 3' ctrllimited='true'/>", 6.0),
        ("", "<motor joint='j' gear='2' forcerange='-2 1' forcelimited='true'/>", 2.0),
        ("actuatorfrcrange='-5 5'", "<motor joint='j' gear='2' ctrlrange='-3 3' ctrllimited='true'/>", 5.0),
        ("actuatorfrcrange='-5 5'", "<position joint='j' kp='2' ctrlrange='-0.1 0.1'/>", 5.0),
        ("", "<position joint='j' kp='2' ctrlrange='-0.1 0.1'/>", 0.2),
        ("", "<motor joint='j'/>", np.inf),
    ],
)
def test_a_joint_bears_no_more_than_its_tightest_limit(joint: str, actuator: str, expected_nm: float) -> None:
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><compiler autolimits='true'/><worldbody><body><freejoint/><geom size='1'/>
        <body><joint name='j' {joint}/><geom size='1'/></body></body></worldbody>
        <actuator>{actuator}</actuator></mujoco>"""
    )
    assert torque_limits(model) == [expected_nm]


def test_an_impossible_stance_is_refused() -> None:
    model = nominal("atlas")
    with pytest.raises(ModelError, match=r"No standing pose with knees bent by 0.80 rad"):
        standing_qpos(model, Morphology.from_model(model), 0.8, spacing_m=3.0)


def test_names_that_do_not_exist_are_refused_with_those_that_do() -> None:
    model = nominal("atlas")
    with pytest.raises(ModelError, match=r"no body named 'l_fot'. Did you mean l_foot"):
        Morphology.from_model(model, feet=("l_fot", "r_foot"))
    with pytest.raises(ModelError, match="no body named 'chest'"):
        Morphology.from_model(model, torso="chest")


def test_models_that_cannot_walk_are_refused() -> None:
    fixed = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>")
    with pytest.raises(ModelError, match="first joint must be a free joint"):
        Morphology.from_model(fixed)
    ball = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(ModelError, match="has 1 bodies that can touch the floor"):
        Morphology.from_model(ball)
