"""What an unknown of a robot is: a number that knows its name, what it writes into a model and what it does.

A new one is a class like those of `bodies`, `joints`, `sensors` and `lags`, in a file of its own or in a user's script:
its fields say where it sits, `write` puts values of it into models and sensors, and `effect` says what a unit more of
it does to a motion. It can then be asked for by name, searched, estimated as a nuisance, judged and saved.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from typing import TYPE_CHECKING, ClassVar, Self, TypedDict

import mujoco
import numpy as np

from massid.errors import BadInputError
from massid.model.layout import Channels
from massid.model.motion import Motion
from massid.search.parameters import Parameter, ParameterSpace
from massid.typing import FloatArray

if TYPE_CHECKING:
    from massid.model.draft import Draft
    from massid.model.robot import Robot

ALL = "all"
"""Target of what is one number for all of its kind."""
NUISANCE_REACH = 8.0
"""Theta of a nuisance, in standard deviations of its prior."""
KINDS: dict[str, type[Unknown]] = {}
"""Every kind of unknown by its name, a user's own ones included."""


@dataclass(frozen=True)
class Effect:
    """What one unit more of an unknown does along n instants of a motion; None for nothing.

    Attributes:
        force: generalised force that acts more, shape (n, nv) [N m or N].
        wrench: that acts more on the contact bodies, in their frames, shape (n, 6 n_contacts) [N, N m].
        measured: by how much the measured state is more, the same at all instants: positions then velocities in the
            tangent space, shape (2 nv,).
    """

    force: FloatArray | None = None
    wrench: FloatArray | None = None
    measured: FloatArray | None = None

    @property
    def is_nothing(self) -> bool:
        """Whether nothing acts and nothing is measured more."""
        return self.force is None and self.wrench is None and self.measured is None

    @classmethod
    def on_joint(cls, channels: Channels, joint: str, torque: FloatArray) -> Effect:
        """A torque on one joint along the motion, shape (n,) [N m or N]."""
        force = np.zeros((len(torque), channels.model.nv))
        force[:, channels.dof(joint)] = torque
        return cls(force=force)

    @classmethod
    def on_axis(cls, channels: Channels, body: str, axis: int, load: FloatArray) -> Effect:
        """A load along one axis of a contact sensor, shape (n,) [N or N m]."""
        wrench = np.zeros((len(load), 6 * len(channels.contact_bodies)))
        wrench[:, channels.axis(body, axis)] = load
        return cls(wrench=wrench)


@dataclass(frozen=True)
class Unknown(Parameter, ABC):
    """One unknown number of a robot or of its sensors.

    A subclass is a frozen dataclass. Its own fields, such as a joint's name, say where it sits and make up its target:
    "l_knee", "l_foot/2". It is registered under its `kind` by being defined.

    Attributes:
        kind: the word before the target in its name.
        title: what several of them are called in a report.
        per_walk: whether it is an error of a sensor, constant within a walk and another one in the next.
        adds_mass: mass that a unit more of it adds to the whole robot [kg].
        log: number of the log, from 1, that an error of a sensor belongs to; None if there is but one.
    """

    kind: ClassVar[str]
    title: ClassVar[str]
    per_walk: ClassVar[bool] = False
    adds_mass: ClassVar[float] = 0.0

    target: str = field(init=False)
    _: KW_ONLY
    log: int | None = None

    def __init_subclass__(cls) -> None:
        """Register a class that has a kind of its own; a user's own may be defined once more, as in a notebook.

        Raises:
            BadInputError: a class of this package has the kind.
        """
        kind = cls.__dict__.get("kind")
        if kind is None:
            return
        package, taken = __name__.partition(".")[0], KINDS.get(kind)
        if taken is not None and taken.__module__.startswith(f"{package}."):
            raise BadInputError(f"{cls.__qualname__}: unknowns of kind '{kind}' are {taken.__qualname__} already.")
        KINDS[kind] = cls

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", self.where)
        super().__post_init__()

    @property
    def where(self) -> str:
        """What it belongs to, as in its name: its own fields, with slashes between them."""
        return "/".join(str(getattr(self, own.name)) for own in fields(self) if own.init and not own.kw_only) or ALL

    @property
    def name(self) -> str:
        """Unique name such as "mass/l_thigh", with the number of the log after an @ if there are several."""
        return f"{self.kind}/{self.target}" + ("" if self.log is None else f"@{self.log}")

    @property
    def label(self) -> str:
        """Where it sits, as a reader would say it."""
        return self.target

    def of_log(self, number: int | None) -> Self:
        """The same of one of several logs."""
        return replace(self, log=number)

    @classmethod
    def ask(cls, robot: Robot, target: str) -> Sequence[Unknown]:
        """The unknowns that KIND/TARGET asks for; some targets stand for several, such as all axes of a body.

        Raises:
            BadInputError: the robot has no such target, or the kind cannot be asked for by name.
        """
        raise BadInputError(f"{cls.kind}/{target}: {cls.title} cannot be asked for by name.")

    @abstractmethod
    def write(self, draft: Draft, values: FloatArray) -> None:
        """Put values of it into N models and their sensors.

        Args:
            draft: what the unknowns before it have written, too; errors of sensors add up.
            values: shape (N,).
        """

    def write_spec(self, spec: mujoco.MjSpec, value: float) -> None:
        """Put a value of it into a spec that is to be saved: what it writes besides bodies and sensors."""

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """What a unit more of it does, besides what follows from the bodies that it writes; nothing by default.

        Args:
            motion: n instants.
            channels: which column belongs to what.
        """
        return Effect()


class Numbers(TypedDict):
    """The numbers of a parameter, to be given to its class by keywords."""

    nominal: float
    lower: float
    upper: float
    scale: float
    prior_std: float | None
    requested: bool
    tangent: bool


def nuisance(prior_std: float, nominal: float = 0.0) -> Numbers:
    """Of something that is not asked for and not exactly known; estimated within eight deviations of its prior."""
    reach = NUISANCE_REACH * prior_std
    return {
        "nominal": nominal,
        "lower": nominal - reach,
        "upper": nominal + reach,
        "scale": prior_std,
        "prior_std": prior_std,
        "requested": False,
        "tangent": True,
    }


def unknowns_of(space: ParameterSpace) -> tuple[Unknown, ...]:
    """The parameters of a space as unknowns of a robot.

    Raises:
        BadInputError: some are not.
    """
    found = tuple(parameter for parameter in space.parameters if isinstance(parameter, Unknown))
    if len(found) < len(space):
        strange = ", ".join(one.name for one in space.parameters if not isinstance(one, Unknown))
        raise BadInputError(f"A robot has no {strange}: its unknowns are of the kinds {', '.join(KINDS)}.")
    return found


def adds_mass(space: ParameterSpace) -> FloatArray:
    """Mass that a unit more of each coordinate adds to the whole robot, shape (n_p,) [kg]."""
    return np.array([unknown.adds_mass for unknown in unknowns_of(space)])
