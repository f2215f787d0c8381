"""How the paper's experiments are run: one place for the choices that are common to all of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from massid.search.guided import GuidedSearch, SearchOptions
from massid.systems import affine, non_affine
from massid.systems.bank import SystemBank
from massid.systems.non_affine import non_affine_plant, non_affine_system
from massid.systems.online import OnlineRun, run_online
from massid.typing import FloatArray

Progress: TypeAlias = Callable[[float, str], None]
"""Called with the fraction done, 0 to 1, and a few words."""

N_MODELS = 9
"""Models of V-A and V-B: what the paper has in V-B, 3 n_p."""
TIMESTEP_S = 2e-3
"""The controller's period and the models' step; measurements come at half of it, 1 kHz, and so do noise draws."""
SYSTEM_TIME_S = 170.0
"""Of Table I."""
WINDOWS = round(SYSTEM_TIME_S / non_affine.DWELL_S + 0.5)
THRESHOLD = 0.01
SETTLED = 6
"""Windows after which an error of V-B counts as noise, not as search."""
CONVERGED = 0.05
"""Error below which a start of V-B has found p*: no other minimum is as near, and noise is far below."""
DIRECTION_NAMES: tuple[str, ...] = (
    "gauss-newton",
    "levenberg-marquardt",
    "gradient",
    "plain-gradient",
    "heavy-ball",
    "adam",
    "bfgs",
)
PAPER_DIRECTION: str = "gradient"
DEFAULT = SearchOptions(scan=("p2", "p3"))
"""V-B: the second-order direction, and p2 and p3, in which mu is far from quadratic, scanned in the first window."""


def silent(fraction: float, what: str) -> None:
    """Say nothing."""


@dataclass(frozen=True)
class NonAffineRun:
    """One online run of V-B.

    Attributes:
        start: initial guess, shape (3,); default the paper's.
        guesses: initial guesses; those beside the start are random points of Theta.
        seed: of the noise and of the sampling.
        windows: dwell windows of `dwell_s`.
        search: how to search.
        n_models: size of the bank.
        theta: bounds of the unknowns.
        gain: k1 = k2 of Eq. (20) [1/s].
        forgetting_rate: lambda of Eq. (6) [1/s].
        dwell_s: T [s].
        noise: standard deviation of Delta.
        hold_s: how long each draw of Delta is held [s].
        keep_motion: keep the states.
    """

    start: tuple[float, float, float] = tuple(non_affine.START.tolist())
    guesses: int = 1
    seed: int = 0
    windows: int = 12
    search: SearchOptions = field(default_factory=lambda: DEFAULT)
    n_models: int = N_MODELS
    theta: tuple[tuple[float, float], ...] = non_affine.THETA
    gain: float = non_affine.GAIN
    forgetting_rate: float = non_affine.FORGETTING_RATE
    dwell_s: float = non_affine.DWELL_S
    noise: float = non_affine.NOISE
    hold_s: float = non_affine.HOLD_S
    keep_motion: bool = False

    def run(self) -> OnlineRun:
        """Do it.

        Raises:
            DivergedBankError: too few models stayed finite.
        """
        system = non_affine_system(np.array(self.start), self.theta, self.gain)
        rng = np.random.default_rng([self.seed, 1])
        plant = non_affine_plant(system, rng, self.noise, self.hold_s, timestep_s=TIMESTEP_S)
        others = np.random.default_rng([self.seed, 3]).uniform(
            system.space.lower, system.space.upper, size=(self.guesses - 1, len(system.space))
        )
        search = GuidedSearch(
            system.space,
            self.n_models,
            self.search,
            np.random.default_rng([self.seed, 2]),
            guesses=[system.space.nominal, *others],
        )
        bank = SystemBank(system, self.n_models, TIMESTEP_S)
        return run_online(
            plant, bank, search, self.windows, self.dwell_s, self.forgetting_rate, keep_motion=self.keep_motion
        )


def random_starts(count: int, theta: tuple[tuple[float, float], ...] = non_affine.THETA) -> list[FloatArray]:
    """Initial guesses all over Theta."""
    rng = np.random.default_rng(20)
    lower, upper = np.array(theta).T
    return [rng.uniform(lower, upper) for _ in range(count)]


def as_start(point: FloatArray) -> tuple[float, float, float]:
    """A point of V-B as the triple that `NonAffineRun` takes."""
    first, second, third = point.tolist()
    return first, second, third


@dataclass(frozen=True)
class AffineRun:
    """One online run of V-A until its termination condition (Eq. 18).

    Attributes:
        search: how to search.
        seed: of the sampling.
        windows: dwell windows at most.
        gain: k of Eq. (17) [1/s].
        forgetting_rate: lambda of Eq. (6) [1/s].
        control: u(t), see `affine.INPUT`.
        dwell_s: T [s].
    """

    search: SearchOptions
    seed: int = 0
    windows: int = 60
    gain: float = affine.GAIN
    forgetting_rate: float = affine.FORGETTING_RATE
    control: tuple[float, ...] = tuple(affine.INPUT.tolist())
    dwell_s: float = affine.DWELL_S

    def run(self) -> OnlineRun:
        """Do it.

        Raises:
            BadInputError: the input does not hold the state.
        """
        system = affine.affine_system(gain=self.gain)
        return run_online(
            affine.affine_plant(system, np.array(self.control), TIMESTEP_S),
            SystemBank(system, N_MODELS, TIMESTEP_S),
            GuidedSearch(system.space, N_MODELS, self.search, np.random.default_rng([self.seed, 2])),
            self.windows,
            self.dwell_s,
            self.forgetting_rate,
            stop_when_converged=True,
        )
