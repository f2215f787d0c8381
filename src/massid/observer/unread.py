"""Output injection for readings without error in which some wrenches are missing.

What a wrench of which nothing is known may have done in a step is taken out of the state after it, and of the output
error. At p = p*, driven by the wrenches that the motion asks for, there is nothing to take out; elsewhere what is wrong
about these wrenches is, and with them an error of the second order in p - p*.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import mujoco
import numpy as np

from massid.model.inverse import DiscreteInverseDynamics, damping_is_implicit
from massid.model.realisation import Realisation, write_fields
from massid.observer.injection import InertiaShapedInjection, InjectionGains
from massid.observer.kalman import LEAST_DIRECTION
from massid.observer.replay import ReplayBlock
from massid.typing import FloatArray, IntArray


class UnreadInjection:
    """Inertia-shaped injection of what wrenches without a sensor cannot have done.

    Args:
        shaped: the injection of logs with all wrenches.
        contact_bodies: bodies with a wrench, in the order of the blocks' columns.
        open_axes: columns of the wrenches that no sensor measures.
    """

    carries_belief: ClassVar[bool] = False
    judges_friction: ClassVar[bool] = False
    look_ahead: ClassVar[int] = 0

    def __init__(self, shaped: InertiaShapedInjection, contact_bodies: Sequence[str], open_axes: Sequence[int]) -> None:
        self._shaped, self._contact_bodies = shaped, tuple(contact_bodies)
        self._model: mujoco.MjModel = copy.copy(shaped.model)
        self._open = np.zeros(6 * len(contact_bodies), dtype=np.bool_)
        self._open[list(open_axes)] = True
        self._before: FloatArray = np.zeros((2 * shaped.model.nv, 2 * shaped.model.nv))

    def place(self, realisation: Realisation) -> None:
        """What a wrench does is that of the centre, the first of the models."""
        write_fields(self._model, realisation)

    def restart(self, *, follows: bool) -> None:
        """No step was made before the next one."""
        self._before = np.zeros_like(self._before)

    def state_shift(self, tangent_changes: FloatArray) -> FloatArray:
        """Nothing: this injection knows no tangents."""
        return self._shaped.state_shift(tangent_changes)

    def shown(self, gains: InjectionGains, centre: object) -> None:
        """Nothing: the models show all there is."""

    def gains(self, block: ReplayBlock) -> InjectionGains:
        """Gains at the measured positions of the block."""
        shaped = self._shaped.gains(block)
        weight, force = shaped.whitener, shaped.force
        assert force is not None  # that is what shaped injection does
        effects, unknown = self._effects(block)
        weighted = weight[:, None] * effects
        found = np.linalg.pinv(weighted, rcond=LEAST_DIRECTION) * weight  # from an error to what wrenches did it
        explained = effects @ found
        state = np.concatenate([self._before[None], explained[:-1]])
        self._before = explained[-1]
        rest = np.eye(len(weight)) - explained
        return replace(
            shaped,
            force=force - force @ state,  # what is left after the state has been corrected
            state=state,
            whitener=weight[:, None] * rest,
            explained=unknown,
        )

    def _effects(self, block: ReplayBlock) -> tuple[FloatArray, IntArray]:
        """Change of the state after each step per unit of unknown wrench, shape (n, 2 nv, m); how many there are."""
        model, n = self._model, len(block)
        dynamics = DiscreteInverseDynamics(model, self._contact_bodies)
        position, step_s = block.qpos[:-1], model.opt.timestep
        inertia = dynamics.inertia(position)
        if damping_is_implicit(model):
            inertia += step_s * np.diag(model.dof_damping)
        loaded = np.repeat(block.wrench.reshape(n, -1, 6).any(axis=2), 6, axis=1)
        unknown = loaded & self._open
        pushed = dynamics.jacobian(position).reshape(n, -1, model.nv) * unknown[..., None]
        velocity = step_s * np.linalg.solve(inertia, pushed[:, self._open].transpose(0, 2, 1))
        return np.concatenate([step_s * velocity, velocity], axis=1), np.asarray(unknown.sum(axis=1))
