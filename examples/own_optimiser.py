"""The bank under another optimiser: CMA-ES (`pip install cma`) asks for 24 points, the bank scores them all at once.

python examples/own_optimiser.py
"""

from dataclasses import replace

import cma
import numpy as np

import massid


def main(generations: int = 60) -> dict[str, float]:
    """Weigh seven links from one second of the sample walk, in units of their nominal masses."""
    walk = massid.read_walk(massid.sample_walk())
    one_second = replace(walk, segments=(massid.Segment(1000, 2001),))
    job = massid.Weighing.prepare(one_second, "atlas", held_out=0.0)
    bank, nominal_kg = job.replay(n_models=24), job.asked.nominal
    settings = {"popsize": 24, "seed": 1, "bounds": [0.3, 2.5], "verbose": -9}
    search = cma.CMAEvolutionStrategy(np.ones(len(nominal_kg)), 0.2, settings)
    for generation in range(generations):
        points = search.ask()
        mu = bank.score(np.array(points) * nominal_kg)
        search.tell(points, mu.tolist())
        if generation % 10 == 0:
            print(f"{generation:3d}: best mu {mu.min():.2e}")
    found_kg = search.result.xbest * nominal_kg
    return dict(zip(job.nominal_kg, found_kg.tolist(), strict=True))


if __name__ == "__main__":
    print({link: round(mass_kg, 2) for link, mass_kg in main().items()})
