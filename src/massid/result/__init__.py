"""What an identification found: the answer as data, with its uncertainty, in memory and on disk."""

from massid.result.result import Result, Status, Uncertainty, WindowResult

__all__ = ["Result", "Status", "Uncertainty", "WindowResult"]
