"""A result document with everything in it that a document can hold, and what may be wrong with one."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

from massid.result.document import (
    SCHEMA,
    CombinationEntry,
    Document,
    IterationEntry,
    LinkEntry,
    NuisanceEntry,
    QuantityEntry,
    ReferenceEntry,
    SumEntry,
    TogetherEntry,
    TorqueErrorEntry,
    TorquesEntry,
    UncertaintyEntry,
    ValidationEntry,
    VerdictEntry,
    WeightEntry,
)

HIDDEN = "calf<b>"
"""A link that is not identifiable, and whose name is markup."""
JUNK = (None, "x", True, -3, [], [[]], {}, {"": {}}, 10**400)
"""Values that hardly any entry may have."""


def document() -> Document:
    """A result of two links from a noisy log, one of which was hidden."""
    return Document(
        schema=SCHEMA,
        links={
            "torso": LinkEntry(
                std_kg=0.1,
                interval95_kg=[4.2, 4.6],
                nominal_kg=4.0,
                estimate_kg=4.4,
                identifiable=True,
                verdict="identifiable",
            ),
            HIDDEN: LinkEntry(nominal_kg=2.0, estimate_kg=None, identifiable=False, verdict="not identifiable"),
        },
        quantities={
            "com/torso/x": QuantityEntry(
                unit="m", nominal=0.1, identifiable=True, estimate=0.12, std=0.005, interval95=[0.11, 0.13]
            ),
            "com/torso/y": QuantityEntry(unit="m", nominal=0.0, identifiable=False, estimate=None),
        },
        together=TogetherEntry(estimate_kg=6.5, std_kg=0.2, interval95_kg=[6.1, 6.9]),
        verdict=VerdictEntry(
            motion="standing still",
            sensors="the log's own noise",
            predicted_std_kg={"torso": 0.1, HIDDEN: 1.0},
            total_std_kg=0.3,
            not_identifiable=[HIDDEN, "com/torso/y"],
            combinations=[
                CombinationEntry(text=HIDDEN, relative_std=0.5, relative_change={"torso": 0.0, HIDDEN: 1.0}),
            ],
            sums=[SumEntry(links=["torso", HIDDEN], nominal_kg=6.0, std_kg=0.2, estimate_kg=6.5)],
            advice=["walk"],
        ),
        validation=ValidationEntry(
            held_out_s=0.2,
            torques=TorquesEntry(
                cutoff_hz=5.0,
                rms_nominal_nm=2.0,
                rms_identified_nm=0.5,
                joints={"knee": TorqueErrorEntry(rms_nominal_nm=2.0, rms_identified_nm=0.5)},
            ),
            weight=WeightEntry(found_kg=30.0, found_std_kg=0.2, carried_kg=30.1, carried_std_kg=0.1, agrees=True),
        ),
        uncertainty=UncertaintyEntry(
            noise={"force_offset": 4.0},
            inflation=1.0,
            chi2_per_sample=1.01,
            nuisances={
                "effort_offset/knee": NuisanceEntry(
                    unit="N m",
                    nominal=0.0,
                    estimate=0.1,
                    std=0.4,
                    prior_std=0.4,
                    kind="effort_offset",
                    title="torque offsets",
                    label="knee",
                ),
                "wrench_offset/sole/2@2": NuisanceEntry(
                    unit="N",
                    nominal=3.0,
                    estimate=3.0,
                    std=0.06,
                    prior_std=0.06,
                    kind="wrench_offset",
                    title="force offsets",
                    label="sole force z",
                    log=2,
                ),
            },
        ),
        iterations=[
            IterationEntry(
                window=window,
                time_s=0.5 * (window + 1),
                mu=0.1,
                estimate_kg={"torso": 4.4, HIDDEN: 2.3},
                chi2=1.0,
                std_kg={"torso": 0.1, HIDDEN: 1.0} if window else None,
            )
            for window in range(2)
        ],
        status="not identifiable",
        mode="online",
        logs=["walk.mcap"],
        warnings=["a sensor drifts"],
        wall_s=1.0,
        log_s=1.0,
        reference=ReferenceEntry(
            method="least squares",
            cutoff_hz=10.0,
            estimate_kg={"torso": 4.5, HIDDEN: 9.876},
            std_kg={"torso": 0.1, HIDDEN: 1.0},
        ),
        options={"noise": "auto", "bank_size": 24, "search": {"radius": 0.1, "largest_step": None, "scan": []}},
    )


def entries(value: Any, where: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Paths to every entry inside a value."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, inner in inside:
        yield (*where, name)
        yield from entries(inner, (*where, name))


def changed(value: Any, where: tuple[str | int, ...], other: object) -> Any:
    """A copy in which the entry at a path is another value."""
    whole = copy.deepcopy(value)
    inner = whole
    for name in where[:-1]:
        inner = inner[name]
    inner[where[-1]] = other
    return whole
