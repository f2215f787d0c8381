"""The accuracy benchmark without its measurements: what it keeps, what it makes wrong, what it prints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from massid.assets import shipped_models
from massid.robot import Robot

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


@pytest.fixture(autouse=True)
def _scripts_on_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(SCRIPTS))


def _case(**changes: Any) -> Any:
    from accuracy.case import Case

    return replace(Case("accuracy", "online", "atlas", "white", "none", 0.0, 10.0, 0), **changes)


def test_finished_cases_survive_a_kill(tmp_path: Path) -> None:
    from accuracy.case import Ledger

    path = tmp_path / "accuracy.jsonl"
    cases = [_case(seed=seed) for seed in range(3)]
    ledger = Ledger(path)
    ledger.add(cases[0], {"l2_kg": 0.1})
    ledger.add(cases[1], {"l2_kg": 0.2})
    path.write_text(path.read_text()[:-9])  # killed while the second was written
    again = Ledger(path)
    assert again.missing(cases) == cases[1:]
    again.add(cases[1], {"l2_kg": 0.3})
    assert [result["l2_kg"] for _, result in Ledger(path).rows("accuracy")] == [0.1, 0.3]


def test_a_rerun_measures_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import bench_accuracy

    measured = []

    def measure(case: Any, bench: Any) -> dict[str, Any]:
        if len(measured) == 4:
            raise KeyboardInterrupt
        measured.append(case)
        return {"l2_kg": 1.0, "by_cutoff": {"5": 1.0}, "gated_l2_kg": 0.5, "open_l2_kg": 1.0}

    monkeypatch.setattr(bench_accuracy, "run", measure)
    bench = bench_accuracy.Bench(tmp_path / "a.jsonl", tmp_path / "logs", ("atlas",), seeds=1)
    with pytest.raises(KeyboardInterrupt):
        bench_accuracy.main(bench)
    first = list(measured)
    measured.clear()
    monkeypatch.setattr(bench_accuracy, "run", lambda case, _: measured.append(case) or {"l2_kg": 1.0})
    bench_accuracy.main(bench)
    assert len(measured) == len(bench_accuracy.accuracy_cases(bench)) - len(first)
    assert not set(measured) & set(first)


def test_tables_show_what_was_measured() -> None:
    from accuracy.tables import accuracy_table, coverage_table, wrong_table

    ours = {
        "l2_kg": 0.06,
        "std_kg": [0.03, 0.04],
        "hits": [True, False],
        "links": ["torso", "l_foot"],
        "status": "converged",
        "inside_ellipsoid": False,
        "warnings": ["odd"],
        "chi2_per_sample": 1.0,
        "inflation": 1.0,
        "wall_s": 2.0,
    }
    rows = [
        (_case(), ours),
        (_case(seed=1), {"error": "refused"}),
        (_case(method="bound"), {"gated_l2_kg": 0.05, "open_l2_kg": 0.07}),
        (_case(method="least-squares"), {"l2_kg": 0.3, "by_cutoff": {"5": 0.2, "8": 0.3}}),
    ]
    console = Console(width=250, record=True)
    for table in (
        accuracy_table(rows),
        coverage_table(rows[:1]),
        wrong_table([(_case(part="wrong", fault="com"), ours)]),
    ):
        console.print(table)
    text = console.export_text()
    assert "1/2" in text  # runs that gave a result
    assert "1.2" in text  # ratio to the bound
    assert "0.2 (5 Hz)" in text
    assert "0.0% (l_foot)" in text
    assert "0/1 " in text
    assert "1/1 " in text


def test_slopes_are_those_of_the_errors() -> None:
    from accuracy.tables import slopes

    rows = [(_case(part="lengths", seconds=s), {"l2_kg": 0.3 * s**-0.5}) for s in (1.0, 3.0, 10.0)]
    assert slopes(rows) == ["white, atlas, online: error falls with seconds to the power -0.50"]


@pytest.mark.parametrize("name", ["atlas", "light", "heavy"])
def test_wrong_robots_are_wrong_as_said(name: str) -> None:
    from accuracy.walks import with_fault, with_friction

    robot = Robot.load(shipped_models()[name])
    rng = np.random.default_rng(0)
    bodies = [robot.model.body(link).id for link in robot.walking_links()]
    others = [b for b in range(robot.model.nbody) if b not in bodies]
    moved, turned = with_fault(robot, "com", rng).model, with_fault(robot, "inertia", rng).model
    shift = np.linalg.norm(moved.body_ipos - robot.model.body_ipos, axis=1)
    np.testing.assert_allclose(shift[bodies], 0.03, atol=1e-9)
    np.testing.assert_allclose(shift[others], 0.0, atol=1e-9)
    ratio = turned.body_inertia[bodies] / robot.model.body_inertia[bodies]
    np.testing.assert_allclose(np.abs(ratio - 1.0), 0.2, atol=1e-9)
    for model in (moved, turned):
        np.testing.assert_allclose(model.body_mass, robot.model.body_mass, rtol=1e-9)
    assert np.all(with_friction(robot, "0.1").model.dof_frictionloss[6:] == 0.1)
    assert with_friction(robot, "5%").model.dof_frictionloss.max() > 1.0
