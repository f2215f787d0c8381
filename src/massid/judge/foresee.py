"""The verdict before the fit: to what standard deviation each mass can be known from a log, and what stands in the way.

One identification model with the nominal masses runs through stretches of the log under the Kalman gain of the sensor
noise. All unknowns, masses and nuisances alike, enter as derivatives of its whitened output error (tangents), whose
Gram matrix is the Fisher information; stretches stand for the whole log in proportion to their length. With the priors
of the nuisances its inverse is the covariance that an identification of the same log ends with.

A log without noise is judged as if its motion had been measured by real sensors (`REFERENCE`): solved to rounding,
every equation shows every mass, and that says nothing about the motion.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from massid.errors import LogError
from massid.identify.logs import PreparedLog, join_spaces
from massid.identify.options import IdentifyOptions
from massid.identify.prepare import prepare_log
from massid.identify.progress import Progress, silent
from massid.judge.advice import advise
from massid.judge.motion import observe_motion
from massid.judge.smoothing import balanced, smoothed
from massid.model.draft import alone
from massid.model.realisation import FRICTION_LOSS
from massid.model.robot import Robot
from massid.model.unknowns.bodies import Mass
from massid.model.unknowns.unknown import adds_mass, unknowns_of
from massid.observer.sensors import ExactSensors, NoisySensors
from massid.result.combinations import known_sums, open_combinations
from massid.result.excitation import LARGEST_DEVIATION
from massid.result.quantities import whole_shapes
from massid.result.verdict import KNOWN_SUM, VAGUE, Motion, MotionFacts, Verdict
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray, IntArray
from massid.walk import Segment, Walk
from massid.walk.noise import PRESETS, NoisePreset

REFERENCE: NoisePreset = "realistic"
"""Sensors with which a log without noise is judged."""
_STRETCHES, _STRETCH_S, _LEAD_S = 8, 0.3, 0.2
"""How many stretches of a long log are looked at, their length, and how long the filter settles before each [s]."""
_SMOOTHING_S, _SMOOTHING_STILL_S = 0.05, 0.5
"""The information is that of the motion; along the noise of a log a robot that stands still would seem to shake."""
_LONGER = (2.0, 4.0, 8.0, 16.0, 32.0)


def foresee(
    logs: Sequence[PreparedLog],
    robot: Robot,
    asked: ParameterSpace,
    options: IdentifyOptions | None = None,
    progress: Progress = silent,
) -> Verdict:
    """Judge what a log, or several of one robot, can reveal about some masses, without fitting anything.

    Args:
        logs: as they would be identified.
        robot: the robot with nominal masses.
        asked: the masses asked for, and what else is.
        options: how the logs would be identified; what is believed of nuisances matters here.
        progress: told the fraction done.

    Raises:
        LogError: a log holds too few samples to be judged.
    """
    started = time.perf_counter()
    options = options or IdentifyOptions()
    is_reference = isinstance(logs[0].sensors, ExactSensors)
    if is_reference:
        # What a clean log tells of friction, in joints that surely slide or stick, is judged after the fit.
        channels = robot.channels(logs[0].walk.contact_bodies)
        told = [one for one in unknowns_of(asked) if FRICTION_LOSS not in alone(channels, one).fields_written]
        asked = ParameterSpace(tuple(told))
        noise = PRESETS[REFERENCE]
        logs = [
            prepare_log(log.walk, robot, asked, NoisySensors(noise, open_axes=log.walk.open_axes), options)
            for log in logs
        ]
    logs = tuple(replace(log, space=_all_tangent(log.space)) for log in logs)
    joint = join_spaces(logs)
    facts = MotionFacts.of_all([observe_motion(robot, log.walk) for log in logs])
    information = np.zeros((len(joint.space), len(joint.space)))
    width_s = 0.0
    if not is_reference:
        width_s = _SMOOTHING_STILL_S if facts.motion is Motion.STANDING else _SMOOTHING_S
    for k, (log, columns) in enumerate(zip(logs, joint.columns, strict=True)):
        part = partial(_report, progress, k, len(logs))
        information[np.ix_(columns, columns)] += _information(log, robot, width_s, part)
    progress(1.0, "done")
    sensors = logs[0].sensors
    scales = sensors.scales if isinstance(sensors, NoisySensors) else None
    posterior = _Posterior(joint.space, information, None if scales is None else scales.information(joint.space))
    everything = posterior.covariance()
    others = _hidden_others(asked, everything)
    masses = np.array([k for k, one in enumerate(asked.parameters) if isinstance(one, Mass)], dtype=np.int64)
    space = ParameterSpace(tuple(asked.parameters[k] for k in masses))
    covariance = everything[np.ix_(masses, masses)]
    links = [parameter.target for parameter in space.parameters]
    relative = covariance / np.outer(space.scale, space.scale)
    std = np.sqrt(np.diagonal(relative))
    hidden = [link for link, value in zip(links, std, strict=True) if value >= LARGEST_DEVIATION]
    if facts.motion is Motion.HELD:
        hidden = links
    combinations = open_combinations(links, relative, LARGEST_DEVIATION) if hidden else ()
    groups = [group for group in _groups(robot, links) if set(group) & set(hidden)]
    held = facts.motion is Motion.HELD
    return Verdict(
        space=space,
        covariance=covariance,
        total_std_kg=posterior.total_std_kg(everything),
        total_known=not held and posterior.total_std_kg(everything) < LARGEST_DEVIATION * robot.total_mass_kg,
        sensors=_sensors(options.noise, is_reference),
        facts=facts,
        hidden_others=others,
        combinations=combinations,
        sums=() if held else known_sums(links, space.nominal, covariance, groups, KNOWN_SUM),
        advice=advise(robot, facts, links, hidden, posterior.longer(masses, sum(log.walk.duration_s for log in logs))),
        wall_s=time.perf_counter() - started,
    )


def _sensors(asked_noise: str, is_reference: bool) -> str:
    """With what sensors a log is judged, and why."""
    if is_reference:
        why = "as `noise=clean` was asked for" if asked_noise == "clean" else "for the log has no noise"
        return f"{REFERENCE} sensors, {why}"
    return "the log's own noise" if asked_noise == "auto" else f"`noise={asked_noise}`"


def _hidden_others(space: ParameterSpace, covariance: FloatArray) -> tuple[str, ...]:
    """Names of what cannot be known besides masses; a rotational inertia is known as a whole or not at all."""
    std = np.sqrt(np.diagonal(covariance))[: len(space)]
    hidden = std >= LARGEST_DEVIATION * space.scale
    seen = whole_shapes(space, ~hidden)
    rows = zip(space.parameters, seen, strict=True)
    others = [one for one, known in rows if one.requested and not (known or isinstance(one, Mass))]
    return tuple(one.name for one in others)


def _all_tangent(space: ParameterSpace) -> ParameterSpace:
    return ParameterSpace(tuple(replace(parameter, tangent=True) for parameter in space.parameters))


def _report(progress: Progress, index: int, count: int, done: float) -> None:
    progress((index + done) / count, "judging")


def _information(log: PreparedLog, robot: Robot, smoothing_s: float, progress: Callable[[float], None]) -> FloatArray:
    """Fisher information of one log about its unknowns, shape (n_p, n_p); a noisy one is smoothed for it."""
    walk = log.walk
    bank = log.sensors.bank(robot, log.space, walk.contact_bodies, walk.timestep_s, n_models=1)
    bank.place(log.space.nominal[None])
    stretches = _pick(walk, round(_LEAD_S / walk.timestep_s))
    if not stretches:
        raise LogError(f"{walk.source}: {walk.duration_s:.3g} s of samples are too few to judge what they reveal.")
    information = np.zeros((len(bank.space), len(bank.space)))
    counted = 0
    for k, (stretch, skipped) in enumerate(stretches):
        part, own = _smoothed(walk, stretch, bank.robot, smoothing_s)
        for steps, errors in bank.replay(part, own):
            tangents = errors.later(own.start + skipped - steps.start).tangents
            if tangents is None:
                continue
            flat = tangents.reshape(len(tangents), -1)
            information += bank.timestep_s * (flat @ flat.T)
            counted += tangents.shape[1]
        progress((k + 1) / len(stretches))
    return information * (walk.duration_s / (counted * walk.timestep_s))


def _smoothed(walk: Walk, stretch: Segment, robot: Robot, width_s: float) -> tuple[Walk, Segment]:
    """A stretch and as much around it as its averages take, smoothed and balanced; and where it is in that."""
    if width_s == 0.0:
        return walk, stretch
    margin = round(width_s / walk.timestep_s)
    segment = next(one for one in walk.segments if one.start <= stretch.start < one.stop)
    start, stop = max(segment.start, stretch.start - margin), min(segment.stop, stretch.stop + margin)
    own = Segment(stretch.start - start, stretch.stop - start)
    part = smoothed(walk.between(start, stop), width_s)
    return balanced(part, robot, np.arange(own.start, own.stop - 1)), own


def _pick(walk: Walk, lead: int) -> list[tuple[Segment, int]]:
    """Stretches and how many of their first samples only settle the filter; a short log is taken as it is."""
    length = lead + round(_STRETCH_S / walk.timestep_s)
    if walk.duration_s <= _STRETCHES * length * walk.timestep_s:
        return [(segment, 0) for segment in walk.segments if len(segment) > 1]
    slots = [
        Segment(start, start + length + 1)
        for segment in walk.segments
        for start in range(segment.start, segment.stop - length, max(1, length // 2))
    ]
    chosen = np.linspace(0, len(slots) - 1, min(_STRETCHES, len(slots))).round().astype(int)
    return [(slots[k], lead) for k in chosen]


@dataclass(frozen=True)
class _Posterior:
    """Information of a log, and the beliefs that it is added to."""

    space: ParameterSpace
    information: FloatArray
    weighed: FloatArray | None = None

    def covariance(self, factor: float = 1.0) -> FloatArray:
        """Covariance of all unknowns if the log were longer by a factor, shape (n_p, n_p)."""
        scale = self.space.scale
        prior = self.space.prior_precision * scale**2
        prior = np.where(prior > 0.0, prior, VAGUE**-2)
        told = factor * self.information + (0.0 if self.weighed is None else self.weighed)
        information = told * np.outer(scale, scale) + np.diag(prior)
        return np.asarray(np.linalg.inv(information) * np.outer(scale, scale))

    def total_std_kg(self, covariance: FloatArray) -> float:
        """Standard deviation of the sum of all masses [kg]."""
        masses = adds_mass(self.space)
        return float(np.sqrt(masses @ covariance @ masses))

    def longer(self, asked: IntArray, log_s: float) -> float | None:
        """Length of a log with the same motion that would reveal everything asked for [s]; None if none would."""
        scale = self.space.scale[asked]
        for factor in _LONGER:
            std = np.sqrt(np.diagonal(self.covariance(factor))[asked])
            if np.all(std < LARGEST_DEVIATION * scale):
                return factor * log_s
        return None


def _groups(robot: Robot, links: Sequence[str]) -> list[tuple[str, ...]]:
    """Links that belong together: all that were asked for, and the chains that hang on each other."""
    model = robot.model
    chains: dict[str, list[str]] = {}
    for link in links:
        body = model.body(link).id
        top = link
        while body and model.body(body).name != robot.root_body:
            if model.body(body).name in links:
                top = model.body(body).name
            body = int(model.body_parentid[body])
        chains.setdefault(top, []).append(link)
    groups = [tuple(links), *(tuple(chain) for chain in chains.values())]
    return [group for group in dict.fromkeys(groups) if len(group) > 1]
