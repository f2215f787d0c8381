"""The massid command line."""

from massid.cli.app import main

__all__ = ["main"]
