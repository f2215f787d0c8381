"""How many steps the models of a noisy log take from one sample to the next: as many as explain the readings best.

A model file's time step is a setting of whoever simulates with it, not a property of the robot. A log of the real robot
knows no step at all, and one from a simulator that of its writer, which may be finer than the file's. At an impact the
difference is larger than sensor noise, and masses make up for it. What the models of both leave unexplained tells them
apart long before masses are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from massid.model.robot import Robot
from massid.observer.sensors import NoisySensors
from massid.search.parameters import ParameterSpace
from massid.walk import Segment, Walk

STRETCHES, STRETCH_S, SETTLING_S = 4, 0.25, 0.1
"""How many stretches of a walk are looked at, how long they are, and after what time models have settled [s]."""
MOST_HALVINGS = 3
"""Steps are halved no more often than that."""
CLEARLY = 0.01
"""Share by which shorter steps must explain a log better."""


def with_suitable_steps(
    sensors: NoisySensors, walk: Walk, robot: Robot, asked: ParameterSpace
) -> tuple[NoisySensors, tuple[str, ...]]:
    """The sensor model with the number of steps that suits a log, and a line on it if that is not the model file's.

    Args:
        sensors: of the log.
        walk: aligned with the robot.
        robot: with nominal masses.
        asked: the parameters asked for.
    """
    stretches = _stretches(walk)
    own = robot.steps_in(walk.timestep_s)
    if not stretches:
        return sensors, ()
    steps, least = own, _unexplained(replace(sensors, steps=own), walk, robot, asked, stretches)
    first = least
    for halving in range(1, MOST_HALVINGS + 1):
        finer = own * 2**halving
        left = _unexplained(replace(sensors, steps=finer), walk, robot, asked, stretches)
        if not left < (1.0 - CLEARLY) * least:
            break
        steps, least = finer, left
    suited = replace(sensors, steps=steps)
    if steps == own:
        return suited, ()
    return suited, (
        f"{walk.source}: models that take steps of {walk.timestep_s / steps:.3g} s explain the readings better than "
        f"those of {walk.timestep_s / own:.3g} s, nearest to the model file's (at the file's masses they leave "
        f"{least:.3g} instead of {first:.3g} times what noise explains), and take them.",
    )


def _stretches(walk: Walk) -> list[Segment]:
    """Short parts of the longest segment, spread over it."""
    longest = max(walk.segments, key=len)
    length = round((SETTLING_S + STRETCH_S) / walk.timestep_s) + 1
    room = len(longest) - length
    if room < 0:
        return []
    count = min(STRETCHES, 1 + room // length)
    starts = [longest.start + round(room * (k + 0.5) / count) for k in range(count)]
    return [Segment(start, start + length) for start in starts]


def _unexplained(
    sensors: NoisySensors, walk: Walk, robot: Robot, asked: ParameterSpace, stretches: Sequence[Segment]
) -> float:
    """Mean square of what the nominal model leaves unexplained, in units of the noise; inf if it diverges."""
    total, counted = 0.0, 0
    bank = sensors.bank(robot, asked, walk.contact_bodies, walk.timestep_s, n_models=1, n_threads=1, tangents=False)
    bank.place(asked.nominal[None])
    for stretch in stretches:
        settled = stretch.start + round(SETTLING_S / walk.timestep_s)
        for part, errors in bank.replay(walk, stretch, stop=stretch.stop):
            if errors.diverged.any():
                return float("inf")
            values = errors.later(settled - part.start).values
            total += bank.timestep_s * float((values**2).sum())
            counted += values.size
    return total / max(counted, 1)
