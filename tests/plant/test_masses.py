import numpy as np
import pytest

from massid.errors import BadInputError, ModelError
from massid.model.robot import WALKING_LINKS, Robot
from massid.model.unknowns.spaces import mass_space
from massid.plant import HiddenMasses, MassErrors, default_links
from massid.score import Truth
from tests.plant.worlds import crab


@pytest.mark.parametrize("norm_kg", [0.0, 0.5, 6.0, 40.0, 100.0])
@pytest.mark.parametrize("seed", range(5))
def test_drawn_errors_have_the_norm_and_stay_in_theta(atlas: Robot, norm_kg: float, seed: int) -> None:
    hidden = MassErrors(norm_kg=norm_kg).draw(atlas, np.random.default_rng(seed))
    assert tuple(hidden.error_kg) == WALKING_LINKS
    assert hidden.norm_kg == pytest.approx(norm_kg, rel=1e-12, abs=1e-15)  # rounding of a sum of squares
    space = mass_space(atlas, hidden.error_kg)
    true = np.array([hidden.true_kg(atlas)[link] for link in hidden.error_kg])
    assert space.contains(true)


def test_the_largest_norm_that_fits_is_reached(atlas: Robot) -> None:
    upper = 1.5 * np.linalg.norm([atlas.nominal_mass_kg(link) for link in WALKING_LINKS])
    hidden = MassErrors(norm_kg=0.99999 * upper).draw(atlas, np.random.default_rng(0))
    assert hidden.norm_kg == pytest.approx(0.99999 * upper, rel=1e-12)
    with pytest.raises(BadInputError, match=r"do not fit .* at most 102\.\d kg"):
        MassErrors(norm_kg=1.001 * upper).draw(atlas, np.random.default_rng(0))


def test_directions_are_spread(atlas: Robot) -> None:
    rng = np.random.default_rng(0)
    draws = np.array([list(MassErrors(norm_kg=0.5).draw(atlas, rng).error_kg.values()) for _ in range(400)])
    # Isotropic: zero mean within 5 standard errors of 0.5 kg / sqrt(7 x 400), and equal shares.
    np.testing.assert_allclose(draws.mean(axis=0), 0.0, atol=5 * 0.5 / np.sqrt(7 * 400))
    np.testing.assert_allclose((draws**2).mean(axis=0), 0.25 / 7, rtol=0.35)


def test_default_links_and_norm() -> None:
    robot = crab("Euler", servo=False)
    assert default_links(robot) == robot.links  # fewer than seven, and none of the paper's names
    hidden = MassErrors().draw(robot, np.random.default_rng(0))
    assert hidden.norm_kg == pytest.approx(np.linalg.norm([3.0, 0.8, 0.4, 0.9]) / 4)


def test_true_model_scales_inertia_and_keeps_the_centre(atlas: Robot) -> None:
    true = HiddenMasses({"torso": 3.0}).true_model(atlas)
    torso = atlas.model.body("torso").id
    factor = (atlas.model.body_mass[torso] + 3.0) / atlas.model.body_mass[torso]
    np.testing.assert_allclose(true.body_inertia[torso], factor * atlas.model.body_inertia[torso], rtol=1e-14)
    np.testing.assert_array_equal(true.body_ipos, atlas.model.body_ipos)
    assert true.body_subtreemass[0] == pytest.approx(atlas.total_mass_kg + 3.0)


def test_unknown_link_is_named(atlas: Robot) -> None:
    with pytest.raises(ModelError, match=r"no link named 'torzo'.*torso"):
        HiddenMasses({"torzo": 1.0}).true_kg(atlas)
    with pytest.raises(ModelError, match=r"no link named 'l_tigh'.*l_thigh"):
        MassErrors(links=("l_tigh",)).draw(atlas, np.random.default_rng(0))


def test_impossible_masses_are_refused(atlas: Robot) -> None:
    with pytest.raises(BadInputError, match=r"-2 kg on 'l_foot' makes it 0\.41 kg, outside \[0\.723, 6\.025\]"):
        HiddenMasses({"l_foot": -2.0}).true_kg(atlas)
    with pytest.raises(BadInputError, match="makes it nan kg"):
        HiddenMasses({"l_foot": float("nan")}).true_kg(atlas)
    with pytest.raises(BadInputError, match="must be a finite number, at least 0"):
        MassErrors(norm_kg=-1.0).draw(atlas, np.random.default_rng(0))


@pytest.mark.parametrize("where", ["torso", "l_foot", "r_hand@0,0,0.1"])
@pytest.mark.parametrize("payload_kg", [1e-3, 5.0])
def test_a_payload_is_on_top_of_the_link(atlas: Robot, where: str, payload_kg: float) -> None:
    hidden = HiddenMasses({"l_thigh": 1.0}, {where: payload_kg})
    link, _, point = where.partition("@")
    true, plain = hidden.true_model(atlas).body(link), atlas.model.body(link)
    assert float(true.mass[0] - plain.mass[0]) == pytest.approx(payload_kg)
    at = np.array([float(x) for x in point.split(",")]) if point else np.zeros(3)
    np.testing.assert_allclose(true.mass * true.ipos, plain.mass * plain.ipos + payload_kg * at, atol=1e-12)
    assert hidden.true_kg(atlas)[link] == pytest.approx(float(plain.mass[0]))


@pytest.mark.parametrize("payload_kg", [0.0, -1.0, float("nan"), float("inf")])
def test_a_payload_weighs_something(atlas: Robot, payload_kg: float) -> None:
    with pytest.raises(BadInputError, match="expected a finite mass above 0"):
        HiddenMasses({}, {"torso": payload_kg}).true_model(atlas)


def test_a_link_that_is_weighed_with_its_payload_is_scored_with_it() -> None:
    truth = Truth({"torso": 10.0, "foot": 1.0}, {"payload/torso@0,0,0.1": 2.0, "com/torso/x": 0.3})
    assert truth.weighed_kg("torso") == 12.0
    assert truth.weighed_kg("torso", apart=["payload/torso@0,0,0.1"]) == 10.0
    assert truth.weighed_kg("foot") == 1.0
