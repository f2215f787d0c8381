"""The robot's geoms as triangles: one mesh per body, in the body's frame, with smooth normals."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.typing import FloatArray, IntArray

SEGMENTS = 24
"""Edges around a round geom."""
ARC = 7
"""Edges from the pole of a round geom to its equator."""
VISIBLE_GROUPS = 3
"""Geom groups 0, 1 and 2 are what MuJoCo's own viewer shows; group 3 holds collision geoms by convention."""


@dataclass(frozen=True)
class Mesh:
    """Triangles of one body.

    Attributes:
        vertices: shape (n, 3) [m].
        normals: unit length, shape (n, 3).
        triangles: shape (m, 3).
        rgba: colour of each vertex as the model paints it, shape (n, 4).
    """

    vertices: FloatArray
    normals: FloatArray
    triangles: IntArray
    rgba: FloatArray


@dataclass(frozen=True)
class _Surface:
    vertices: FloatArray
    normals: FloatArray
    triangles: IntArray


def shown_geoms(model: mujoco.MjModel, body: int) -> list[int]:
    """Geoms of a body that are drawn: the visible groups, or all of them if a body has none of those."""
    planes = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
    solid = [int(g) for g in np.flatnonzero(model.geom_bodyid == body) if int(model.geom_type[g]) not in planes]
    visible = [g for g in solid if model.geom_group[g] < VISIBLE_GROUPS and model.geom_rgba[g, 3] > 0]
    return visible or solid


def body_mesh(model: mujoco.MjModel, body: int) -> Mesh | None:
    """All drawn geoms of a body as one mesh in the body's frame; None for a body without any."""
    parts: list[Mesh] = []
    for geom in shown_geoms(model, body):
        surface = _geom_surface(model, geom)
        if surface is None:
            continue
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        matrix = rotation.reshape(3, 3)
        material = int(model.geom_matid[geom])
        rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        parts.append(
            Mesh(
                vertices=surface.vertices @ matrix.T + model.geom_pos[geom],
                normals=surface.normals @ matrix.T,
                triangles=surface.triangles,
                rgba=np.repeat(np.asarray(rgba, dtype=np.float64)[None], len(surface.vertices), axis=0),
            )
        )
    if not parts:
        return None
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return Mesh(
        vertices=np.vstack([part.vertices for part in parts]),
        normals=np.vstack([part.normals for part in parts]),
        triangles=np.vstack([part.triangles + offset for part, offset in zip(parts, offsets, strict=True)]),
        rgba=np.vstack([part.rgba for part in parts]),
    )


def _geom_surface(model: mujoco.MjModel, geom: int) -> _Surface | None:
    size = np.asarray(model.geom_size[geom], dtype=np.float64)
    kinds = mujoco.mjtGeom
    surface: _Surface | None = None
    match mujoco.mjtGeom(int(model.geom_type[geom])):
        case kinds.mjGEOM_SPHERE:
            surface = _ellipsoid(np.full(3, size[0]))
        case kinds.mjGEOM_ELLIPSOID:
            surface = _ellipsoid(size)
        case kinds.mjGEOM_CAPSULE:
            surface = _capsule(size[0], size[1])
        case kinds.mjGEOM_CYLINDER:
            surface = _cylinder(size[0], size[1])
        case kinds.mjGEOM_BOX:
            surface = _box(size)
        case kinds.mjGEOM_MESH | kinds.mjGEOM_SDF:
            surface = _mesh(model, int(model.geom_dataid[geom]))
    return surface


def _revolve(profile: FloatArray) -> _Surface:
    """Turn a profile around z.

    Args:
        profile: rows (r, z, normal r, normal z) from the top down, shape (k, 4).
    """
    angle = np.linspace(0.0, 2.0 * np.pi, SEGMENTS, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    k = len(profile)

    def ring(radius: FloatArray, height: FloatArray) -> FloatArray:
        around = radius[:, None, None] * circle
        return np.concatenate([around, np.broadcast_to(height[:, None, None], (k, SEGMENTS, 1))], axis=2).reshape(-1, 3)

    rows, columns = np.meshgrid(np.arange(k - 1), np.arange(SEGMENTS), indexing="ij")
    a = rows * SEGMENTS + columns
    b = rows * SEGMENTS + (columns + 1) % SEGMENTS
    triangles = np.stack([a, a + SEGMENTS, b, b, a + SEGMENTS, b + SEGMENTS], axis=-1).reshape(-1, 3)
    return _Surface(ring(profile[:, 0], profile[:, 1]), ring(profile[:, 2], profile[:, 3]), triangles)


def _arc(n: int, start: float, stop: float) -> FloatArray:
    polar = np.linspace(start, stop, n + 1)
    return np.stack([np.sin(polar), np.cos(polar)], axis=1)


def _ellipsoid(radii: FloatArray) -> _Surface:
    arc = _arc(2 * ARC, 0.0, np.pi)
    unit = _revolve(np.hstack([arc, arc]))
    normals = unit.normals / radii
    return _Surface(unit.vertices * radii, normals / np.linalg.norm(normals, axis=1, keepdims=True), unit.triangles)


def _capsule(radius: float, half_length: float) -> _Surface:
    top, bottom = _arc(ARC, 0.0, np.pi / 2), _arc(ARC, np.pi / 2, np.pi)
    shift = np.array([0.0, half_length])
    return _revolve(np.vstack([np.hstack([radius * top + shift, top]), np.hstack([radius * bottom - shift, bottom])]))


def _cylinder(radius: float, half_length: float) -> _Surface:
    return _revolve(
        np.array(
            [
                [0.0, half_length, 0.0, 1.0],
                [radius, half_length, 0.0, 1.0],
                [radius, half_length, 1.0, 0.0],
                [radius, -half_length, 1.0, 0.0],
                [radius, -half_length, 0.0, -1.0],
                [0.0, -half_length, 0.0, -1.0],
            ]
        )
    )


def _box(half_size: FloatArray) -> _Surface:
    vertices, normals = [], []
    for axis in range(3):
        u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        for sign in (1.0, -1.0):
            normal = sign * np.eye(3)[axis]
            corners = [normal - sign * u - v, normal + sign * u - v, normal + sign * u + v, normal - sign * u + v]
            vertices.append(np.array(corners) * half_size)
            normals.append(np.repeat(normal[None], 4, axis=0))
    face = np.array([[0, 1, 2], [0, 2, 3]])
    triangles = np.vstack([face + 4 * k for k in range(6)])
    return _Surface(np.vstack(vertices), np.vstack(normals), triangles)


def _mesh(model: mujoco.MjModel, mesh: int) -> _Surface:
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    start, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    vertices = np.asarray(model.mesh_vert[first : first + count], dtype=np.float64)
    triangles = np.asarray(model.mesh_face[start : start + faces], dtype=np.int64)
    corners = vertices[triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], area)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return _Surface(vertices, np.divide(normals, length, out=np.zeros_like(normals), where=length > 0), triangles)
