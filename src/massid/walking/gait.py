"""How a robot shall walk: step sizes, timing, randomness, and motions that make the links' masses visible."""

from __future__ import annotations

from dataclasses import dataclass, replace

from massid.errors import BadInputError, unknown_name

REFERENCE_LEG_M = 0.87
"""Lengths and durations of a Gait are those of a robot with legs of this length; others scale them."""


@dataclass(frozen=True)
class Gait:
    """One way of walking.

    Lengths are for legs of 0.87 m from hip to sole and scale with the robot's legs; durations and speeds scale with the
    root.

    Attributes:
        name: short name.
        description: one line for a list of gaits.
        forward_m: advance of a foot beyond the stance foot.
        sideways_m: distance walked to the left (negative: right) in each pair of steps.
        turn_rad: turn to the left of each step.
        random_forward_m: half range of a uniform addition to each step's advance.
        random_sideways_m: largest widening of a step, uniform from zero.
        random_turn_rad: half range of a uniform addition to each step's turn.
        random_duration: half range of a uniform relative change of each single support.
        random_apex_m: largest addition to the apex of a swing, uniform from zero.
        apex_m: highest point of a swing above the floor.
        landing_m_s: speed at which a foot comes down on the floor; zero sets it down gently.
        single_support_s: duration of a swing.
        double_support_s: duration of the weight's transfer between two swings.
        first_shift_s: duration of the first transfer, from standing onto one foot.
        arm_rad: amplitude of the arms' motion.
        torso_rad: amplitude of the torso's roll, pitch and yaw.
        height_m: amplitude of the centre of mass's height.
        steps: number of steps before the robot stands still again; None: it goes on.
    """

    name: str
    description: str
    forward_m: float = 0.0
    sideways_m: float = 0.0
    turn_rad: float = 0.0
    random_forward_m: float = 0.0
    random_sideways_m: float = 0.0
    random_turn_rad: float = 0.0
    random_duration: float = 0.0
    random_apex_m: float = 0.0
    apex_m: float = 0.07
    landing_m_s: float = 0.0
    single_support_s: float = 0.6
    double_support_s: float = 0.2
    first_shift_s: float = 1.2
    arm_rad: float = 0.0
    torso_rad: float = 0.0
    height_m: float = 0.0
    steps: int | None = None

    def __post_init__(self) -> None:
        """Refuse durations and heights that no walk can have.

        Raises:
            BadInputError: a duration or the apex is not positive, or an amplitude is negative.
        """
        for field in ("apex_m", "single_support_s", "double_support_s", "first_shift_s"):
            if not getattr(self, field) > 0.0:
                raise BadInputError(f"Gait '{self.name}': {field} is {getattr(self, field)}; it must be above zero.")
        amplitudes = ("random_forward_m", "random_sideways_m", "random_turn_rad", "random_duration", "random_apex_m")
        for field in (*amplitudes, "landing_m_s", "arm_rad", "torso_rad", "height_m"):
            if not getattr(self, field) >= 0.0:
                raise BadInputError(f"Gait '{self.name}': {field} is {getattr(self, field)}; it must not be negative.")
        if self.random_duration >= 0.5:
            raise BadInputError(f"Gait '{self.name}': random_duration is {self.random_duration}; it must be below 0.5.")

    def excited(self, arm_rad: float = 0.25, torso_rad: float = 0.12, height_m: float = 0.02) -> Gait:
        """The same gait with arms, torso and height in motion."""
        return replace(self, arm_rad=arm_rad, torso_rad=torso_rad, height_m=height_m)


_STAND = Gait(name="stand", description="stand on both feet", steps=0)
_STRAIGHT = Gait(name="straight", description="straight ahead", forward_m=0.2).excited()
_BACKWARD = Gait(name="backward", description="straight back", forward_m=-0.15).excited()
_TURN = Gait(name="turn", description="on a circle to the left", forward_m=0.15, turn_rad=0.12).excited()
_SIDEWAYS = Gait(name="sideways", description="to the left, facing ahead", sideways_m=0.12).excited()
_RANDOM = Gait(
    name="random",
    description="random steps: length, width, heading, duration, height",
    forward_m=0.08,
    random_forward_m=0.14,
    random_sideways_m=0.08,
    random_turn_rad=0.12,
    random_duration=0.12,
    random_apex_m=0.05,
).excited()
_STAMP = replace(
    _RANDOM,
    name="stamp",
    description="random steps, short and quick, that come down hard",
    random_apex_m=0.03,
    apex_m=0.08,
    landing_m_s=1.0,
    single_support_s=0.38,
    double_support_s=0.03,
    first_shift_s=0.9,
)

GAITS: dict[str, Gait] = {g.name: g for g in (_RANDOM, _STRAIGHT, _BACKWARD, _TURN, _SIDEWAYS, _STAMP, _STAND)}
"""Gaits by name; the first is the default."""

DEFAULT_GAIT = "random"


def find_gait(name: str) -> Gait:
    """Look a gait up by its name.

    Raises:
        BadInputError: there is no such gait; the message lists those that exist.
    """
    if name not in GAITS:
        raise BadInputError(unknown_name("gait", name, GAITS, "The walker"))
    return GAITS[name]
