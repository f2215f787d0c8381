"""Every example runs as it stands, and finds what it says."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from massid.assets import sample_walk
from massid.result import Result, Status
from massid.score import Truth

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
WEIGHINGS = ("first_call", "own_direction", "own_topics", "own_unknown")


def _main_of(name: str) -> Callable[..., Any]:
    main: Callable[..., Any] = runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]
    return main


@pytest.fixture(scope="module")
def true_kg() -> dict[str, float]:
    return Truth.load(sample_walk().with_suffix(".truth.json")).mass_kg


@pytest.mark.parametrize("name", WEIGHINGS)
def test_examples_that_weigh_the_sample_walk_end_at_the_truth(name: str, true_kg: dict[str, float]) -> None:
    result: Result = _main_of(name)()
    assert result.status is Status.CONVERGED
    for link, mass_kg in result.estimate_kg.items():
        assert mass_kg == pytest.approx(true_kg[link], abs=1e-9)


def test_another_optimiser_gets_closer_with_the_bank(true_kg: dict[str, float]) -> None:
    main = _main_of("own_optimiser")
    few, more = (
        np.linalg.norm([mass_kg - true_kg[link] for link, mass_kg in main(generations=n).items()]) for n in (2, 12)
    )
    assert more < 0.5 * few


def test_a_system_of_ones_own_is_found() -> None:
    np.testing.assert_allclose(_main_of("own_system")(), [9.81, 0.3, 0.8], atol=1e-6)


def test_no_example_is_left_out() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {*WEIGHINGS, "own_optimiser", "own_system"}
