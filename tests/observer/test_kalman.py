from __future__ import annotations

import numpy as np
import pytest

from massid.observer.inputs import InputBelief
from massid.observer.kalman import KalmanInjection
from massid.observer.linearisation import Lineariser
from massid.observer.replay import replay_block
from massid.typing import FloatArray
from massid.walk import Segment
from massid.walk.noise import PRESETS
from tests.conftest import Pushed
from tests.pushed_robot import FEET

NOISE = PRESETS["white"]


def _second_motion(pushed: Pushed, follows: bool | None) -> FloatArray:
    """Accelerations believed of the second of two blocks, with a restart between them or, for None, without."""
    layout, model = pushed.robot.layout, pushed.robot.identification_model(FEET)
    injection = KalmanInjection(Lineariser(model, layout), layout, NOISE, InputBelief(model, layout, NOISE))
    injection.place(pushed.robot.realise(pushed.space, pushed.truth[None]))
    injection.gains(replay_block(pushed.walk, layout, Segment(300, 351)))
    if follows is not None:
        injection.restart(follows=follows)
    inputs = injection.gains(replay_block(pushed.walk, layout, Segment(350, 401))).inputs
    assert inputs is not None
    return inputs.motion.acceleration


@pytest.mark.parametrize("follows", [True, False])
def test_a_restart_keeps_what_tells_of_the_inputs_if_and_only_if_samples_follow(follows: bool, pushed: Pushed) -> None:
    kept = np.array_equal(_second_motion(pushed, follows), _second_motion(pushed, None))
    assert kept is follows
