"""The one page: the paper's numbers beside ours, what was chosen where it is silent, and what could not be met."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from massid.paper.counts import count, spread
from massid.paper.figures import initial_affine_error
from massid.paper.non_affine_case import first_below
from massid.paper.paper_direction import PAPER_GAIN
from massid.paper.recorded import Check
from massid.paper.reproduce import Reproduction
from massid.paper.sections import section_a, section_b, section_c, section_d
from massid.systems import non_affine
from massid.view.page import Cell, HtmlPage


def write_page(out: Reproduction, path: Path) -> None:
    """Write the page; its pictures lie beside it.

    Raises:
        BadInputError: it cannot be written.
    """
    page = HtmlPage("A guided search framework in multiple model control: run again")
    page.paragraph(
        "Every figure and table of the paper that was asked for, from the code of massid, beside the paper's numbers. "
        "Where the paper is silent a choice was made; how much the result depends on it stands below each section. "
        "Errors are |p - p*|.",
        soft=True,
    )
    page.table(("section", "quantity", "paper", "here"), _comparison(out))
    if out.a:
        section_a(page, out.a)
    if out.b:
        section_b(page, out.b, out.estimators)
    if out.c:
        section_c(page, out.c)
    if out.d:
        section_d(page, out.d, out.rendered)
    _theory(page, out.checks)
    walls = ", ".join(f"V-{part} {seconds:.0f} s" for part, seconds in out.wall_s.items())
    page.paragraph(f"Wall time: {walls}.", soft=True)
    page.write(path)


def summary_lines(out: Reproduction) -> list[str]:
    """The comparison as lines of text."""
    rows = _comparison(out)
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    return [f"{a:<{widths[0]}}  {b:<{widths[1]}}  paper {c:<{widths[2]}}  here {d}" for a, b, c, d in rows]


def _comparison(out: Reproduction) -> list[tuple[str, str, str, str]]:
    rows: list[tuple[str, str, str, str]] = []
    if out.a:
        default, seeds = out.a.outcomes["gauss-newton"], out.a.seeds
        error = np.median([outcome.error for outcome in seeds])
        rows += [
            (
                "V-A",
                f"iterations, error: gradient, {len(seeds)} seeds",
                "9, 0.11",
                f"{spread([outcome.iterations for outcome in seeds])}, {error:.3f}",
            ),
            ("V-A", "iterations, error: default", "-", f"{count(default.iterations)}, {default.error:.1e}"),
            ("V-A", "initial error", "21.9", f"{initial_affine_error():.2f}"),
        ]
    if out.b:
        truth, settling, chosen = non_affine.TRUTH, out.b.settling["gauss-newton"], out.b.paper.variants[0].errors
        rows += [
            (
                "V-B",
                f"final error: gradient, k = {PAPER_GAIN:g} 1/s, {len(chosen)} seeds",
                "0.16",
                f"{np.median(chosen):.2f} ({chosen.min():.2f}-{chosen.max():.2f})",
            ),
            (
                "V-B",
                f"final error: gradient, k = {non_affine.GAIN:g} 1/s",
                "0.16",
                f"{out.b.paper.stiff.errors(truth)[-1]:.2f}",
            ),
            ("V-B", "final error: default", "-", f"{out.b.default.errors(truth)[-1]:.4f}"),
            ("V-B", "windows until 0.01: default", "-", count(first_below(out.b.default))),
            (
                "V-B",
                "random starts that converge; their windows until 0.01: default",
                "-",
                f"{settling.converged} of {settling.starts}; {spread(settling.start_windows)}",
            ),
        ]
    if out.c:
        rows += [
            ("V-C", "models: guided / dynamic sampling", "9 / 64", f"{out.c.guided.models} / {out.c.sampling.models}"),
            (
                "V-C",
                "computation (processor) [s] for 170 s",
                "95 / 774",
                f"{out.c.guided.compute_s:.2f} / {out.c.sampling.compute_s:.2f}",
            ),
            ("V-C", "error", "0.16 / 2.03", f"{out.c.guided.error:.4f} / {out.c.sampling.error:.4f}"),
        ]
    if out.d:
        for name in ("gradient", "gauss-newton"):
            windows = out.d.errors[name].windows_to_threshold
            rows.append(("V-D", f"windows until 0.5 kg: {name}", "> 20" if name == "gradient" else "-", count(windows)))
    return rows


def _theory(page: HtmlPage, checks: Sequence[Check]) -> None:
    if not checks:
        return
    page.heading("Section IV: the theory, checked")
    page.paragraph(
        "The theorems' search has the least ModelSet there is: a centre, its samples, alpha = 1/L and no candidates. "
        "On the walk the unknowns are masses in kilograms and the models those of the humanoid bank; Eq. (23) is not "
        "affine in them. Statements of the paper that are wrong as they stand are listed as what was found instead."
    )
    rows = [
        (
            check.name,
            check.system,
            check.claim,
            check.measured,
            Cell("holds", "good") if check.holds else Cell("does not hold", "bad"),
        )
        for check in checks
    ]
    page.table(("where", "on", "statement", "measured", "outcome"), rows)
