"""Conventions that are got wrong most often: each is told from the right one, with and without sensor noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from massid.assets import sample_walk
from massid.audit import audit_walk, prepare_walk
from massid.audit.balance import Balance, measure_balance
from massid.audit.forces import Rest, check_rest, check_weight
from massid.audit.kinematics import Kinematics, check_kinematics
from massid.audit.names import without_prefix
from massid.errors import LogError
from massid.log import read_walk
from massid.model.robot import Robot
from massid.walk import Segment, Walk
from massid.walk.conventions import to_world
from massid.walk.noise import PRESETS, NoisePreset, Sensors
from massid.weighing import load_robot
from tests.conftest import Pushed

NOISES: tuple[NoisePreset, ...] = ("clean", "white", "realistic")


@cache
def robot() -> Robot:
    return load_robot(None, [read_walk(sample_walk())])


@cache
def walked(noise: NoisePreset, seed: int = 3) -> Walk:
    """The sample walk, nearly straight ahead, through such sensors."""
    walk = robot().align(read_walk(sample_walk()))
    if noise == "clean":
        return walk
    sensors = Sensors(PRESETS[noise], len(walk.joint_names), walk.contact_bodies, np.random.default_rng(seed))
    return sensors.measure(walk)


def in_world(walk: Walk, columns: slice) -> Walk:
    """Read as if the body's: what was given in the world is turned once too often."""
    qvel = walk.qvel.copy()
    qvel[:, columns] = to_world(walk.qpos[:, 3:7], qvel[:, columns])
    return replace(walk, qvel=qvel)


def inverse(walk: Walk) -> Walk:
    qpos = walk.qpos.copy()
    qpos[:, 4:7] *= -1.0
    return replace(walk, qpos=qpos)


def wrenches(walk: Walk, change: Callable[[np.ndarray], np.ndarray]) -> Walk:
    return replace(walk, wrench=np.ascontiguousarray(change(walk.wrench.copy())))


def times(values: np.ndarray, part: tuple[object, ...], factor: float) -> np.ndarray:
    values[part] *= factor
    return values


def geared(walk: Walk) -> Walk:
    """Torques of the motors of the legs."""
    ratio = np.ones(len(walk.joint_names))
    ratio[-12:] = [100, 80, 100, 50, 60, 80] * 2
    return replace(walk, effort=walk.effort / ratio)


def rate_in_degrees(walk: Walk) -> Walk:
    qvel = walk.qvel.copy()
    qvel[:, 3:6] = np.degrees(qvel[:, 3:6])
    return replace(walk, qvel=qvel)


def joints(walk: Walk, factor: float, *, positions: bool = False) -> Walk:
    """Positions or velocities of all joints in another unit, or of the other sign."""
    qpos, qvel = walk.qpos.copy(), walk.qvel.copy()
    if positions:
        qpos[:, 7:] *= factor
    else:
        qvel[:, 6:] *= factor
    return replace(walk, qpos=qpos, qvel=qvel)


def sides(walk: Walk) -> list[int]:
    """The order in which left and right joints of the sample robot change places."""
    names = walk.joint_names
    other = {"l_": "r_", "r_": "l_"}
    return [names.index(other.get(name[:2], name[:2]) + name[2:]) for name in names]


def one_turned(walk: Walk) -> Walk:
    effort = walk.effort.copy()
    effort[:, walk.joint_names.index("l_leg_aky")] *= -1.0
    return replace(walk, effort=effort)


