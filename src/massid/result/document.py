"""What a result document holds: the JSON of `massid identify --json`, entry by entry. This is schema 1.

Whoever builds, writes, reads, draws or scores a result does it with these types. An entry whose default is None is left
out of the JSON while it is None; one without a default is always there, and null where it may be None. All masses are
in kg and all times in s; every number is finite.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from msgspec import UNSET, Meta, Struct, UnsetType
from msgspec.structs import replace

SCHEMA: Literal[1] = 1
"""Changes with what an entry means, or when one is removed."""

Positive: TypeAlias = Annotated[float, Meta(gt=1e-12)]
"""What is divided by: positive, and not merely so."""
Interval: TypeAlias = Annotated[list[float], Meta(min_length=2, max_length=2)]
"""Lower and upper end of a 95 % interval."""
Setting: TypeAlias = str | int | float | bool | list[str] | None
"""Value of an option; None for one that is infinite."""
Settings: TypeAlias = dict[str, Setting | dict[str, Setting]]
"""Options by name, those of a part by the name of the part and theirs."""


class LinkEntry(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The mass of one link.

    Attributes:
        std_kg: standard deviation [kg]; None for a log without noise, and for a link that is not identifiable.
        interval95_kg: 95 % interval [kg]; None likewise.
        nominal_kg: of the model file [kg].
        estimate_kg: as found [kg]; None for a link that is not identifiable.
        identifiable: whether the log reveals it.
        verdict: the same in words.
        true_kg: what was hidden in a simulated walk [kg]; None if the result was not scored.
        error_kg: estimate minus truth [kg]; None for a link that is not identifiable, unset if there is no score.
    """

    std_kg: float | None = None
    interval95_kg: Interval | None = None
    nominal_kg: Positive
    estimate_kg: float | None
    identifiable: bool
    verdict: str
    true_kg: float | None = None
    error_kg: float | UnsetType | None = UNSET


