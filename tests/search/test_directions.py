"""Every direction behind one interface, the line search, the scan and the model set."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.errors import BadInputError
from massid.search.directions import DIRECTIONS, Direction, make_direction
from massid.search.directions.adam import AdamDirection
from massid.search.directions.bfgs import BfgsDirection
from massid.search.directions.gauss_newton import GaussNewtonDirection
from massid.search.directions.gradient import GradientDirection
from massid.search.directions.heavy_ball import HeavyBallDirection
from massid.search.directions.levenberg_marquardt import LevenbergMarquardtDirection
from massid.search.guided import GuidedSearch, SearchOptions, SearchStatus
from massid.search.line_search import LineSearch
from massid.search.model_set import ModelSet
from massid.search.parameters import ParameterSpace
from massid.search.proposal import Role
from massid.search.quadratic import LocalQuadratic
from massid.search.scan import scan_points, scanned_columns
from massid.typing import FloatArray
from tests.search.quadratic_bank import QuadraticBank, drive, make_space

TRUTH = np.array([1.0, -2.0, 0.5])
CURVATURE = np.array([[2.0, 0.9, 0.0], [0.9, 3.0, 0.2], [0.0, 0.2, 1.0]])


def _bank(n_models: int, bend: float = 0.0) -> QuadraticBank:
    jacobian = np.random.default_rng(0).normal(size=(50, 2, 3)) * np.array([1.0, 3.0, 0.3])
    return QuadraticBank(jacobian, TRUTH, n_models, bend=bend)


def _at(point: FloatArray) -> LocalQuadratic:
    """Exact picture of (p - p*)^T H (p - p*) / 2 around a point."""
    offset = point - TRUTH
    value = 0.5 * float(offset @ CURVATURE @ offset)
    return LocalQuadratic(point, value, CURVATURE @ offset, CURVATURE, 1.0, 0.0, 1)


def _descend(direction: Direction, steps: int) -> list[LocalQuadratic]:
    space, point, seen = make_space(), np.zeros(3), []
    for _ in range(steps):
        seen.append(_at(point))
        point = point + LineSearch().limit(point, direction.step(seen[-1], space), space)
    return [*seen, _at(point)]


@pytest.mark.parametrize("name", sorted(DIRECTIONS))
def test_every_direction_descends_and_converges_on_a_quadratic(name: str) -> None:
    seen = _descend(DIRECTIONS[name](0.0), 60)
    assert seen[1].value < seen[0].value
    assert seen[-1].value < 1e-3 * seen[0].value


@pytest.mark.parametrize("name", sorted(DIRECTIONS))
def test_every_search_has_a_direction_of_its_own(name: str) -> None:
    """What one search has learnt does not leak into the next."""
    options = SearchOptions(direction=name)

    def run() -> FloatArray:
        search = GuidedSearch(make_space(), 12, options, np.random.default_rng(0))
        return drive(search, _bank(12), 5)[-1].estimate

    np.testing.assert_array_equal(run(), run())


def test_gauss_newton_gets_there_in_one_step() -> None:
    np.testing.assert_allclose(GaussNewtonDirection().step(_at(np.zeros(3)), make_space()), TRUTH, atol=1e-12)


def test_the_safe_gradient_steps_by_one_over_l() -> None:
    quadratic = _at(np.zeros(3))
    step = GradientDirection("unit", rule="lipschitz").step(quadratic, make_space())
    np.testing.assert_allclose(step, -quadratic.gradient / np.linalg.eigvalsh(CURVATURE)[-1])
    fixed = GradientDirection("unit", step_size=0.03).step(quadratic, make_space())
    np.testing.assert_allclose(fixed, -0.03 * quadratic.gradient)


def test_the_metric_of_the_scales_makes_units_not_matter() -> None:
    """The same problem in grams takes the same steps."""
    unit = np.array([1.0, 1000.0, 1.0])
    space = make_space()
    rescaled = ParameterSpace(
        tuple(
            replace(p, lower=p.lower * u, upper=p.upper * u, scale=p.scale * u)
            for p, u in zip(space.parameters, unit, strict=True)
        )
    )
    quadratic = _at(np.zeros(3))
    grams = replace(
        quadratic,
        centre=quadratic.centre * unit,
        gradient=quadratic.gradient / unit,
        curvature=quadratic.curvature / np.outer(unit, unit),
    )
    for make in (GradientDirection, HeavyBallDirection, BfgsDirection, AdamDirection):
        np.testing.assert_allclose(make().step(grams, rescaled), make().step(quadratic, space) * unit, rtol=1e-9)
    plain = GradientDirection("unit").step(grams, rescaled) / unit
    assert not np.allclose(plain, GradientDirection("unit").step(quadratic, space), rtol=0.1)


def test_heavy_ball_overtakes_the_plain_step() -> None:
    """On an ill-conditioned quadratic momentum is worth many windows."""
    stiff = np.diag([1.0, 1.0, 60.0])

    def error(direction: Direction) -> float:
        point = np.zeros(3)
        for _ in range(30):
            quadratic = LocalQuadratic(point, 0.0, stiff @ (point - TRUTH), stiff, 1.0, 0.0, 1)
            point = point + direction.step(quadratic, make_space())
        return float(np.linalg.norm(point - TRUTH))

    assert error(HeavyBallDirection()) < 0.5 * error(GradientDirection("scale", rule="lipschitz"))


def test_a_step_that_is_taken_back_leaves_no_momentum_and_raises_the_damping() -> None:
    heavy, damped, space = HeavyBallDirection(), LevenbergMarquardtDirection(), make_space()
    quadratic = _at(np.zeros(3))
    first, again = heavy.step(quadratic, space), heavy.step(quadratic, space)
    np.testing.assert_array_equal(first, again)
    lengths = [np.linalg.norm(damped.step(quadratic, space)) for _ in range(4)]
    assert lengths[0] > lengths[1] > lengths[2] > lengths[3]


def test_adam_moves_every_coordinate_alike_at_first() -> None:
    step = AdamDirection(0.2).step(_at(np.zeros(3)), make_space())
    np.testing.assert_allclose(np.abs(step), 0.2, rtol=1e-6)


def test_bfgs_learns_the_curvature_from_gradients() -> None:
    """Where mu is the same quadratic in every window it ends in few steps, without being told the curvature."""
    seen = _descend(BfgsDirection(), 8)
    assert seen[-1].value < 1e-8 * seen[0].value


def test_the_line_search_caps_and_discounts() -> None:
    space, step = make_space(bound=1.0), np.array([3.0, 1.0, 0.0])
    capped = LineSearch(largest_step=0.5).limit(np.zeros(3), step, space)
    np.testing.assert_allclose(capped, step / 6.0)
    inside = LineSearch().limit(np.zeros(3), step, space)
    assert space.contains(inside)
    np.testing.assert_allclose(inside, 0.7**4 * step)
    outwards = LineSearch().limit(np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), space)
    assert np.linalg.norm(outwards) < 1e-8


def test_the_cap_narrows_after_a_failure_and_widens_again() -> None:
    narrow = LineSearch().narrowed(2.0)
    assert narrow.largest_step == 0.5
    assert narrow.widened(np.inf).widened(np.inf).largest_step == 8.0
    assert narrow.widened(1.0).largest_step == 1.0


@pytest.mark.parametrize("direction", ["gauss-newton", "gradient", "adam", "bfgs"])
def test_the_largest_step_holds_in_a_search(direction: str) -> None:
    options = SearchOptions(direction=direction, largest_step=0.1)
    search = GuidedSearch(make_space(), 12, options, np.random.default_rng(0))
    before = np.zeros(3)
    for iteration in drive(search, _bank(12), 6):
        start = iteration.monitoring.proposal.points[iteration.best]
        assert np.abs(iteration.estimate - start).max() <= 0.1 + 1e-12
        before = iteration.estimate
    assert np.linalg.norm(before) > 0.1


def test_scanned_points_cover_theta() -> None:
    space = make_space(bound=2.0)
    points = scan_points(space, np.ones(3), np.array([1]), 8)
    np.testing.assert_allclose(points[:, 1], -1.75 + 0.5 * np.arange(8))
    assert np.all(points[:, [0, 2]] == 1.0)
    both = scan_points(space, np.ones(3), np.array([0, 2]), 16)
    assert space.contains(both)
    quadrants = {(bool(a > 0), bool(b > 0)) for a, b in both[:, [0, 2]]}
    assert len(quadrants) == 4


def test_a_scan_sees_past_the_nearest_minimum() -> None:
    """An output error like sin(2 d) + 0.9 d, d = p1 - p1*: many minima in p1, none of them but p* with mu = 0."""

    class Wavy(QuadraticBank):
        def advance(self, block: object):  # type: ignore[no-untyped-def]
            errors = super().advance(block)
            offset = (self.points - self.truth)[:, 1]
            wave = np.sin(2.0 * offset) + 0.9 * offset - offset
            return replace(errors, values=errors.values + wave[:, None, None] * self.jacobian[None, :, :, 1])

    def end(scan: tuple[str, ...]) -> FloatArray:
        bank = Wavy(_bank(24).jacobian, np.array([1.0, 5.6, 0.5]), 24)
        search = GuidedSearch(make_space(), 24, SearchOptions(scan=scan), np.random.default_rng(0))
        return drive(search, bank, 12)[-1].estimate

    assert np.linalg.norm(end(("p1",)) - [1.0, 5.6, 0.5]) < 1e-3
    assert np.linalg.norm(end(()) - [1.0, 5.6, 0.5]) > 1.0


def test_a_scan_judges_a_value_with_the_others_adjusted() -> None:
    """Where mu is quadratic one scan window finds the others exactly, for the best of the scanned values."""
    search = GuidedSearch(make_space(), 15, SearchOptions(scan=("p1",)), np.random.default_rng(0))
    (first,) = drive(search, _bank(15), 1)
    scanned = first.monitoring.proposal.points[first.monitoring.proposal.candidates, 1]
    assert first.estimate[1] == scanned[np.argmin(np.abs(scanned - TRUTH[1]))]
    given = first.estimate[1] - TRUTH[1]
    information = np.einsum("kyi,kyj->ij", _bank(15).jacobian, _bank(15).jacobian)
    others = np.linalg.solve(information[np.ix_([0, 2], [0, 2])], -information[[0, 2], 1] * given)
    np.testing.assert_allclose(first.estimate[[0, 2]], TRUTH[[0, 2]] + others, atol=1e-6)


def test_bad_scans_are_refused() -> None:
    with pytest.raises(BadInputError, match="no parameter named 'p9'"):
        GuidedSearch(make_space(), 12, SearchOptions(scan=("p9",)))
    with pytest.raises(BadInputError, match="leaves none to scan p1 with: use at least 5 models"):
        GuidedSearch(make_space(), 4, SearchOptions(scan=("p1",)))
    assert scanned_columns(make_space(), ("p2", "p0")).tolist() == [2, 0]


def test_kept_models_come_back_as_candidates() -> None:
    search = GuidedSearch(make_space(), 24, SearchOptions(kept=4), np.random.default_rng(0))
    bank = _bank(24)
    (first,) = drive(search, bank, 1)
    proposal = search.ask()
    assert proposal.roles.count(Role.CANDIDATE) == 3 + 4
    best = ModelSet.select_kept(first.monitoring, 4, first.best)
    for point in best:
        assert any(np.array_equal(point, candidate) for candidate in proposal.points[proposal.candidates])
    drive(search, bank, 3)
    np.testing.assert_allclose(search.estimate, TRUTH, atol=1e-6)


def test_from_a_distant_guess_that_wins_the_search_takes_no_step_but_samples_there() -> None:
    """The samples around the first guess say nothing about a point far away when mu is bent."""
    far = TRUTH + np.array([0.05, 0.0, 0.0])
    search = GuidedSearch(make_space(), 24, rng=np.random.default_rng(0), guesses=[np.array([9.0, 9.0, 9.0]), far])
    first, second, *_ = drive(search, _bank(24, bend=3.0), 2)
    np.testing.assert_array_equal(first.estimate, far)
    assert first.status is SearchStatus.RUNNING
    assert np.linalg.norm(second.estimate - TRUTH) < np.linalg.norm(far - TRUTH)


class _HalfNewton:
    """A direction of a user's own, which counts its steps."""

    second_order = True

    def __init__(self) -> None:
        self.steps = 0

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        self.steps += 1
        return 0.5 * GaussNewtonDirection().step(quadratic, space)


def test_a_direction_of_ones_own_is_handed_in_and_every_search_has_a_copy() -> None:
    own = _HalfNewton()
    search = GuidedSearch(make_space(), 9, SearchOptions(direction=own))
    drive(search, _bank(9), 12)
    assert np.linalg.norm(search.estimate - TRUTH) < 1e-3 * np.linalg.norm(TRUTH)
    assert own.steps == 0


def test_what_is_no_direction_is_refused() -> None:
    with pytest.raises(BadInputError, match=r"no direction named 'newton'\. .* It has: gauss-newton, adam"):
        make_direction("newton")
    with pytest.raises(BadInputError, match="object is no direction: expected a name, or an object with `step`"):
        make_direction(object())  # type: ignore[arg-type]
