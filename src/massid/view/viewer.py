"""Opens the Rerun viewer on a recording, with a window or, for a screenshot, without."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from massid.errors import BadInputError, MassidError
from massid.outputs import write_file
from massid.view.names import SIM_TIME

MAGIC = b"RRF"
LOCAL_ONLY = "127.0.0.1"
"""The viewer also listens for live data; by default it would do so on every network interface."""
START_TIMEOUT_S = 30.0
SETTLE_S = 2.0
"""Time for the viewer to draw what it was told."""
MENU_BAR_PIXELS = 36
"""Height of the viewer's own menu, which a screenshot leaves out."""


def open_viewer(path: Path) -> None:
    """Show a recording and wait until the viewer's window is closed.

    Raises:
        BadInputError: the file does not exist or is not a Rerun recording.
        MassidError: there is no display, or the viewer did not start.
    """
    check_recording(path)
    if not _has_display():
        raise MassidError(
            f"There is no display here to show {path} on. Run `rerun {path.name}` on a machine with one, or show it in "
            f"a browser with `rerun --web-viewer --bind {LOCAL_ONLY} {path}` (over ssh, forward ports 9090 and 9876)."
        )
    command = [_executable(), "--bind", LOCAL_ONLY, "--port", "auto", str(path)]
    try:
        code = subprocess.run(command, check=False).returncode
    except KeyboardInterrupt:
        return
    if code != 0:
        raise MassidError(f"The Rerun viewer ended with exit code {code}; its own messages are above.")


def take_screenshot(
    recording: Path, picture: Path, time_s: float | None = None, size: tuple[int, int] = (1600, 1000)
) -> None:
    """Save what the viewer shows of a recording as a PNG file, without a display.

    Needs a graphics driver; on a machine without a graphics card, Debian's mesa-vulkan-drivers is one.

    Args:
        recording: an .rrd file.
        picture: the PNG file to write.
        time_s: where to put the cursor of the timeline `sim_time` [s]; None for wherever the viewer starts.
        size: width and height [pixels].

    Raises:
        BadInputError: the file does not exist or is not a Rerun recording.
        MassidError: the viewer did not start, or saved nothing.
    """
    from PIL import Image

    check_recording(recording)
    width, height = size
    with TemporaryDirectory() as folder:
        window = Path(folder) / "window.png"
        with _headless_viewer(width, height + MENU_BAR_PIXELS) as viewer:
            viewer.open(str(recording.resolve()))
            time.sleep(SETTLE_S)
            if time_s is not None:
                viewer.set_time(SIM_TIME, duration=time_s)
            viewer.set_time(play_state="paused")
            time.sleep(SETTLE_S)
            viewer.save_screenshot(str(window))
        content = BytesIO()
        try:
            with Image.open(window) as whole:
                whole.crop((0, MENU_BAR_PIXELS, width, height + MENU_BAR_PIXELS)).save(content, format="png")
        except OSError as error:
            raise MassidError(f"The viewer saved no screenshot: {error}.") from error
        write_file(picture, content.getvalue())


@contextmanager
def _headless_viewer(width: int, height: int) -> Iterator[Any]:
    """A viewer without a window, and the client that steers it; both end with the block."""
    from rerun.experimental import ViewerClient

    with socket.socket() as probe:
        probe.bind((LOCAL_ONLY, 0))
        port = probe.getsockname()[1]
    command = [_executable(), "--bind", LOCAL_ONLY, "--port", str(port), "--headless", "--hide-welcome-screen"]
    command += ["--window-size", f"{width}x{height}"]
    environment = os.environ | {"RERUN_APP_ONLY": "true"}
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield _connect(process, ViewerClient, f"rerun+http://{LOCAL_ONLY}:{port}/proxy")
    finally:
        process.terminate()
        process.wait()


def _connect(process: subprocess.Popen[bytes], client: Any, url: str) -> Any:
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise MassidError(
                f"The Rerun viewer ended with exit code {process.returncode} before it drew anything; it needs a "
                "graphics driver (without a graphics card: apt-get install mesa-vulkan-drivers libegl1 libgl1)."
            )
        try:
            viewer = client(url)
            viewer.get_state()
        except (RuntimeError, ConnectionError, ValueError):
            time.sleep(0.2)
        else:
            return viewer
    raise MassidError(f"The Rerun viewer did not answer within {START_TIMEOUT_S:.0f} s.")


def check_recording(path: Path) -> None:
    """Make sure that a file can be shown.

    Raises:
        BadInputError: it does not exist or is not a Rerun recording.
    """
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise BadInputError(f"Recording {path} {what}; `massid identify LOG --rerun FILE.rrd` writes one.")
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise BadInputError(
                f"{path} is not a Rerun recording (.rrd); `massid identify LOG --rerun FILE.rrd` writes one."
            )


def _has_display() -> bool:
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _executable() -> str:
    """The viewer itself: its launcher on the path would leave it running when stopped."""
    spec = find_spec("rerun_cli")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun", "rerun.exe"):
            if (Path(folder) / name).is_file():
                return str(Path(folder) / name)
    raise MassidError("The Rerun viewer is not installed; `pip install rerun-sdk` brings it.")
