"""The accuracy benchmark without its measurements: what it keeps, what it makes wrong, what it prints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from rich.table import Table

from massid.assets import shipped_models
from massid.model.robot import Robot
from massid.model.unknowns.bodies import Mass
from massid.model.unknowns.sensors import EffortOffset
from massid.model.unknowns.unknown import nuisance
from massid.search.parameters import ParameterSpace

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
    from accuracy.tables import slope_table

    seconds = (1.0, 3.0, 10.0)
    rows = [(_case(part="lengths", seconds=s), {"l2_kg": 0.3 * s**-0.5, "std_kg": [s**-0.75]}) for s in seconds]
    rows += [(_case(part="lengths", method="bound", seconds=s), {"gated_l2_kg": 0.1 / s}) for s in seconds]
    assert _printed(slope_table(rows))[0][3:] == ["-0.50 +-0.00", "-0.75 +-0.00", "-1.00 +-0.00"]


def test_what_was_predicted_is_compared_with_the_scatter_over_logs() -> None:
    from accuracy.tables import verdict_table

    rng = np.random.default_rng(0)
    std = np.array([0.3, 0.1])
    errors = 1.0 + std * rng.normal(size=(400, 2))  # what all logs have in common is no scatter
    rows = [
        (_case(part="verdict", seed=seed), {
            "links": ["torso", "l_foot"], "error_kg": error.tolist(),
            "std_kg": [0.3, 0.1], "predicted_std_kg": [0.3, 0.2],
        })
        for seed, error in enumerate(errors)
    ]  # fmt: skip
    torso, foot, both = _printed(verdict_table(rows))
    assert float(torso[11]) == pytest.approx(1.0, rel=0.1)  # a standard deviation over 400 logs is known to 3.5 %
    assert float(foot[11]) == pytest.approx(2.0, rel=0.1)
    low, high = map(float, torso[10].split(" - "))
    assert low < 0.3 < high
    assert (high - low) / 0.6 == pytest.approx(1.96 / np.sqrt(2 * 399), rel=0.1)
    assert float(both[11].split()[0]) == pytest.approx(np.mean([1.0, 0.25]) ** -0.5, rel=0.1)


def test_a_verdict_is_judged_on_one_walk_with_sensors_of_many() -> None:
    assert _case(part="verdict", seed=3).walk_seed == _case(part="verdict", seed=4).walk_seed
    assert _case(part="coverage", seed=3).walk_seed == 3


def test_an_unfinished_recording_of_another_process_is_not_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from accuracy import walks

    recorded = []

    def interrupted(robot: Robot, path: Path, *_: Any, **__: Any) -> None:
        path.write_bytes(b"the beginning of a log")
        recorded.append(path)
        raise KeyboardInterrupt

    monkeypatch.setattr(walks, "record_walk", interrupted)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            walks.prepare(_case(robot="light"), tmp_path, 1.0)
    assert len(set(recorded)) == 2
    assert not list(tmp_path.iterdir())


def test_settled_mu_is_the_least_that_the_other_unknowns_leave() -> None:
    from accuracy.along import settled_mu

    rng = np.random.default_rng(0)
    masses = [Mass.of(link, 5.0) for link in ("torso", "l_thigh", "l_calf")]
    space = ParameterSpace((*masses, EffortOffset("l_knee", **nuisance(0.1))))
    direction = np.array([0.0, 0.6, -0.8])
    error, derivatives = rng.normal(size=(2, 30)), rng.normal(size=(len(space), 30))
    rows = np.vstack([error, derivatives])
    across = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.8, 0.6, 0.0], [0.0, 0.0, 0.0, 1.0]])
    believed = np.vstack([(across @ derivatives).T, [0.0, 0.0, 1.0 / 0.1]])
    for y, least in zip(error, settled_mu(rows @ rows.T, 2, space, direction), strict=True):
        _, left, *_ = np.linalg.lstsq(believed, -np.append(y, 0.0))
        assert least == pytest.approx(left[0], rel=1e-9)  # rounding


def _printed(table: Table) -> list[list[str]]:
    """Cells of a table, row by row."""
    return [list(row) for row in zip(*(column.cells for column in table.columns), strict=True)]


@pytest.mark.parametrize("name", ["atlas", "light", "heavy", "nimble", "geared"])
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
