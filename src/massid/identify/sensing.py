"""What the sensors are taken to do: noise levels, given or read off the log, and the nuisances that come with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massid.audit.balance import measure_balance
from massid.audit.one_step import one_step_residual
from massid.identify.options import IdentifyOptions
from massid.model.draft import Draft
from massid.model.robot import Robot
from massid.model.unknowns.bodies import InertiaScale, Mass
from massid.model.unknowns.joints import Armature, typical_armature
from massid.model.unknowns.lags import EffortLag, WrenchLag
from massid.model.unknowns.sensors import (
    FORCE_AXES,
    EffortGain,
    EffortOffset,
    EncoderOffset,
    WrenchGain,
    WrenchOffset,
)
from massid.model.unknowns.unknown import Unknown, nuisance, unknowns_of
from massid.observer.contact_gate import offsets_in_air
from massid.observer.scales import Scales
from massid.observer.sensors import ExactSensors, NoisySensors, SensorModel
from massid.search.parameters import ParameterSpace
from massid.walk import Walk
from massid.walk.noise import PRESETS, NoisePreset, SensorNoise
from massid.walk.resampling import rotation_between
from massid.walk.white_noise import CLEAN_VELOCITY, looks_noisy, white_level

LEAST_SHARE = 0.01
"""Least noise of a state or a force in a log with noise, as a share of `white`."""

COARSE: NoisePreset = "white"
"""Sensors as which samples count between which models take several steps."""


def choose_sensors(walk: Walk, robot: Robot, options: IdentifyOptions, *, explained: bool = False) -> SensorModel:
    """What the sensors of a log are taken to do: the only place where this is decided.

    With `auto`, white noise is read off the log and slow errors, which no log shows, are those of `realistic`. A log
    without noise whose samples are further apart than the model's steps does not say what happened in between: that is
    as if `white` sensors had measured it.

    Args:
        walk: aligned with the robot.
        robot: with nominal masses.
        options: how to identify.
        explained: whether physics is known to explain the log to rounding, as it never does one with sensor noise.
    """
    if options.noise == "auto":
        noise = None if explained else read_noise(walk, robot)
        if noise is None and not explained and robot.steps_in(walk.timestep_s) > 1:
            noise = PRESETS[COARSE]
    else:
        noise = None if options.noise == "clean" else PRESETS[options.noise]
    if noise is None:
        return ExactSensors(options.bandwidth_rad_s, options.damping_ratio, options.forgetting_rate, walk.open_axes)
    scales = None
    if options.total_mass_kg is not None:
        scales = Scales(options.total_mass_kg - robot.total_mass_kg, options.total_mass_std_kg)
    return NoisySensors(noise, open_axes=walk.open_axes, scales=scales)


def read_noise(walk: Walk, robot: Robot) -> SensorNoise | None:
    """White noise that a log shows; None for none.

    What shakes may also be the robot, such as by a stiff servo: then the logged torques and wrenches explain it.

    Args:
        walk: aligned with the robot.
        robot: with nominal masses.
    """
    if not looks_noisy(walk):
        return None
    noise = estimate_white_noise(walk)
    noise = replace(noise, joint_velocity=min(noise.joint_velocity, _largest_velocity_noise(robot, walk)))
    return None if noise.joint_velocity < CLEAN_VELOCITY else _floored(noise)


def coarse_doubts(walk: Walk, options: IdentifyOptions, sensors: NoisySensors) -> tuple[str, ...]:
    """Say so if a log without noise is weighed as if it had some: noise that was read off a log is no preset's."""
    if options.noise != "auto" or sensors.noise != PRESETS[COARSE]:
        return ()
    return (
        f"{walk.source} shows no sensor noise, but its samples are far apart: it is weighed as if `{COARSE}` sensors "
        "had measured it (`noise=clean` interpolates instead, `noise=realistic` allows for more).",
    )


def clean_doubts(walk: Walk, robot: Robot, options: IdentifyOptions) -> tuple[str, ...]:
    """Say so if a log is called clean and is not."""
    noise = read_noise(walk, robot) if options.noise == "clean" else None
    if noise is None:
        return ()
    return (
        f"{walk.source} is taken as `noise=clean`, but shows noise of {noise.joint_velocity:.2g} rad/s in the joint "
        "velocities, which no forces explain: without that option the noise is read off the log.",
    )


def _floored(noise: SensorNoise) -> SensorNoise:
    """No state is known exactly: a channel that is smooth in a noisy log was filtered."""
    least = PRESETS["white"].scaled(LEAST_SHARE)
    states = ("joint_position", "base_position", "base_orientation", "base_linear_velocity", "base_angular_velocity")
    return replace(noise, **{name: max(getattr(noise, name), getattr(least, name)) for name in states})


