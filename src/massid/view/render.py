"""Frames of the robot for a printed page, rendered by MuJoCo on a white floor; none where nothing can render."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from massid.model.robot import Robot
from massid.typing import AnyArray, FloatArray
from massid.view import colours
from massid.view.shapes import shown_geoms
from massid.view.stage import stage

AZIMUTH_DEG, ELEVATION_DEG = 140.0, -10.0
DISTANCE = 1.5
"""From the robot to the camera, in heights of the robot."""


@dataclass(frozen=True)
class Shot:
    """One frame to render.

    Attributes:
        qpos: pose in the model's order, shape (nq,).
        link_rgb: colours of the identified links, sRGB in [0, 1].
    """

    qpos: FloatArray
    link_rgb: Mapping[str, FloatArray]


def render_shots(robot: Robot, shots: Sequence[Shot], height_m: float, width: int, height: int) -> list[AnyArray]:
    """Render frames off-screen.

    Args:
        robot: the robot to show.
        shots: poses and colours.
        height_m: of the robot.
        width: of each frame [pixels].
        height: of each frame [pixels].

    Returns:
        Pictures of shape (height, width, 3) and type uint8; none if no graphics driver works here.
    """
    try:
        return _render(robot, shots, height_m, width, height)
    except Exception:  # whatever a missing or broken graphics driver raises, the page does without the robot
        return []


def _render(robot: Robot, shots: Sequence[Shot], height_m: float, width: int, height: int) -> list[AnyArray]:
    from mujoco.egl import GLContext

    model = copy.copy(stage(robot))
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    data, option, camera = mujoco.MjData(model), mujoco.MjvOption(), mujoco.MjvCamera()
    context = GLContext(width, height)
    try:
        context.make_current()
        gpu = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(int(mujoco.mjtFramebuffer.mjFB_OFFSCREEN), gpu)
        scene = mujoco.MjvScene(model, maxgeom=4 * model.ngeom + 100)
        view = mujoco.MjrRect(0, 0, width, height)
        pictures = []
        for shot in shots:
            _paint(model, robot, shot.link_rgb)
            data.qpos[:] = shot.qpos
            at = robot.layout.root_qpos
            model.light_pos[-1, :2] = shot.qpos[at : at + 2]  # far from the light, shadows speckle the floor
            mujoco.mj_forward(model, data)
            root = data.body(robot.root_body).xpos
            camera.lookat[:] = root[0], root[1], data.xpos[1:, 2].min() + 0.45 * height_m
            camera.distance = DISTANCE * height_m
            camera.azimuth, camera.elevation = AZIMUTH_DEG, ELEVATION_DEG
            mujoco.mjv_updateScene(model, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
            mujoco.mjr_render(view, scene, gpu)
            pixels = np.empty((height, width, 3), dtype=np.uint8)
            mujoco.mjr_readPixels(pixels, None, view, gpu)
            pictures.append(pixels[::-1].copy())
        gpu.free()
        return pictures
    finally:
        context.free()


def _paint(model: mujoco.MjModel, robot: Robot, link_rgb: Mapping[str, FloatArray]) -> None:
    """Tint the links; the robot's own light and dark paint stays visible."""
    own = stage(robot)
    for body in range(1, own.nbody):
        rgb = link_rgb.get(own.body(body).name, np.array(colours.NEUTRAL))
        shown = shown_geoms(own, body)
        for geom in np.flatnonzero(own.geom_bodyid == body).tolist():
            material = int(own.geom_matid[geom])
            paint = own.mat_rgba[material] if material >= 0 else own.geom_rgba[geom]
            model.geom_matid[geom] = -1
            model.geom_rgba[geom, :3] = rgb * colours.tone(np.asarray(paint)[None])[0]
            model.geom_rgba[geom, 3] = 1.0 if geom in shown else 0.0
            model.geom_group[geom] = 0
