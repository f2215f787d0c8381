"""Centre of mass, inertia and payload: against a robot that was written body by body, not by the code under test."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massid.errors import BadInputError, ModelError
from massid.identify import IdentifyOptions
from massid.identify.sensing import nuisances
from massid.model.robot import Robot
from massid.model.unknowns.bodies import CentreOfMass, Inertia, InertiaScale, Mass
from massid.model.unknowns.spaces import mass_space, parameter_space
from massid.observer.bank import RobotBank
from massid.observer.replay import replay_block
from massid.result import Result, Status
from massid.search.guided import enough_models
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Segment, Walk
from massid.walk.noise import PRESETS, Sensors
from tests.altered_robot import INERTIA_GAIN, PAYLOAD, PAYLOAD_KG, altered, moments
from tests.pushed_robot import LINKS, draw_truth, make_robot, push_about
from tests.weighed import weigh_offline, weigh_online

NOMINAL = make_robot()


def _log(true: Robot, seconds: float) -> tuple[Walk, FloatArray]:
    """A log of the true robot with masses 15 % off, and these masses."""
    masses = mass_space(true, LINKS)
    truth = draw_truth(masses, seed=3)
    return push_about(true, masses, truth, seconds), truth


def _true_point(space: ParameterSpace, true: Robot, masses_kg: FloatArray) -> FloatArray:
    """The truth in the space's coordinates."""
    point = space.nominal.copy()
    for k, unknown in enumerate(space.parameters):
        match unknown:
            case Mass(body):
                point[k] = masses_kg[LINKS.index(body)]
            case CentreOfMass(body, axis):
                point[k] = true.model.body(body).ipos["xyz".index(axis)]
            case Inertia(entry=entry):
                point[k] = 0.5 * np.log(INERTIA_GAIN) if entry in ("xx", "yy", "zz") else 0.0
            case _:
                point[k] = PAYLOAD_KG
    return point


def _options(space: ParameterSpace, **changes: object) -> IdentifyOptions:
    options = IdentifyOptions(dwell_s=0.2, noise="clean", bank_size=enough_models(len(space)))
    return replace(options, **changes)  # type: ignore[arg-type]


def _found(result: Result) -> dict[str, float]:
    return {quantity.name: quantity.estimate for quantity in result.quantities}


def test_everything_known_means_zero_response() -> None:
    true = altered(com="torso", inertia="l_thigh", payload="torso")
    walk, masses_kg = _log(true, 0.4)
    space = parameter_space(NOMINAL, LINKS, ["com/torso", "inertia/l_thigh", f"payload/{PAYLOAD}"])
    bank = RobotBank(NOMINAL, space, walk.contact_bodies, 2)
    bank.place(np.array([_true_point(space, true, masses_kg), space.nominal]))
    block = replay_block(walk, NOMINAL.layout, Segment(0, 400))
    bank.restart(block)
    exact, nominal = np.abs(bank.advance(block).values).max(axis=(1, 2))
    assert exact < 1e-11  # rounding, in rad, rad/s, m, m/s
    assert nominal > 1e-3


def test_centre_of_mass_and_payload_are_found_beside_the_masses() -> None:
    true = altered(com="torso", payload="torso")
    walk, masses_kg = _log(true, 1.6)
    space = parameter_space(NOMINAL, LINKS, ["com/torso", f"payload/{PAYLOAD}"])
    result = weigh_online(walk, NOMINAL, space, _options(space))
    assert result.status is Status.CONVERGED
    np.testing.assert_allclose(result.estimate[: len(LINKS)], masses_kg, atol=1e-6)  # kg
    found = _found(result)
    for axis, position in zip("xyz", true.model.body("torso").ipos, strict=True):
        assert found[f"com/torso/{axis}"] == pytest.approx(position, abs=1e-6)  # m
    assert found[f"payload/{PAYLOAD}"] == pytest.approx(PAYLOAD_KG, abs=1e-6)  # kg
    assert result.to_json()["quantities"]["com/torso/x"]["unit"] == "m"


def test_inertia_is_found_beside_the_masses() -> None:
    true = altered(inertia="torso")
    walk, masses_kg = _log(true, 0.8)
    space = parameter_space(NOMINAL, LINKS, ["inertia/torso"])
    result = weigh_offline(walk, NOMINAL, space, _options(space))
    np.testing.assert_allclose(result.estimate[: len(LINKS)], masses_kg, atol=1e-6)  # kg
    expected = moments(true, "torso") * masses_kg[0] / NOMINAL.nominal_mass_kg("torso")
    found = [_found(result)[f"inertia/torso/{number}"] for number in (1, 2, 3)]
    np.testing.assert_allclose(found, expected, atol=1e-6)  # kg m^2


