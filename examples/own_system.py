"""A system of one's own in some thirty lines: gravity and friction of a motor-driven pendulum, found while it swings.

python examples/own_system.py
"""

import math

import numpy as np

from massid.search.guided import GuidedSearch
from massid.search.parameters import ParameterSpace
from massid.systems.bank import SystemBank
from massid.systems.online import run_online
from massid.systems.plant import Controller, Plant
from massid.systems.system import System, coefficient


def pendulum(x, p, u, dx):
    """State (angle, speed), unknowns (gravity, friction, dry friction), input (torque)."""
    dx[0] = x[1]
    dx[1] = u[0] - p[0] * math.sin(x[0]) - p[1] * x[1] - p[2] * math.tanh(20.0 * x[1])


def swing(time, x, p, settings, u):
    """Torque over time, whatever the state and the estimate are."""
    u[0] = 6.0 * math.sin(1.7 * time) + 3.0 * math.sin(0.6 * time)


def main() -> np.ndarray:
    """Swing for 18 s and print what is known after every dwell window."""
    unknowns = (coefficient("gravity", 7.0, 0, 20), coefficient("friction", 1.0, 0, 5), coefficient("dry", 0.0, 0, 2))
    system = System("pendulum", pendulum, n_x=2, n_u=1, space=ParameterSpace(unknowns), gain=20.0 * np.eye(2))
    plant = Plant(system, truth=np.array([9.81, 0.3, 0.8]), controller=Controller(swing), start=np.zeros(2))
    bank, search = SystemBank(system, n_models=9, timestep_s=1e-3), GuidedSearch(system.space, n_models=9)
    run = run_online(plant, bank, search, windows=6, dwell_s=3.0, forgetting_rate=0.1)
    for time_s, estimate in zip(run.times_s, run.estimates, strict=True):
        print(f"{time_s:4.0f} s  gravity {estimate[0]:.5f}  friction {estimate[1]:.5f}  dry friction {estimate[2]:.5f}")
    return run.estimates[-1]


if __name__ == "__main__":
    main()
