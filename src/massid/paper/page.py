"""The one page: the paper's numbers beside ours, what was chosen where it is silent, and what could not be met."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from massid.paper.figures import initial_affine_error
from massid.paper.markup import count, spread, table
from massid.paper.non_affine_case import first_below
from massid.paper.paper_direction import PAPER_GAIN
from massid.paper.reproduce import Reproduction
from massid.paper.sections import section_a, section_b, section_c, section_d
from massid.systems import non_affine

STYLE = """
body{font:15px/1.5 "Segoe UI",system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#1d2229}
h1{font-size:1.6rem}h2{margin-top:2.5rem;border-bottom:1px solid #dde2e8;padding-bottom:.2rem}
table{border-collapse:collapse;margin:1rem 0;font-size:.92em}
td,th{padding:.25rem .8rem;text-align:left;vertical-align:top}
th{border-bottom:2px solid #5b6470}tr:nth-child(even) td{background:#f5f7f9}img{max-width:100%}
.no{color:#b4192f;font-weight:600}.yes{color:#1a7f4b;font-weight:600}.note{color:#4c5560}
"""
THEORY_NOTE = (
    "<p>The theorems' search has the least ModelSet there is: a centre, its samples, alpha = 1/L and no candidates. On "
    "the walk the unknowns are masses in kilograms and the models those of the humanoid bank; Eq. (23) is not affine "
    "in them. Statements of the paper that are wrong as they stand are listed as what was found instead.</p>"
)


def write_page(out: Reproduction, path: Path) -> None:
    """Write the page; its pictures lie beside it."""
    sections = [
        "<h1>A guided search framework in multiple model control: run again</h1>",
        '<p class="note">Every figure and table of the paper that was asked for, from the code of massid, beside the '
        "paper's numbers. Where the paper is silent a choice was made; how much the result depends on it stands below "
        "each section. Errors are |p - p*|.</p>",
        table(("section", "quantity", "paper", "here"), _comparison(out)),
        *(section_a(out.a) if out.a else []),
        *(section_b(out.b, out.estimators) if out.b else []),
        *(section_c(out.c) if out.c else []),
        *(section_d(out.d, out.rendered) if out.d else []),
        *_theory(out),
    ]
    walls = ", ".join(f"V-{part} {seconds:.0f} s" for part, seconds in out.wall_s.items())
    sections.append(f'<p class="note">Wall time: {walls}.</p>')
    body = "\n".join(sections)
    path.write_text(
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>massid paper</title><style>{STYLE}</style>'
        f"<body>{body}</body></html>\n"
    )


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


def _theory(out: Reproduction) -> list[str]:
    if not out.checks:
        return []
    rows = [
        (check.name, check.system, check.claim, check.measured, "holds" if check.holds else "does not hold")
        for check in out.checks
    ]
    text = table(("where", "on", "statement", "measured", "outcome"), rows)
    for word, kind in (("holds", "yes"), ("does not hold", "no")):
        text = text.replace(f"<td>{word}</td>", f'<td class="{kind}">{word}</td>')
    return ["<h2>Section IV: the theory, checked</h2>", THEORY_NOTE, text]