def _largest_velocity_noise(robot: Robot, walk: Walk) -> float:
    """Noise of joint velocities that the forces leave room for [rad/s].

    White noise changes a velocity by sqrt(2) of its deviation from sample to sample, and no force explains that: a step
    of the model with the masses that fit best leaves at least as much.
    """
    balance = measure_balance(robot, walk)
    return np.inf if balance is None else one_step_residual(robot, walk, balance).fitted / np.sqrt(2.0)


def estimate_white_noise(walk: Walk) -> SensorNoise:
    """Read white noise levels off a log; see `white_level`."""
    return replace(
        PRESETS["realistic"],
        joint_position=white_level(walk.qpos[:, 7:]),
        joint_velocity=white_level(walk.qvel[:, 6:]),
        effort=white_level(walk.effort),
        base_position=white_level(walk.qpos[:, :3]),
        base_orientation=white_level(rotation_between(walk.qpos[:-1, 3:7], walk.qpos[1:, 3:7]), already_differenced=1),
        base_linear_velocity=white_level(walk.qvel[:, :3]),
        base_angular_velocity=white_level(walk.qvel[:, 3:6]),
        **_wrench_noise(walk),
    )


def _wrench_noise(walk: Walk) -> dict[str, float]:
    """Noise of the contact sensors that there are [N, N m]."""
    found = {}
    for name, axes in (("force", slice(0, 3)), ("moment", slice(3, 6))):
        if walk.measured[:, axes].any():
            found[name] = white_level(walk.wrench[:, :, axes][:, walk.measured[:, axes]])
    return found


def nuisances(
    robot: Robot, walk: Walk, space: ParameterSpace, noise: SensorNoise, options: IdentifyOptions
) -> tuple[Unknown, ...]:
    """What else is not known: slow errors of sensors, inertias of the links asked for, masses of those that are not.

    Nothing that is asked for is among them.
    """
    pair = np.vstack([space.nominal, space.nominal + space.scale])
    asked = Draft(robot.channels(walk.contact_bodies), unknowns_of(space), pair).bodies
    links = [name for name, body in asked.items() if body.mass[0] != body.mass[1]]  # whoever writes their mass
    found: list[Unknown] = []
    per_joint = (
        (EffortOffset, noise.effort_offset),
        (EffortGain, noise.effort_gain),
        (EncoderOffset, noise.joint_position_offset),
    )
    for kind, std in per_joint:
        if std > 0.0:
            found += [kind(joint, **nuisance(std)) for joint in robot.joint_names]
    if noise.wrench_gain > 0.0:
        axes = [(walk.contact_bodies[contact], axis) for contact, axis in np.argwhere(walk.measured).tolist()]
        found += [WrenchGain(body, axis, **nuisance(noise.wrench_gain)) for body, axis in axes]
    if options.lag_s > 0.0:
        found.append(EffortLag(**nuisance(options.lag_s)))
        found += [WrenchLag(**nuisance(options.lag_s))] if walk.measured.any() else []
    if noise.force_offset > 0.0:
        found += _force_offsets(walk, noise)
    if options.link_inertia > 0.0:
        scaled = [link for link in links if asked[link].keeps_shape]
        found += [InertiaScale(link, **nuisance(options.link_inertia)) for link in scaled]
    if not robot.model.dof_armature.any():  # a file that says nothing of rotors, as every URDF
        std = typical_armature(robot)
        found += [Armature(joint, **(nuisance(std) | {"lower": 0.0})) for joint in robot.joint_names]
    if options.other_links > 0.0:
        for link in robot.links:
            if link not in links:
                mass_kg = robot.nominal_mass_kg(link)
                found.append(Mass(link, **nuisance(options.other_links * mass_kg, mass_kg)))
    return tuple(unknown for unknown in found if unknown.name not in space.names)


def _force_offsets(walk: Walk, noise: SensorNoise) -> list[WrenchOffset]:
    """Offsets of the force sensors, with what their readings off the ground say about them."""
    readings, least = walk.wrench.reshape(len(walk), -1), LEAST_SHARE * PRESETS["white"].force
    offsets = offsets_in_air(readings, noise, walk.timestep_s, least, walk.open_axes)
    return [
        WrenchOffset(body, axis, **nuisance(float(offsets.std[at]), float(offsets.mean[at])))
        for contact, body in enumerate(walk.contact_bodies)
        for axis, at in enumerate(range(6 * contact, 6 * contact + FORCE_AXES))
        if at not in walk.open_axes
    ]


def with_nuisances(
    space: ParameterSpace, robot: Robot, walk: Walk, noise: SensorNoise, options: IdentifyOptions
) -> ParameterSpace:
    """The parameters asked for, followed by the nuisances."""
    return ParameterSpace((*space.parameters, *nuisances(robot, walk, space, noise, options)))
