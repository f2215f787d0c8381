"""The benchmark of costs: whose processes are measured, what is charged to whom, and what the ratios are ratios of."""

from __future__ import annotations

import os
import pickle
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from massid.assets import sample_walk
from massid.errors import BadInputError
from massid.model.unknowns.spaces import parameter_space
from massid.score import Truth

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
LARGE_MIB = 64


@pytest.fixture(autouse=True)
def _scripts_on_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(SCRIPTS))


def _problem(**changes: Any) -> Any:
    from costs.problem import Problem

    return Problem("clean", sample_walk(), "atlas", "clean", **changes)


def _spent(value: Any, processor_s: float, peak_mib: float = 100.0) -> Any:
    from costs.apart import Spent

    return Spent(value, processor_s=processor_s, wall_s=2.0 * processor_s, before_mib=50.0, peak_mib=peak_mib)


def _large() -> Any:
    return lambda: np.ones(LARGE_MIB * 2**17).nbytes


def test_memory_is_that_of_the_work_alone() -> None:
    from costs.apart import run_apart

    mine = np.ones(4 * LARGE_MIB * 2**17)  # a child must not be charged for what its parent holds
    spent = run_apart(_large)
    assert spent.value == LARGE_MIB * 2**20
    assert spent.before_mib < mine.nbytes / 2**20
    assert spent.peak_mib - spent.before_mib == pytest.approx(LARGE_MIB, rel=0.1)  # and a few pages


def test_a_process_that_dies_is_a_result_too() -> None:
    from costs.apart import DiedError, run_apart

    with pytest.raises(DiedError, match="out of memory"):
        run_apart(partial(partial, os._exit, 1))


def test_a_bank_is_compared_with_as_many_steps_of_the_engine() -> None:
    from costs.bank import bank_sheet, measure_banks

    costs = measure_banks([_problem(seconds=0.6)], sizes=(8, 9), threads=(1,), rounds=1)
    assert [one.n_models for one in costs] == [8, 9]
    for one in costs:
        assert one.processor == pytest.approx(one.step_us / one.raw_us)
        assert one.per_second == pytest.approx(one.n_models * one.step_us * 1e-6 * 1000.0)  # the log's 1 kHz
    assert len(bank_sheet(costs).rows) == 2


def test_cma_ends_when_its_budget_is_spent() -> None:
    from costs.methods import prepare_cma

    pytest.importorskip("cma")
    problem = _problem(seconds=0.6)
    found = prepare_cma(problem, budget_s=1e-9, marks_s=(1e-12,))()
    assert found.note == "1 generation of 24"
    assert found.on_the_way == ((1e-12, found.mass_kg),)
    space = problem.prepare().asked
    masses = np.array([found.mass_kg[link.target] for link in space.parameters])
    assert np.all((space.lower <= masses) & (masses <= space.upper))


def test_rows_are_ratios_to_ours_and_the_budget_is_in_times_of_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    from costs import peers
    from costs.methods import Found, prepare_cma, prepare_massid

    truth = Truth({"torso": 10.0})
    turns = iter([2.0, 1.0])

    def run(prepare: Any) -> Any:
        if prepare.func is prepare_cma:
            assert prepare.args[1:] == (20.0, (1.0,))
            early = ((1.0, {"torso": 14.0}),)
            return _spent(Found({"torso": 11.0}, "3 generations", early), 20.5)
        if prepare.func is prepare_massid and not prepare.keywords:
            return _spent(Found({"torso": 10.5}), next(turns))
        if prepare.func is prepare_massid:
            return _spent(Found({"torso": 9.0}), 4.0, peak_mib=150.0)
        raise BadInputError("it is not installed: pip install it")

    monkeypatch.setattr(peers, "run_apart", run)
    rows = peers.compare(_problem(), truth, ("chunks",), budget=20.0, rounds=2, tell=lambda _: None)
    found = {line[1]: line[2:] for line in peers.peers_sheet(rows, "").rows}
    assert found["massid"][:3] == ("1", "1", "1")
    assert found["massid, as it comes"][:3] == ("2", "4", "1.5")
    assert found["CMA-ES on our bank"][:3] == ("2", "20.5", "1")
    assert found["CMA-ES on our bank"][-1] == "3 generations; 4 kg after 1 s"
    assert found["mujoco.sysid"] == (*["-"] * 6, "it is not installed: pip install it")


