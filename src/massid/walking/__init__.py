"""A model-based torque walker: footsteps, a plan for the divergent component of motion, a whole-body QP."""

from massid.walking.gait import GAITS, Gait, find_gait
from massid.walking.morphology import Morphology, Sole
from massid.walking.walker import Walker, WalkerOptions

__all__ = ["GAITS", "Gait", "Morphology", "Sole", "Walker", "WalkerOptions", "find_gait"]
