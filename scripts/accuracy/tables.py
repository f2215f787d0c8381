"""Sums up what was measured."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Any

import numpy as np
from rich.table import Table
from scipy.stats import chi2, linregress

from accuracy.case import Case

Rows = Iterable[tuple[Case, dict[str, Any]]]
OURS = ("online", "offline")
Group = tuple[Any, ...]


def accuracy_table(rows: Rows, title: str = "Root mean square L2 error in kg") -> Table:
    """Errors of all methods beside the bound, a row for each problem.

    mujoco.sysid, by itself and with our observer, is followed by how many walks it saw and its share of hits.
    """
    groups = _grouped(rows, ("preset", "robot", "friction", "other_links", "seconds", "sensors"))
    table = Table(title=title)
    for name in (
        *("preset", "robot", "friction", "others", "s", "sensors", "method", "runs", "ours", "said", "bound", "ratio"),
        *("bound, no gate", "in 95 %", "chi2", "inflation", "wall s", "LS best", "LS chosen", "sysid", "observer"),
    ):
        table.add_column(name, justify="right")
    for key, found in groups.items():
        bound = _rms(found["bound"], "gated_l2_kg")
        baselines = [_least_squares(found["least-squares"])]
        baselines += [_number(_rms(found["least-squares"], "l2_kg"))]
        baselines += [_few(found[method]) for method in ("sysid", "sysid-observer")]
        for method in [m for m in OURS if found[m]] or ["-"]:
            ours = [result for result in found[method] if "l2_kg" in result]
            error = _rms(ours, "l2_kg")
            said = [float(np.linalg.norm(result["std_kg"])) for result in ours if "std_kg" in result]
            table.add_row(
                *(str(part) for part in key),
                method,
                f"{len(ours)}/{len(found[method])}",
                _number(error),
                _number(float(np.sqrt(np.mean(np.square(said)))) if said else None),
                _number(bound),
                _number(error / bound if error is not None and bound else None),
                _number(_rms(found["bound"], "open_l2_kg")),
                _hits(ours),
                *(_number(_mean(ours, name)) for name in ("chi2_per_sample", "inflation", "wall_s")),
                *baselines,
            )
    return table


def slope_table(rows: Rows) -> Table:
    """How errors fall with the seconds of walking beside how the bound does: exponents of power laws."""
    table = Table("preset", "robot", "method", title="The error falls with seconds to the power")
    for name in ("ours", "said", "bound"):
        table.add_column(name, justify="right")
    for key, found in _grouped(rows, ("preset", "robot")).items():
        bound = _exponent([(result["seconds"], result.get("gated_l2_kg")) for result in found["bound"]])
        for method in [m for m in OURS if found[m]]:
            said = [
                (result["seconds"], float(np.linalg.norm(result["std_kg"])) if "std_kg" in result else None)
                for result in found[method]
            ]
            error = [(result["seconds"], result.get("l2_kg")) for result in found[method]]
            table.add_row(*key, method, _exponent(error), _exponent(said), bound)
    return table


def _exponent(points: list[tuple[float, float | None]]) -> str:
    """Exponent of the power law through points, with its standard error."""
    logs = np.log([(seconds, value) for seconds, value in points if value is not None]).reshape(-1, 2)
    if len(np.unique(logs[:, 0])) < 2:
        return "-"
    line = linregress(logs[:, 0], logs[:, 1])
    return f"{line.slope:.2f} +-{line.stderr:.2f}" if len(logs) > 2 else f"{line.slope:.2f}"


def coverage_table(rows: Rows) -> Table:
    """How often the truth lay within the 95 % intervals: pooled, and the link where it was so least."""
    table = Table("preset", "robot", "friction", "method", "walks", "pooled", "worst link", title="Coverage")
    for (*key, method), found in _grouped(rows, ("preset", "robot", "friction", "method"), by_method=False).items():
        hits = np.array([result["hits"] for result in found["all"] if "hits" in result])
        if not len(hits):
            continue
        links = next(result["links"] for result in found["all"] if "hits" in result)
        worst = int(np.argmin(hits.mean(axis=0)))
        share = hits.mean(axis=0)[worst]
        table.add_row(*map(str, key), method, str(len(hits)), f"{hits.mean():.1%}", f"{share:.1%} ({links[worst]})")
    return table


def verdict_table(rows: Rows) -> Table:
    """Deviations of each link's mass: predicted before the fit, reported after it, found over logs of one walk.

    Below, all links: the ratio of root mean squares in units of what was predicted, with its extremes over links.
    """
    table = Table(title="Standard deviations in kg over logs of one walk, each with sensors of its own")
    for name in (
        *(
            "preset",
            "robot",
            "gait",
            "s",
            "method",
            "link",
            "logs",
            "predicted",
            "reported",
            "found",
            "95 % range of found",
        ),
        *("predicted / found", "mean error"),
    ):
        table.add_column(name, justify="right")
    for key, found in _grouped(rows, ("preset", "robot", "gait", "seconds", "method"), by_method=False).items():
        done = [result for result in found["all"] if "std_kg" in result]
        if len(done) < 2:
            continue
        links, errors = done[0]["links"], np.array([result["error_kg"] for result in done])
        predicted = np.mean([result["predicted_std_kg"] for result in done], axis=0)
        reported = np.mean([result["std_kg"] for result in done], axis=0)
        std, free = errors.std(axis=0, ddof=1), len(done) - 1
        low, high = (np.sqrt(free / chi2.ppf(share, free)) for share in (0.975, 0.025))
        ratio = predicted / std
        for k, link in enumerate(links):
            table.add_row(
                *map(str, key), link, f"{len(done)}/{len(found['all'])}", _number(predicted[k]), _number(reported[k]),
                _number(std[k]), f"{low * std[k]:.3g} - {high * std[k]:.3g}", f"{ratio[k]:.2f}",
                _number(errors[:, k].mean()),
            )  # fmt: skip
        pooled = float(np.mean(ratio**-2.0) ** -0.5)
        extremes = f"{pooled:.2f} ({ratio.min():.2f} - {ratio.max():.2f})"
        table.add_row(*map(str, key), "all", *[""] * 5, extremes, "", end_section=True)
    return table


def wrong_table(rows: Rows) -> Table:
    """Errors with a wrong model, and whether the result owns up to it."""
    table = Table("preset", "robot", "wrong", "method", "runs", "RMS L2, kg", "said, kg", title="Wrong models")
    for name in ("in 95 %", "truth in ellipsoid", "warned", "either"):
        table.add_column(name, justify="right")
    for key, found in _grouped(rows, ("preset", "robot", "fault", "method"), by_method=False).items():
        done = [result for result in found["all"] if "hits" in result]
        inside = [bool(result["inside_ellipsoid"]) for result in done]
        warned = [bool(result["warnings"]) or result["status"] == "not identifiable" for result in done]
        said = [float(np.sum(np.square(result["std_kg"]))) for result in done]
        table.add_row(
            *map(str, key),
            f"{len(done)}/{len(found['all'])}",
            _number(_rms(done, "l2_kg")),
            _number(float(np.sqrt(np.mean(said))) if said else None),
            _hits(done),
            *(f"{sum(flags)}/{len(done)}" for flags in (inside, warned, np.logical_or(inside, warned).tolist())),
        )
    return table


def speed_table(rows: Rows) -> Table:
    """Wall time and error on one clean log."""
    table = Table("robot", "s", "seed", "method", "L2, kg", "wall, s", title="Time on a clean log, one after the other")
    for case, result in rows:
        table.add_row(
            case.robot, f"{case.seconds:g}", str(case.seed), case.method,
            _number(result.get("l2_kg")), _number(result.get("wall_s")),
        )  # fmt: skip
    return table


def problems(rows: Rows) -> list[str]:
    """The unknowns and priors of every bound, by preset and robot."""
    named = {(case.preset, case.robot, case.other_links): result.get("problem") for case, result in rows}
    return [f"{preset}, {robot}: {problem}" for (preset, robot, _), problem in named.items() if problem]


def _grouped(
    rows: Rows, names: tuple[str, ...], by_method: bool = True
) -> dict[Group, dict[str, list[dict[str, Any]]]]:
    groups: dict[Group, dict[str, list[dict[str, Any]]]] = defaultdict(lambda: defaultdict(list))
    for case, result in rows:
        key = tuple(getattr(case, name) for name in names)
        groups[key][case.method if by_method else "all"].append(result | {"seconds": case.seconds})
    return dict(sorted(groups.items()))


def _least_squares(results: list[dict[str, Any]]) -> str:
    """Smallest error that one cut-off for all walks reaches, which takes the truth to know."""
    tables = [result["by_cutoff"] for result in results if "by_cutoff" in result]
    common = set.intersection(*(set(table) for table in tables)) if tables else set()
    if not common:
        return "-"
    errors = {cutoff: float(np.sqrt(np.mean([table[cutoff] ** 2 for table in tables]))) for cutoff in common}
    best = min(errors, key=lambda cutoff: errors[cutoff])
    return f"{errors[best]:.3g} ({best} Hz)"


def _rms(results: list[dict[str, Any]], name: str) -> float | None:
    values = [result[name] for result in results if name in result]
    return float(np.sqrt(np.mean(np.square(values)))) if values else None


def _mean(results: list[dict[str, Any]], name: str) -> float | None:
    values = [result[name] for result in results if name in result]
    return float(np.mean(values)) if values else None


def _hits(results: list[dict[str, Any]]) -> str:
    hits = [hit for result in results for hit in result.get("hits", [])]
    return f"{np.mean(hits):.0%}" if hits else "-"


def _few(results: list[dict[str, Any]]) -> str:
    """Error over the walks that a slow method saw, how many they were, and how often its intervals held the truth."""
    done = [result for result in results if "l2_kg" in result]
    return f"{_number(_rms(done, 'l2_kg'))} ({len(done)}; {_hits(done)})" if done else "-"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
