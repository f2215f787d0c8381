"""Output injection: how an identification model is pulled towards the measurement (K1 and K2 of Eq. 23).

An injection answers, for each sample of a block, with matrices that act on the innovation e = y (-) y_hat:
a generalised force and, for gains that correct positions directly, a change of the state. It also says how output
errors are weighted in the monitoring signal. At p = p* the innovation is zero and none of this acts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import mujoco
import numpy as np

from massid.model.realisation import Realisation
from massid.observer.inputs import BelievedBlock
from massid.observer.replay import ReplayBlock
from massid.search.bank import Shown
from massid.typing import FloatArray, IntArray


@dataclass(frozen=True)
class InjectionGains:
    """Gains of one block of n steps.

    Attributes:
        force: generalised force per innovation, shape (n, nv, 2 nv); None when no force is injected.
        state: tangent-space correction of (q, qd) per innovation, made before the step, shape (n, 2 nv, 2 nv); None
            when the state is left to the dynamics.
        whitener: weight of the output error at the end of each step, shape (n, n_y, 2 nv) or (2 nv,) for a constant
            diagonal; the monitoring signal integrates |whitener y~|^2.
        inputs: what the inputs are believed to have been; None for what was measured.
        tangents: derivatives of whitener y~ by the last parameters or by all, shape (n, n_parameters, n_y).
        explained: scalar output errors at the end of each step that inputs take up of which nothing is known, shape
            (n,); None for none.
    """

    force: FloatArray | None
    state: FloatArray | None
    whitener: FloatArray
    tangents: FloatArray | None = None
    inputs: BelievedBlock | None = None
    explained: IntArray | None = None


@dataclass(frozen=True)
class Trajectory:
    """How a model went through a block.

    Attributes:
        position: from which each step began, shape (n, nq).
        velocity: likewise, shape (n, nv).
        acceleration: mean of each step, shape (n, nv).
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


class OutputInjection(Protocol):
    """What a bank needs to know about an injection."""

    carries_belief: ClassVar[bool]
    """Whether the state belief is carried from one dwell window to the next instead of being reset."""
    judges_friction: ClassVar[bool]
    """Whether it says what friction was, so that the models have none of their own."""

    @property
    def look_ahead(self) -> int:
        """Samples after a block that bear upon it."""

    def place(self, realisation: Realisation) -> None:
        """Take notice of the models' new parameters; the first of them is the centre."""

    def restart(self, *, follows: bool) -> None:
        """Forget what is believed of the state; and, unless the next block follows the last one, what came before."""

    def state_shift(self, tangent_changes: FloatArray) -> FloatArray:
        """By how much states would differ, had the tangent parameters been different.

        Args:
            tangent_changes: one row for each model, shape (n_models, n_tangents).

        Returns:
            Shape (n_models, 2 nv).
        """

    def gains(self, block: ReplayBlock) -> InjectionGains:
        """Gains for the samples of the block that comes next."""

    def shown(self, gains: InjectionGains, centre: Trajectory) -> Shown | None:
        """What the centre showed along a block, where `InjectionGains.tangents` do not; see `OutputErrors.shown`."""


@dataclass(frozen=True)
class InertiaShapedInjection:
    """K1 = w^2 H0(q), K2 = 2 zeta w H0(q), with the nominal mass matrix H0 at the measured position.

    The shape makes every joint, light or heavy, follow the measurement with the same bandwidth; a diagonal gain that
    is stiff enough for the trunk makes light distal links diverge. The mass matrix is held over a few samples, which
    changes the gain and nothing else.

    Attributes:
        model: the nominal identification model.
        bandwidth_rad_s: w > 0.
        damping_ratio: zeta >= 0.
        position_weight: weight of position errors [1/rad or 1/m] in the monitoring signal.
        velocity_weight: weight of velocity errors [s/rad or s/m].
        hold_steps: samples for which a mass matrix is kept.
    """

    model: mujoco.MjModel
    bandwidth_rad_s: float = 60.0
    damping_ratio: float = 1.0
    position_weight: float = 1.0
    velocity_weight: float = 1.0
    hold_steps: int = 10

    carries_belief: ClassVar[bool] = False
    judges_friction: ClassVar[bool] = False
    look_ahead: ClassVar[int] = 0

    def place(self, realisation: Realisation) -> None:
        """The gain keeps the shape of the nominal model."""

    def restart(self, *, follows: bool) -> None:
        """Nothing is carried over: the gain depends on the measured position alone."""

    def state_shift(self, tangent_changes: FloatArray) -> FloatArray:
        """Nothing: this injection knows no tangents."""
        return np.zeros((len(tangent_changes), 2 * self.model.nv))

    def shown(self, gains: InjectionGains, centre: Trajectory) -> None:
        """Nothing: the models show all there is."""

    def gains(self, block: ReplayBlock) -> InjectionGains:
        """Gains at the measured positions of the block."""
        nv, n = self.model.nv, len(block)
        data = mujoco.MjData(self.model)
        inertia = np.empty((nv, nv))
        force = np.empty((n, nv, 2 * nv))
        w, zeta = self.bandwidth_rad_s, self.damping_ratio
        for start in range(0, n, self.hold_steps):
            data.qpos[:] = block.qpos[start]
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_comPos(self.model, data)
            mujoco.mj_makeM(self.model, data)
            mujoco.mj_fullM(self.model, data, inertia)
            stop = start + self.hold_steps
            force[start:stop, :, :nv] = w * w * inertia
            force[start:stop, :, nv:] = 2.0 * zeta * w * inertia
        weight = np.repeat([self.position_weight, self.velocity_weight], nv)
        return InjectionGains(force=force, state=None, whitener=weight)
