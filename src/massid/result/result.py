"""What an identification found: a frozen trace that knows nothing of the truth."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import UNSET, UnsetType

from massid.errors import BadInputError
from massid.model.unknowns.bodies import Mass
from massid.model.unknowns.unknown import Unknown
from massid.result.checks import Validation
from massid.result.combinations import Sum
from massid.result.description import describe_result
from massid.result.disagreement import disagreement
from massid.result.document import Document, ReferenceEntry, Settings
from massid.result.evidence import Evidence
from massid.result.excitation import Excitation
from massid.result.file import plain
from massid.result.posterior import LARGEST_INFLATION
from massid.result.presentation import Columns, columns, notebook_html, one_or_two_lines
from massid.result.quantities import Quantity
from massid.result.verdict import KNOWN_SUM, Verdict
from massid.search.guided import Iteration
from massid.search.parameters import ParameterSpace
from massid.search.proposal import Role
from massid.typing import FloatArray, IntArray
from massid.walk.noise import SensorNoise

_BORDER = 1e-3
"""Distance to the border of Theta below which an estimate was stopped by it, in scales."""


class Status(enum.StrEnum):
    """How an identification ended."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not converged"
    NOT_IDENTIFIABLE = "not identifiable"
    CONTRADICTED = "contradicted"
    """The search has come to rest, but what the log says besides denies what it found."""


@dataclass(frozen=True)
class WindowResult:
    """One update of the estimate.

    Attributes:
        index: number of the update, from 0: the dwell window online, the pass over the log offline.
        time_s: time in the log at which the update was made, since its first sample [s]; several logs follow each
            other.
        estimate: shape (n_p,).
        mu: scores of all models, shape (n_models,); inf for diverged ones.
        best: row of p_best.
        points: parameters of all models, shape (n_models, n_p).
        roles: what each model was for.
        newton_step: distance to the predicted minimum, shape (n_p,).
        std: standard deviations at this point, shape (n_p,); None for a log without noise.
        diverged: rows of the models that diverged.
        chi2: mu of the centre per scalar output error: on a noisy log the mean square of whitened innovations.
    """

    index: int
    time_s: float
    estimate: FloatArray
    mu: FloatArray
    best: int
    points: FloatArray
    roles: tuple[Role, ...]
    newton_step: FloatArray
    diverged: IntArray
    std: FloatArray | None = None
    chi2: float = float("nan")

    @classmethod
    def from_iteration(
        cls, iteration: Iteration, n_asked: int, time_s: float, std: FloatArray | None = None
    ) -> WindowResult:
        """Keep what is worth keeping of a search iteration: of the points, the parameters that were asked for."""
        monitoring, asked = iteration.monitoring, slice(n_asked)
        return cls(
            index=iteration.index,
            time_s=time_s,
            estimate=iteration.estimate[asked],
            mu=monitoring.mu,
            best=iteration.best,
            points=monitoring.proposal.points[:, asked],
            roles=monitoring.proposal.roles,
            newton_step=iteration.newton_step[asked],
            diverged=monitoring.diverged.nonzero()[0],
            std=std,
            chi2=float(monitoring.gram[monitoring.proposal.centre, monitoring.proposal.centre]) / monitoring.samples,
        )


