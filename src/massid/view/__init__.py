"""What an identification looks like: a Rerun recording, and one picture for people without a viewer.

Nothing heavy is imported until it is used: Rerun and matplotlib load with the first function that needs them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from massid.lazy import lazy_names

if TYPE_CHECKING:
    from massid.view.picture import write_summary_png
    from massid.view.recording import write_recording
    from massid.view.viewer import open_viewer, take_screenshot

_HOMES = {
    "write_recording": "recording",
    "write_summary_png": "picture",
    "open_viewer": "viewer",
    "take_screenshot": "viewer",
}

__all__ = ["open_viewer", "take_screenshot", "write_recording", "write_summary_png"]

__getattr__ = lazy_names(__name__, _HOMES)
