from __future__ import annotations

import itertools

import numpy as np
from numpy.testing import assert_allclose

from massid.typing import FloatArray
from massid.walking.capture import possible_shift, uncorrectable
from massid.walking.dcm import DcmPiece, ZmpPiece, plan_dcm

FREQUENCY = 3.1


def walk_plan() -> list[DcmPiece]:
    """Three steps with a shift before each."""
    points = np.array([[0.0, 0.0], [0.0, 0.11], [0.2, -0.11], [0.35, 0.13], [0.6, -0.1]])
    pieces = []
    for here, there in itertools.pairwise(points):
        pieces.append(ZmpPiece(0.2, here, there))
        pieces.append(ZmpPiece(0.6, there, there))
    return plan_dcm(pieces, FREQUENCY)


def integrate(dcm: FloatArray, piece: DcmPiece, steps: int = 4000) -> FloatArray:
    """Euler's midpoint rule on d(xi)/dt = w (xi - p)."""
    h = piece.zmp.duration_s / steps
    for k in range(steps):
        half = dcm + h / 2 * FREQUENCY * (dcm - piece.zmp_at(k * h))
        dcm = dcm + h * FREQUENCY * (half - piece.zmp_at((k + 0.5) * h))
    return dcm


def test_each_piece_obeys_the_pendulum() -> None:
    for piece in walk_plan():
        # midpoint rule at 0.15 ms: its error is far below a micrometre
        assert_allclose(integrate(piece.dcm_at(0.0), piece), piece.final_dcm, atol=1e-6)


def test_the_reference_is_continuous_and_comes_to_rest_over_the_last_point() -> None:
    plan = walk_plan()
    for before, after in itertools.pairwise(plan):
        assert_allclose(before.dcm_at(before.zmp.duration_s), after.dcm_at(0.0), atol=1e-12)
    assert_allclose(plan[-1].final_dcm, plan[-1].zmp.end)


def test_the_dcm_stays_near_the_points_it_is_planned_for() -> None:
    for piece in walk_plan():
        for time_s in np.linspace(0.0, piece.zmp.duration_s, 7):
            assert np.linalg.norm(piece.dcm_at(time_s) - piece.zmp_at(time_s)) < 0.3


def test_before_its_start_and_after_its_end_a_piece_is_held() -> None:
    piece = walk_plan()[0]
    assert_allclose(piece.dcm_at(-1.0), piece.dcm_at(0.0))
    assert_allclose(piece.dcm_at(9.0), piece.final_dcm)
    assert_allclose(piece.zmp_at(9.0), piece.zmp.end)


def test_an_error_that_the_sole_can_correct_needs_no_shift() -> None:
    reach = np.array([0.1, 0.05])
    wanted = np.array([0.2, -0.1])
    growth = np.exp(FREQUENCY * 0.5)
    dcm = (wanted + (growth - 1) * np.array([0.04, -0.03])) / growth  # ends at wanted with a point inside the sole
    assert_allclose(uncorrectable(dcm, wanted, growth, reach), 0.0, atol=1e-12)


def test_what_the_sole_cannot_correct_grows_with_the_remaining_time() -> None:
    reach = np.array([0.1, 0.05])
    dcm, wanted = np.array([0.0, 0.08]), np.zeros(2)
    errors = [uncorrectable(dcm, wanted, np.exp(FREQUENCY * t), reach)[1] for t in (0.1, 0.3, 0.5)]
    assert 0.0 < errors[0] < errors[1] < errors[2]


def test_a_landing_moves_outwards_freely_but_not_into_the_other_foot() -> None:
    out = possible_shift(np.array([0.05, 0.3]), 0.22, outward=1.0, limit_m=0.12, narrowest_m=0.17)
    assert_allclose(out, [0.05, 0.12])
    inwards = possible_shift(np.array([-0.3, -0.3]), 0.22, outward=1.0, limit_m=0.12, narrowest_m=0.17)
    assert_allclose(inwards, [-0.12, -0.05])
    right = possible_shift(np.array([0.0, 0.3]), -0.22, outward=-1.0, limit_m=0.12, narrowest_m=0.17)
    assert_allclose(right, [0.0, 0.05])
