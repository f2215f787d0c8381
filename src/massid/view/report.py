"""The report of one result: what was found, how sure it is, and what the log says about it, on one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from massid.result.document import Document, LinkEntry, ReferenceEntry, Setting, ValidationEntry
from massid.result.posterior import INTERVAL_95
from massid.result.sidecar import read_result
from massid.typing import AnyArray, FloatArray
from massid.view.chart import Chart
from massid.view.colours import LINK_COLOURS
from massid.view.nuisances import write_nuisances
from massid.view.page import HtmlPage, Mood

_BEFORE, _AFTER, _REFERENCE, _TRUTH = "#c3ccd6", "#0a8a78", "#d9822b", "#1d2229"
_NBSP = "\N{NO-BREAK SPACE}"
_CURVES = 3
_CHANNELS = 12


def write_report(result_path: Path, page_path: Path) -> tuple[str, ...]:
    """Turn a result document and its sidecar into one page.

    Args:
        result_path: JSON that `massid identify --json` wrote.
        page_path: HTML to write.

    Returns:
        What the page lacks, one line each.

    Raises:
        BadInputError: the document or its sidecar cannot be read or lacks an entry, or the page cannot be written.
    """
    stored = read_result(result_path)
    document, arrays = stored.document, stored.arrays
    page = HtmlPage(f"massid: {', '.join(document.logs)}")
    _head(page, document)
    _masses(page, document)
    _quantities(page, document)
    _verdict(page, document)
    _convergence(page, document)
    _information(page, document, arrays)
    _held_out(page, document, arrays)
    _residuals(page, document, arrays)
    write_nuisances(page, document)
    _settings(page, document)
    page.write(page_path)
    return stored.warnings


def _head(page: HtmlPage, document: Document) -> None:
    status, links = document.status, document.links
    seen = sum(entry.identifiable for entry in links.values())
    page.paragraph(
        f"{len(links)} links weighed from {document.log_s:.1f} s of log, {document.mode}, in {document.wall_s:.1f} s.",
        soft=True,
    )
    cards: list[tuple[str, str, Mood]] = [
        (status, f"{seen} of {len(links)} links identifiable", "good" if status == "converged" else "bad"),
    ]
    together = document.together
    if together and together.std_kg is not None:
        half = INTERVAL_95 * together.std_kg
        cards.append((f"{together.estimate_kg:.2f} ±{half:.2f}{_NBSP}kg", "these links together, 95 %", ""))
    if document.validation:
        cards += _checks(document.validation)
    if document.uncertainty:
        cards.append((f"{document.uncertainty.chi2_per_sample:.3f}", "χ² per sample; 1 if all is explained", ""))
    page.cards(cards)
    for warning in document.warnings:
        page.warning(warning)


def _checks(validation: ValidationEntry) -> list[tuple[str, str, Mood]]:
    """Cards of what the log itself says about the result."""
    cards: list[tuple[str, str, Mood]] = []
    if weight := validation.weight:
        carried = f"{weight.carried_kg:.2f} ±{INTERVAL_95 * weight.carried_std_kg:.2g} kg"
        half = f" ±{INTERVAL_95 * weight.found_std_kg:.2g}" if weight.found_std_kg else ""
        text = f"whole robot; the ground carried {carried}, 95 %"
        cards.append((f"{weight.found_kg:.2f}{half}{_NBSP}kg", text, "" if weight.agrees else "bad"))
    if torques := validation.torques:
        before, after = torques.rms_nominal_nm, torques.rms_identified_nm
        what = f"error of torques predicted for {validation.held_out_s:.1f} s that were held out"
        cards.append((f"{before:.2g} → {after:.2g}{_NBSP}N{_NBSP}m", what, "good" if after < before else "bad"))
    return cards


def _masses(page: HtmlPage, document: Document) -> None:
    links, reference = document.links, document.reference or None
    if not links:
        return
    page.heading("Masses")
    head = ["link", "model file [kg]", "estimate [kg]", "95 % interval [kg]", "change"]
    has_truth = any(entry.true_kg is not None for entry in links.values())
    head += ["least squares [kg]"] if reference else []
    head += ["true [kg]"] if has_truth else []
    rows = []
    for link, entry in links.items():
        found, nominal = entry.estimate_kg, entry.nominal_kg
        row = [link, f"{nominal:.3f}", "–" if found is None else f"{found:.3f}"]
        row.append("{:.3f} – {:.3f}".format(*entry.interval95_kg) if entry.interval95_kg else "–")
        row.append("not identifiable" if found is None else f"{100 * (found / nominal - 1):+.1f} %")
        row += ["–" if found is None else f"{reference.estimate_kg[link]:.3f}"] if reference else []
        row += ["–" if entry.true_kg is None else f"{entry.true_kg:.3f}"] if has_truth else []
        rows.append(row)
    page.table(head, rows)
    _mass_chart(page, links, reference)


def _quantities(page: HtmlPage, document: Document) -> None:
    """What was asked for besides masses of links."""
    quantities = document.quantities
    if not quantities:
        return
    page.heading("What else was asked for")
    rows, has_truth = [], any(entry.true is not None for entry in quantities.values())
    for name, entry in quantities.items():
        row = [name, f"{entry.nominal:.4f}", "not identifiable" if entry.estimate is None else f"{entry.estimate:.4f}"]
        row.append("{:.4f} – {:.4f}".format(*entry.interval95) if entry.interval95 else "–")
        row += ["–" if entry.true is None else f"{entry.true:.4f}"] if has_truth else []
        rows.append([*row, entry.unit])
    head = ["quantity", "model file", "estimate", "95 % interval", *(["true"] if has_truth else []), "unit"]
    page.table(head, rows)


def _mass_chart(page: HtmlPage, links: Mapping[str, LinkEntry], reference: ReferenceEntry | None) -> None:
    """Each link as a share of its nominal mass, with its interval."""
    share = {}
    for link, entry in links.items():
        found = entry.estimate_kg
        low, high = entry.interval95_kg or (found, found)
        other = reference.estimate_kg[link] if reference and found is not None else None
        masses = {"estimate": found, "true": entry.true_kg, "reference": other, "low": low, "high": high}
        share[link] = {
            name: 100.0 * (value / entry.nominal_kg - 1.0) for name, value in masses.items() if value is not None
        }
    values = [value for marks in share.values() for value in marks.values()] or [0.0]
    margin = 0.06 * (max(*values, 0.0) - min(*values, 0.0)) + 0.5
    ends = (min(*values, 0.0) - margin, max(*values, 0.0) + margin)
    chart = Chart.of_rows("change against the model file", list(links), ends, "%")
    chart.level(0.0, upright=True)
    for row, (link, marks) in enumerate(share.items()):
        if "estimate" not in marks:
            chart.note(0.0, row, "not identifiable", "#b4313f")
            continue
        if "reference" in marks:
            chart.dot(marks["reference"], row, _REFERENCE, 4.0, hollow=True)
        if "true" in marks:
            chart.tick(marks["true"], row, _TRUTH)
        chart.bar(marks["low"], marks["high"], row, _AFTER, 6.0, 0.45)
        chart.dot(marks["estimate"], row, _AFTER, 4.5, hint=f"{link} {marks['estimate']:+.2f} %")
    page.drawing(chart.svg())
    entries = [(_AFTER, "estimate with its 95 % interval")]
    if reference:
        entries.append((_REFERENCE, f"reference: {reference.method} on the same log ({_cutoff(reference)})"))
    if any("true" in marks for marks in share.values()):
        entries.append((_TRUTH, "truth"))
    page.key(entries)


def _cutoff(reference: ReferenceEntry) -> str:
    if reference.cutoff_hz is None:
        return "unfiltered"
    return f"cut-off {reference.cutoff_hz:g} Hz, the best of those tried on its own held-out part"


def _verdict(page: HtmlPage, document: Document) -> None:
    verdict = document.verdict
    if not verdict:
        return
    page.heading("What the log can reveal")
    page.paragraph(
        f"Before anything was fitted: {verdict.motion}, whole robot known to "
        f"±{INTERVAL_95 * verdict.total_std_kg:.2g} kg ({verdict.sensors}). What follows ± is a 95 % "
        "interval: one in twenty misses."
    )
    lines = [f"known only to ±{INTERVAL_95 * one.relative_std:.0%}: {one.text}" for one in verdict.combinations]
    lines += [
        f"known all the same: {' + '.join(one.links)} together, {one.estimate_kg:.2f} "
        f"±{INTERVAL_95 * one.std_kg:.2g} kg"
        for one in verdict.sums
        if one.estimate_kg is not None
    ]
    lines += [f"what would help: {line}" for line in verdict.advice]
    if lines:
        page.bullets(lines)


def _convergence(page: HtmlPage, document: Document) -> None:
    iterations = document.iterations
    links = [link for link, entry in document.links.items() if entry.identifiable]
    if not iterations or not links:
        return
    online = document.mode == "online"
    page.heading("Convergence")
    x = np.array([0.0, *(one.time_s if online else one.window + 1 for one in iterations)])
    values = {
        link: np.array([0.0, *(one.estimate_kg[link] for one in iterations)])
        - np.array([0.0] + [document.links[link].nominal_kg] * len(iterations))
        for link in links
    }
    everything = np.concatenate(list(values.values()))
    margin = 0.1 * float(np.ptp(everything)) + 1e-3
    ends = (float(everything.min()) - margin, float(everything.max()) + margin)
    unit = "time in the log [s]" if online else "passes over the log"
    chart = Chart("estimate − model file [kg]", (0.0, float(x[-1])), ends, 300.0, x_label=unit)
    colours = {link: LINK_COLOURS[k % len(LINK_COLOURS)] for k, link in enumerate(links)}
    for link, change in values.items():
        std = np.array([one.std_kg[link] if one.std_kg else np.nan for one in iterations])
        if np.all(np.isfinite(std)) and len(std) > 1:
            half = INTERVAL_95 * std
            chart.band(
                x[1:], np.maximum(change[1:] - half, ends[0]), np.minimum(change[1:] + half, ends[1]), colours[link]
            )
    for link, change in values.items():
        chart.line(x, change, colours[link])
    page.drawing(chart.svg())
    page.key([(colour, link) for link, colour in colours.items()])
    chi2 = np.array([one.chi2 for one in iterations if one.chi2 is not None])
    if len(chi2) == len(iterations):
        top = float(min(max(chi2.max(), 1.1), 3.0))
        name = "χ² per sample of each dwell window" if online else "χ² per sample of each pass"
        small = Chart(f"{name} (cut off at {top:.2g})", (0.0, float(x[-1])), (0.8, top), 170.0, x_label=unit)
        small.level(1.0)
        small.line(x[1:], np.minimum(chi2, top), _AFTER)
        for across, value in zip(x[1:], chi2, strict=True):
            small.dot(float(across), min(float(value), top), _AFTER, 3.0, hint=f"{value:.3f}")
        page.drawing(small.svg())


def _information(page: HtmlPage, document: Document, arrays: Mapping[str, AnyArray]) -> None:
    if "covariance" not in arrays or document.verdict is None or not document.links:
        return
    links, predicted = document.links, document.verdict.predicted_std_kg
    page.heading("Information about each link")
    page.paragraph("Standard deviations, as foreseen by the verdict and as the fit reports them.", soft=True)
    shares = {
        link: (100.0 * predicted[link] / entry.nominal_kg, 100.0 * (entry.std_kg or 0.0) / entry.nominal_kg)
        for link, entry in links.items()
    }
    biggest = max(max(both) for both in shares.values())
    chart = Chart.of_rows("standard deviation, share of the link's mass", list(links), (0.0, 1.05 * biggest), "%")
    for row, (link, (before, after)) in enumerate(shares.items()):
        chart.bar(0.0, before, row - 0.17, _BEFORE, 8.0)
        if links[link].std_kg is not None:
            chart.bar(0.0, after, row + 0.17, _AFTER, 8.0)
    page.drawing(chart.svg())
    page.key([(_BEFORE, "foreseen before the fit"), (_AFTER, "reported by the fit")])
    covariance: FloatArray = arrays["covariance"]
    if len(covariance) == len(links) > 1:
        scale = np.sqrt(np.diagonal(covariance))
        correlation = covariance / np.outer(scale, scale)
        page.paragraph("Correlations of the estimates: near −1, the log shows little but the sum.", soft=True)
        page.table(
            ["", *links], [[link, *(f"{value:+.2f}" for value in correlation[k])] for k, link in enumerate(links)]
        )


def _held_out(page: HtmlPage, document: Document, arrays: Mapping[str, AnyArray]) -> None:
    validation = document.validation
    if validation is None or validation.torques is None or not validation.torques.joints:
        return
    torques = validation.torques
    page.heading("Held-out joint torques")
    page.paragraph(
        f"The last {validation.held_out_s:.1f} s of the log were not fitted. Their joint torques, "
        f"predicted by inverse dynamics below {torques.cutoff_hz:g} Hz, were off by "
        f"{torques.rms_nominal_nm:.3g} N m with the model file and by {torques.rms_identified_nm:.2g} N m with "
        "what was found."
    )
    joints = sorted(torques.joints, key=lambda joint: -torques.joints[joint].rms_nominal_nm)[:_CHANNELS]
    shown = [torques.joints[joint] for joint in joints]
    biggest = max(max(one.rms_nominal_nm, one.rms_identified_nm) for one in shown)
    chart = Chart.of_rows("root mean square error", joints, (0.0, 1.05 * biggest), "N m", 22.0)
    for row, one in enumerate(shown):
        chart.bar(0.0, one.rms_nominal_nm, row - 0.17, _BEFORE, 6.5)
        chart.bar(0.0, one.rms_identified_nm, row + 0.17, _AFTER, 6.5)
    page.drawing(chart.svg())
    page.key([(_BEFORE, "with the model file"), (_AFTER, "with the masses found")])
    if "torque_measured" in arrays:
        _torque_curves(page, joints[:_CURVES], list(torques.joints), arrays)


def _torque_curves(page: HtmlPage, joints: Sequence[str], names: Sequence[str], arrays: Mapping[str, AnyArray]) -> None:
    """Measured and predicted torques of some joints; names are those of the columns."""
    time_s = arrays["torque_time_s"]
    for joint in joints:
        column = names.index(joint)
        measured, nominal, found = (
            arrays[f"torque_{name}"][:, column] for name in ("measured", "nominal", "identified")
        )
        low = float(min(each.min() for each in (measured, nominal, found)))
        high = float(max(each.max() for each in (measured, nominal, found)))
        one = Chart(f"{joint} [N m]", (float(time_s[0]), float(time_s[-1])), (low, high), 190.0, x_label="time [s]")
        one.line(time_s, nominal, "#9aa7b5", 2.0, "5 4")
        one.line(time_s, measured, _TRUTH, 3.0)
        one.line(time_s, found, "#2bc4ae", 1.6)
        page.drawing(one.svg())
    page.key([(_TRUTH, "measured"), ("#9aa7b5", "predicted with the model file"), ("#2bc4ae", "with the masses found")])


def _residuals(page: HtmlPage, document: Document, arrays: Mapping[str, AnyArray]) -> None:
    if "residual_channels" not in arrays:
        return
    page.heading("Residuals by channel")
    page.paragraph(
        "Mean squares of whitened innovations: 1 where model and sensor noise explain the channel.", soft=True
    )
    before, after = arrays["residual_nominal"], arrays["residual_identified"]
    channels = [str(name) for name in arrays["residual_channels"]]
    order = sorted(np.argsort(-np.maximum(before, after))[:_CHANNELS].tolist())
    top = float(min(max(np.maximum(before, after)[order].max() * 1.05, 1.5), 4.0))
    chart = Chart.of_rows(f"χ² (cut off at {top:.2g})", [channels[k] for k in order], (0.0, top), "", 22.0)
    chart.level(1.0, upright=True)
    for row, k in enumerate(order):
        chart.bar(0.0, float(before[k]), row - 0.17, _BEFORE, 6.5)
        chart.bar(0.0, float(after[k]), row + 0.17, _AFTER, 6.5)
    page.drawing(chart.svg())
    page.key([(_BEFORE, "model file"), (_AFTER, "found, sensor errors included")])
    page.paragraph(
        f"All {len(channels)} channels: median {np.median(after):.3f}, worst {after.max():.3f} "
        f"({channels[int(np.argmax(after))]}).",
        soft=True,
    )


def _settings(page: HtmlPage, document: Document) -> None:
    """The options and the noise that was assumed."""
    options, noise = document.options or {}, document.uncertainty.noise if document.uncertainty else {}
    if not (options or noise):
        return
    page.heading("Options and assumed noise")
    if noise:
        asked = options.get("noise", "auto")
        read = "white levels read off the log, offsets and gains as in realistic" if asked == "auto" else "the preset"
        page.paragraph(f"--noise {asked}: {read}. Standard deviations, white ones per sample, in SI units.", soft=True)
        page.table(["sensor error", "deviation"], [[name, f"{value:.3g}"] for name, value in noise.items()])
    plain: dict[str, Setting] = {}
    for name, value in options.items():
        plain |= (
            {f"{name} {inner}": each for inner, each in value.items()} if isinstance(value, dict) else {name: value}
        )
    page.table(["option", "value"], [[name.replace("_", "-"), str(value)] for name, value in plain.items()])
