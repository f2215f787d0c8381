from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from massid.errors import BadInputError
from massid.search.directions.gauss_newton import GaussNewtonDirection
from massid.search.directions.gradient import GradientDirection
from massid.search.guided import GuidedSearch, SearchOptions, SearchStatus
from massid.search.line_search import LineSearch
from massid.search.proposal import Role
from massid.search.quadratic import LocalQuadratic
from massid.search.sampling import Sampling, sample_locally
from tests.search.quadratic_bank import QuadraticBank, drive, make_space

TRUTH = np.array([1.0, -2.0, 0.5])


def _bank(n_models: int, bend: float = 0.0) -> QuadraticBank:
    jacobian = np.random.default_rng(0).normal(size=(50, 2, 3)) * np.array([1.0, 3.0, 0.3])
    return QuadraticBank(jacobian, TRUTH, n_models, bend=bend)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("n_models", [4, 7, 12, 24])
def test_gauss_newton_needs_one_window_where_mu_is_quadratic(n_models: int, seed: int) -> None:
    search = GuidedSearch(make_space(), n_models, rng=np.random.default_rng(seed))
    first, second = drive(search, _bank(n_models), 2)
    np.testing.assert_allclose(first.estimate, TRUTH, atol=1e-6)
    assert second.status is SearchStatus.CONVERGED


@pytest.mark.parametrize("seed", range(3))
def test_gauss_newton_converges_quickly_where_mu_is_bent(seed: int) -> None:
    search = GuidedSearch(make_space(), 12, rng=np.random.default_rng(seed))
    iterations = drive(search, _bank(12, bend=0.1), 6)
    np.testing.assert_allclose(iterations[-1].estimate, TRUTH, atol=1e-6)


def test_gradient_reduces_the_error_in_every_window() -> None:
    """Theorem 1: with the step that the curvature allows, |p - p*| never grows on a quadratic mu."""
    search = GuidedSearch(make_space(), 12, SearchOptions(direction="gradient", candidates=0))
    iterations = drive(search, _bank(12), 40)
    scores = [iteration.mu for iteration in iterations]
    assert all(later <= earlier * (1.0 + 1e-9) for earlier, later in pairwise(scores))
    assert np.linalg.norm(iterations[-1].estimate - TRUTH) < 0.5 * np.linalg.norm(TRUTH)


def test_the_estimate_never_leaves_theta() -> None:
    space = make_space(bound=1.0)  # the truth lies outside
    for direction in ("gauss-newton", "gradient"):
        search = GuidedSearch(space, 12, SearchOptions(direction=direction))  # type: ignore[arg-type]
        for iteration in drive(search, _bank(12), 8):
            assert space.contains(iteration.estimate)
            assert space.contains(iteration.monitoring.proposal.points)


def test_at_the_border_gauss_newton_finds_the_constrained_minimum() -> None:
    space = make_space(bound=1.0)
    curvature = np.array([[2.0, 0.9, 0.0], [0.9, 1.0, 0.2], [0.0, 0.2, 3.0]])
    quadratic = LocalQuadratic(np.zeros(3), 10.0, -curvature @ TRUTH, curvature, 1.0, 0.0, 100)
    point = GaussNewtonDirection().step(quadratic, space)
    grid = np.linspace(-1.0, 1.0, 41)
    candidates = np.array(np.meshgrid(grid, grid, grid)).reshape(3, -1).T
    assert quadratic.at(point) <= min(quadratic.at(candidate) for candidate in candidates) + 1e-12


def test_gradient_step_minimises_along_the_gradient_and_is_damped_at_the_border() -> None:
    curvature = np.diag([1.0, 4.0, 9.0])
    quadratic = LocalQuadratic(np.zeros(3), 0.0, np.array([1.0, 1.0, 1.0]), curvature, 1.0, 0.0, 1)
    inside = GradientDirection().step(quadratic, make_space())
    np.testing.assert_allclose(inside, -3.0 / 14.0 * np.ones(3))
    tight = LineSearch().limit(np.zeros(3), inside, make_space(bound=0.1))
    assert make_space(bound=0.1).contains(tight)
    np.testing.assert_allclose(tight / np.linalg.norm(tight), inside / np.linalg.norm(inside))


