"""Robots' files on the command line: a URDF from log to saved URDF, links by default, refusals before any work."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from massid.cli import main
from massid.log import write_walk
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from tests.pushed_robot import XML, draw_truth, push_about


def _link(name: str, mass: float, size: tuple[float, float, float], z: float, touches: bool = False) -> str:
    x, y, height = size
    moments = mass / 12.0 * np.array([y * y + height**2, x * x + height**2, x * x + y * y])
    collision = f'<collision><origin xyz="0.03 0 {z}"/><geometry><box size="{x} {y} {height}"/></geometry></collision>'
    return (
        f'<link name="{name}"><inertial><origin xyz="0.01 0 {z}"/><mass value="{mass}"/><inertia ixx="{moments[0]}" '
        f'ixy="0" ixz="0" iyy="{moments[1]}" iyz="0" izz="{moments[2]}"/></inertial>'
        f"{collision if touches else ''}</link>"
    )


def _joint(name: str, parent: str, child: str, place: str) -> str:
    return (
        f'<joint name="{name}" type="continuous"><origin xyz="{place}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="0 1 0"/><dynamics damping="0.2"/></joint>'
    )


def _urdf() -> str:
    """A biped whose links have names of their own; it hangs on a fixed joint, as in a planner's file."""
    parts = ['<link name="world"/>', _joint("rig", "world", "hull", "0 0 0.92").replace("continuous", "fixed")]
    parts.append(_link("hull", 20.0, (0.2, 0.3, 0.4), 0.1))
    for side, y in (("l", 0.1), ("r", -0.1)):
        parts += [
            _link(f"{side}_upper", 4.0, (0.1, 0.1, 0.35), -0.17),
            _link(f"{side}_lower", 2.5, (0.08, 0.08, 0.35), -0.17),
            _link(f"{side}_foot", 1.0, (0.4, 0.16, 0.04), -0.05, touches=True),
            _joint(f"{side}_hip", "hull", f"{side}_upper", f"0 {y} -0.15"),
            _joint(f"{side}_knee", f"{side}_upper", f"{side}_lower", "0.01 0 -0.35"),
            _joint(f"{side}_ankle", f"{side}_lower", f"{side}_foot", "-0.01 0 -0.35"),
        ]
    return f'<robot name="biped"><!-- made by hand -->{"".join(parts)}</robot>'


LINKS = ("hull", "l_upper", "r_upper", "l_lower", "r_lower", "l_foot", "r_foot")


def test_a_urdf_is_weighed_by_default_links_and_saved_as_a_urdf(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "biped.urdf"
    path.write_text(_urdf())
    plant = Robot.load(path).spec.copy()
    plant.option.timestep, plant.option.tolerance = 0.001, 0.0
    plant.body("hull").pos = [0.0, 0.0, 0.92]
    for joint in plant.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            plant.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    robot = Robot(plant)
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed=3)
    write_walk(push_about(robot, space, truth, seconds=1.6), tmp_path / "walk.mcap")

    saved = tmp_path / "weighed.urdf"
    arguments = ["--model", str(path), "--dwell-s", "0.25", "--save-model", str(saved)]
    code = main(["identify", str(tmp_path / "walk.mcap"), *arguments])
    told = capsys.readouterr()
    assert code == 0, told.err
    assert f"links: {', '.join(LINKS)} (--links names others)" in told.out
    assert told.out.index("links: ") < told.out.index("verdict: ")
    warning, of_rotors = [line for line in told.err.splitlines() if "warning" in line]
    assert "--unknown armature/JOINT" in of_rotors
    assert "link 'hull' floats instead of being fixed" in warning
    assert "<!-- made by hand -->" in saved.read_text()
    weighed = Robot.load(saved)
    np.testing.assert_allclose([weighed.nominal_mass_kg(link) for link in LINKS], truth, atol=1e-6)


def test_links_shows_what_is_weighed_by_default(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "biped.urdf"
    path.write_text(_urdf())
    assert main(["links", str(path)]) == 0
    told = capsys.readouterr()
    assert sum(line.endswith("*") for line in told.out.splitlines()) == len(LINKS)
    assert "floats instead of being fixed" in told.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--save-model", "x.urdf"], "--save-model x.urdf: only what was read from a URDF is saved as one"),
        (["--copy-assets"], "--copy-assets goes with --save-model"),
    ],
)
def test_what_cannot_be_saved_is_told_before_any_work(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.xml").write_text(XML)
    assert main(["identify", str(tmp_path / "no.mcap"), "--model", str(tmp_path / "robot.xml"), *arguments]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
