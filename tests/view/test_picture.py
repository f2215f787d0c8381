from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from massid.errors import BadInputError
from massid.typing import AnyArray
from massid.view import picture, write_summary_png
from massid.view.render import Shot, render_shots
from tests.conftest import Pushed
from tests.view.conftest import Story


def pixels(path: Path) -> AnyArray:
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


@pytest.fixture
def no_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(picture, "render_shots", lambda *arguments, **named: [])


def test_it_is_a_page_with_something_on_it(online: Story, tmp_path: Path) -> None:
    path = tmp_path / "new_folder" / "summary.png"
    write_summary_png(path, online.walk, online.robot, online.result, online.score)
    image = pixels(path)
    assert image.shape[1] == 1800
    inked = np.any(image < 250, axis=-1)
    assert 0.02 < inked.mean() < 0.5
    assert np.all(image[:3] == 255)  # nothing runs off the page
    assert np.all(image[-3:] == 255)


@pytest.mark.usefixtures("no_robot")
def test_where_nothing_can_render_the_page_has_no_robot(online: Story, offline: Story, tmp_path: Path) -> None:
    for name, story in {"online": online, "offline": offline}.items():
        path = tmp_path / f"{name}.png"
        write_summary_png(path, story.walk, story.robot, story.result)
        image = pixels(path)
        assert image.shape[0] < image.shape[1] * 0.7
        assert np.any(image < 250)


def test_no_graphics_driver_means_no_frames(pushed: Pushed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)  # what a machine without EGL does to the import
    qpos = pushed.robot.layout.to_qpos(pushed.walk.qpos[0])
    assert render_shots(pushed.robot, [Shot(qpos, {})], 1.5, 40, 50) == []


def test_rendered_frames_show_the_links_colour(pushed: Pushed) -> None:
    qpos = pushed.robot.layout.to_qpos(pushed.robot.align(pushed.walk).qpos[0])
    frames = render_shots(
        pushed.robot, [Shot(qpos, {"torso": np.array([1.0, 0.0, 0.0])}), Shot(qpos, {})], 1.5, 120, 160
    )
    if not frames:
        pytest.skip("no graphics driver renders here")
    red = [np.sum((frame[..., 0] > 90) & (frame[..., 1] < 60) & (frame[..., 2] < 60)) for frame in frames]
    assert red[0] > 200
    assert red[1] == 0


def test_labels_keep_their_distance_and_order() -> None:
    values = np.array([0.0, 0.01, 5.0, 0.02, -0.01])
    places = picture._spread(values, 0.5)
    assert np.all(np.diff(np.sort(places)) >= 0.5 - 1e-6)
    assert np.argsort(places).tolist() == np.argsort(values).tolist()


@pytest.mark.usefixtures("no_robot")
def test_a_path_that_cannot_be_written_is_named(online: Story, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"Cannot write .*: Is a directory"):
        write_summary_png(tmp_path, online.walk, online.robot, online.result)
