"""Whatever a robot's file says of integration, a log is identified and inspected; what exactness it costs is said."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from massid.cli import main
from massid.model.unknowns.spaces import mass_space
from massid.walk.noise import PRESETS, Sensors
from tests.cli.test_cli import write_walk
from tests.pushed_robot import FEET, LINKS, draw_truth, make_robot, push_about

ENABLE, DISABLE = mujoco.mjtEnableBit, mujoco.mjtDisableBit
INVERSE_FLAGS = int(ENABLE.mjENBL_INVDISCRETE | ENABLE.mjENBL_FWDINV)
CASES = [
    ("Euler", 0, 0),
    ("Euler", int(DISABLE.mjDSBL_DAMPER), INVERSE_FLAGS),
    ("implicit", 0, 0),
    ("implicitfast", 0, INVERSE_FLAGS),
    ("discrete", 0, 0),
    ("RK4", 0, 0),
    ("RK4", int(DISABLE.mjDSBL_EULERDAMP), INVERSE_FLAGS),
]


@pytest.mark.parametrize(("integrator", "disabled", "enabled"), CASES)
def test_every_integrator_is_identified_and_inspected(
    integrator: str, disabled: int, enabled: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = make_robot(integrator, disabled=disabled)
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed=3)
    clean = push_about(robot, space, truth, seconds=0.6, amplitude=0.2)
    noisy = Sensors(PRESETS["white"], len(clean.joint_names), FEET, np.random.default_rng(0)).measure(clean)
    model = tmp_path / "robot.xml"
    robot.spec.option.enableflags |= enabled  # for its file alone: with these the engine makes no step of RK4
    model.write_text(robot.spec.to_xml())
    for name, walk in (("clean", clean), ("noisy", noisy)):
        log, result = write_walk(tmp_path / f"{name}.mcap", walk), tmp_path / f"{name}.json"
        given = [str(log), "--model", str(model), "--links", ",".join(LINKS)]
        assert main(["inspect", *given]) == 0
        assert ("integrates with RK4" in capsys.readouterr().out) == (integrator == "RK4")
        fast = ["--dwell-s", "0.2", "--held-out", "0", "--mode", "online", "--json", str(result)]
        assert main(["identify", *given, *fast]) in (0, 3, 4)
        assert ("integrates with RK4" in capsys.readouterr().err) == (integrator == "RK4")
    found = json.loads((tmp_path / "clean.json").read_text())["links"]
    error_kg = np.linalg.norm([found[link]["estimate_kg"] - true for link, true in zip(LINKS, truth, strict=True)])
    # Runge-Kutta's step has no single torque and wrench; the others are replayed exactly.
    limit = 0.5 if integrator == "RK4" else 1e-3
    assert error_kg < limit * np.linalg.norm(truth - space.nominal)
