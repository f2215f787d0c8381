"""Damaged logs and topic maps: refused in one line, or the loss is stated; never a traceback or a wrong number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from massid.errors import LogError
from massid.log import load_topics
from massid.log.messages.cdr import CdrError, parse_schema, trace
from massid.log.messages.paths import PathError, find_paths
from tests.fuzz.fuzzing import BAD, Seed, damage, damage_text, judge_log, judge_map, make_seeds, map_texts
from tests.fuzz.pairs import judge_pair, write_pair

INPUTS = 60


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def seeds(folder: Path) -> list[Seed]:
    return make_seeds(folder)


def test_every_encoding_holds_the_same_walk(seeds: list[Seed]) -> None:
    first = seeds[0].walk
    for seed in seeds[1:]:
        np.testing.assert_array_equal(seed.walk.qpos, first.qpos)
        np.testing.assert_array_equal(seed.walk.effort, first.effort)
        np.testing.assert_array_equal(seed.walk.wrench[:, 0], first.wrench[:, 0])


@pytest.mark.parametrize("start", range(3))
def test_damaged_logs_end_in_a_line_or_a_stated_loss(start: int, seeds: list[Seed], tmp_path: Path) -> None:
    rng = np.random.default_rng(start)
    path = tmp_path / "damaged.mcap"
    kinds = set()
    for _ in range(INPUTS):
        for seed in seeds:
            path.write_bytes(damage(seed.content, rng))
            outcome = judge_log(path, seed)
            assert outcome.kind not in BAD, (seed.name, outcome)
            kinds.add(outcome.kind)
    assert len(kinds) >= 2  # some refused, some read with a loss


def test_damaged_maps_end_in_a_line(folder: Path, seeds: list[Seed], tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    path = tmp_path / "damaged.yaml"
    for _ in range(INPUTS):
        for text in map_texts():
            path.write_bytes(damage_text(text, rng))
            assert judge_map(path, folder / "own.mcap").kind not in BAD


def test_results_that_somebody_made_up_end_in_a_page_or_a_line(tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    kinds = set()
    for _ in range(3 * INPUTS):
        outcome = judge_pair(write_pair(tmp_path, rng))
        assert outcome.kind not in BAD, outcome
        kinds.add(outcome.kind)
    assert len(kinds) == 2  # some refused, some drawn


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    content=st.one_of(st.binary(max_size=400), st.text(max_size=400).map(lambda text: text.encode("utf-8", "ignore")))
)
def test_any_bytes_are_a_topic_map_or_one_line(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "any.yaml"
    path.write_bytes(content)
    try:
        load_topics(path)
    except LogError as error:
        assert "\n" not in str(error)


_VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.just("wxyz")),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.sampled_from(["topic", "field", "order", "frame", "body", "names", "position"]), inner),
    ),
    max_leaves=8,
)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    content=st.dictionaries(
        st.sampled_from(["preset", "base", "joints", "contacts", "clock", "rate", "lag_s", "supply"]), _VALUES
    )
)
def test_any_settings_are_a_topic_map_or_one_line(content: dict[str, object], tmp_path: Path) -> None:
    from ruamel.yaml import YAML

    path = tmp_path / "any.yaml"
    YAML(typ="safe", pure=True).dump(content, path)
    try:
        load_topics(path)
    except LogError as error:
        assert "\n" not in str(error)


@settings(max_examples=200, deadline=None)
@given(
    fields=st.lists(
        st.tuples(
            st.sampled_from(["float64", "uint8", "string", "float64[3]", "int32[]", "string[]", "A", "A[]", "A[2]"]),
            st.sampled_from(["x", "y", "z", "w"]),
        ),
        max_size=5,
    ),
    message=st.binary(max_size=200),
)
def test_any_definition_and_any_message_are_traced_or_refused(fields: list[tuple[str, str]], message: bytes) -> None:
    lines = "\n".join(f"{kind} {name}" for kind, name in fields)
    text = f"A a\n{'=' * 80}\nMSG: p/A\n{lines}\n"  # A may hold itself
    try:
        layout = trace(parse_schema("p/msg/Root", text), b"\x00\x01\x00\x00" + message)
    except CdrError:
        return
    assert layout.size == len(message) + 4


@given(path=st.text(alphabet="ab.[]:019", max_size=12))
def test_any_path_is_found_or_refused(path: str) -> None:
    known = {"a.a": None, "a.b": 3, "b[0].a": None, "b[1].a": None}
    try:
        picks = find_paths(known, [path])
    except PathError:
        return
    assert picks
    assert all(pick.path in known for pick in picks)
