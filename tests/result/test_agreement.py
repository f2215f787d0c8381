from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from massid.errors import BadInputError
from massid.result.agreement import RISK, compare_results
from massid.result.document import Document, LinkEntry
from massid.view.comparison import write_comparison
from tests.result.samples import document

LINKS = {"torso": (10.0, 0.02), "thigh": (3.0, 0.01), "foot": (0.6, 0.005)}


def _result(masses: dict[str, float], *, noisy: bool = True, status: str = "converged") -> Document:
    links = {
        link: LinkEntry(
            nominal_kg=LINKS[link][0],
            estimate_kg=mass_kg,
            identifiable=True,
            verdict="identifiable",
            std_kg=LINKS[link][1] if noisy else None,
        )
        for link, mass_kg in masses.items()
    }
    return msgspec.structs.replace(document(), links=links, status=status)


def _measured(rng: np.random.Generator, **extra_kg: float) -> Document:
    return _result({link: kg + std * rng.normal() + extra_kg.get(link, 0.0) for link, (kg, std) in LINKS.items()})


@pytest.mark.parametrize("count", [2, 5])
def test_results_of_one_robot_are_rarely_said_to_differ(count: int) -> None:
    rng = np.random.default_rng(0)
    alarms = [
        bool(compare_results([str(k) for k in range(count)], [_measured(rng) for _ in range(count)]).differing)
        for _ in range(600)
    ]
    assert 0.4 * RISK < np.mean(alarms) < 1.6 * RISK


def test_a_link_that_became_heavier_is_the_one_that_differs() -> None:
    rng = np.random.default_rng(1)
    agreement = compare_results(["monday", "friday"], [_measured(rng), _measured(rng, thigh=0.1)])
    assert agreement.differing == ("thigh",)
    (thigh,) = (one for one in agreement.links if one.link == "thigh")
    assert thigh.difference_kg == pytest.approx(0.1, abs=3.0 * thigh.difference_std_kg)
    assert thigh.difference_std_kg == pytest.approx(np.sqrt(2.0) * LINKS["thigh"][1])


def test_the_common_mass_leans_to_the_surer_result() -> None:
    exact, noisy = _result({"torso": 10.0}, noisy=False), _result({"torso": 10.04})
    (torso,) = compare_results(["clean", "noisy"], [exact, noisy]).links
    assert torso.agrees
    assert torso.common_kg == pytest.approx(10.008)
    assert torso.common_std_kg < LINKS["torso"][1]


def test_what_cannot_be_compared_is_said() -> None:
    first, second = _result({"torso": 10.0, "thigh": 3.0}), _result({"torso": 10.0, "foot": 0.6})
    agreement = compare_results(["a", "b"], [first, second])
    assert [one.link for one in agreement.links] == ["torso"]
    assert agreement.alone == {"thigh": "not asked for in b", "foot": "not asked for in a"}
    with pytest.raises(BadInputError, match="No link has a mass in two"):
        compare_results(["a", "b"], [_result({"thigh": 3.0}), _result({"foot": 0.6})])


def test_results_that_are_not_to_be_relied_on_are_named() -> None:
    doubts = compare_results(
        ["a", "b"], [_result({"torso": 10.0}), _result({"torso": 10.0}, status="contradicted")]
    ).doubts
    assert len(doubts) == 1 and "b ended as contradicted" in doubts[0]


def test_a_page_holds_every_result(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    agreement = compare_results(["<monday>", "friday"], [_measured(rng), _measured(rng, foot=0.2)])
    write_comparison(agreement, tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert "<monday>" not in text and "&lt;monday&gt;" in text
    assert "1 of 3 links differ" in text
