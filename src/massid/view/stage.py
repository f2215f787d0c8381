"""The robot as it is shown, compiled once for everything that shows it: on a white floor in a white room."""

from __future__ import annotations

from functools import lru_cache

import mujoco

from massid.memory import give_back
from massid.model.robot import Robot

FLOOR = "massid_floor"


@lru_cache(maxsize=1)
def stage(robot: Robot) -> mujoco.MjModel:
    """The robot with all that is seen of it; its geoms come with the floor's, which is the world's.

    Meshes and textures take up to hundreds of megabytes: what a compilation leaves behind is given back.

    Raises:
        ModelError: it does not compile.
    """
    model = robot.with_all_seen(_dress)
    mujoco.mj_clearCache(mujoco.mj_getCache())
    give_back()
    return model


def _dress(spec: mujoco.MjSpec) -> None:
    """Floor, light and sky in place of the file's own."""
    for geom in spec.worldbody.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE:  # two floors at one height would shine through each other
            geom.material, geom.rgba = "", [0.0] * 4
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