def test_a_noisy_log_leaves_the_truth_within_its_deviations() -> None:
    true = altered(com="torso", payload="torso")
    walk, masses_kg = _log(true, 1.6)
    measured = Sensors(PRESETS["white"], 8, walk.contact_bodies, np.random.default_rng(0)).measure(walk)
    space = parameter_space(NOMINAL, LINKS, ["com/torso", f"payload/{PAYLOAD}"])
    options = _options(space, noise="white", other_links=0.0, bank_size=24)
    result = weigh_offline(measured, NOMINAL, space, options)
    assert result.uncertainty is not None
    error = result.estimate - _true_point(space, true, masses_kg)
    assert np.all(np.abs(error) < 4.0 * result.uncertainty.std)
    assert all(quantity.std is not None and quantity.identifiable for quantity in result.quantities)


@pytest.mark.parametrize("seed", range(2))
def test_an_inertia_that_nobody_asked_about_does_not_bias_the_masses(seed: int) -> None:
    walk, masses_kg = _log(altered(inertia="torso"), 1.2)
    measured = Sensors(PRESETS["white"], 8, walk.contact_bodies, np.random.default_rng(seed)).measure(walk)
    space = mass_space(NOMINAL, LINKS)
    believed, blamed = (
        weigh_offline(measured, NOMINAL, space, IdentifyOptions(noise="white", other_links=0.0, link_inertia=width))
        for width in (0.1, 0.0)
    )
    found = believed.uncertainty
    assert found is not None
    assert blamed.uncertainty is not None
    assert np.all(np.abs(believed.estimate - masses_kg) < 4.0 * found.std)
    assert np.abs(blamed.estimate - masses_kg).max() > 2.0 * np.abs(believed.estimate - masses_kg).max()
    torso = [parameter.name for parameter in found.nuisances].index("inertia_scale/torso")
    assert abs(found.nuisance_estimate[torso] - np.log(INERTIA_GAIN)) < 4.0 * found.nuisance_std[torso]
    assert found.nuisance_std[torso] < 0.02


def test_an_inertia_that_is_asked_for_has_no_other_unknown_in_it() -> None:
    walk, _ = _log(NOMINAL, 0.2)
    space = parameter_space(NOMINAL, ["torso", "l_calf"], ["inertia/torso"])
    unknown = nuisances(NOMINAL, walk, space, PRESETS["white"], IdentifyOptions())
    assert [parameter.target for parameter in unknown if isinstance(parameter, InertiaScale)] == ["l_calf"]


def test_the_saved_model_has_what_was_found(tmp_path: Path) -> None:
    wanted = ["com/torso", "inertia/torso", "inertia/l_calf", f"payload/{PAYLOAD}"]
    space = parameter_space(NOMINAL, ["torso"], wanted)
    point = space.nominal + 0.2 * space.scale * np.random.default_rng(0).uniform(-1.0, 1.0, len(space))
    point[-1] = PAYLOAD_KG
    NOMINAL.write_model(space, point, tmp_path / "saved.xml")
    saved, expected = Robot.load(tmp_path / "saved.xml").model, NOMINAL.model_at(space, point)
    for name in ("body_mass", "body_ipos", "body_inertia", "body_iquat"):
        np.testing.assert_allclose(getattr(saved, name), getattr(expected, name), atol=1e-4, err_msg=name)


@pytest.mark.parametrize(
    ("unknowns", "error", "message"),
    [
        (["com/l_tigh"], ModelError, "no link named 'l_tigh'. Did you mean l_thigh"),
        (["inertia/world"], ModelError, "The world has no mass"),
        (["payload/l_hand"], ModelError, "no moving body named 'l_hand'"),
        (["payload/torso@0,1"], BadInputError, r"Payload 'torso@0,1': expected BODY or BODY@X,Y,Z"),
        (["payload/torso@0,1,nan"], BadInputError, "expected BODY or BODY@X,Y,Z"),
        (["com/torso", "com/torso"], BadInputError, "named more than once: com/torso/x"),
        (["com/torso", "com/torso/y"], BadInputError, "named more than once: com/torso/y"),
        (["damping/l_nee"], ModelError, r"no joint named 'l_nee'\. Did you mean"),
        (["wrench_gain/l_foot/6"], BadInputError, r"a contact sensor has axes 0-2 \(force\) and 3-5"),
        (["effort_lag/all"], BadInputError, "lag of the torques cannot be asked for by name"),
        (["colour/torso"], BadInputError, "Unknown 'colour/torso': expected KIND/TARGET, with a kind out of mass, com"),
        (["torso"], BadInputError, "Unknown 'torso': expected KIND/TARGET"),
    ],
)
def test_what_cannot_be_asked_for_is_named(unknowns: list[str], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        parameter_space(NOMINAL, LINKS, unknowns)
