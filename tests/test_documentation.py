"""The pages: their commands exist, and the messages that they explain are said somewhere."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from massid.cli.app import _parse

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def _commands(page: Path) -> list[str]:
    """Lines of a page's blocks that call massid, without their comments."""
    blocks = re.findall(r"```(?:bash|sh)?\n(.*?)```", page.read_text(), flags=re.DOTALL)
    lines = [line.split("  #")[0].strip() for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    return [line for line in lines if line.startswith("massid ") and "..." not in line]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_of_the_pages_can_be_typed(page: Path) -> None:
    assert page.name not in {"README.md", "first_walk.md"} or len(_commands(page)) > 5
    for line in _commands(page):
        _parse(shlex.split(line)[1:])  # an option that is gone would end here


def test_messages_that_are_explained_are_said() -> None:
    rows = re.findall(r"^\| (`.*?) \| ", (ROOT / "docs" / "troubleshooting.md").read_text(), flags=re.MULTILINE)
    explained = [text for row in rows for text in re.findall(r"`((?:[^`]|`links`)+)`(?:,|$)", row)]
    assert len(explained) > 15
    code = "\n".join(path.read_text() for path in (ROOT / "src" / "massid").rglob("*.py"))
    said = re.sub(r'"\s*\n\s*f?"', "", code)  # literals that are broken over lines are one text
    said = re.sub(r"\{_GAP_PERIODS\}", "1.5", said)
    missing = [text for text in explained if text not in said]
    assert not missing, missing
