"""Colours of both outputs: how wrong a mass is, which link a line belongs to, what a model is for."""

from __future__ import annotations

import numpy as np

from massid.search.proposal import Role
from massid.typing import AnyArray, FloatArray

WORST_ERROR, BEST_ERROR = 0.3, 0.003
"""Relative mass errors at the two ends of the scale; it is logarithmic between them."""

_STOPS = np.array([[0.0, 0.659, 0.620], [0.961, 0.718, 0.200], [0.706, 0.098, 0.196]])
"""Teal, amber, dark red (sRGB): told apart by lightness and by the blue channel with any kind of colour vision."""

NEUTRAL = (0.60, 0.64, 0.70)
"""Links that are not identified."""

LINK_COLOURS = (
    "#4a90e2",
    "#f0883e",
    "#3fb68b",
    "#e5606e",
    "#a879e6",
    "#b98b5e",
    "#e667b1",
    "#8c9aa8",
    "#c2b53a",
    "#33b5c9",
)
"""Lines of links; readable on black and on white."""

ROLE_COLOURS = {Role.CENTRE: "#e5397f", Role.CANDIDATE: "#f0a830", Role.SAMPLE: "#7d9cc0"}
FORCE_COLOURS = ("#4a90e2", "#f0883e", "#3fb68b", "#a879e6")
HEADLINE_COLOUR = "#e5397f"
INTERVAL_COLOUR = "#c3ccd6"
PASS_COLOURS = ("#3a4350", "#566476")
"""Stretches of passes, by turns: quiet, for the colours of links and lines say more."""


def badness(relative_error: FloatArray) -> FloatArray:
    """Place relative errors on the colour scale.

    Args:
        relative_error: |error| / mass, any shape.

    Returns:
        0 (at most 0.3 %, good) to 1 (at least 30 %, bad), logarithmic between, same shape.
    """
    error = np.clip(np.abs(relative_error), BEST_ERROR, WORST_ERROR)
    return np.asarray(np.log(error / BEST_ERROR) / np.log(WORST_ERROR / BEST_ERROR), dtype=np.float64)


def scale_rgb(position: FloatArray) -> FloatArray:
    """Colours of positions on the scale: 0 teal, 0.5 amber, 1 dark red.

    Args:
        position: in [0, 1], any shape.

    Returns:
        sRGB in [0, 1], shape (*position.shape, 3).
    """
    places = np.linspace(0.0, 1.0, len(_STOPS))
    return np.stack([np.interp(position, places, channel) for channel in _STOPS.T], axis=-1)


def error_rgb(relative_error: FloatArray) -> FloatArray:
    """Colour of a relative mass error, sRGB in [0, 1], shape (*relative_error.shape, 3)."""
    return scale_rgb(badness(relative_error))


def rgba8(rgb: FloatArray, alpha: float = 1.0) -> AnyArray:
    """Bytes for Rerun: shape (..., 3) in [0, 1] to (..., 4) of uint8."""
    opaque = np.concatenate([rgb, np.full((*rgb.shape[:-1], 1), alpha)], axis=-1)
    return np.asarray(np.round(255.0 * np.clip(opaque, 0.0, 1.0)), dtype=np.uint8)


def tone(rgba: FloatArray) -> FloatArray:
    """Keep the light and dark of a model's own paint, as grey that an error's colour can tint.

    Args:
        rgba: shape (n, 4).

    Returns:
        sRGB in [0, 1], shape (n, 3).
    """
    lightness = rgba[:, :3] @ np.array([0.2126, 0.7152, 0.0722])
    return np.repeat((0.62 + 0.38 * lightness)[:, None], 3, axis=1)


def hex_rgb(colour: str) -> FloatArray:
    """Turn "#rrggbb" into sRGB in [0, 1], shape (3,)."""
    return np.array([int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)])


def hex_rgba8(colour: str, alpha: float = 1.0) -> list[int]:
    """Turn "#rrggbb" into four bytes for Rerun."""
    return [int(byte) for byte in rgba8(hex_rgb(colour), alpha)]
