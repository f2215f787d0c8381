from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from massid.assets import shipped_models
from massid.errors import LogError, ModelError
from massid.robot import Robot
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
    space = robot.mass_space(links)
    point = space.nominal * np.array([1.2, 0.8])
    robot.write_mjcf(space, point, tmp_path / "identified.xml")

    saved = Robot.load(tmp_path / "identified.xml").model
    for link, mass, nominal in zip(links, point, space.nominal, strict=True):
        np.testing.assert_allclose(saved.body(link).mass, mass, rtol=1e-6)  # MJCF text keeps 6 digits or more
        before = robot.model.body(link).inertia
        np.testing.assert_allclose(saved.body(link).inertia, before * mass / nominal, rtol=1e-5)
    others = [b for b in range(saved.nbody) if saved.body(b).name not in links]
    np.testing.assert_allclose(saved.body_mass[others], robot.model.body_mass[others], rtol=1e-6)
    np.testing.assert_allclose(saved.body_ipos, robot.model.body_ipos, atol=1e-6)


def test_a_mass_scales_the_inertia_and_leaves_the_centre_of_mass() -> None:
    robot = make_robot()
    space = robot.mass_space(["l_thigh"])
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
        make_robot().mass_space([link])


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
