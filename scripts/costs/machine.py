"""What the figures were measured on and with."""

from __future__ import annotations

import os
import platform
import re
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("massid", "mujoco", "numpy", "scipy", "cma")


def describe_machine() -> str:
    """Processor, cores that may be used, system and versions, in one line."""
    versions = [f"{name} {_version(name)}" for name in PACKAGES]
    named = ["Python " + platform.python_version(), *versions]
    return f"{_processor()}, {_cores()} cores, {platform.system()}; {', '.join(named)}"


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    found = re.search(r"^model name\s*:\s*(.+)$", info.read_text(), re.MULTILINE) if info.exists() else None
    return found[1].strip() if found else platform.processor() or platform.machine()


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