def test_a_method_whose_package_is_missing_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    from mujoco import sysid

    from costs.methods import prepare_cma, prepare_sysid

    monkeypatch.setitem(__import__("sys").modules, "cma", None)
    monkeypatch.delattr(sysid, "optimize", raising=False)
    with pytest.raises(BadInputError, match=r"cma is not installed: pip install"):
        prepare_cma(_problem(), 1.0)
    with pytest.raises(BadInputError, match=r"mujoco.sysid is not installed: pip install"):
        prepare_sysid(_problem(), observed=False)


def test_what_was_loaded_stays_in_its_process() -> None:
    problem = _problem(seconds=0.6)
    assert problem.robot.links
    assert len(problem.walk) == 600
    assert pickle.loads(pickle.dumps(problem)) == problem


def test_errors_are_those_of_the_links_asked_for() -> None:
    from costs.problem import error_kg

    truth = Truth({"torso": 10.0, "l_foot": 1.0, "pelvis": 7.0})
    assert error_kg({"torso": 13.0, "l_foot": 5.0}, truth) == pytest.approx(5.0)
    with pytest.raises(BadInputError, match="mass of l_hand"):
        error_kg({"l_hand": 1.0}, truth)


@pytest.mark.parametrize("n", [2, 7, 12, 24, 50])
def test_so_many_unknowns_are_asked_for(n: int) -> None:
    from costs.scaling import ask_for

    problem = _problem()
    asked = ask_for(problem, problem.robot, n)
    space = parameter_space(problem.robot, asked.links or (), asked.unknowns)
    assert n <= len(space) <= n + 2


def test_each_number_is_varied_alone() -> None:
    from costs.scaling import variations

    cases = variations(_problem(), unknowns=(2, 7), seconds=(1.0, 2.0, 4.0), threads=(1, 2), bank_sizes=(15, 24, 48))
    middle = cases[0].problem
    assert (middle.seconds, middle.threads, len(middle.links)) == (2.0, 1, 7)
    changed = [
        {name for name in vars(middle) if name in vars(case.problem) and vars(middle)[name] != vars(case.problem)[name]}
        for case in cases
    ]
    names = ("links", "unknowns", "seconds", "threads", "bank_size")
    assert [set(names) & one for one in changed] == [
        set(), {"links"}, {"unknowns"}, set(), {"seconds"}, {"seconds"}, {"threads"}, {"bank_size"}, {"bank_size"},
    ]  # fmt: skip
    assert [case.usual for case in cases].index(True) == 3


def test_costs_are_those_over_the_middle_case() -> None:
    from costs.scaling import Variation, costs_of, scaling_sheet

    middle, longer, refused = (Variation("length", f"{s:g} s", _problem(seconds=s)) for s in (2.0, 4.0, 8.0))
    spent = {middle: _spent(4, 10.0), longer: _spent(8, 30.0, peak_mib=120.0)}
    first, second, third = costs_of([middle, longer, refused], spent, {refused: "too long"})
    assert (first.processor, first.by_pass, first.wall, first.memory) == (1.0, 1.0, 1.0, 1.0)
    assert (second.processor, second.by_pass, second.wall, second.memory) == pytest.approx((3.0, 1.5, 3.0, 1.2))
    assert (third.processor, third.note) == (None, "too long")
    assert scaling_sheet([first, second, third]).rows[2][2:] == (*["-"] * 6, "too long")


def test_a_document_holds_what_is_printed() -> None:
    from costs.sheet import Sheet, as_markdown

    sheet = Sheet("Title", ("a", "b"), (("1", "2"), ("3", "4")))
    assert as_markdown([sheet], "machine").splitlines()[2:] == [
        "**Title**", "", "| a | b |", "| --- | --- |", "| 1 | 2 |", "| 3 | 4 |",
    ]  # fmt: skip
    assert [list(column.cells) for column in sheet.rich().columns] == [["1", "3"], ["2", "4"]]
