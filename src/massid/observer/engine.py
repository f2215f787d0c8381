"""The one place that drives `mujoco.batch.Batch`: writing parameters, restarting, stepping, noticing divergence.

What it takes care of, so that nobody else has to: constants that depend on masses are recomputed after every write;
the solver's warm start is cleared on a restart; a diverged simulation is reported instead of being reset without a
word; and the engine's warnings neither land in a file in the working folder nor on the terminal.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import mujoco
import numpy as np
from mujoco.batch import Batch

from massid.model.realisation import Realisation
from massid.typing import BoolArray, FloatArray

_BAD_STATE = [
    int(mujoco.mjtWarning.mjWARN_BADQPOS),
    int(mujoco.mjtWarning.mjWARN_BADQVEL),
    int(mujoco.mjtWarning.mjWARN_BADQACC),
]


class BatchEngine:
    """N simulations of one identification model with masses of their own.

    Attributes:
        qpos: live view of the positions, shape (N, nq).
        qvel: live view of the velocities, shape (N, nv).
        force: live view of the generalised force input [N, N m], shape (N, nv).
        wrench: live view of the wrench inputs on the contact bodies, shape (N, nu).
    """

    def __init__(self, model: mujoco.MjModel, n_models: int, n_threads: int = 0) -> None:
        self.model = model
        self._batch = Batch(model, n_models, n_threads)
        self.qpos: FloatArray = self._batch.bind("qpos")
        self.qvel: FloatArray = self._batch.bind("qvel")
        self.force: FloatArray = self._batch.bind("qfrc_applied")
        self.wrench: FloatArray = self._batch.bind("ctrl")
        self._warm_start: FloatArray = self._batch.bind("qacc_warmstart")
        self._time: FloatArray = self._batch.bind("time")
        self._friction_loss: FloatArray = model.dof_frictionloss.copy()
        self._warnings_before = np.zeros_like(self._batch.warning[:, :, 1])

    @property
    def n_models(self) -> int:
        """Number of simulations."""
        return int(self._batch.nsim)

    def write(self, realisation: Realisation) -> None:
        """Give every simulation its own model fields and refresh the constants that follow from them."""
        for name, values in realisation.model_fields.items():
            self._batch.expand(name)[:] = values
        self._batch.set_const()

    def restart(self, qpos: FloatArray, qvel: FloatArray) -> None:
        """Put all simulations into one state (or one each), forgetting warm starts and past divergence."""
        self.qpos[:] = qpos
        self.qvel[:] = qvel
        self.force[:] = 0.0
        self._warm_start[:] = 0.0
        self._time[:] = 0.0
        self._warnings_before[:] = self._batch.warning[:, :, 1]

    def set_friction_loss(self, friction_loss: FloatArray) -> None:
        """Let all simulations have the same dry friction from now on, shape (nv,) [N m or N]."""
        if not np.array_equal(friction_loss, self._friction_loss):
            self._batch.expand("dof_frictionloss")[:] = friction_loss
            self._friction_loss = friction_loss.copy()

    def step(self, count: int = 1) -> None:
        """Advance all simulations by some time steps."""
        for _ in range(count):
            self._batch.step()

    def diverged(self) -> BoolArray:
        """Which simulations left the finite numbers since the last restart, shape (N,)."""
        new = self._batch.warning[:, :, 1] - self._warnings_before
        bad = new[:, _BAD_STATE].any(axis=1)
        return np.asarray(bad | ~np.isfinite(self.qvel).all(axis=1) | ~np.isfinite(self.qpos).all(axis=1))

    @contextlib.contextmanager
    def quiet(self) -> Iterator[None]:
        """Keep the engine's warnings out of files and terminals for as long as models may diverge."""
        before = mujoco.MjLogConfig.get()
        config = mujoco.MjLogConfig.get()
        config.logto_file = config.logto_console = False
        mujoco.MjLogConfig.set(config)
        try:
            yield
        finally:
            mujoco.MjLogConfig.set(before)