@dataclass(frozen=True)
class Uncertainty:
    """What noise leaves uncertain, of the parameters that were asked for.

    Attributes:
        noise: sensor noise that was assumed or read off the log.
        covariance: shape (n_p, n_p), in the parameters' units.
        inflation: factor in it by which the windows' scores scatter more than the noise explains.
        chi2_per_sample: mean square of the whitened innovations; near 1 if the model explains the log.
        total_std_kg: standard deviation of all masses of the robot together [kg].
        nuisances: what else was estimated.
        nuisance_estimate: shape (n_nuisances,).
        nuisance_std: shape (n_nuisances,).
    """

    noise: SensorNoise
    covariance: FloatArray
    inflation: float
    chi2_per_sample: float
    total_std_kg: float
    nuisances: tuple[Unknown, ...]
    nuisance_estimate: FloatArray
    nuisance_std: FloatArray

    @property
    def std(self) -> FloatArray:
        """Standard deviations, shape (n_p,)."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))


@dataclass(frozen=True)
class Result:
    """What an identification found.

    Attributes:
        space: what was unknown.
        estimate: the final estimate, shape (n_p,).
        status: how it ended.
        windows: every update.
        excitation: what the log reveals of each parameter.
        uncertainty: covariance and nuisances; None for a log without noise.
        verdict: what was said before the fit; None if nobody asked.
        validation: checks against the log itself; None if nobody asked.
        quantities: what was asked for besides masses of links, in units of its own.
        mode: "online" or "offline".
        log_s: time covered by the logs [s].
        wall_s: time it took [s].
        warnings: what the user should know, one line each.
        sources: the logs.
        evidence: robot and logs that it was found from; None if nobody kept them.
        stopped: whether the search was stopped from outside.
        replayed: whether replays of the logs have not settled what one pass had not either.
    """

    space: ParameterSpace
    estimate: FloatArray
    status: Status
    windows: tuple[WindowResult, ...]
    excitation: Excitation
    mode: str
    log_s: float
    wall_s: float
    warnings: tuple[str, ...] = ()
    sources: tuple[str, ...] = ("walk",)
    uncertainty: Uncertainty | None = None
    verdict: Verdict | None = None
    validation: Validation | None = None
    quantities: tuple[Quantity, ...] = ()
    evidence: Evidence | None = field(default=None, repr=False, compare=False)
    stopped: bool = False
    replayed: bool = False

    def __getstate__(self) -> dict[str, Any]:
        """Without robot and logs, which stay where they are: results come back from other processes."""
        return vars(self) | {"evidence": None}

    def stopped_early(self) -> Result:
        """The same, found by a search that was stopped from outside: it has not converged, whatever its last step."""
        settled = self.status in (Status.CONVERGED, Status.CONTRADICTED)
        status = Status.NOT_CONVERGED if settled else self.status
        return replace(self, stopped=True, status=status)

    def denied(self, *, settled_or_not: bool = False) -> Result:
        """The same, which the log contradicts: these are not the robot's masses.

        Args:
            settled_or_not: whether that explains a search that has not converged, too.
        """
        denied = settled_or_not or self.status is Status.CONVERGED
        return replace(self, status=Status.CONTRADICTED) if denied and not self.stopped else self

    def save_model(self, path: Path, *, with_assets: bool = False) -> None:
        """Save the robot's model with what was found in it; what is not identifiable keeps the model file's value.

        Args:
            path: an .xml file; or a .urdf file, if that is what the robot was read from.
            with_assets: copy meshes and textures into a folder beside it.

        Raises:
            BadInputError: nobody kept the robot.
            ModelError: the file cannot be written, or does not give the same robot.
        """
        if self.evidence is None:
            raise BadInputError("This result has no robot with it; `Robot.write_model` writes one.")
        self.evidence.complete.write_model(
            self.space, self.reported, Path(path), remark=self.kept_text, with_assets=with_assets
        )

    @property
    def kept_text(self) -> str:
        """What a saved model does not have from the log, in words; "" if it has all."""
        return f"{', '.join(self.hidden)}: not identifiable, the model file's value kept" if self.hidden else ""

    def checked(self, validation: Validation) -> Result:
        """The result with the checks against its log, and their warnings; no longer converged if they deny it."""
        said = validation.warnings()
        result = replace(self, validation=validation, warnings=self.warnings + said)
        return result.denied() if said else result

    def unknowns(self) -> tuple[ParameterSpace, FloatArray]:
        """Everything that was estimated for the first log, nuisances included, and its values, shape (n,).

        Hidden links have the values that the search ended with: with the others' they add up to what the log does show.
        """
        parameters, values = list(self.space.parameters), self.estimate.tolist()
        if self.uncertainty is not None:
            found = self.uncertainty
            for unknown, value in zip(found.nuisances, found.nuisance_estimate.tolist(), strict=True):
                if unknown.log in (None, 1):
                    parameters.append(unknown.of_log(None))
                    values.append(value)
        return ParameterSpace(tuple(parameters)), np.array(values)

    def judged(self, verdict: Verdict) -> Result:
        """The result under a verdict made before the fit: what it calls hidden is not identified, whatever came out."""
        hidden = {one.name for one in self.space.parameters if isinstance(one, Mass) and one.body in verdict.hidden}
        hidden |= set(verdict.hidden_others)
        seen = [name not in hidden for name in self.space.names]
        excitation = replace(self.excitation, identifiable=self.excitation.identifiable & np.array(seen))
        kept = excitation.identifiable.all() or self.status is Status.CONTRADICTED
        status = self.status if kept else Status.NOT_IDENTIFIABLE
        quantities = tuple(quantity.without(hidden) for quantity in self.quantities)
        result = replace(self, verdict=verdict, excitation=excitation, status=status, quantities=quantities)
        sums = (result.known_sum(one) for one in verdict.sums)
        said = disagreement(verdict, result.unforeseen, result._deviations_kg, result.contradicted, result.log_s)
        return replace(
            result,
            verdict=replace(verdict, sums=tuple(one for one in sums if one is not None)),
            warnings=result.warnings + said,
        )

    @property
    def unsettled(self) -> str | None:
        """Why the search did not converge and what helps, in words; None if it did."""
        if self.stopped:
            return "stopped before the search had settled: what it had found by then"
        if self.status is not Status.NOT_CONVERGED:
            return None
        step = np.abs(self.windows[-1].newton_step)
        worst = int(np.argmax(step / self.space.scale))
        parameter = self.space.parameters[worst]
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        said = f"the last step was still {step[worst]:.2g}{unit} in {parameter.target}"
        if self.replayed:
            return f"{said}, when the log ended, and replays did not settle it: see the warnings for what is wrong"
        if self.mode == "online":
            return f"{said}, when the log ended: replay it (`mode=offline`), or see the warnings for what is wrong"
        return f"{said}: more `passes`, or see the warnings for what is wrong"

    @property
    def contradicted(self) -> bool:
        """Whether the windows of a noisy log contradict each other: model, log or assumed noise are wrong."""
        return self.uncertainty is not None and self.uncertainty.inflation >= LARGEST_INFLATION

    @property
    def unforeseen(self) -> tuple[str, ...]:
        """What the verdict foresaw to be known and the fit left unknown.

        The verdict says less of other quantities than of links; they count if the whole fit is in doubt.
        """
        if self.verdict is None:
            return ()
        found = tuple(link for link in self.hidden_links if link not in self.verdict.hidden)
        if not self.contradicted:
            return found
        others = set(self.verdict.hidden_others)
        return found + tuple(
            one.name for one in self.quantities if not (one.identifiable or others & set(one.parameters))
        )

    def known_sum(self, foreseen: Sum) -> Sum | None:
        """The mass of several links together as found; None if the fit does not know it.

        That is so at the border of Theta, where the search was stopped, and where the windows contradict each other so
        much that links are lost.

        Args:
            foreseen: which links, and a deviation that counts for a log without noise.
        """
        space = self.space
        masses = [isinstance(one, Mass) and one.body in foreseen.links for one in space.parameters]
        chosen = np.array(masses, dtype=np.float64)
        room = np.minimum(self.estimate - space.lower, space.upper - self.estimate) / space.scale
        if (self.contradicted and self.unforeseen) or np.any(room[masses] < _BORDER):
            return None
        std_kg = foreseen.std_kg
        if self.uncertainty is not None:
            std_kg = float(np.sqrt(chosen @ self.uncertainty.covariance @ chosen))
        estimate_kg = float(chosen @ self.estimate)
        return replace(foreseen, std_kg=std_kg, estimate_kg=estimate_kg) if std_kg < KNOWN_SUM * estimate_kg else None

    @property
    def hidden_links(self) -> tuple[str, ...]:
        """The links whose mass the log does not reveal."""
        rows = zip(self.space.parameters, self.excitation.identifiable, strict=True)
        return tuple(parameter.target for parameter, seen in rows if not seen and isinstance(parameter, Mass))

    @property
    def hidden(self) -> tuple[str, ...]:
        """The links whose mass the log does not reveal, and the names of the other quantities that it does not."""
        return self.hidden_links + tuple(quantity.name for quantity in self.quantities if not quantity.identifiable)

    @property
    def reported(self) -> FloatArray:
        """The estimate with the nominal value of what is not identifiable: what a saved model gets, shape (n_p,)."""
        return np.where(self.excitation.identifiable, self.estimate, self.space.nominal)

    @property
    def estimate_kg(self) -> dict[str, float]:
        """Estimated mass of each link [kg]."""
        return self.masses_kg(self.estimate)

    @property
    def nominal_kg(self) -> dict[str, float]:
        """Nominal mass of each link [kg]."""
        return self.masses_kg(self.space.nominal)

    def masses_kg(self, point: FloatArray) -> dict[str, float]:
        """The masses among the coordinates of a point, by link [kg]."""
        return {
            parameter.target: float(value)
            for parameter, value in zip(self.space.parameters, point, strict=True)
            if isinstance(parameter, Mass)
        }

    @property
    def std_kg(self) -> dict[str, float]:
        """Standard deviation of each link's mass [kg]; empty for a log without noise."""
        return {} if self.uncertainty is None else self.masses_kg(self.uncertainty.std)

    @property
    def _deviations_kg(self) -> dict[str, float]:
        """Those of a log without noise as ordinary encoders would leave them."""
        return self.std_kg or self.masses_kg(self.excitation.reference_std)

    @property
    def together(self) -> Sum | None:
        """The sum of all masses asked for; None if it is not known. A log without noise leaves it no deviation."""
        return self.known_sum(Sum(tuple(self.nominal_kg), sum(self.nominal_kg.values()), 0.0))

    def document(
        self,
        reference: ReferenceEntry | UnsetType | None = UNSET,
        options: Settings | None = None,
        sidecar_sha256: str | None = None,
    ) -> Document:
        """The result as a document, without any truth.

        Args:
            reference: another method's masses from the same log; None if the log is too short for it.
            options: settings of the identification, as `IdentifyOptions.to_json` gives them.
            sidecar_sha256: of the file beside it, as `massid.result.sidecar.sidecar_of` gives it.
        """
        return describe_result(self, reference, options, sidecar_sha256)

    def table(self) -> Columns:
        """The masses column by column, all of the same length: ``pandas.DataFrame(result.table())``.

        Returns:
            link: names.
            nominal_kg: of the model file [kg].
            estimate_kg: as found [kg]; nan where the log does not reveal it.
            std_kg: standard deviation [kg]; nan there, and for a log without noise.
            low95_kg, high95_kg: ends of the 95 % interval [kg]; nan likewise.
            identifiable: whether the log reveals it.
        """
        return columns(self)

    def __repr__(self) -> str:
        return one_or_two_lines(self)

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return notebook_html(self)

    def to_json(self) -> dict[str, Any]:
        """The document as plain JSON values."""
        values: dict[str, Any] = plain(self.document())
        return values
