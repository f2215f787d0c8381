"""What `make` installs has known hashes, comes from nowhere in particular, and is needed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from packaging.utils import canonicalize_name

from tests.test_licences import needed

ROOT = Path(__file__).resolve().parents[1]
FILES = ("constraints.txt", "constraints-peers.txt", "constraints-docs.txt")


def pinned(name: str) -> dict[str, list[str]]:
    """The hashes of every requirement of a file, by name and version."""
    text = (ROOT / name).read_text().replace("\\\n", " ")
    found = {}
    for line in (line for line in text.splitlines() if line and not line.startswith("#")):
        requirement, *rest = line.split()
        found[requirement] = [word.removeprefix("--hash=sha256:") for word in rest]
    return found


@pytest.mark.parametrize("name", FILES)
def test_every_requirement_is_one_version_with_its_hashes(name: str) -> None:
    for requirement, hashes in pinned(name).items():
        assert re.fullmatch(r"[\w.-]+==[\w.+!]+", requirement), requirement
        assert hashes, requirement
        assert all(re.fullmatch("[0-9a-f]{64}", one) for one in hashes), requirement


@pytest.mark.parametrize("name", FILES)
def test_no_address_is_named(name: str) -> None:
    assert not re.search(r"://|--index|--find-links|--trusted", (ROOT / name).read_text())


def test_nothing_is_pinned_that_nobody_needs_and_nothing_needed_is_free() -> None:
    names = {canonicalize_name(requirement.partition("==")[0]) for requirement in pinned("constraints.txt")}
    assert names == needed(["dev"]).keys()


def test_all_files_pin_the_same_versions() -> None:
    ours, *others = (pinned(name) for name in FILES)
    for other in others:
        assert ours.items() <= other.items()
