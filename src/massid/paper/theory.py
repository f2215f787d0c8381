"""Section IV as checks that are run: what the paper proves or remarks, measured with models of V-A and V-B.

The humanoid's part is in `massid.paper.walk_theory`. Every check says what was measured and the limit it was held
against; `holds` is the outcome and is not assumed anywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from massid.paper.recorded import SAFE, Check, Recorded, growth_of_mu, offline_rate, order_of_change
from massid.paper.setting import TIMESTEP_S, AffineRun, NonAffineRun
from massid.systems import affine, non_affine
from massid.systems.bank import SystemBank
from massid.systems.plant import Controller, Plant
from massid.systems.system import MeasuredBlock, System
from massid.typing import FloatArray

EDGE = 1e-9
"""Relative rounding of sums over a window."""
OFFLINE_PASSES = 60
ONLINE_WINDOWS = 40
SPACING = 0.5
"""Offset of the models around a point of V-A; mu is quadratic there, so any will do."""
Windows: TypeAlias = Recorded[MeasuredBlock]


def recorded(system: System, truth: FloatArray, forgetting_rate: float, *blocks: MeasuredBlock) -> Windows:
    """Windows of a small system."""
    return Recorded(
        space=system.space,
        truth=truth,
        blocks=blocks,
        make_bank=lambda n_models: SystemBank(system, n_models, TIMESTEP_S),
        forgetting_rate=forgetting_rate,
        spacing=np.full(len(truth), SPACING),
    )


def excited_window() -> Windows:
    """V-A under the input of the experiments."""
    system = affine.affine_system()
    block = affine.affine_plant(system, timestep_s=TIMESTEP_S).run(affine.DWELL_S, affine.START).block
    return recorded(system, affine.TRUTH, affine.FORGETTING_RATE, block)


def resting_window() -> Windows:
    """V-A at the equilibrium of a constant input, where no state moves: nothing is excited."""
    system = affine.affine_system()
    control = np.array([-6.0, 0.0, 1.0, 0.0, 1.0])
    plant = Plant(system, affine.TRUTH, Controller(affine.two_sines, control), np.zeros(2), TIMESTEP_S)
    plant.run(30.0, affine.START)  # comes to rest
    block = plant.run(affine.DWELL_S, affine.START).block
    return recorded(system, affine.TRUTH, affine.FORGETTING_RATE, block)


def unique_minimiser() -> Check:
    """Proposition 1 with excitation: mu(p*) = 0 and mu grows at least like the bound of Eq. (11)."""
    growth = growth_of_mu(excited_window(), farthest=20.0)
    return Check(
        "V-A",
        "Proposition 1",
        "Excited: p* is the unique minimiser, mu(p) >= w alpha(|p - p*|).",
        f"mu(p*) = {growth.at_truth:.1e}; over 200 points mu / |p - p*|^2 >= {growth.least_ratio:.3f}, "
        f"smallest eigenvalue of Q {growth.eigenvalue:.3f}",
        growth.at_truth < 1e-12 and growth.least_ratio >= growth.eigenvalue * (1.0 - 1e-6) > 0.0,
    )


def no_unique_minimiser() -> Check:
    """Proposition 1 without excitation: other points explain the output as well as p* does."""
    window = resting_window()
    eigenvalues, vectors = np.linalg.eigh(window.information())
    other = affine.TRUTH + 5.0 * vectors[:, 0]
    mu = window.score(np.vstack([affine.TRUTH, other, affine.TRUTH + 5.0 * vectors[:, -1]])).mu
    return Check(
        "V-A",
        "Proposition 1, not excited",
        "At rest under a constant input p* is not the only minimiser.",
        f"5 away from p* mu = {mu[1]:.1e} in one direction, {mu[2]:.1e} in another; "
        f"eigenvalues of Q {_list(eigenvalues)}",
        bool(mu[1] < 1e-9 * mu[2]),
    )


def windowed_information() -> Check:
    """Assumption 2, numerically: the smallest eigenvalue of the information of each window."""
    run = AffineRun(SAFE, windows=10).run()
    least = [0.5 * float(np.linalg.eigvalsh(i.quadratic.curvature)[0]) for i in run.iterations]
    disturbed = NonAffineRun(windows=10).run()
    other = [0.5 * float(np.linalg.eigvalsh(i.quadratic.curvature)[0]) for i in disturbed.iterations[1:]]
    return Check(
        "V-A, V-B",
        "Assumption 2",
        "Persistently exciting: the smallest eigenvalue of the windowed information stays away from zero.",
        f"V-A {min(least):.3f} .. {max(least):.3f}, V-B {min(other):.2e} .. {max(other):.2e}",
        bool(min(least) > 1e-3 and min(other) > 0.0),
    )


def proposition_2() -> Check:
    """Eq. (14) with alpha = 1/L."""
    run = offline_rate(excited_window(), OFFLINE_PASSES)
    gap, bound, error = run.gap, run.bound, run.error
    return Check(
        "V-A",
        "Proposition 2, Eq. (14)",
        "Offline with alpha = 1/L: mu_k - mu* <= |p0 - p*|^2 / (2 alpha k).",
        f"largest ratio to the bound {np.max(gap / bound):.3f} over {len(gap)} passes, error {error[-1]:.1e} at last",
        bool(np.all(gap <= bound)),
    )


def edge_of_stability() -> Check:
    """Eq. (33) drops a factor 2: with alpha = 1 / lambda_max(M) = 2/L the error does not shrink."""
    safe, edge = (offline_rate(excited_window(), OFFLINE_PASSES, over).steepest[-1] for over in (1.0, 2.0))
    return Check(
        "V-A",
        "Eq. (33)",
        "L = 2 lambda_max(M), not lambda_max(M): alpha = 1/lambda_max(M) is the edge of stability.",
        f"share of the error left in the steepest direction after {OFFLINE_PASSES} passes: {safe:.1e} with 1/L, "
        f"{edge:.3f} with 1/lambda_max(M)",
        bool(safe < 1e-6 and edge > 0.9),
    )


def theorem_1() -> Check:
    """Eq. (15), online on V-A."""
    run = AffineRun(SAFE, windows=ONLINE_WINDOWS).run()
    errors = run.errors(affine.TRUTH)
    growth = np.max(errors[1:] / errors[:-1])
    return Check(
        "V-A",
        "Theorem 1, Eq. (15)",
        "Online with alpha_i = 1/L_i the error never grows.",
        f"largest ratio of successive errors {growth:.4f} over {len(errors) - 1} windows",
        bool(growth <= 1.0 + EDGE),
    )


def theorem_1_disturbed() -> Check:
    """Where its assumptions break: mu_i(p*) is not 0 under V-B's noise, and mu is not convex far from p*."""
    truth = non_affine.TRUTH
    run = NonAffineRun(start=(truth[0], truth[1], truth[2]), windows=ONLINE_WINDOWS, search=SAFE).run()
    errors = run.errors(non_affine.TRUTH)
    grew = int(np.sum(errors[1:] > errors[:-1] * (1.0 + EDGE)))
    return Check(
        "V-B",
        "Theorem 1 under disturbance",
        "The theorems assume mu_i(p*) = 0; V-B's noise breaks that, and the error does grow in some windows.",
        f"started at p*, the error grew in {grew} of {len(errors) - 1} windows, to {errors.max():.1e}",
        grew > 0,
    )


