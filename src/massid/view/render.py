"""Frames of the robot for a printed page, rendered by MuJoCo on a white floor; none where nothing can render."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from massid.model.robot import Robot
from massid.typing import AnyArray, FloatArray
from massid.view import colours
from massid.view.shapes import shown_geoms

FLOOR = "massid_floor"
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

    model = _stage(robot, width, height)
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


def _stage(robot: Robot, width: int, height: int) -> mujoco.MjModel:
    """The robot on a white floor in a white room."""
    spec = robot.seen.copy()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.shadowsize = 4096
    spec.visual.map.shadowclip = 3.0  # a tighter shadow map speckles the floor
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.68] * 3, [0.42] * 3
    for light in list(spec.lights):
        spec.delete(light)
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[0, 0, 4],
        dir=[-0.16, 0.1, -1.0],
        diffuse=[0.32] * 3,
        castshadow=True,
    )
    if not any(int(texture.type) == int(mujoco.mjtTexture.mjTEXTURE_SKYBOX) for texture in spec.textures):
        builtin = int(mujoco.mjtBuiltin.mjBUILTIN_FLAT)
        spec.add_texture(
            name="massid_sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=builtin,
            rgb1=[1.0] * 3,
            rgb2=[1.0] * 3,
            width=64,
            height=64,
        )
    spec.worldbody.add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 1],
        rgba=[1.0, 1.0, 1.0, 1.0],
        contype=0,
        conaffinity=0,
    )
    return spec.compile()


def _paint(model: mujoco.MjModel, robot: Robot, link_rgb: Mapping[str, FloatArray]) -> None:
    """Tint the links; the robot's own light and dark paint stays visible."""
    for body in range(1, robot.drawn.nbody):
        rgb = link_rgb.get(robot.drawn.body(body).name, np.array(colours.NEUTRAL))
        shown = shown_geoms(robot.drawn, body)
        first = int(model.body_geomadr[model.body(robot.drawn.body(body).name).id]) - int(
            robot.drawn.body_geomadr[body]
        )
        for geom in np.flatnonzero(robot.drawn.geom_bodyid == body):
            target = int(geom) + first
            material = int(robot.drawn.geom_matid[geom])
            own = robot.drawn.mat_rgba[material] if material >= 0 else robot.drawn.geom_rgba[geom]
            model.geom_matid[target] = -1
            model.geom_rgba[target, :3] = rgb * colours.tone(np.asarray(own)[None])[0]
            model.geom_rgba[target, 3] = 1.0 if int(geom) in shown else 0.0
            model.geom_group[target] = 0
