from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.cli import main
from massid.identify import IdentifyOptions
from massid.observer.scales import Scales
from massid.plant import without_wrenches
from massid.walk.noise import PRESETS, Sensors
from tests.conftest import Pushed
from tests.weighed import verdict_on


def test_what_the_scales_read_is_believed_of_the_sum_and_of_nothing_else(pushed: Pushed) -> None:
    belief = Scales(excess_kg=1.5, std_kg=0.2).belief(pushed.space)
    point = pushed.space.nominal.copy()
    point[0] += 1.5
    assert belief.at(point) == pytest.approx(0.0, abs=1e-9)
    point[1], point[2] = point[1] + 0.4, point[2] - 0.4
    assert belief.at(point) == pytest.approx(0.0, abs=1e-9)
    point[3] += 0.2  # one deviation
    assert belief.at(point) == pytest.approx(1.0, rel=1e-9)


def test_scales_bound_what_torque_sensors_have_in_common(pushed: Pushed) -> None:
    """Before the fit: without force sensors nothing else tells of the robot's weight."""
    noise = replace(PRESETS["realistic"], effort_gain=0.2)
    walk = pushed.walk.between(200, 900)
    noisy = Sensors(noise, 8, walk.contact_bodies, np.random.default_rng(0)).measure(walk)
    options = IdentifyOptions(dwell_s=0.2, noise="realistic")
    weighed = replace(options, total_mass_kg=pushed.truth.sum(), total_mass_std_kg=0.2)
    alone, known = (
        verdict_on(without_wrenches(noisy), pushed.robot, pushed.space, one).total_std_kg for one in (options, weighed)
    )
    assert alone > 0.3
    assert known == pytest.approx((alone**-2 + 0.2**-2) ** -0.5, rel=0.01)


def test_a_weight_that_is_none_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "walk.mcap", "--total-mass-kg", "-3"]) == 2
    assert "--total-mass-kg is -3" in capsys.readouterr().err
