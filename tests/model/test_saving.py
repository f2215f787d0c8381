"""What a saved model is: the user's own text with other numbers in it, wherever that can hold them."""

from __future__ import annotations

import difflib
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space, parameter_space
from massid.model.xml_text import XmlText

TETRAHEDRON = "v 0 0 0\nv {a} 0 0\nv 0 {a} 0\nv 0 0 {a}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
LEG = """<!-- left out of the trunk on purpose -->
<mujoco>
  <body name='leg' pos="0 0 -0.3"><joint name="hip" axis="0 1 0" damping="0.5"/>
    <inertial pos="0 0 -0.1" euler="0 0.3 0" mass="2" diaginertia="0.02 0.03 0.012345678901"/> <!-- CAD, rev. B -->
  </body>
</mujoco>"""
HAND = """
<mujoco model="hand"><compiler meshdir="assets"/><asset><mesh name="part" file="part.obj"/></asset>
  <worldbody><body name="hand"><joint name="wrist"/><geom type="mesh" mesh="part"/></body></worldbody>
</mujoco>"""
ROBOT = """<?xml version="1.0"?>
<!-- a robot > a box -->
<mujoco model="robot">
  <compiler meshdir="meshes" angle="radian"/>
  <asset><mesh name="part" file="part.obj"/>{models}</asset>
  <worldbody>
    <!-- the trunk -->
    <body name="base" pos="0 0 1">
      <freejoint/> <geom type="mesh" mesh="part" mass="3"/>
      <include file="parts/leg.xml"/>{attached}
    </body>
  </worldbody>
</mujoco>
"""


def write_robot(folder: Path, hand: bool = False) -> Path:
    """A robot with an include file, meshes in a folder, and a hand that has a folder of its own."""
    meshes = {"meshes": 0.3, "hand/assets": 0.1}
    for name, size in meshes.items():
        (folder / name).mkdir(parents=True)
        (folder / name / "part.obj").write_text(TETRAHEDRON.format(a=size))
    (folder / "parts").mkdir()
    (folder / "parts" / "leg.xml").write_text(LEG)
    (folder / "hand" / "hand.xml").write_text(HAND)
    models = '<model name="hand" file="hand/hand.xml"/>' if hand else ""
    attached = '<attach model="hand" body="hand" prefix="my_"/>' if hand else ""
    (folder / "robot.xml").write_text(ROBOT.format(models=models, attached=attached))
    return folder / "robot.xml"


def test_comments_stay_and_numbers_keep_all_their_digits(tmp_path: Path) -> None:
    path = write_robot(tmp_path / "robots")
    robot = Robot.load(path)
    space = parameter_space(robot, ["leg"], ["damping/hip"])
    robot.write_model(space, np.array([2.123456789012, 0.7]), tmp_path / "saved.xml")
    text = (tmp_path / "saved.xml").read_text()
    for kept in ("<!-- a robot > a box -->", "<!-- the trunk -->", "<!-- CAD, rev. B -->", 'euler="0 0.3 0"'):
        assert kept in text
    saved = mujoco.MjModel.from_xml_path(str(tmp_path / "saved.xml"))  # as others read it
    assert saved.body("leg").mass[0] == 2.123456789012
    assert saved.joint("hip").damping[0] == 0.7
    expected = robot.model_at(space, np.array([2.123456789012, 0.7])).body("leg")
    np.testing.assert_allclose(saved.body("leg").inertia, expected.inertia, rtol=1e-15)
    np.testing.assert_allclose(saved.body("leg").iquat, expected.iquat, atol=1e-15)
    lines = difflib.ndiff(ROBOT.format(models="", attached="").splitlines(), text.splitlines())
    gone = [line for line in lines if line.startswith("- ")]
    assert len(gone) == 2, gone  # where the meshes are, and what is included


def test_a_body_without_inertia_of_its_own_gets_one_where_it_stands(tmp_path: Path) -> None:
    path = write_robot(tmp_path / "robots")
    robot = Robot.load(path)
    robot.write_model(mass_space(robot, ["base"]), np.array([4.0]), path.with_name("saved.xml"))
    saved = Robot.load(path.with_name("saved.xml")).model
    np.testing.assert_allclose(saved.body("base").inertia, robot.model.body("base").inertia * 4.0 / 3.0, rtol=1e-14)
    assert saved.body("leg").mass[0] == 2.0
    assert '<compiler meshdir="meshes" angle="radian"/>' in path.with_name("saved.xml").read_text()  # same folder


@pytest.mark.parametrize("link", ["leg", "my_hand"])
@pytest.mark.parametrize("with_assets", [False, True])
def test_models_within_the_model_keep_their_own_meshes(link: str, with_assets: bool, tmp_path: Path) -> None:
    path = write_robot(tmp_path / "robots", hand=True)
    robot = Robot.load(path)
    space = mass_space(robot, [link])
    other = tmp_path / "results" / "today"
    other.mkdir(parents=True)
    expected, drawn = robot.model_at(space, 1.5 * space.nominal), robot.with_all_seen()
    robot.write_model(space, 1.5 * space.nominal, other / "saved.xml", with_assets=with_assets)
    if with_assets:
        shutil.rmtree(tmp_path / "robots")
    else:  # both folders may move together
        (tmp_path / "moved").mkdir()
        for name in ("robots", "results"):
            (tmp_path / name).rename(tmp_path / "moved" / name)
        other = tmp_path / "moved" / "results" / "today"
    saved = mujoco.MjModel.from_xml_path(str(other / "saved.xml"))
    np.testing.assert_allclose(saved.body_mass, expected.body_mass, rtol=1e-5)
    np.testing.assert_allclose(np.sort(saved.mesh_vert.ravel()), np.sort(drawn.mesh_vert.ravel()), atol=1e-6)


def test_a_copied_mesh_lies_beside_the_model(tmp_path: Path) -> None:
    path = write_robot(tmp_path / "robots")
    robot = Robot.load(path)
    space = mass_space(robot, ["leg"])
    robot.write_model(space, space.nominal, tmp_path / "saved.xml", with_assets=True)
    assert [file.name for file in (tmp_path / "saved_assets").iterdir()] == ["part.obj"]
    assert "<!-- the trunk -->" in (tmp_path / "saved.xml").read_text()


def test_places_in_a_text_are_changed_and_nothing_else() -> None:
    content = b"<?xml version='1.0'?>\n<a  x = '1>2'\n  y=\"3\"><b/><!-- <c/> --><c z='4'>text</c></a>\n"
    text = XmlText(content, "a.xml")
    b, c = text.root.children
    assert text.render() == content
    text.set(text.root, {"x": "5 < 6", "w": "7"})
    text.insert_first(b, "<d/>")
    text.set(c, {"z": None})
    assert text.render() == (
        b'<?xml version=\'1.0\'?>\n<a  x = "5 &lt; 6"\n  y="3" w="7"><b><d/></b><!-- <c/> --><c>text</c></a>\n'
    )
    text.remove(c)
    text.replace(b, "<e/>")
    assert text.render().endswith(b"<e/><!-- <c/> --></a>\n")