SPOILS: dict[str, tuple[Callable[[Walk], Walk], str]] = {
    "twist": (
        lambda w: in_world(w, slice(0, 3)),
        "velocity looks as if it were given in the world (linear_velocity: fr",
    ),
    "rate in degrees": (
        rate_in_degrees,
        "turn rate looks as if it were in degrees per second (angular_velocity: scale",
    ),
    "velocities in degrees": (
        lambda w: joints(w, 180.0 / np.pi),
        "velocities look as if they were in degrees per second (velocity: scale: 0.0174533)",
    ),
    "velocities turned": (lambda w: joints(w, -1.0), "or of the position is turned (velocity: scale: -1)"),
    "swapped torques": (
        lambda w: replace(w, effort=w.effort[:, sides(w)]),
        "the torques of left and right joints look",
    ),
    "kgf": (lambda w: wrenches(w, lambda f: f / 9.80665), "look as if they were in kgf and kgf m (contacts: force"),
    "inverse": (inverse, "the attitude looks as if it were that of the world in the body"),
    "sign": (lambda w: replace(w, effort=-w.effort), "torques look as if their sign were turned (effort: scale: -1)"),
    "mN m": (lambda w: replace(w, effort=1e3 * w.effort), "torques look as if they were in mN m (effort: scale: 0.001"),
    "gears": (geared, "those of motors before gears (joints: gears: {"),
    "one sign": (one_turned, "torques of l_leg_aky look as if their sign were turned (joints: gears: {l_leg_aky: -1})"),
    "upside down": (
        lambda w: wrenches(w, lambda f: f * np.tile([-1.0, 1.0, 1.0], 2)),
        "turned by 180 degrees about x, and the forces as if they were those on the ground (contacts: on: ground, rot",
    ),
    "feet": (lambda w: wrenches(w, lambda f: f[:, ::-1]), "wrenches of l_foot and r_foot look swapped"),
    "foot": (
        lambda w: wrenches(w, lambda f: times(f, (slice(None), 0), -1.0)),
        "wrench of l_foot looks as if it were th",
    ),
    "moments": (
        lambda w: wrenches(w, lambda f: times(f, (..., slice(3, 6)), 1e3)),
        "moments of the wrenches look as if ",
    ),
}


@cache
def balance(noise: NoisePreset) -> Balance:
    """What the walk took: the same whatever torques and wrenches are read as."""
    found = measure_balance(robot(), walked(noise), steps=400)
    assert found is not None
    return found


def judged(walk: Walk, noise: NoisePreset) -> tuple[Kinematics, Rest]:
    return check_kinematics(walk), check_rest(robot(), walk, balance(noise), check_weight(robot(), walk))


@pytest.mark.parametrize("noise", NOISES)
def test_what_is_right_is_not_doubted(noise: NoisePreset) -> None:
    kinematics, rest = judged(walked(noise), noise)
    assert kinematics.suspicions == ()
    assert rest.suspicions == ()


@pytest.mark.parametrize("noise", ["clean", "realistic"])
@pytest.mark.parametrize("kind", SPOILS)
def test_what_is_wrong_is_named_with_the_setting_that_cures_it(kind: str, noise: NoisePreset) -> None:
    spoil, message = SPOILS[kind]
    kinematics, rest = judged(spoil(walked(noise)), noise)
    said = (*kinematics.suspicions, *rest.suspicions)
    assert any(message in line for line in said), said
    assert kinematics.misread or rest.names_a_setting


@pytest.mark.parametrize("noise", ["clean", "white"])
@pytest.mark.parametrize("columns", [slice(0, 3), slice(3, 6)], ids=["velocity", "turn rate"])
def test_frames_show_on_a_straight_walk_through_noise(columns: slice, noise: NoisePreset) -> None:
    """However small the difference is: what is left goes along with it. The right frame is never doubted."""
    what = "angular_velocity: frame: world" if columns.start else "linear_velocity: frame: world"
    for seed in range(1 if noise == "clean" else 2):
        found = check_kinematics(in_world(walked(noise, seed), columns))
        (line,) = found.suspicions
        assert what in line
        assert found.misread
        assert check_kinematics(walked(noise, seed)).suspicions == ()


@pytest.mark.parametrize("factor", [1.1, 0.8])
def test_a_scale_that_is_off_is_told_from_gains_of_sensors(factor: float) -> None:
    """Without noise any; beside noise only what sensors do not do."""
    _, rest = judged(replace(walked("clean"), effort=factor * walked("clean").effort), "clean")
    assert f"(effort: scale: {1 / factor:.3g})" in rest.suspicions[0]
    assert "or the wrenches" in rest.suspicions[0]  # which of the two are right no balance shows
    assert rest.names_a_setting
    _, rest = judged(replace(walked("realistic"), effort=1.02 * walked("realistic").effort), "realistic")
    assert rest.suspicions == ()


