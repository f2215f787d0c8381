"""The check by held-out torques must not mislead: the true masses beat the model file on every shipped robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest


@pytest.mark.parametrize("name", ["atlas", "heavy", "light", "nimble", "geared"])
def test_true_masses_leave_less_of_held_out_torques_than_the_model_file(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "scripts"))
    from bench_held_out import Bench, measure, trials

    bench = Bench(robots=(name,), presets=("white",), seconds=2.2, logs=tmp_path)
    (trial,) = trials(bench)
    error_kg, file, found, true = measure(trial, held_out=0.6, passes=1)
    assert true < file
    assert np.isfinite([error_kg, found]).all()
