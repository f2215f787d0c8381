"""Names are data: whatever signs they hold, every output shows them and none obeys them."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest

from massid.cli import main
from massid.errors import MassidError, on_one_line, printable
from massid.log import WalkWriter
from massid.markup import element
from massid.model.robot import Robot
from massid.model.xml_text import comment
from massid.view.words import in_markdown, in_picture
from massid.walk import Walk
from tests.conftest import Pushed
from tests.pushed_robot import LINKS, XML

NAMES = {
    "torso": "[/b]torso $a_{b$",
    "l_thigh": "<script>alert(1)</script>",
    "r_thigh": "arm[left]:smile:",
    "l_calf": 'a|b `mode` **c** "x"',
    "r_calf": "--> <!-- ]]>",
    "l_foot": "_foot\nof two lines",
    "r_foot": "脚 $x$ \\$",
    "l_knee": "[red]knee|",
}
"""What the links of a robot may be called; XML can hold no others."""
FILE = os.fsdecode(b"walk \x1b[31m\xff\n$x$ |[/b]--><img src=x onerror=alert(1)>.mcap".replace(b"/", b"%"))
"""What a log may be called: with an escape code, a line's end, half a character and markup."""
TOPIC, TYPE = "/\x1b]0;title\x07[/b]\n<b>", "evil\x1b[2J/msg/[/b]\x9b"


def renamed(text: str) -> str:
    for name, hostile in NAMES.items():
        quoted = quoteattr(hostile, {"\n": "&#10;"})
        text = text.replace(f'name="{name}"', f"name={quoted}").replace(f'joint="{name}"', f"joint={quoted}")
    return text


def write_log(path: Path, walk: Walk) -> None:
    """A log of the robot with these names, that holds a topic with another such name and type as well."""
    draft = path.with_name("draft.mcap")
    joints = [NAMES.get(name, name) for name in walk.joint_names]
    bodies = [NAMES[name] for name in walk.contact_bodies]
    with WalkWriter(
        draft, root_body=NAMES["torso"], joint_names=joints, timestep_s=walk.timestep_s, contact_bodies=bodies
    ) as writer:
        wrenches = dict(zip(bodies, np.moveaxis(walk.wrench, 1, 0), strict=True))
        writer.append_block(walk.stamps_ns, walk.qpos, walk.qvel, walk.effort, wrenches)
        schema = writer._sink._writer.register_schema(TYPE, "ros2msg", b"float64 x\n")
        channel = writer._sink._writer.register_channel(TOPIC, "cdr", schema)
        writer._sink._writer.add_message(channel, int(walk.stamps_ns[0]), bytes(12), int(walk.stamps_ns[0]))
    draft.rename(path)


@pytest.fixture(scope="module")
def folder(pushed: Pushed, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("names")
    (folder / "robot $x$ [b].xml").write_text(renamed(XML), encoding="utf-8")
    write_log(folder / FILE, pushed.walk)
    return folder


class Page(HTMLParser):
    """The elements of a page, with what could run or load anything."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.words = ""
        self.policy = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}
        if ("http-equiv", "Content-Security-Policy") in attrs:
            self.policy = dict(attrs)["content"] or ""

    def handle_data(self, data: str) -> None:
        self.words += data


def check_page(path: Path, *names: str) -> None:
    text = path.read_text(encoding="utf-8")
    page = Page(text)
    assert not page.tags & {"script", "img", "link", "iframe", "object"}
    assert not {name for name in page.attributes if name.startswith("on")} | page.attributes & {"src", "href"}
    assert page.policy.startswith("default-src 'none'; ")
    assert "\x1b" not in text
    for name in names:
        assert printable(name) in page.words


def check_terminal(said: str) -> None:
    assert not set(said) & {"\x1b", "\x07", "\x9b", "\r"}
    assert not re.search("[\ud800-\udfff]", said)
    said.encode()


def test_every_output_shows_hostile_names_and_obeys_none(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, model = str(folder / FILE), str(folder / "robot $x$ [b].xml")
    page, json_path = tmp_path / "inspect.html", tmp_path / "r.json"
    assert main(["inspect", log, "--model", model, "--html", str(page), "--json", str(tmp_path / "i.json")]) in (0, 3)
    said = capsys.readouterr()
    check_terminal(said.out + said.err)
    assert printable(TOPIC) in said.out
    assert printable(TYPE) in said.out
    check_page(page, *(NAMES[link] for link in LINKS), TOPIC, TYPE)
    found = json.loads((tmp_path / "i.json").read_text())["logs"][0]
    assert TOPIC in [topic["topic"] for topic in found["topics"]]  # JSON has every name as it is

    written = ("--json", str(json_path), "--png", str(tmp_path / "p.png"), "--rerun", str(tmp_path / "r.rrd"))
    saved = tmp_path / "saved.xml"
    code = main(["identify", log, "--model", model, "--dwell-s", "0.25", "--save-model", str(saved), *written])
    said = capsys.readouterr()
    assert code == 0, said.err
    check_terminal(said.out + said.err)
    weighed = json.loads(json_path.read_text())["links"]
    assert set(weighed) <= set(NAMES.values())
    for name in weighed:
        assert printable(name) in said.out
    assert set(NAMES.values()) >= set(Robot.load(saved).links) - set(LINKS)

    assert main(["report", str(json_path)]) == 0
    check_page(json_path.with_suffix(".html"), *weighed, str(log))
    assert main(["links", model]) == 0
    said = capsys.readouterr()
    check_terminal(said.out)
    assert said.out.count("\n") == len(LINKS) + 2  # also the one with a line's end in its name is on one line; report


@pytest.mark.parametrize("arguments", [["links", FILE], ["identify", FILE], ["record", FILE, "--gait", FILE]])
def test_errors_with_hostile_names_are_one_line(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    said = capsys.readouterr().err
    check_terminal(said)
    assert said.count("\n") == 1
    assert "[%b]" in said


def test_a_terminal_without_a_sign_gets_its_number(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    import subprocess
    import sys

    command = [sys.executable, "-m", "massid", "links", str(folder / "robot $x$ [b].xml")]
    done = subprocess.run(command, capture_output=True, check=False, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0, done.stderr
    assert b"\\u811a $x$" in done.stdout


def test_what_may_be_shown_is_one_line_of_printable_signs() -> None:
    assert printable("a\nb\x1b[31m\u202ec\ud800 d\u00a0") == "a b?[31m?c? d\u00a0"
    assert on_one_line(" a \n  b ") == "a b"
    assert len(str(MassidError("x" * 300_000))) < 5000


def test_each_output_writes_its_own_signs_of_markup_as_signs() -> None:
    assert element("td", "<b>\x1b", title='"\ud800') == '<td title="&quot;?">&lt;b&gt;?</td>'
    assert in_markdown("a|b_c *d* _e_\n<i>") == r"a\|b_c \*d\* \_e\_ \<i\>"
    assert in_picture("$x$") == r"\$x\$"
    for text in ("--", "---", "a--b-", "-->"):
        inside = comment(text).removeprefix("<!--").removesuffix("-->\n")
        assert "--" not in inside
        assert not inside.endswith("-")


def test_one_walk_is_read_with_hostile_names(folder: Path, pushed: Pushed) -> None:
    from massid.log import read_walk

    walk = read_walk(folder / FILE)
    assert walk.root_body == NAMES["torso"]
    assert set(walk.contact_bodies) == {NAMES["l_foot"], NAMES["r_foot"]}
    assert replace(walk).joint_names == tuple(NAMES.get(name, name) for name in pushed.walk.joint_names)
