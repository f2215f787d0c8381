"""What can be unknown of a robot and of its sensors, and the spaces that such unknowns span."""

from massid.model.unknowns import bodies, joints, lags, sensors

__all__ = ["bodies", "joints", "lags", "sensors"]
