"""The licence of everything that massid needs at run time, as tests/test_licences.py judges it.

python scripts/licences.py
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.test_licences import Kind, kind_of, licence_files, needed

LONGEST = 60


def main() -> int:
    """Print a table; the exit code is 1 if something asks for more than massid itself does."""
    worst = Kind.PERMISSIVE
    for name, found in sorted(needed().items()):
        kind = kind_of(found.metadata, licence_files(found))
        said = found.metadata["License-Expression"] or next(
            (
                text.rpartition(":: ")[2]
                for text in found.metadata.get_all("Classifier", [])
                if text.startswith("License ::")
            ),
            (found.metadata["License"] or "see its licence file").splitlines()[0],
        )
        sys.stdout.write(f"{name:24} {found.version:14} {kind.name.lower():12} {said[:LONGEST]}\n")
        worst = max(worst, kind)
    return 1 if worst > Kind.PERMISSIVE else 0


if __name__ == "__main__":
    sys.exit(main())
