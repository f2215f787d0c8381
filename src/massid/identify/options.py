"""How to identify: the bank, the dwell windows, the injection and the search, with defaults that need no tuning."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, TypeAlias, get_args

from massid.errors import BadInputError
from massid.ranges import OptionError, require_at_most, require_not_negative, require_positive
from massid.search.directions import direction_name
from massid.search.guided import SearchOptions, enough_models
from massid.walk.noise import NoisePreset

NoiseChoice: TypeAlias = Literal["auto", "clean", "white", "realistic", "harsh"]
"""What is known of a log's sensors."""
USUAL_BANK = 24
"""Models of a bank, unless there are many unknowns."""


LARGEST_BANK, MOST_THREADS = 2000, 1024
"""More models than that take gigabytes, and more threads than any machine has are a slip of the hand."""


@dataclass(frozen=True)
class IdentifyOptions:
    """Settings of an identification.

    Attributes:
        bank_size: identification models that run in parallel; None for 24, or for many unknowns three each and three
            more.
        dwell_s: length T of a dwell window [s]; model states are reset at its start only.
        bandwidth_rad_s: w of the output injection K1 = w^2 H0, K2 = 2 zeta w H0 (clean logs only) [rad/s].
        damping_ratio: zeta of the output injection (clean logs only).
        forgetting_rate: lambda of the monitoring signal, Eq. 6 (clean logs only) [1/s].
        passes: offline only: how often the log is replayed at most.
        noise: sensor noise of the log: clean, white, realistic or harsh, or auto to read white noise off the log and
            take offsets and gains as in realistic.
        other_links: relative standard deviation of the masses of links that are not asked for (noisy logs only).
        link_inertia: relative standard deviation of the rotational inertia, at its mass, of each link that is asked for
            (noisy logs only).
        lag_s: standard deviation of the times by which torques and wrenches are stamped late (noisy logs only) [s]. The
            default is half a cycle of a 1 kHz bus, what a reading waits for on average.
        total_mass_kg: what the whole robot weighed on scales (noisy logs only); None if nobody weighed it [kg].
        total_mass_std_kg: standard deviation of that [kg].
        threads: worker threads of the bank; 0 for one per processor.
        seed: seeds the sampling; the same seed gives the same result at any number of threads.
        search: how directions and steps are computed.
    """

    bank_size: int | None = None
    dwell_s: float = 0.5
    bandwidth_rad_s: float = 60.0
    damping_ratio: float = 1.0
    forgetting_rate: float = 1.0
    passes: int = 20
    noise: NoiseChoice = "auto"
    other_links: float = 0.02
    link_inertia: float = 0.1
    lag_s: float = 5e-4
    total_mass_kg: float | None = None
    total_mass_std_kg: float = 0.2
    threads: int = 0
    seed: int = 0
    search: SearchOptions = field(default_factory=SearchOptions)

    def models(self, n_unknowns: int) -> int:
        """Size of the bank for so many unknowns that models are sampled in."""
        return self.bank_size or max(USUAL_BANK, enough_models(n_unknowns))

    def to_json(self) -> dict[str, Any]:
        """As plain JSON values, an infinite one as null."""
        search_options = replace(self.search, direction=direction_name(self.search.direction))
        document = asdict(replace(self, search=search_options))
        search = document.pop("search")
        return {name: _finite(value) for name, value in document.items()} | {
            "search": {name: _finite(value) for name, value in search.items()}
        }

    def __post_init__(self) -> None:
        known = ("auto", *get_args(NoisePreset))
        if self.noise not in known:
            raise BadInputError(f"`noise` is {self.noise!r}; expected one of {', '.join(known)}.")
        if not isinstance(self.search, SearchOptions):
            raise BadInputError(f"search is a {type(self.search).__name__}; expected SearchOptions.")
        for name in ("bank_size", "passes", "threads", "seed"):
            value = getattr(self, name)
            if value is not None and value != int(value):
                raise OptionError(name, value, "a whole number")
        require_positive(
            {
                "bank_size": USUAL_BANK if self.bank_size is None else self.bank_size,
                "dwell_s": self.dwell_s,
                "bandwidth_rad_s": self.bandwidth_rad_s,
                "passes": self.passes,
                "total_mass_kg": 1.0 if self.total_mass_kg is None else self.total_mass_kg,
                "total_mass_std_kg": self.total_mass_std_kg,
            }
        )
        require_at_most(LARGEST_BANK, {"bank_size": self.bank_size or USUAL_BANK})
        require_at_most(MOST_THREADS, {"threads": self.threads})
        require_not_negative(
            {
                "damping_ratio": self.damping_ratio,
                "forgetting_rate": self.forgetting_rate,
                "other_links": self.other_links,
                "link_inertia": self.link_inertia,
                "lag_s": self.lag_s,
                "threads": self.threads,
                "seed": self.seed,
            }
        )


_FOR_CLEAN = ("bandwidth_rad_s", "damping_ratio", "forgetting_rate")
_FOR_NOISY = ("other_links", "link_inertia", "lag_s", "total_mass_kg", "total_mass_std_kg")


def idle_options(options: IdentifyOptions, noisy: bool) -> tuple[str, ...]:
    """What was changed and has no effect on such a log, one line each."""
    kind, names = ("a noisy", _FOR_CLEAN) if noisy else ("a clean", _FOR_NOISY)
    usual = IdentifyOptions()
    changed = [name for name in names if getattr(options, name) != getattr(usual, name)]
    return tuple(f"`{name}` has no effect on {kind} log." for name in changed)


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
