"""A result as the document that is written of it."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from msgspec import UnsetType

from massid.result.document import (
    SCHEMA,
    Document,
    IterationEntry,
    LinkEntry,
    NuisanceEntry,
    ReferenceEntry,
    Settings,
    TogetherEntry,
    UncertaintyEntry,
)
from massid.result.posterior import interval_95

if TYPE_CHECKING:
    from massid.result.result import Result, Uncertainty


def describe_result(
    result: Result, reference: ReferenceEntry | UnsetType | None, options: Settings | None, sidecar_sha256: str | None
) -> Document:
    """The document of a result; see `Result.document`."""
    return Document(
        schema=SCHEMA,
        links=describe_links(result),
        quantities={quantity.name: quantity.entry() for quantity in result.quantities},
        together=_together(result),
        verdict=None if result.verdict is None else result.verdict.entry(),
        validation=None if result.validation is None else result.validation.entry(),
        uncertainty=None if result.uncertainty is None else _uncertainty(result.uncertainty),
        iterations=_iterations(result),
        status=str(result.status),
        stopped=result.stopped,
        mode=result.mode,
        logs=list(result.sources),
        warnings=list(result.warnings),
        wall_s=result.wall_s,
        log_s=result.log_s,
        reference=reference,
        options=options,
        sidecar_sha256=sidecar_sha256,
    )


def describe_links(result: Result) -> dict[str, LinkEntry]:
    """A link that is not identifiable has no estimate, only what was known before."""
    nominal_kg, std_kg, hidden = result.nominal_kg, result.std_kg, result.hidden_links
    return {
        link: LinkEntry(nominal_kg=nominal_kg[link], estimate_kg=None, identifiable=False, verdict="not identifiable")
        if link in hidden
        else LinkEntry(
            std_kg=std_kg.get(link),
            interval95_kg=interval_95(value, std_kg.get(link)),
            nominal_kg=nominal_kg[link],
            estimate_kg=value,
            identifiable=True,
            verdict="identifiable",
        )
        for link, value in result.estimate_kg.items()
    }


def _together(result: Result) -> TogetherEntry | None:
    together = result.together
    if together is None or together.estimate_kg is None:
        return None
    std_kg = together.std_kg if result.uncertainty else None
    interval = interval_95(together.estimate_kg, std_kg)
    return TogetherEntry(estimate_kg=together.estimate_kg, std_kg=std_kg, interval95_kg=interval)


def _uncertainty(found: Uncertainty) -> UncertaintyEntry:
    rows = zip(found.nuisances, found.nuisance_estimate.tolist(), found.nuisance_std.tolist(), strict=True)
    return UncertaintyEntry(
        noise=asdict(found.noise),
        inflation=found.inflation,
        chi2_per_sample=found.chi2_per_sample,
        nuisances={
            parameter.name: NuisanceEntry(
                unit=parameter.unit,
                nominal=parameter.nominal,
                estimate=value,
                std=std,
                prior_std=parameter.prior_std or parameter.scale,  # a nuisance has both, and they are one
                kind=parameter.kind,
                title=parameter.title,
                label=parameter.label,
                log=parameter.log,
            )
            for parameter, value, std in rows
        },
    )


def _iterations(result: Result) -> list[IterationEntry]:
    return [
        IterationEntry(
            window=window.index,
            time_s=window.time_s,
            mu=float(window.mu[window.best]),
            estimate_kg=result.masses_kg(window.estimate),
            chi2=None if result.uncertainty is None else window.chi2,
            std_kg=None if window.std is None else result.masses_kg(window.std),
        )
        for window in result.windows
    ]
