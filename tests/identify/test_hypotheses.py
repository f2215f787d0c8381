"""What a fit says of errors that its priors rule out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.identify.hypotheses import hypotheses
from massid.identify.options import IdentifyOptions
from massid.model.unknowns.bodies import Mass
from massid.model.unknowns.sensors import EffortGain, EffortScale
from massid.model.unknowns.unknown import nuisance
from massid.result import Status
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk.noise import PRESETS, Sensors
from tests.conftest import Pushed
from tests.weighed import weigh_offline

GAINS = tuple(EffortGain(f"joint{k}", **nuisance(0.02)) for k in range(6))
SPACE = ParameterSpace((Mass.of("torso", 20.0), *GAINS))
TRUE_KG = 22.0
OPTIONS = IdentifyOptions(dwell_s=0.25, lag_s=0.0, link_inertia=0.0, other_links=0.0)


def _log(gains: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Rows of a linear log with noise of one, and what they read."""
    rows = rng.normal(size=(400, 7)) * np.array([3.0, *[20.0] * 6])
    return rows, rows @ np.array([TRUE_KG, *gains]) + rng.normal(size=400)


def _fit(rows: FloatArray, read: FloatArray, precision: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Estimate, covariance and -2 log likelihood, prior included; the prior is a matrix around the nominal values."""
    information = rows.T @ rows + precision
    estimate = np.linalg.solve(information, rows.T @ read + precision @ SPACE.nominal)
    off = estimate - SPACE.nominal
    return estimate, np.linalg.inv(information), float(np.sum((rows @ estimate - read) ** 2) + off @ precision @ off)


@pytest.mark.parametrize("gains", [np.full(6, 0.1), np.array([0.0, 0.0, -0.2, 0.0, 0.0, 0.0])], ids=["all", "one"])
def test_it_foretells_what_a_fit_without_that_prior_finds(gains: FloatArray) -> None:
    rows, read = _log(gains, np.random.default_rng(1))
    prior = np.diag(SPACE.prior_precision)
    estimate, covariance, before = _fit(rows, read, prior)
    first = hypotheses(SPACE, estimate, covariance)[0]
    assert first.name == ("effort_scale/all" if gains.all() else "effort_gain/joint2")
    direction = np.concatenate([[0.0], (gains != 0.0).astype(float)])
    pull = prior @ direction
    free = prior - np.outer(pull, pull) / (pull @ direction)  # knows nothing along the direction
    expected, _, after = _fit(rows, read, free)
    np.testing.assert_allclose(estimate + first.change, expected, atol=1e-9)
    assert first.gain == pytest.approx(before - after)


def test_what_would_take_an_error_that_no_sensor_has_is_not_advised() -> None:
    rows, read = _log(np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]), np.random.default_rng(1))
    estimate, covariance, _ = _fit(rows, read, np.diag(SPACE.prior_precision))
    first = hypotheses(SPACE, estimate, covariance)[0]
    assert not first.believable
    assert first.text(SPACE).startswith("no error that can be explains the log (effort_gain/joint2 is -0.99")


def test_errors_as_large_as_believed_are_no_hypothesis() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        rows, read = _log(rng.normal(0.0, 0.02, size=6), rng)
        estimate, covariance, _ = _fit(rows, read, np.diag(SPACE.prior_precision))
        assert not hypotheses(SPACE, estimate, covariance)


def test_torques_that_read_too_much_are_named_and_found(pushed: Pushed) -> None:
    rng = np.random.default_rng(0)
    walk = Sensors(PRESETS["white"], len(pushed.walk.joint_names), pushed.walk.contact_bodies, rng).measure(pushed.walk)
    walk = replace(walk, effort=1.1 * walk.effort)
    denied = weigh_offline(walk, pushed.robot, pushed.space, OPTIONS)
    assert denied.status is Status.CONTRADICTED
    assert any("all torques read" in line and "`unknown=effort_scale/all`" in line for line in denied.warnings)
    space = ParameterSpace((*pushed.space.parameters, *EffortScale.ask(pushed.robot, "all")))
    found = weigh_offline(walk, pushed.robot, space, OPTIONS)
    assert found.status is Status.CONVERGED
    assert found.estimate[-1] == pytest.approx(0.1, abs=3.0 * found.uncertainty.std[-1])