def test_a_lucky_guess_wins_the_first_window() -> None:
    guesses = [np.zeros(3), np.full(3, 9.0), TRUTH + 1e-3]
    search = GuidedSearch(make_space(), 24, guesses=guesses)
    (first,) = drive(search, _bank(24), 1)
    assert first.best == 2
    assert first.monitoring.proposal.roles[:4] == (Role.CENTRE, Role.CANDIDATE, Role.CANDIDATE, Role.SAMPLE)


def test_a_step_that_overshoots_is_taken_back() -> None:
    """The old estimate runs beside the new one; the better of both is where the next step starts."""
    search = GuidedSearch(make_space(), 24, rng=np.random.default_rng(0))
    bank = _bank(24)
    drive(search, bank, 1)
    bank.truth = np.zeros(3)  # the target moved back to where the search came from
    (second,) = drive(search, bank, 1)
    assert second.monitoring.proposal.roles[second.best] is Role.CANDIDATE
    np.testing.assert_allclose(second.estimate, 0.0, atol=1e-6)


def test_same_seed_same_search() -> None:
    def run() -> np.ndarray:
        search = GuidedSearch(make_space(), 12, rng=np.random.default_rng(5))
        return drive(search, _bank(12, bend=0.1), 4)[-1].estimate

    np.testing.assert_array_equal(run(), run())


def test_termination_by_the_gradient_norm_of_eq_18() -> None:
    search = GuidedSearch(make_space(), 12, SearchOptions(direction="gradient", gradient_tolerance=1e6))
    assert drive(search, _bank(12), 1)[0].status is SearchStatus.CONVERGED


def test_more_unknowns_than_the_bank_serves_is_an_error() -> None:
    with pytest.raises(BadInputError, match="A bank of 3 models serves at most 2 unknowns, but 3 are asked for"):
        GuidedSearch(make_space(), 3)


def test_a_guess_outside_theta_is_refused() -> None:
    with pytest.raises(BadInputError, match="not a point of Theta"):
        GuidedSearch(make_space(), 12, guesses=[np.full(3, 99.0)])


@pytest.mark.parametrize("sampling", ["pairs", "ball", "cube"])
@pytest.mark.parametrize("n_samples", [3, 5, 6, 20])
def test_samples_stay_near_and_span_every_direction(sampling: Sampling, n_samples: int) -> None:
    centre = np.array([0.5, -0.5, 0.0])
    samples = sample_locally(centre, n_samples, 0.2, make_space(), np.random.default_rng(0), sampling)
    offsets = samples - centre
    assert samples.shape == (n_samples, 3)
    reach = np.max(np.abs(offsets), axis=1) if sampling == "cube" else np.linalg.norm(offsets, axis=1)
    assert np.all(reach <= 0.2 + 1e-12)
    assert np.linalg.matrix_rank(offsets) == 3


def test_pairs_are_antithetic() -> None:
    offsets = sample_locally(np.zeros(3), 20, 0.2, make_space(), np.random.default_rng(0), "pairs")
    np.testing.assert_allclose(offsets[:10], -offsets[10:])


class OwnDirection:
    """Steps somewhere that is no place in the space."""

    second_order = True

    def __init__(self, step: np.ndarray) -> None:
        self._step = step

    def step(self, quadratic: LocalQuadratic, space: object) -> np.ndarray:
        return self._step


@pytest.mark.parametrize("step", [np.zeros(2), np.array([0.0, np.nan, 0.0])])
def test_a_step_that_leads_nowhere_is_refused_with_the_name_of_its_direction(step: np.ndarray) -> None:
    search = GuidedSearch(make_space(), 12, SearchOptions(direction=OwnDirection(step)))
    with pytest.raises(BadInputError, match=r"Direction OwnDirection .* expected \(3,\) finite numbers"):
        drive(search, _bank(12), 1)


@pytest.mark.parametrize("name", ["sampling", "gradient"])
def test_a_way_that_does_not_exist_is_refused(name: str) -> None:
    with pytest.raises(BadInputError, match=f"`{name}` is 'x'; expected one of"):
        SearchOptions(**{name: "x"})  # type: ignore[arg-type]
