from __future__ import annotations

import mujoco
import pytest

from massid.errors import BadInputError
from massid.model.robot import Robot
from massid.weighing import named_links


def _body(name: str, mass: float, z: float, inside: str = "", y: float = 0.0, axis: str = "0 1 0") -> str:
    return (
        f'<body name="{name}" pos="0 {y} {z}"><joint name="{name}" axis="{axis}"/>'
        f'<geom size="0.03" pos="0 0 -0.03" mass="{mass}"/>{inside}</body>'
    )


def _leg(side: str, y: float, toes: int = 0) -> str:
    """A hip of three bodies, a knee, an ankle with a light cross: as many commercial humanoids have it."""
    toe = "".join(_body(f"{side}_toe{k}", 0.05, -0.02) for k in range(toes))
    sole = _body(f"{side}_sole", 0.7, -0.02, toe, axis="1 0 0")
    shin = _body(f"{side}_shin", 1.7, -0.3, _body(f"{side}_cross", 0.07, -0.3, sole))
    yaw = _body(f"{side}_yaw", 2.2, -0.06, shin, axis="0 0 1")
    roll = _body(f"{side}_roll", 0.4, -0.04, yaw, axis="1 0 0")
    return _body(f"{side}_pitch", 1.0, -0.05, roll, y)


def _humanoid(legs: str, waist: bool = False) -> Robot:
    arms = "".join(_body(f"{s}_arm", 1.5, 0.2, _body(f"{s}_hand", 0.8, -0.3), y) for s, y in (("l", 0.3), ("r", -0.3)))
    below = _body("waist", 2.5, -0.05, legs, axis="0 0 1") if waist else legs
    return Robot(
        mujoco.MjSpec.from_string(
            f'<mujoco><worldbody><body name="base" pos="0 0 1"><freejoint/><geom size="0.1" mass="4"/>'
            f"{_body('chest', 9, 0.2, arms)}{below}</body></worldbody></mujoco>"
        )
    )


USUAL = ("chest", "l_yaw", "r_yaw", "l_shin", "r_shin", "l_sole", "r_sole")


@pytest.mark.parametrize("waist", [False, True])
@pytest.mark.parametrize("toes", [0, 2])
def test_trunk_thighs_shanks_and_feet_are_found_by_the_tree(waist: bool, toes: int) -> None:
    robot = _humanoid(_leg("l", 0.1, toes) + _leg("r", -0.1, toes), waist)
    assert robot.default_links() == USUAL
    assert named_links(robot, None) == USUAL
    assert named_links(robot, ["l_hand"]) == ("l_hand",)


def test_the_usual_names_need_not_be_there_in_full() -> None:
    """A robot with some of them has others by other names: they would not be weighed."""
    spec = _humanoid(_leg("l", 0.1) + _leg("r", -0.1)).spec
    spec.body("chest").name = "torso"
    assert Robot(spec).default_links() == ("torso", *USUAL[1:])


def test_a_robot_without_two_legs_asks_for_links() -> None:
    with pytest.raises(BadInputError, match=r"no two legs.*name the links to weigh \(`links`\).*chest"):
        named_links(_humanoid(_leg("l", 0.1)), None)