def equality_counter_example() -> Check:
    """Theorem 1 says equality if and only if p+ = p*: with mu = (L/2)|p - p*|^2 and alpha = 1/L one step gets there."""
    before, lipschitz = np.array([3.0, -1.0]), 4.0
    after = before - (1.0 / lipschitz) * lipschitz * before  # p* = 0
    return Check(
        "-",
        "Theorem 1, 'if and only if'",
        "p+ = p* does not imply equality in Eq. (15): Q = (L/2) I, alpha = 1/L.",
        f"|p-| = {np.linalg.norm(before):.2f}, |p+| = {np.linalg.norm(after):.2f}",
        bool(np.linalg.norm(after) == 0.0 < np.linalg.norm(before)),
    )


def theorem_2() -> Check:
    """Convergence online, on V-A."""
    errors = AffineRun(SAFE, windows=2 * ONLINE_WINDOWS).run().errors(affine.TRUTH)
    return Check(
        "V-A",
        "Theorem 2",
        "Online with c < alpha_i <= 1/L_i the estimate converges to p*.",
        f"error {errors[0]:.1f} -> {errors[ONLINE_WINDOWS]:.1e} -> {errors[-1]:.1e} "
        f"after 0, {ONLINE_WINDOWS} and {2 * ONLINE_WINDOWS} windows",
        bool(errors[-1] < 1e-4 * errors[0]),
    )


def continuity() -> Check:
    """Remark 2 and Eq. (26): the change of mu is of the order of the change of p, not of its square."""
    system = non_affine.non_affine_system()
    plant = non_affine.non_affine_plant(system, np.random.default_rng(0), noise=0.0, timestep_s=TIMESTEP_S)
    block = plant.run(non_affine.DWELL_S, non_affine.START).block
    windows = recorded(system, non_affine.TRUTH, non_affine.FORGETTING_RATE, block)
    order = order_of_change(windows, non_affine.START)
    return Check(
        "V-B",
        "Remark 2, Eq. (26)",
        "mu is continuous in p; the change is O(|dp|) (Eq. 26 has the square, which is wrong away from p*).",
        f"|mu(p + dp) - mu(p)| ~ |dp|^{order:.2f} for |dp| = 1e-1 .. 1e-6",
        bool(abs(order - 1.0) < 0.1),
    )


