"""Do several logs show robots of the same masses? A payload in one of them makes every common answer wrong.

Each log's force balance is solved for the masses of all links and for what its sensors' offsets and gains may be; what
is between the masses of two logs is then judged by the covariances of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from massid.audit.balance import Balance, measure_balance
from massid.audit.forces import slow_errors
from massid.audit.prepare import Prepared
from massid.model.robot import Robot
from massid.typing import FloatArray
from massid.walk import Walk

_SURE = 4.5
"""Deviations by which a link must differ; of the largest of thirty that do not it is 2 to 3."""
_FLOOR = 0.005
"""Of a mass, as a deviation: what integration and interpolation leave of a log without noise."""
_CORRELATED = 3.0
"""Smoothed terms overlap: so many of them tell as much as one."""
_SMOOTHING_S = 0.1
"""Over which noise of the velocities leaves the forces of a walk clear."""
_ROUNDS = 4
_LEAST_NOISE = 1e-9  # of the force that a degree of freedom takes
_VAGUE = 10.0
_INTERVAL = 1.96


@dataclass(frozen=True)
class _Fit:
    """Relative mass errors of all links, shape (n_links,), and their covariance."""

    links: tuple[str, ...]
    errors: FloatArray
    covariance: FloatArray


def differing_masses(prepared: Sequence[Prepared]) -> tuple[str, ...]:
    """Say which logs show robots of different masses, and what differs most, one line for each pair.

    Args:
        prepared: logs of one robot, checked; those whose forces nothing explains say nothing of masses.
    """
    if len(prepared) < 2:
        return ()
    balances = [(one, measure_balance(one.robot, one.walk)) for one in prepared if not one.audit.doubts]
    fits = [(one, _fit(one.robot, one.walk, balance)) for one, balance in balances if balance is not None]
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


def _fit(robot: Robot, walk: Walk, balance: Balance) -> _Fit:
    """Solve the balance for masses and sensor errors, the latter with their priors."""
    balance = replace(
        balance, smoothing=min(round(_SMOOTHING_S / walk.timestep_s), *(len(s) // 2 for s in balance.stretches))
    )
    effort, wrench = walk.effort[balance.rows], walk.wrench[balance.rows]
    masses = balance.smooth(balance.per_link)
    slow = np.stack(list(slow_errors(robot, walk, balance, effort, wrench)), axis=1)
    columns = np.hstack([masses, slow])
    supplied = balance.force_of_torques(effort, robot) + balance.force_of(wrench)
    target = balance.smooth(supplied - balance.required)
    count, dofs = masses.shape[1], balance.required.shape[1]
    prior = np.diag(np.concatenate([np.full(count, _VAGUE**-2), np.ones(slow.shape[1])]))
    noise = np.full(dofs, float(np.sqrt(np.mean(target**2))))
    for _ in range(_ROUNDS):  # the noise of each degree of freedom, and how far the priors hold against it
        weight = np.tile(1.0 / noise, len(target) // dofs)
        weighted = columns * weight[:, None]
        precision = weighted.T @ weighted / _CORRELATED + prior
        solution = np.linalg.solve(precision, weighted.T @ (target * weight) / _CORRELATED)
        rest = (target - columns @ solution).reshape(-1, dofs)
        noise = np.maximum(np.sqrt(np.mean(rest**2, axis=0)), _LEAST_NOISE)
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
    return _Fit(balance.links, np.asarray(solution[:count]), covariance[:count, :count])
