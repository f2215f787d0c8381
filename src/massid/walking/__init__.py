"""A model-based torque walker: footsteps, a plan for the divergent component of motion, a whole-body QP.

Robots with position servos are walked by targets that it sets.
"""

from massid.walking.gait import DEFAULT_GAIT, GAITS, Gait, find_gait
from massid.walking.morphology import Morphology, Sole
from massid.walking.servo import ServoOptions, Servos, ServoWalker, driven_by_servos
from massid.walking.stepper import Phase, StepperOptions
from massid.walking.walker import Walker, WalkerOptions

__all__ = [
    "DEFAULT_GAIT",
    "GAITS",
    "Gait",
    "Morphology",
    "Phase",
    "ServoOptions",
    "ServoWalker",
    "Servos",
    "Sole",
    "StepperOptions",
    "Walker",
    "WalkerOptions",
    "driven_by_servos",
    "find_gait",
]
