from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from massid.view import colours

TEAL, AMBER, RED = colours.scale_rgb(np.array([0.0, 0.5, 1.0]))


def test_badness_rises_with_the_error_and_saturates_at_the_ends() -> None:
    errors = np.geomspace(1e-12, 10.0, 200)
    badness = colours.badness(errors)
    assert np.all(np.diff(badness) >= 0.0)
    assert badness[0] == 0.0
    assert badness[-1] == 1.0
    assert_allclose(colours.badness(np.array([0.03])), 0.5, atol=1e-12)  # the logarithmic middle of 0.3 % and 30 %


def test_the_sign_of_an_error_does_not_matter() -> None:
    errors = np.array([0.01, 0.1])
    assert_allclose(colours.error_rgb(-errors), colours.error_rgb(errors), rtol=0, atol=0)


def test_falling_errors_go_from_red_over_amber_to_teal() -> None:
    rgb = colours.error_rgb(np.array([0.5, 0.03, 1e-4]))
    assert_allclose(rgb, [RED, AMBER, TEAL], atol=1e-12)
    redness = colours.error_rgb(np.geomspace(0.5, 1e-4, 50))[:, 0]
    blueness = colours.error_rgb(np.geomspace(0.5, 1e-4, 50))[:, 2]
    assert redness[0] > redness[-1]
    assert np.all(np.diff(blueness) >= -1e-12)


def test_the_three_colours_differ_in_lightness_or_blue_for_any_colour_vision() -> None:
    lightness = np.stack([TEAL, AMBER, RED]) @ np.array([0.2126, 0.7152, 0.0722])
    assert lightness[1] > lightness[0] + 0.15
    assert lightness[0] > lightness[2] + 0.15
    assert TEAL[2] > RED[2] + 0.3


def test_tones_keep_dark_paint_darker_than_light_paint() -> None:
    tones = colours.tone(np.array([[0.1, 0.1, 0.1, 1.0], [0.9, 0.9, 0.9, 1.0]]))
    assert np.all(tones[0] < tones[1])
    assert np.all(tones <= 1.0)


def test_bytes() -> None:
    assert colours.hex_rgba8("#ff8000") == [255, 128, 0, 255]
    assert colours.rgba8(np.array([[0.0, 2.0, 0.5]])).tolist() == [[0, 255, 128, 255]]
