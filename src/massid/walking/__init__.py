"""A model-based torque walker: footsteps, a plan for the divergent component of motion, a whole-body QP."""

from massid.walking.gait import DEFAULT_GAIT, GAITS, Gait, find_gait
from massid.walking.morphology import Morphology, Sole
from massid.walking.stepper import Phase, StepperOptions
from massid.walking.walker import Walker, WalkerOptions

__all__ = [
    "DEFAULT_GAIT",
    "GAITS",
    "Gait",
    "Morphology",
    "Phase",
    "Sole",
    "StepperOptions",
    "Walker",
    "WalkerOptions",
    "find_gait",
]
