from __future__ import annotations

import numpy as np
import pytest

from massid.errors import DivergedBankError
from massid.search.bank import OutputErrors, Shown
from massid.search.gradient import GradientEstimator, estimate_gradient, ransac_inliers
from massid.search.guided import GuidedSearch
from massid.search.monitoring import MonitoringFilter
from massid.search.proposal import Proposal, Role
from massid.search.sampling import sample_locally
from tests.search.quadratic_bank import QuadraticBank, make_space, score

TRUTH = np.array([1.0, -2.0, 0.5])


def _bank(n_models: int = 12, **kwargs: object) -> QuadraticBank:
    jacobian = np.random.default_rng(0).normal(size=(50, 2, 3)) * np.array([1.0, 3.0, 0.3])
    return QuadraticBank(jacobian, TRUTH, n_models, **kwargs)  # type: ignore[arg-type]


def _proposal(n_models: int = 12, radius: float = 0.1) -> Proposal:
    rng = np.random.default_rng(1)
    centre = np.zeros(3)
    samples = sample_locally(centre, n_models - 1, radius, make_space(), rng)
    return Proposal(np.vstack([centre, samples]), (Role.CENTRE, *[Role.SAMPLE] * (n_models - 1)))


def test_the_filter_of_eq_7_agrees_with_the_quadrature_of_eq_5() -> None:
    rng = np.random.default_rng(0)
    errors, rate, timestep = rng.normal(size=(4, 200, 3)), 2.0, 0.01
    proposal = Proposal(np.zeros((4, 1)), (Role.CENTRE, *[Role.SAMPLE] * 3))
    filtered = MonitoringFilter(4, timestep, rate)
    for start in range(0, 200, 30):
        filtered.update(OutputErrors(errors[:, start : start + 30], np.zeros(4, dtype=np.bool_)))
    weight = np.exp(-rate * timestep * np.arange(199, -1, -1)) * timestep
    expected = np.einsum("k,nky,nky->n", weight, errors, errors)
    np.testing.assert_allclose(filtered.result(proposal).mu, expected, rtol=1e-12)


def test_mu_is_not_negative_and_zero_at_the_truth() -> None:
    proposal = _proposal()
    points = proposal.points.copy()
    points[3] = TRUTH
    mu = score(_bank(), Proposal(points, proposal.roles)).mu
    assert np.all(mu >= 0.0)
    assert mu[3] == 0.0


def test_gradient_and_curvature_are_exact_on_a_quadratic_mu() -> None:
    bank = _bank()
    quadratic = score(bank, _proposal()).local_quadratic()
    information = 0.01 * np.einsum("kyi,kyj->ij", bank.jacobian, bank.jacobian)
    np.testing.assert_allclose(quadratic.curvature, 2.0 * information, rtol=1e-9)
    np.testing.assert_allclose(quadratic.gradient, -2.0 * information @ TRUTH, rtol=1e-9)
    assert quadratic.misfit < 1e-12 * quadratic.value
    assert quadratic.at(TRUTH) == pytest.approx(0.0, abs=1e-10 * quadratic.value)


def test_the_order_of_the_samples_does_not_matter() -> None:
    proposal = _proposal()
    order = np.r_[0, np.random.default_rng(0).permutation(np.arange(1, 12))]
    one = score(_bank(bend=0.1), proposal).local_quadratic()
    other = score(_bank(bend=0.1), Proposal(proposal.points[order], proposal.roles)).local_quadratic()
    np.testing.assert_allclose(one.gradient, other.gradient, rtol=1e-10)
    np.testing.assert_allclose(one.misfit, other.misfit, rtol=1e-8)


def test_misfit_grows_with_the_bend() -> None:
    misfits = [score(_bank(bend=bend), _proposal()).local_quadratic().misfit for bend in (0.0, 0.1, 0.2)]
    assert misfits[0] < misfits[1] < misfits[2]


@pytest.mark.parametrize("estimator", ["gram", "differences", "least-squares", "ransac"])
def test_every_estimator_finds_the_gradient(estimator: GradientEstimator) -> None:
    bank = _bank()
    information = 0.01 * np.einsum("kyi,kyj->ij", bank.jacobian, bank.jacobian)
    gradient = estimate_gradient(score(bank, _proposal(radius=1e-5)), estimator, np.random.default_rng(0))
    np.testing.assert_allclose(gradient, -2.0 * information @ TRUTH, rtol=1e-3)


def test_ransac_survives_planted_outliers() -> None:
    rng = np.random.default_rng(0)
    offsets = rng.normal(size=(20, 7))
    slope = rng.normal(size=7)
    rise = offsets @ slope + 1e-3 * rng.normal(size=20)
    rise[[2, 5, 11]] += [50.0, -30.0, 1e3]
    inliers = ransac_inliers(offsets, rise, rng)
    assert not inliers[[2, 5, 11]].any()
    assert inliers.sum() >= 14


