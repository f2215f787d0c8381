"""What pyproject.toml asks for, with some of its groups: what `make lock` finds versions and hashes of.

python scripts/requirements_of.py dev compare
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


def requirements(groups: list[str]) -> list[str]:
    """Of the package itself, and of the groups."""
    content = tomllib.loads(PROJECT.read_text())
    return content["project"]["dependencies"] + [
        line for group in groups for line in content["dependency-groups"][group]
    ]


if __name__ == "__main__":
    sys.stdout.write("\n".join(requirements(sys.argv[1:])) + "\n")
