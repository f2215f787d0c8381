from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from massid.view.shapes import Mesh, body_mesh

PI = np.pi
CUBE = "-1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  -1 -1 1  1 -1 1  -1 1 1  1 1 1"
GEOMS = {
    "sphere": ('type="sphere" size="0.3"', 4 / 3 * PI * 0.3**3),
    "ellipsoid": ('type="ellipsoid" size="0.1 0.2 0.3"', 4 / 3 * PI * 0.1 * 0.2 * 0.3),
    "capsule": ('type="capsule" size="0.1 0.25"', PI * 0.1**2 * 0.5 + 4 / 3 * PI * 0.1**3),
    "cylinder": ('type="cylinder" size="0.2 0.15"', PI * 0.2**2 * 0.3),
    "box": ('type="box" size="0.1 0.2 0.3"', 8 * 0.1 * 0.2 * 0.3),
    "mesh": ('type="mesh" mesh="cube"', 8.0),
}
POSE = 'pos="0.4 -0.2 0.1" euler="30 40 50"'


def model(*geoms: str) -> mujoco.MjModel:
    inside = "".join(f"<geom {geom}/>" for geom in geoms)
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="cube" vertex="{CUBE}"/></asset>'
        f'<worldbody><body name="b"><freejoint/>{inside}</body></worldbody></mujoco>'
    )


def only_mesh(*geoms: str) -> Mesh:
    mesh = body_mesh(model(*geoms), 1)
    assert mesh is not None
    return mesh


def volume(mesh: Mesh) -> float:
    """Divergence theorem: right only if the surface is closed and every triangle is wound outwards."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize("kind", GEOMS)
def test_a_geom_becomes_a_closed_surface_of_its_volume(kind: str) -> None:
    description, expected = GEOMS[kind]
    # an inscribed polyhedron of 24 edges around and 14 along loses up to 4 % of a round body
    assert_allclose(volume(only_mesh(f"{description} {POSE}")), expected, rtol=0.04)


@pytest.mark.parametrize("kind", GEOMS)
def test_normals_have_unit_length_and_point_outwards(kind: str) -> None:
    mesh = only_mesh(f"{GEOMS[kind][0]} {POSE}")
    assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-9)
    outwards = mesh.vertices - mesh.vertices.mean(axis=0)
    assert np.all(np.einsum("ij,ij->i", outwards, mesh.normals) > 0.0)


def test_all_geoms_of_a_body_are_joined() -> None:
    parts = [f"{description} {POSE}" for description, _ in GEOMS.values()]
    together = only_mesh(*parts)
    assert_allclose(volume(together), sum(volume(only_mesh(part)) for part in parts), rtol=1e-9)


def test_collision_geoms_are_left_out_where_there_is_something_to_see() -> None:
    small, large = 'type="box" size="0.1 0.1 0.1"', 'type="box" size="1 1 1" group="3"'
    assert_allclose(volume(only_mesh(small, large)), 0.008, rtol=1e-12)
    assert_allclose(volume(only_mesh(large)), 8.0, rtol=1e-12)


def test_a_body_without_geoms_has_no_mesh() -> None:
    xml = """<mujoco><worldbody><body><freejoint/><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/></body>
      </worldbody></mujoco>"""
    assert body_mesh(mujoco.MjModel.from_xml_string(xml), 1) is None


def test_paint_comes_from_the_material_before_the_geom() -> None:
    xml = """<mujoco><asset><material name="m" rgba="0.1 0.2 0.3 1"/></asset><worldbody><body><freejoint/>
      <geom size="0.1" material="m"/><geom size="0.1" rgba="0.5 0.6 0.7 1"/></body></worldbody></mujoco>"""
    mesh = body_mesh(mujoco.MjModel.from_xml_string(xml), 1)
    assert mesh is not None
    assert_allclose(np.unique(mesh.rgba, axis=0), [[0.1, 0.2, 0.3, 1.0], [0.5, 0.6, 0.7, 1.0]], atol=1e-6)  # float32