class QuantityEntry(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One number that was asked for besides the masses of links: a coordinate of a centre of mass, a payload.

    Attributes:
        unit: of all its values, such as "m" or "kg m^2".
        nominal: of the model file.
        identifiable: whether the log reveals it.
        estimate: as found; None if it is not identifiable.
        std: standard deviation; None for a log without noise, and if it is not identifiable.
        interval95: 95 % interval; None likewise.
        true: of a simulated walk; None if the result was not scored, or the truth file does not know it.
        error: estimate minus truth; None if it is not identifiable, unset if there is no truth.
    """

    unit: str
    nominal: float
    identifiable: bool
    estimate: float | None
    std: float | None = None
    interval95: Interval | None = None
    true: float | None = None
    error: float | UnsetType | None = UNSET


class TogetherEntry(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The sum of all masses that were asked for.

    Attributes:
        estimate_kg: as found [kg].
        std_kg: standard deviation [kg]; None for a log without noise.
        interval95_kg: 95 % interval [kg]; None likewise.
    """

    estimate_kg: float
    std_kg: float | None = None
    interval95_kg: Interval | None = None


class CombinationEntry(Struct, frozen=True, kw_only=True):
    """Links that cannot be told apart, or a link that cannot be weighed.

    Attributes:
        text: named by links, such as "l_thigh + l_calf against torso".
        relative_std: standard deviation along it, in shares of the links' masses.
        relative_change: of each link's mass along it, a unit vector.
    """

    text: str
    relative_std: float
    relative_change: dict[str, float]


class SumEntry(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The mass of several links together, which is known although not all of theirs are.

    Attributes:
        links: which.
        nominal_kg: of the model file [kg].
        std_kg: standard deviation [kg].
        estimate_kg: as found [kg]; None before the fit.
    """

    links: list[str]
    nominal_kg: float
    std_kg: float
    estimate_kg: float | None = None


class VerdictEntry(Struct, frozen=True, kw_only=True):
    """What the log can reveal, said before the fit.

    Attributes:
        motion: what the robot does, in words.
        sensors: with what sensors the log was judged, in words.
        predicted_std_kg: standard deviation to which each link's mass can be known [kg].
        total_std_kg: standard deviation to which the whole robot's mass can be known [kg].
        not_identifiable: links, and names of other quantities, that the log does not reveal.
        combinations: what cannot be told apart, worst first.
        sums: what is known all the same, as the fit found it.
        advice: which motion would help, one line each.
    """

    motion: str
    sensors: str
    predicted_std_kg: dict[str, float]
    total_std_kg: float
    not_identifiable: list[str]
    combinations: list[CombinationEntry]
    sums: list[SumEntry]
    advice: list[str]


class TorqueErrorEntry(Struct, frozen=True, kw_only=True):
    """How far off the predicted torque of a joint is.

    Attributes:
        rms_nominal_nm: root mean square with the model file's masses [N m].
        rms_identified_nm: root mean square with what was found [N m].
    """

    rms_nominal_nm: float
    rms_identified_nm: float


class TorquesEntry(Struct, frozen=True, kw_only=True):
    """How far off the predicted joint torques of the held-out part are.

    Attributes:
        cutoff_hz: of the low-pass under which torques are compared [Hz].
        rms_nominal_nm: over all joints, with the model file's masses [N m].
        rms_identified_nm: over all joints, with what was found [N m].
        joints: each by itself.
    """

    cutoff_hz: float
    rms_nominal_nm: float
    rms_identified_nm: float
    joints: dict[str, TorqueErrorEntry]


class WeightEntry(Struct, frozen=True, kw_only=True):
    """The mass of the whole robot.

    Attributes:
        found_kg: model file with the masses found in it [kg].
        found_std_kg: its standard deviation; 0 for a log without noise [kg].
        carried_kg: what the ground carried [kg].
        carried_std_kg: standard error of that [kg].
        agrees: whether the two differ by no more than their errors allow.
    """

    found_kg: float
    found_std_kg: float
    carried_kg: float
    carried_std_kg: float
    agrees: bool


class ValidationEntry(Struct, frozen=True, kw_only=True):
    """The checks of the result against its own log.

    Attributes:
        held_out_s: length of the part that was not fitted [s].
        torques: prediction of its joint torques; None if nothing was held out.
        weight: None if nothing carries the robot.
    """

    held_out_s: float
    torques: TorquesEntry | None
    weight: WeightEntry | None


class NuisanceEntry(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One number that was estimated without being asked for: an error of a sensor, the mass of another link.

    Attributes:
        unit: of all its values; "1" for shares.
        nominal: what it is without an error.
        estimate: as found.
        std: standard deviation.
        prior_std: standard deviation that was believed before.
        kind: of unknown, such as "effort_offset".
        title: what all of its kind are called together.
        label: what it belongs to, for people.
        log: number of the log that it belongs to, of several; None if it is common to them, or there is one.
    """

    unit: str
    nominal: float
    estimate: float
    std: float
    prior_std: Positive
    kind: str | None = None
    title: str | None = None
    label: str | None = None
    log: int | None = None


class UncertaintyEntry(Struct, frozen=True, kw_only=True):
    """What the noise of a log leaves uncertain.

    Attributes:
        noise: standard deviation of each sensor error, as `SensorNoise` has them, in SI units.
        inflation: factor in the covariance by which the windows' scores scatter more than the noise explains.
        chi2_per_sample: mean square of the whitened innovations; near 1 if the model explains the log.
        nuisances: what else was estimated.
    """

    noise: dict[str, float]
    inflation: float
    chi2_per_sample: float
    nuisances: dict[str, NuisanceEntry]


class IterationEntry(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One update of the estimate.

    Attributes:
        window: number of the update, from 0.
        time_s: time in the log at which it was made [s].
        mu: score of the best model.
        estimate_kg: each link's mass, hidden ones included [kg].
        chi2: mean square of the whitened innovations; None for a log without noise.
        std_kg: standard deviation of each link's mass [kg]; None where it was not computed.
        l2_error_kg: L2 norm of the masses' errors [kg]; None if the result was not scored.
    """

    window: int
    time_s: float
    mu: float
    estimate_kg: dict[str, float]
    chi2: float | None
    std_kg: dict[str, float] | None
    l2_error_kg: float | None = None


class ReferenceEntry(Struct, frozen=True, kw_only=True):
    """Another method's masses from the same log.

    Attributes:
        method: its name.
        cutoff_hz: of its low-pass [Hz]; None if it did not filter.
        estimate_kg: mass of each link [kg].
        std_kg: standard deviation of each [kg].
    """

    method: str
    cutoff_hz: float | None
    estimate_kg: dict[str, float]
    std_kg: dict[str, float]


class Document(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A result as JSON.

    Attributes:
        schema: of this document.
        links: each link's mass.
        quantities: what was asked for besides; empty if nothing was.
        together: the sum of all masses asked for; None if it is not known.
        verdict: what was said before the fit; None if nobody asked.
        validation: checks against the log itself; None if nobody asked.
        uncertainty: None for a log without noise.
        iterations: every update.
        status: how it ended, in words.
        mode: "online" or "offline".
        logs: names of the logs.
        warnings: what the user should know, one line each.
        wall_s: time it took [s].
        log_s: time covered by the logs [s].
        reference: another method on the same log; None if the log is too short for it, unset if it was not run.
        options: as `IdentifyOptions` has them, those of the search in "search"; None if they are not known.
        sidecar_sha256: of the file beside the document; None if there is none.
        l2_error_initial_kg: L2 norm of the nominal masses' errors [kg]; None if the result was not scored.
        l2_error_kg: the same of the estimate [kg].
        stopped: whether somebody stopped it before its end.
    """

    schema: Literal[1]
    links: dict[str, LinkEntry]
    quantities: dict[str, QuantityEntry]
    together: TogetherEntry | None
    verdict: VerdictEntry | None
    validation: ValidationEntry | None
    uncertainty: UncertaintyEntry | None
    iterations: list[IterationEntry]
    status: str
    mode: str
    logs: list[str]
    warnings: list[str]
    wall_s: float
    log_s: float
    reference: ReferenceEntry | UnsetType | None = UNSET
    options: Settings | None = None
    sidecar_sha256: str | None = None
    l2_error_initial_kg: float | None = None
    l2_error_kg: float | None = None
    stopped: bool = False

    def beside(self, reference: ReferenceEntry | None) -> Document:
        """The document with what another method found."""
        return replace(self, reference=reference)