def test_left_and_right_joints_that_are_swapped_are_told_from_swapped_feet() -> None:
    """States as well: the balance is that of another motion, and no force convention is blamed for it."""
    walk = walked("clean")
    order = sides(walk)
    swapped = replace(
        walk,
        qpos=np.hstack([walk.qpos[:, :7], walk.qpos[:, 7:][:, order]]),
        qvel=np.hstack([walk.qvel[:, :6], walk.qvel[:, 6:][:, order]]),
        effort=walk.effort[:, order],
        segments=(Segment(0, 1500),),
    )
    audit = audit_walk(robot(), swapped)
    assert "left and right joints look swapped (joints: names, or rename) (then 0%)" in audit.warnings[0]
    assert audit.misread
    assert len(audit.doubts) == 1


def test_axes_that_point_the_other_way_are_told_by_limits_and_forces() -> None:
    walk = walked("clean")
    k = walk.joint_names.index("l_leg_kny")
    qpos, qvel, effort = walk.qpos.copy(), walk.qvel.copy(), walk.effort.copy()
    qpos[:, 7 + k] *= -1.0
    qvel[:, 6 + k] *= -1.0
    effort[:, k] *= -1.0
    audit = audit_walk(robot(), replace(walk, qpos=qpos, qvel=qvel, effort=effort, segments=(Segment(0, 1500),)))
    limit, force = audit.warnings[:2]
    assert "l_leg_kny" in limit
    assert "as if their sign were turned" in limit
    assert "the axes of l_leg_kny look as if they pointed the other way in the model" in force
    assert audit.misread


def test_forces_are_not_blamed_for_a_state_that_was_misread() -> None:
    """With a wrong state no force fits."""
    audit = audit_walk(robot(), in_world(walked("clean"), slice(0, 3)))
    assert audit.misread
    assert [line for line in audit.warnings if "force" in line] == []
    assert len(audit.doubts) == 1


@pytest.mark.parametrize("noise", ["clean", "realistic"])
def test_joints_in_degrees_are_told_by_their_limits(noise: NoisePreset) -> None:
    """Positions and velocities alike, so that they agree with each other. In such poses links touch: none of that is
    said, and nothing is cut out of the log for it."""
    walk = walked(noise)
    qpos, qvel = walk.qpos.copy(), walk.qvel.copy()
    qpos[:, 7:], qvel[:, 6:] = np.degrees(qpos[:, 7:]), np.degrees(qvel[:, 6:])
    spoilt = replace(walk, qpos=qpos, qvel=qvel, segments=(Segment(0, 500),))
    audit = audit_walk(robot(), spoilt)
    (line,) = audit.warnings
    assert "look as if they were in degrees (position: scale: 0.0174533" in line
    assert audit.misread
    assert audit.walk.segments == spoilt.segments


def test_torques_that_are_all_zero_are_refused(pushed: Pushed) -> None:
    silent = replace(pushed.walk, effort=np.zeros_like(pushed.walk.effort))
    with pytest.raises(
        LogError, match=r"the effort of all 8 joints of spec is 0 in every sample: the log holds no tor"
    ):
        prepare_walk(silent, pushed.robot)


@pytest.mark.parametrize("prefix", ["robot1/", "biped::", "left_arm_"])
def test_a_prefix_of_all_names_is_taken_off_and_said(pushed: Pushed, prefix: str) -> None:
    walk = pushed.walk
    named = replace(
        walk,
        root_body=prefix + walk.root_body,
        contact_bodies=tuple(prefix + name for name in walk.contact_bodies),
    )
    found = without_prefix(named, pushed.robot)
    assert (found.root_body, found.contact_bodies) == (walk.root_body, walk.contact_bodies)
    assert f"names begin with '{prefix}'" in found.warnings[-1]


def test_names_that_differ_otherwise_stay(pushed: Pushed) -> None:
    walk = pushed.walk
    for name in ("robot1/trunk", "strange_torso_frame", "xtorso"):
        odd = replace(walk, root_body=name)
        assert without_prefix(odd, pushed.robot) is odd
