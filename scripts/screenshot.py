"""Take the README's picture of the Rerun view, without a display.

    massid demo --out massid_demo && python scripts/screenshot.py massid_demo/walk.rrd docs/images/view.png --time-s 0.8

Needs a Vulkan driver; on Debian: mesa-vulkan-drivers libgl1-mesa-dri libegl1 libgl1 fonts-dejavu-core.
"""

from pathlib import Path

import tyro

from massid.view import take_screenshot


def main(recording: tyro.conf.Positional[Path], picture: tyro.conf.Positional[Path], time_s: float = 0.8) -> None:
    """Open a recording in a headless viewer, go to a time, save what it shows."""
    take_screenshot(recording, picture, time_s=time_s)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
