from __future__ import annotations

import mujoco
import numpy as np

from massid.model.inertia import inertial_frame, log_cholesky_factor, pseudo_inertia, spatial_inertia
from tests.pushed_robot import make_robot


def test_any_vector_is_a_body_that_can_exist() -> None:
    """Positive definite pseudo-inertia, and moments that obey the triangle inequality."""
    rng = np.random.default_rng(0)
    entries = rng.uniform(-3.0, 3.0, (500, 6))
    scaled = rng.uniform(0.01, 1.0, 3)[:, None] * log_cholesky_factor(entries)
    mass, centre = np.exp(rng.normal(size=500)), rng.normal(size=(500, 3))
    pseudo = pseudo_inertia(mass, centre, scaled @ scaled.transpose(0, 2, 1))
    root = np.linalg.cholesky(pseudo)  # raises where one is not positive definite
    assert np.all(np.diagonal(root, axis1=1, axis2=2) > 0.0)
    moments = inertial_frame(pseudo).moments
    assert np.all(2.0 * moments.max(axis=1) <= moments.sum(axis=1) * (1.0 + 1e-12))


def test_a_body_is_read_back_from_its_pseudo_inertia() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(20, 3, 3))
    mass, centre, spread = rng.uniform(1.0, 9.0, 20), rng.normal(size=(20, 3)), root @ root.transpose(0, 2, 1)
    frame = inertial_frame(pseudo_inertia(mass, centre, spread))
    np.testing.assert_allclose(frame.mass, mass)
    np.testing.assert_allclose(frame.centre, centre)
    for k in range(20):
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, frame.quaternion[k])
        axes = rotation.reshape(3, 3)
        full = mass[k] * (np.trace(spread[k]) * np.eye(3) - spread[k])
        np.testing.assert_allclose(axes @ np.diag(frame.moments[k]) @ axes.T, full, atol=1e-12 * np.abs(full).max())


def test_spatial_inertia_is_the_engines() -> None:
    model = make_robot().model
    data = mujoco.MjData(model)
    data.qpos[7:] = np.random.default_rng(2).normal(size=model.nq - 7)
    mujoco.mj_fwdPosition(model, data)
    spread = 0.5 * model.body_inertia.sum(axis=1, keepdims=True) - model.body_inertia
    spread = spread[1:] / model.body_mass[1:, None]
    axes = np.empty((model.nbody - 1, 9))
    for row, quaternion in zip(axes, model.body_iquat[1:], strict=True):
        mujoco.mju_quat2Mat(row, quaternion)
    axes = axes.reshape(-1, 3, 3)
    pseudo = pseudo_inertia(
        model.body_mass[1:], model.body_ipos[1:], (axes * spread[:, None]) @ axes.transpose(0, 2, 1)
    )
    found = spatial_inertia(pseudo, data.xmat[1:].reshape(-1, 3, 3), data.xpos[1:] - data.subtree_com[1])
    np.testing.assert_allclose(found, data.cinert[1:], atol=1e-12)
