"""Do several logs show robots of the same masses? A payload in one of them makes every common answer wrong.

Each log's force balance is solved for the masses of all links; what is between those of two logs is then judged by the
covariances of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from massid.audit.balance import measure_balance
from massid.audit.balance_fit import fit_balance
from massid.audit.prepare import Prepared

_SURE = 4.5
"""Deviations by which a link must differ; of the largest of thirty that do not it is 2 to 3."""
_FLOOR = 0.005
"""Of a mass, as a deviation: what integration and interpolation leave of a log without noise."""
_INTERVAL = 1.96


def differing_masses(prepared: Sequence[Prepared]) -> tuple[str, ...]:
    """Say which logs show robots of different masses, and what differs most, one line for each pair.

    Args:
        prepared: logs of one robot, checked; those whose forces nothing explains say nothing of masses.
    """
    if len(prepared) < 2:
        return ()
    balances = [(one, measure_balance(one.robot, one.walk)) for one in prepared if not one.audit.doubts]
    fits = [(one, fit_balance(one.robot, one.walk, balance)) for one, balance in balances if balance is not None]
    lines = []
    for (first, of_first), (second, of_second) in combinations(fits, 2):
        common = [link for link in of_first.links if link in of_second.links]
        a, b = ([fit.links.index(link) for link in common] for fit in (of_first, of_second))
        difference = of_second.errors[b] - of_first.errors[a]
        spread = of_first.covariance[np.ix_(a, a)] + of_second.covariance[np.ix_(b, b)]
        precision = np.linalg.inv(spread + 2.0 * _FLOOR**2 * np.eye(len(common)))
        # The one link that explains most of the difference, if it alone had another mass.
        power = np.diagonal(precision)
        change = (precision @ difference) / power
        link = int(np.argmax(np.abs(change) * np.sqrt(power)))
        if abs(change[link]) * np.sqrt(power[link]) < _SURE:
            continue
        kg = first.robot.nominal_mass_kg(common[link])
        more = "heavier" if change[link] > 0.0 else "lighter"
        lines.append(
            f"{first.walk.source} and {second.walk.source} are of robots with different masses: {common[link]}, or "
            f"what it carries, is {abs(change[link]) * kg:.2g} +-{_INTERVAL * kg / np.sqrt(power[link]):.1g} kg "
            f"{more} in {second.walk.source}, if it alone differs. One set of masses cannot be found from both: "
            "identify them one at a time."
        )
    return tuple(lines)
