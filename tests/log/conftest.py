from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.log.samples import Foreign, Samples, make_samples, write_samples


@pytest.fixture
def samples() -> Samples:
    """Enough samples for several chunks."""
    return make_samples(1000)


@pytest.fixture
def log(tmp_path: Path, samples: Samples) -> Path:
    return write_samples(tmp_path / "walk.mcap", samples)


@pytest.fixture
def foreign(tmp_path: Path) -> Callable[..., Foreign]:
    def make(n: int = 40) -> Foreign:
        return Foreign(tmp_path / "foreign.mcap", make_samples(n))

    return make