def quadratic_mu() -> Check:
    """Remark 3: on V-A mu is (p - p*)^T Q (p - p*), with Q from the filtered regressor, and L = 2 lambda_max(Q)."""
    window = excited_window()
    q = regressor_information(window)
    rng = np.random.default_rng(1)
    points = affine.TRUTH + rng.uniform(-20.0, 20.0, size=(50, 3))
    mu = window.score(points).mu
    offset = points - affine.TRUTH
    predicted = np.einsum("ni,ij,nj->n", offset, q, offset)
    worst = float(np.max(np.abs(mu - predicted) / mu))
    lipschitz = window.quadratic(affine.START).lipschitz
    ratio = lipschitz / (2.0 * float(np.linalg.eigvalsh(q)[-1]))
    return Check(
        "V-A",
        "Remark 3, Eq. (13)",
        "Affine parameters: mu is quadratic with Q of Eq. (31), and L of Eq. (12) is 2 lambda_max(Q).",
        f"mu of 50 models against Q by quadrature: {worst:.1e} relative; L / (2 lambda_max(Q)) = {ratio:.6f}",
        bool(worst < 1e-2 and abs(ratio - 1.0) < 1e-2),
    )


def bounded_lipschitz() -> Check:
    """Remark 4: with bounded x, u and dwell time the L_i are bounded."""
    bounds = {}
    for dwell_s in (1.0, 2.0, 4.0, 8.0):
        run = AffineRun(SAFE, windows=8, dwell_s=dwell_s).run()
        bounds[dwell_s] = max(i.quadratic.lipschitz for i in run.iterations) / dwell_s
    rates = list(bounds.values())
    return Check(
        "V-A",
        "Remark 4",
        "L_i is bounded when the dwell time is: max L_i / T does not grow with T.",
        "max L_i / T = " + ", ".join(f"{value:.3f} (T = {dwell:g} s)" for dwell, value in bounds.items()),
        bool(max(rates[1:]) <= 2.0 * rates[0]),
    )


def poor_case() -> Check:
    """Remark 6: where nothing is excited but a combination, the estimate improves and does not converge."""
    window = resting_window()
    iterations = window.offline(affine.START, 30)
    before = float(np.linalg.norm(affine.START - affine.TRUTH))
    after = float(np.linalg.norm(iterations[-1].estimate - affine.TRUTH))
    mu = [iteration.mu for iteration in iterations]
    return Check(
        "V-A",
        "Remark 6",
        "Not excited, the search still improves on the initial guess without reaching p*.",
        f"error {before:.2f} -> {after:.2f}, mu {mu[0]:.1e} -> {mu[-1]:.1e}",
        bool(1.0 < after < before and mu[-1] < 1e-6 * mu[0]),
    )


def regressor_information(window: Windows) -> FloatArray:
    """Q of Eq. (31) by quadrature: g of Eq. (16) through the model's own error dynamics, not through its bank."""
    (block,) = window.blocks
    x, u = block.measured[::2], np.append(block.control[:, 0], block.control[-1, 0])
    g = np.stack([np.sin(x.sum(axis=1)), np.exp(x[:, 0] + u), x[:, 0] ** 2 + x[:, 1]], axis=1)
    decay = math.exp(-affine.GAIN * block.timestep_s)
    response = np.zeros((len(block), 3))
    state = np.zeros(3)
    for k in range(len(block)):
        # The input jumps at the steps: the mean over each step uses that step's own u.
        last = np.array([g[k + 1, 0], math.exp(x[k + 1, 0] + u[k]), g[k + 1, 2]])
        state = decay * state + (1.0 - decay) / affine.GAIN * 0.5 * (g[k] + last)
        response[k] = state
    age = block.timestep_s * np.arange(len(block) - 1, -1, -1)
    weight = block.timestep_s * np.exp(-affine.FORGETTING_RATE * age)
    return np.asarray(np.einsum("k,ki,kj->ij", weight, response, response))


CHECKS: tuple[Callable[[], Check], ...] = (
    unique_minimiser,
    no_unique_minimiser,
    windowed_information,
    proposition_2,
    edge_of_stability,
    theorem_1,
    theorem_1_disturbed,
    equality_counter_example,
    theorem_2,
    continuity,
    quadratic_mu,
    bounded_lipschitz,
    poor_case,
)


def _list(values: FloatArray) -> str:
    return ", ".join(f"{value:.1e}" for value in values)
