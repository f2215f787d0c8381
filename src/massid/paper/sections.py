"""The page's sections on V-A to V-D: pictures, tables, what was chosen, and what it changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massid.markup import element
from massid.paper.affine_case import AffineCase
from massid.paper.comparison_case import ComparisonCase, exponent
from massid.paper.counts import count, spread
from massid.paper.estimators import CASES, EstimatorOutcome
from massid.paper.figures import tracking_error
from massid.paper.humanoid_case import HumanoidCase
from massid.paper.model_sets import SHAKEN, MirrorOutcome, ModelSetOutcome, settled_error
from massid.paper.non_affine_case import TARGET_WINDOWS, NonAffineCase
from massid.paper.paper_direction import PAPER_ERROR, PAPER_GAIN, PAPER_STEP, PaperDirectionCase
from massid.paper.setting import SYSTEM_TIME_S
from massid.paper.walk_drift import LINK, RATE_KG_S, WalkDrift
from massid.systems import affine, non_affine
from massid.view.page import HtmlPage


def section_a(page: HtmlPage, case: AffineCase) -> None:
    """V-A."""
    rows = [(name, count(o.iterations), f"{o.error:.2g}") for name, o in case.outcomes.items()]
    changed = [
        (label, f"{count(paper.iterations)}, {paper.error:.2g}", f"{count(own.iterations)}, {own.error:.1e}")
        for label, paper, own in case.sensitivity
    ]
    page.heading("V-A: affine parameters")
    page.picture("fig2.png", "Fig. 2: parameter estimation error; the cross is where the paper ends")
    page.table(("direction", "iterations until Eq. (18)", "error"), rows)
    page.paragraph(
        f"Chosen, since the paper does not say: A = [[0, 1], [-{affine.STIFFNESS:g}, -{affine.DAMPING:g}]]; "
        f"u = -6 + 6 sin(πt/2) + 4 sin(3πt/2); k = {affine.GAIN:g} 1/s; λ = {affine.FORGETTING_RATE:g} 1/s; alpha from "
        "the curvature; the state starts at rest. c",
        element("sub", "terminate"),
        " is compared with a gradient whose size goes with k, so the number of iterations does as well:",
    )
    page.table(("changed", "gradient: iterations, error", "gauss-newton: iterations, error"), changed)


def section_b(page: HtmlPage, case: NonAffineCase, estimators: Sequence[EstimatorOutcome]) -> None:
    """V-B."""
    truth = non_affine.TRUTH
    rows = [
        (
            name,
            f"{np.median(s.final_errors):.2g} (worst {s.final_errors.max():.2g})",
            spread(s.windows),
            f"{s.converged} of {s.starts}",
            spread(s.start_windows),
        )
        for name, s in case.settling.items()
    ]
    tracking = [float(np.sqrt(np.mean(tracking_error(run) ** 2))) for run in (case.without, case.default)]
    page.heading("V-B: non-affine parameters, disturbed")
    page.picture("fig1.png", "Fig. 1: a sampling and update step of a run, over contours of mu")
    page.picture("fig3.png", "Fig. 3: tracking error")
    page.paragraph(
        f"Root mean square tracking error over the 170 s: {tracking[0]:.4f} without the search, {tracking[1]:.4f} "
        "with it. The paper prints no numbers in Fig. 3."
    )
    page.picture("fig4.png", "Fig. 4: parameter estimation error")
    page.table(
        ("direction", "error after 170 s, 8 noise seeds", "windows until 0.01", "random starts", "their windows"), rows
    )
    page.paragraph(
        "All of these have p2 and p3 scanned in the first window. The target is an error below 0.01 within "
        f"{TARGET_WINDOWS} windows. What the scan brings, and that it does not hang on a scanned value that happens to "
        "lie at p* (p2 = 2 is one in [0, 4]):"
    )
    page.table(
        ("scanned", "random starts that converge", f"below 0.01 within {TARGET_WINDOWS} windows", "most windows"),
        [(o.label, f"{o.converged} of {o.starts}", f"{o.in_time} of {o.starts}", count(o.worst)) for o in case.scans],
    )
    _paper_direction(page, case.paper)
    _default_search(page, case)
    _model_sets(page, case.model_sets, case.mirror_scans)
    page.subheading("Drift, and one state measured")
    page.picture("drift.png", "Left: p1 falls by 0.02 and p3 rises by 0.002 a second. Right: x1 alone measured")
    page.paragraph(
        f"With x1 alone measured the error is {case.output.errors(truth)[-1]:.4f} after "
        f"{len(case.output.times_s) - 1} windows: x2 comes from an observer at the running estimate, so both converge "
        f"together. Under drift the online error settles at {np.median(case.drift.online[6:]):.3f}, half a window "
        f"behind; offline, one estimate for the whole record is off by up to {case.drift.offline.max():.2f}. "
        f"(Settled error without drift: {settled_error(case.default):.4f}.)"
    )
    page.subheading("Gradient estimators")
    page.paragraph("Error of the gradient at p0 relative to its length, median of 50 draws, 12 samples.")
    page.table(("estimator", *CASES), [(e.method, *(f"{value:.2g}" for value in e.error)) for e in estimators])


def _default_search(page: HtmlPage, case: NonAffineCase) -> None:
    page.subheading("The default search: what was chosen, and how much it matters")
    page.paragraph(
        "Chosen: Theta = [0, 20] x [0, 4] x [0, 4]; k1 = k2 = 50 1/s; λ = 0.1 1/s; kp = 100, kd = 20; robust term "
        "10 sat(s / 0.5); Delta held 1 ms; first sampling radius 0.1 of a quarter of Theta's width. How much it "
        "matters:"
    )
    page.table(
        ("changed", "windows until 0.01", "error, root mean square after 6 windows"),
        [(label, count(windows), f"{error:.4f}") for label, windows, error in case.sensitivity],
    )
    page.table(
        ("Delta held", "error, root mean square", "Cramér-Rao bound of one window"),
        [(f"{hold * 1e3:g} ms", f"{error:.4f}", f"{bound:.4f}") for hold, error, bound in case.holds],
    )


def _paper_direction(page: HtmlPage, case: PaperDirectionCase) -> None:
    chosen = case.variants[0].errors
    fixed = next(grid for grid in case.grids if grid.rule.startswith("α"))
    page.subheading("The paper's direction: which choices give its 0.16")
    page.picture(
        "paper_direction.png", f"Median final error with the gradient; bold: at most the paper's {PAPER_ERROR}"
    )
    page.paragraph(
        f"k, λ, the metric of the gradient and the sampling radius are not given. With k = {PAPER_GAIN:g} 1/s, "
        f"units of the scales and an exact step the error after 170 s is {np.median(chosen):.2f} ({chosen.min():.2f} "
        f"to {chosen.max():.2f} over {len(chosen)} noise seeds); the paper has {PAPER_ERROR}. A slow model integrates "
        "what p1 and p3 do and smooths what p2 does, so its Hessian is better conditioned; with k = "
        f"{non_affine.GAIN:g} 1/s, which suits the second-order search, any first-order direction creeps. The paper's "
        f"alpha = {PAPER_STEP} in the parameters' own units ends at {fixed.errors.min():.1f} at best, whatever k and λ "
        "are, so its own scale of mu must have been another one."
    )
    page.table(
        (f"changed (k = {PAPER_GAIN:g} 1/s, λ = 0.1 1/s)", "median error after 170 s", "least", "most"),
        [
            (v.label, f"{np.median(v.errors):.2f}", f"{v.errors.min():.2f}", f"{v.errors.max():.2f}")
            for v in case.variants
        ],
    )


def _model_sets(page: HtmlPage, outcomes: Sequence[ModelSetOutcome], scans: Sequence[MirrorOutcome]) -> None:
    smallest = outcomes[0]
    settled = [o.error for o in outcomes]
    page.subheading("Is a larger ModelSet more robust?")
    page.paragraph(
        "The paper says so, of disturbance and noise. Tried without a scan: larger banks that keep their best "
        "models from window to window, and banks with further initial guesses all over Theta; in Theta, in one that "
        f"admits p3 < 0 and so a mirror minimum, and with {SHAKEN:g} times the noise. Against noise nothing is "
        f"gained: the settled error is {min(settled):.4f} to {max(settled):.4f} with {smallest.n_models} to "
        f"{outcomes[-1].n_models} models, since the disturbance is common to all of them. Kept models do not help "
        "against other minima either, they lie where the search has been; further guesses do, and do not cure the "
        "mirror."
    )
    page.table(
        (
            "models",
            "kept",
            "guesses",
            "starts that find p*",
            "p3 < 0 admitted: p*",
            "mirror minimum",
            "settled error",
            f"noise x {SHAKEN:g}",
        ),
        [
            (
                str(o.n_models),
                str(o.kept),
                str(o.guesses),
                f"{o.converged} of {o.starts}",
                f"{o.found} of {o.starts}",
                f"{o.mirrored} of {o.starts}",
                f"{o.error:.4f}",
                f"{o.shaken:.4f}",
            )
            for o in outcomes
        ],
    )
    page.paragraph(
        "Where Theta admits p3 < 0 and the first window scans, a larger set pays once it scans both parameters "
        "that bend mu: nine models see too few values of p3 to tell p* from its mirror."
    )
    page.table(
        ("scanned", "models", "starts that find p*", "mirror minimum"),
        [
            (", ".join(o.scan), str(o.n_models), f"{o.found} of {o.starts}", f"{o.mirrored} of {o.starts}")
            for o in scans
        ],
    )


def section_c(page: HtmlPage, case: ComparisonCase) -> None:
    """V-C."""
    zooms = [
        (f"{z.zoom:g}", "p3 in [-4, 4]" if z.mirrored else "p3 in [0, 4]", f"{z.error:.4f}", f"{z.mirror_distance:.3f}")
        for z in case.zooms
    ]
    page.heading("V-C: dynamic sampling")
    page.table(
        ("Table I", "guided: paper", "here", "dynamic sampling: paper", "here"),
        [
            ("models", "9", str(case.guided.models), "64 (4 x 4 x 4)", str(case.sampling.models)),
            (
                "computation (processor) time [s]",
                "95",
                f"{case.guided.compute_s:.2f}",
                "774",
                f"{case.sampling.compute_s:.2f}",
            ),
            ("system running time [s]", "170", f"{SYSTEM_TIME_S:g}", "170", f"{SYSTEM_TIME_S:g}"),
            ("estimation error", "0.16", f"{case.guided.error:.4f}", "2.03", f"{case.sampling.error:.4f}"),
            (
                "windows until the error stays below 0.01",
                "-",
                count(case.guided.windows),
                "-",
                count(case.sampling.windows),
            ),
        ],
    )
    page.picture("table1.png", "Table I as curves")
    page.paragraph(
        "Both methods run in the same program on the same plant, compilation left out. Dynamic sampling has its "
        f"best zoom factor, {case.zoom:g}; tuned fairly it reaches the same accuracy as the guided search, later and "
        f"with {case.sampling.compute_s / case.guided.compute_s:.1f} times its time. The paper's 2.03 appears where "
        "Theta admits p3 < 0: there the zoom can end in a mirror minimum near (13.19, 2.0005, -0.988)."
    )
    page.table(("zoom", "Theta", "error", "distance from the mirror minimum"), zooms)
    page.paragraph("The guided search is not immune, see the sizes of its ModelSet under V-B.")
    _costs(page, case)


def _costs(page: HtmlPage, case: ComparisonCase) -> None:
    costs = [
        (
            str(c.n_p),
            str(c.guided_models),
            count(c.guided_windows),
            f"{c.window_steps:,}",
            "not reached" if c.total_steps is None else f"{c.total_steps:,}",
            f"{c.copy_step_s * 1e9:.0f}",
            f"{c.guided_s * 1e3:.1f}",
            f"{c.grid_models:,}",
            f"{c.grid_s * 1e3:,.0f}" if c.grid_s is not None else "not run",
        )
        for c in case.costs
    ]
    n_p = [c.n_p for c in case.costs]
    totals = [(c.n_p, c.total_steps) for c in case.costs if c.total_steps is not None]
    powers = {
        "models": exponent(n_p, [c.guided_models for c in case.costs]),
        "model steps of a window": exponent(n_p, [c.window_steps for c in case.costs]),
        "model steps until 0.01": exponent([n for n, _ in totals], [steps for _, steps in totals]),
        "time of one step of one copy": exponent(n_p, [c.copy_step_s for c in case.costs]),
        "time of a window": exponent(n_p, [c.guided_s for c in case.costs]),
    }
    page.subheading("Cost against the number of unknowns")
    page.picture("cost.png", "Independent copies of V-B")
    page.table(
        (
            "unknowns",
            "guided: models",
            "windows until 0.01 per copy",
            "model steps of a window",
            "until 0.01",
            "a step of a copy [ns]",
            "a window [ms]",
            "grid: models",
            "a window [ms]",
        ),
        costs,
    )
    page.paragraph(
        "Exponents of n_p, fitted: " + ", ".join(f"{name} {power:.2f}" for name, power in powers.items()) + ". A "
        "model of c copies is c times the system, so the time of a window grows faster than its steps; a step of one "
        "copy in one model is what to compare. The grid's models are exponential, 4^n_p; its times beyond 6 "
        "unknowns are extrapolated."
    )


def section_d(page: HtmlPage, case: HumanoidCase, rendered: bool) -> None:
    """V-D."""
    rows = [
        (name, f"{e.l2_kg[0]:.2f}", count(e.windows_to_threshold), f"{e.l2_kg.min():.1e}", f"{e.l2_kg[-1]:.1e}")
        for name, e in case.errors.items()
    ]
    how = "rendered by MuJoCo" if rendered else "no graphics driver works here: a stick figure"
    page.heading("V-D: masses of a walking humanoid")
    page.picture(
        "fig5.png",
        f"Fig. 5: from one touch-down of a foot to its next ({how}); blue: the links whose masses are unknown",
    )
    page.picture("fig6.png", "Fig. 6: L2 mass error with each direction")
    page.table(("direction", "initial [kg]", "windows until 0.5 kg", "least [kg]", "last [kg]"), rows)
    page.paragraph(
        f"Chosen: a walk of {case.walk.duration_s:.0f} s, windows of {case.dwell_s:g} s, output injection shaped "
        "by the inertia, 24 models, Theta from 0.3 to 2.5 times the nominal masses, clean sensors."
    )
    if case.drift:
        _walk_drift(page, case.drift)


def _walk_drift(page: HtmlPage, drift: WalkDrift) -> None:
    page.subheading("Masses that drift")
    page.picture(
        "walk_drift.png", f"Section IV-B: the {LINK} grows heavier by {RATE_KG_S:g} kg/s while the robot walks"
    )
    page.paragraph(
        f"Online, window by window, the L2 error stays at {np.median(drift.online_error_kg):.2f} kg (worst "
        f"{drift.online_error_kg.max():.2f}), {np.median(drift.online_error_kg) / RATE_KG_S:.1f} s behind. Offline, "
        f"one estimate for the whole log is off by up to {drift.offline_error_kg.max():.2f} kg."
    )
