"""A small result without a log: two links, one of which may be hidden, and a centre of mass."""

from __future__ import annotations

import numpy as np

from massid.model.unknowns.bodies import Mass
from massid.result import Result, Status, Uncertainty, WindowResult
from massid.result.excitation import Excitation
from massid.result.quantities import Quantity
from massid.search.parameters import ParameterSpace
from massid.search.proposal import Role
from massid.walk.noise import SensorNoise
from tests.result.samples import HIDDEN

ESTIMATE = np.array([4.4, 2.3])  # kg
STD = np.array([0.1, 1.0])  # kg


def small_result(noisy: bool = True, hidden: bool = True) -> Result:
    """What an identification of `torso` and `HIDDEN` could have found."""
    space = ParameterSpace((Mass.of("torso", 4.0), Mass.of(HIDDEN, 2.0)))
    window = WindowResult(
        index=0,
        time_s=0.5,
        estimate=ESTIMATE,
        mu=np.array([0.2, 0.1]),
        best=1,
        points=np.array([space.nominal, ESTIMATE]),
        roles=(Role.CENTRE, Role.SAMPLE),
        newton_step=np.array([0.01, 0.02]),
        diverged=np.array([], dtype=np.int64),
        std=STD if noisy else None,
        chi2=1.02,
    )
    uncertainty = Uncertainty(
        noise=SensorNoise(force=2.0),
        covariance=np.diag(STD**2),
        inflation=1.0,
        chi2_per_sample=1.01,
        total_std_kg=1.1,
        nuisances=(),
        nuisance_estimate=np.array([]),
        nuisance_std=np.array([]),
    )
    com = "com/torso/x"
    return Result(
        space=space,
        estimate=ESTIMATE,
        status=Status.NOT_IDENTIFIABLE if hidden else Status.CONVERGED,
        windows=(window,),
        excitation=Excitation(STD, np.array([True, not hidden]), 1.0),
        mode="online",
        log_s=0.5,
        wall_s=0.1,
        uncertainty=uncertainty if noisy else None,
        quantities=(Quantity(com, "m", 0.1, 0.12, 0.005 if noisy else None, True, (com,)),),
    )
