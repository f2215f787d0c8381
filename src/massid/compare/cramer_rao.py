"""The Cramer-Rao bound: how well any unbiased estimator could weigh the links from a log with this noise.

Computed from the noise-free walk of the simulated plant at its true masses, by finite differences of the engine's step;
there is no estimator in it. The linearisation shares nothing with the estimator's, on purpose: not even what unknowns
say of their effects, so that an error there would show. States are measured with white noise; joint torques and contact
wrenches are inputs that are read with white noise and slow errors. The error of the state then follows a linear system
driven by that noise, whose information about the masses is exact (`SensitivityRecursion`). A prior counts as one more
measurement. A wrench without a sensor is an input of which nothing is known where its foot is loaded, and zero in the
air.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import mujoco
import numpy as np

from massid.compare.sensitivity import SensitivityRecursion
from massid.errors import BadInputError
from massid.model.inverse import with_single_stage
from massid.model.realisation import write_fields
from massid.model.robot import Robot
from massid.model.unknowns.bodies import BodyUnknown
from massid.model.unknowns.lags import EffortLag, WrenchLag
from massid.model.unknowns.sensors import EffortGain, EffortOffset, EncoderOffset, WrenchGain, WrenchOffset
from massid.model.unknowns.unknown import unknowns_of
from massid.search.parameters import ParameterSpace
from massid.typing import BoolArray, FloatArray
from massid.walk import Walk
from massid.walk.noise import SensorNoise

STATE_STEP = 1e-6
"""Finite difference of states and wrenches [rad, m, N, N m]."""
EFFORT_STEP = 1e-3
"""Finite difference of joint torques [N m]; the step is linear in them."""
BODY_STEP = 1e-4
"""Finite difference of what changes a body, relative to its scale."""
HOLD_STEPS = 5
"""Samples over which a linearisation is kept."""

_ON_INPUTS = (EffortOffset, EffortGain, WrenchOffset, WrenchGain)


@dataclass(frozen=True)
class Bound:
    """Smallest covariance of an unbiased estimate.

    Attributes:
        space: the unknowns and what is believed of them; those asked for come first.
        covariance: in the parameters' units, shape (n_p, n_p).
        gated: whether it was taken as known that the wrench on a foot in the air is zero.
    """

    space: ParameterSpace
    covariance: FloatArray
    gated: bool

    @property
    def std(self) -> FloatArray:
        """Of the parameters that were asked for, shape (n_asked,)."""
        return np.sqrt(np.diagonal(self.covariance)[: self._asked])

    @property
    def l2(self) -> float:
        """Root mean square L2 error of the parameters that were asked for."""
        return float(np.linalg.norm(self.std))

    @property
    def problem(self) -> str:
        """The unknowns by number and kind, with the widths of their priors."""
        counts = Counter((p.kind, p.requested, _width(p.prior_std, p.nominal)) for p in unknowns_of(self.space))
        return ", ".join(
            f"{count} {kind}{'' if asked else ' (other)'}{width}" for (kind, asked, width), count in counts.items()
        )

    @property
    def _asked(self) -> int:
        return sum(parameter.requested for parameter in self.space.parameters)


def _width(prior_std: float | None, nominal: float) -> str:
    if prior_std is None:
        return ""
    return f" +-{100.0 * prior_std / nominal:.2g} %" if nominal else f" +-{prior_std:.2g}"


def cramer_rao(
    walk: Walk,
    robot: Robot,
    space: ParameterSpace,
    truth: FloatArray,
    noise: SensorNoise,
    *,
    gate: bool = True,
    hold_steps: int = HOLD_STEPS,
) -> Bound:
    """Bound the covariance of the parameters.

    Args:
        walk: without noise; wrenches without a sensor (`Walk.open_axes`) as they were.
        robot: the robot with nominal masses.
        space: the unknowns and their priors; of bodies and slow errors of the sensors.
        truth: of bodies, and anything for the others, shape (n_p,).
        noise: white noise of the sensors; their slow errors are unknowns of the space.
        gate: take it as known that the wrench on a foot in the air is zero. Its sensor then shows its own offset there.
            Otherwise that foot's wrench is as uncertain as when it is loaded.
        hold_steps: samples over which a linearisation is kept.

    Raises:
        BadInputError: a measured state has no noise, a parameter is not a mass or a slow error, or the walk and the
            priors leave a combination of the unknowns entirely open.
        LogError: the walk does not match the robot.
    """
    walk = robot.align(walk)
    plant = _Plant(robot, space, truth, walk.contact_bodies, walk.timestep_s)
    std = noise.state_std(len(robot.joint_names))
    if not np.all(std > 0.0):
        raise BadInputError("Without noise on every measured state there is nothing to bound: masses are then exact.")
    n_v = 6 + len(robot.joint_names)
    order = robot.layout.to_qvel
    variance = np.concatenate([order(std[:n_v] ** 2), order(std[n_v:] ** 2)])
    recursion = SensitivityRecursion(plant.from_output(), variance)
    rates = _rates(walk)
    loaded = np.asarray(walk.wrench.any(axis=2)) | (not gate)
    for segment in walk.segments:
        recursion.restart()
        for k in range(segment.start, segment.stop - 1):
            if (k - segment.start) % hold_steps == 0:
                plant.linearise(walk, k)
            read = loaded[k][:, None] & walk.measured
            recursion.step(
                plant.transition,
                plant.process_noise(noise, read),
                plant.effects(walk, k, loaded[k], rates[k]),
                plant.from_wrench(loaded[k][:, None] & ~walk.measured),
            )
    information = recursion.information + np.diag(space.prior_precision)
    if gate:
        information += np.diag(_shown_in_the_air(space, walk, loaded, noise))
    return Bound(space, _inverse(information), gate)


def _rates(walk: Walk) -> FloatArray:
    """Slopes of joint torques and wrenches, shape (n, n_inputs) [per s]; zero where a segment has no slope."""
    inputs = np.hstack([walk.effort, walk.wrench.reshape(len(walk), -1)])
    out = np.zeros_like(inputs)
    for segment in walk.segments:
        rows = slice(segment.start, segment.stop)
        if len(segment) > 1:
            out[rows] = np.gradient(inputs[rows], walk.timestep_s, axis=0)
    return out


def _inverse(information: FloatArray) -> FloatArray:
    scale = np.sqrt(np.maximum(np.diagonal(information), np.finfo(float).tiny))
    try:
        factor = np.linalg.inv(np.linalg.cholesky(information / np.outer(scale, scale))) / scale
    except np.linalg.LinAlgError as error:
        raise BadInputError(
            "The walk and the priors do not bound every unknown: name fewer links, or give the other unknowns a prior."
        ) from error
    return np.asarray(factor.T @ factor)


def _shown_in_the_air(space: ParameterSpace, walk: Walk, loaded: BoolArray, noise: SensorNoise) -> FloatArray:
    """Information about wrench offsets from readings of sensors that carry nothing, shape (n_p,)."""
    variance = noise.wrench_std() ** 2
    out = np.zeros(len(space))
    for column, parameter in enumerate(space.parameters):
        if isinstance(parameter, WrenchOffset):
            unloaded = np.count_nonzero(~loaded[:, walk.contact_bodies.index(parameter.body)])
            out[column] = unloaded / variance[parameter.axis]
    return out


class _Plant:
    """The engine's step at the true masses, contacts off and wrenches applied in the feet's frames, linearised.

    RK4, which the engine does not linearise, is taken as Euler.

    Attributes:
        transition: A, shape (2 nv, 2 nv).
    """

    def __init__(
        self, robot: Robot, space: ParameterSpace, truth: FloatArray, contact_bodies: tuple[str, ...], timestep_s: float
    ) -> None:
        self._robot, self._space, self._channels = robot, space, robot.channels(contact_bodies)
        known = (BodyUnknown, EncoderOffset, EffortLag, WrenchLag, *_ON_INPUTS)
        strange = [parameter.name for parameter in space.parameters if not isinstance(parameter, known)]
        if strange:
            raise BadInputError(
                f"There is no bound for {', '.join(strange)}: only for bodies and for slow errors of sensors."
            )
        unknowns = unknowns_of(space)
        self._inertial = [k for k, unknown in enumerate(unknowns) if isinstance(unknown, BodyUnknown)]
        self._body_steps = BODY_STEP * space.scale[self._inertial]
        on_inputs = {k: unknown for k, unknown in enumerate(unknowns) if isinstance(unknown, _ON_INPUTS)}
        self._sensors = list(on_inputs)
        self._sources = [self._source(unknown) for unknown in on_inputs.values()]
        self._is_gain = [isinstance(unknown, EffortGain | WrenchGain) for unknown in on_inputs.values()]
        points = np.repeat(truth[None], 1 + len(self._inertial), axis=0)
        points[1 + np.arange(len(self._inertial)), self._inertial] += self._body_steps
        self._models = []
        for point in points:
            model = with_single_stage(robot.identification_model(contact_bodies))
            model.opt.timestep = timestep_s
            write_fields(model, robot.realise(space, point, contact_bodies))
            self._models.append(model)
        self._datas = [mujoco.MjData(model) for model in self._models]
        nv, nu = self._models[0].nv, self._models[0].nu
        self._inputs = np.zeros((2 * nv, len(robot.joint_names) + nu))
        self._from_bodies = np.zeros((2 * nv, len(self._inertial)))
        self.transition: FloatArray = np.zeros((2 * nv, 2 * nv))

    def _source(self, unknown: EffortOffset | EffortGain | WrenchOffset | WrenchGain) -> int:
        """Column of the input that a slow error belongs to."""
        if isinstance(unknown, WrenchOffset | WrenchGain):
            return len(self._robot.joint_names) + self._channels.axis(unknown.body, unknown.axis)
        return self._channels.joint(unknown.joint)

    def from_output(self) -> FloatArray:
        """What the parameters add to the measured state, shape (2 nv, n_p)."""
        out = np.zeros((len(self.transition), len(self._space)))
        for column, parameter in enumerate(self._space.parameters):
            if isinstance(parameter, EncoderOffset):
                out[self._channels.dof(parameter.joint), column] = 1.0
        return out

    def linearise(self, walk: Walk, k: int) -> None:
        """Take finite differences of the step from sample k."""
        model, data, joint_dof = self._models[0], self._datas[0], self._robot.layout.joint_dof
        qpos, qvel = self._robot.layout.to_qpos(walk.qpos[k]), self._robot.layout.to_qvel(walk.qvel[k])
        force = np.zeros(model.nv)
        force[joint_dof] = walk.effort[k]
        wrench = walk.wrench[k].ravel()
        n_joints = len(joint_dof)
        _set(data, qpos, qvel, force, wrench)
        from_wrench = np.empty((2 * model.nv, model.nu))
        mujoco.mjd_transitionFD(model, data, STATE_STEP, False, self.transition, from_wrench, None, None)
        self._inputs[:, n_joints:] = from_wrench
        base = _step(model, data, qpos, qvel, force, wrench)
        for column, dof in enumerate(joint_dof):
            force[dof] += EFFORT_STEP
            change = _difference(model, _step(model, data, qpos, qvel, force, wrench), base)
            self._inputs[:, column] = change / EFFORT_STEP
            force[dof] -= EFFORT_STEP
        for column, (other, scratch) in enumerate(zip(self._models[1:], self._datas[1:], strict=True)):
            change = _difference(model, _step(other, scratch, qpos, qvel, force, wrench), base)
            self._from_bodies[:, column] = change / self._body_steps[column]

    def from_wrench(self, components: BoolArray) -> FloatArray:
        """What some components of the wrenches, shape (n_c, 6), add to the state in one step, shape (2 nv, m)."""
        return self._inputs[:, len(self._robot.joint_names) :][:, components.ravel()]

    def process_noise(self, noise: SensorNoise, read: BoolArray) -> FloatArray:
        """Covariance that the noise of the input readings adds to the state in one step, shape (2 nv, 2 nv).

        Args:
            noise: of the sensors.
            read: components of the wrenches that are not known better, shape (n_c, 6).
        """
        std = np.concatenate([np.full(len(self._robot.joint_names), noise.effort), (read * noise.wrench_std()).ravel()])
        scaled = self._inputs * std
        return np.asarray(scaled @ scaled.T)

    def effects(self, walk: Walk, k: int, loaded: BoolArray, rates: FloatArray) -> FloatArray:
        """What the parameters add to the state in the step from sample k, C, shape (2 nv, n_p).

        A reading is (1 + gain) input + offset, of an input one lag earlier: with a larger offset or gain the same
        reading means a smaller input; with a larger lag, what acts is read later.
        """
        out = np.zeros((len(self.transition), len(self._space)))
        out[:, self._inertial] = self._from_bodies
        readings = np.concatenate([walk.effort[k], walk.wrench[k].ravel()])
        acts = np.concatenate([np.ones(walk.effort.shape[1]), np.repeat(loaded, 6)])
        per_unit = np.where(self._is_gain, readings[self._sources], acts[self._sources])
        out[:, self._sensors] = -self._inputs[:, self._sources] * per_unit
        n_joints = walk.effort.shape[1]
        for column, parameter in enumerate(self._space.parameters):
            if isinstance(parameter, EffortLag | WrenchLag):
                late = slice(n_joints) if isinstance(parameter, EffortLag) else slice(n_joints, None)
                out[:, column] = self._inputs[:, late] @ (acts * rates)[late]
        return out


def _set(data: mujoco.MjData, qpos: FloatArray, qvel: FloatArray, force: FloatArray, wrench: FloatArray) -> None:
    data.qpos[:], data.qvel[:], data.qacc_warmstart[:] = qpos, qvel, 0.0
    data.qfrc_applied[:], data.ctrl[:] = force, wrench


def _step(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    qpos: FloatArray,
    qvel: FloatArray,
    force: FloatArray,
    wrench: FloatArray,
) -> FloatArray:
    """The state (qpos, qvel) after one step, shape (nq + nv,)."""
    _set(data, qpos, qvel, force, wrench)
    mujoco.mj_step(model, data)
    return np.concatenate([data.qpos, data.qvel])


def _difference(model: mujoco.MjModel, state: FloatArray, other: FloatArray) -> FloatArray:
    """State less another one, in the tangent space, shape (2 nv,)."""
    out = np.empty(2 * model.nv)
    mujoco.mj_differentiatePos(model, out[: model.nv], 1.0, other[: model.nq], state[: model.nq])
    out[model.nv :] = state[model.nq :] - other[model.nq :]
    return out
