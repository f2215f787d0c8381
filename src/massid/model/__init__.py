"""The robot: its MJCF, names and masses, what is unknown of it, and what points of Theta make of it."""

from massid.model.robot import Robot

__all__ = ["Robot"]