def test_least_squares_does_not_survive_them() -> None:
    """The reason for RANSAC: one corrupted score turns the least-squares gradient around."""
    monitoring = score(_bank(), _proposal(radius=1e-3))
    monitoring.gram[4, 4] += 1e3
    exact = estimate_gradient(monitoring, "gram", np.random.default_rng(0))
    robust = estimate_gradient(monitoring, "ransac", np.random.default_rng(0))
    naive = estimate_gradient(monitoring, "least-squares", np.random.default_rng(0))
    error = np.linalg.norm(robust - exact) / np.linalg.norm(exact)
    assert error < 0.05 < np.linalg.norm(naive - exact) / np.linalg.norm(exact)


def test_diverged_models_score_inf_and_are_left_out() -> None:
    monitoring = score(_bank(diverging=(2, 7)), _proposal())
    assert np.isinf(monitoring.mu[[2, 7]]).all()
    assert np.isfinite(np.delete(monitoring.mu, [2, 7])).all()
    complete = score(_bank(), _proposal()).local_quadratic()
    np.testing.assert_allclose(monitoring.local_quadratic().gradient, complete.gradient, rtol=1e-9)


def test_too_few_finite_models_is_an_error_that_names_the_others() -> None:
    monitoring = score(_bank(n_models=5, diverging=(2, 3)), _proposal(5))
    with pytest.raises(DivergedBankError, match=r"2 of 5 identification models diverged \(models 2, 3"):
        monitoring.local_quadratic()


def test_windows_add_up() -> None:
    proposal = _proposal()
    one = score(_bank(), proposal)
    np.testing.assert_allclose((one + one).local_quadratic().gradient, 2.0 * one.local_quadratic().gradient)


def test_search_needs_no_mujoco() -> None:
    import subprocess
    import sys

    code = "import massid.search.guided, sys; assert 'mujoco' not in sys.modules and 'scipy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
    assert GuidedSearch.__module__ == "massid.search.guided"


def test_what_a_nuisance_explains_of_a_smoothed_column_is_taken_off_rightly() -> None:
    """Column a + b / 10, nuisance a, instrument 0.8 a + b / 10: only b tells the first parameter.

    Made symmetric, the slope of the score would be that of 0.9 a twice instead of 0.8 a times a: no information left.
    """
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 20000))
    proposal = Proposal(np.array([[0.0, 0.0], [0.1, 0.0], [-0.1, 0.0]]), (Role.CENTRE, Role.SAMPLE, Role.SAMPLE), 1)
    roots, said = [], []
    for _ in range(60):
        errors = OutputErrors(
            values=(rng.normal(size=20000) + proposal.points[:, :1] * (a + 0.1 * b))[:, :, None],
            diverged=np.zeros(3, dtype=np.bool_),
            tangents=np.stack([0.8 * a + 0.1 * b, a])[:, :, None],
        )
        scores = MonitoringFilter(3, timestep_s=1.0)
        scores.update(errors)
        quadratic = scores.result(proposal).window_quadratic().symmetric()
        roots.append(-np.linalg.solve(quadratic.curvature, quadratic.gradient)[0])
        said.append(2.0 * np.linalg.inv(quadratic.curvature)[0, 0])
    assert np.var(roots) == pytest.approx(1.0 / (0.1**2 * 20000), rel=0.5)
    assert np.mean(said) == pytest.approx(np.var(roots), rel=0.5)


def test_noise_in_the_instruments_is_not_taken_for_information() -> None:
    """The root of the gradient scatters as the information says; the curvature alone would say a twenty-fifth."""
    rng = np.random.default_rng(0)
    derivative = 0.5 * rng.normal(size=2000)
    proposal = Proposal(np.array([[0.0], [0.1], [-0.1]]), (Role.CENTRE, Role.SAMPLE, Role.SAMPLE))
    roots, said, naive = [], [], []
    for _ in range(200):
        error = rng.normal(size=2000)
        errors = OutputErrors(
            values=(error + proposal.points * derivative)[:, :, None],
            diverged=np.zeros(3, dtype=np.bool_),
            tangents=(derivative + rng.normal(size=2000))[None, :, None],
            shown=Shown(np.array([0]), derivative[None, :, None]),
        )
        scores = MonitoringFilter(3, timestep_s=1.0)
        scores.update(errors)
        raw = scores.result(proposal).window_quadratic()
        quadratic = raw.symmetric()
        roots.append(-quadratic.gradient[0] / quadratic.curvature[0, 0])
        said.append(2.0 / quadratic.curvature[0, 0])
        naive.append(2.0 / raw.curvature[0, 0])
    assert np.mean(said) == pytest.approx(np.var(roots), rel=0.3)
    assert np.mean(naive) < 0.1 * np.mean(said)
