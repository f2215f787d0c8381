"""Columns of topics to the base and the contacts of a walk, in MuJoCo's conventions, on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from massid.errors import LogError
from massid.log.alignment import Alignment
from massid.log.columns import TopicColumns
from massid.log.signals import Signal, check_finite
from massid.log.topics.map import BASE_STATE, BaseMap, ContactMap, Frame, On, Order
from massid.typing import FloatArray, IntArray
from massid.walk import resampling
from massid.walk.conventions import NANOSECONDS, rpy_to_wxyz, to_body, to_world, xyzw_to_wxyz

_EXACT_NORM = 1e-6  # farther from 1 than a float32 quaternion gets: normalised, and said
_SOUND_NORM = 1e-3  # farther off than this it is no attitude
_GAP_PERIODS = 1.5


@dataclass
class Base:
    """State of the floating base."""

    layout: BaseMap
    position: Signal
    orientation: Signal
    linear: Signal | None
    angular: Signal | None

    @property
    def signals(self) -> list[Signal]:
        """All that were logged."""
        return [signal for signal in (self.position, self.orientation, self.linear, self.angular) if signal is not None]

    def on(self, alignment: Alignment, *, ends_with_velocity: bool) -> FloatArray:
        """Position, attitude (wxyz), world velocity and body turn rate on the alignment's clock, shape (n, 13).

        Args:
            alignment: the clock.
            ends_with_velocity: a velocity that was not logged is that of the step before a sample, as in simulators
                that move with the velocity at the end of a step; else that of the steps on both sides.
        """
        position, attitude = self.position.rows(alignment), self.orientation.rows(alignment)
        at_position, at_attitude = self.position.times(alignment), self.orientation.times(alignment)
        if self.linear is None:
            at_linear, linear = at_position, _rates(at_position, position, ends_with_velocity)
        else:
            at_linear, linear = self.linear.times(alignment), self.linear.rows(alignment)
            if self.layout.linear_frame is Frame.BODY:
                linear = to_world(self.attitude_of(self.linear, alignment), linear)
        if self.angular is None:
            at_angular, angular = at_attitude, _turn_rates(at_attitude, attitude, ends_with_velocity)
        else:
            at_angular, angular = self.angular.times(alignment), self.angular.rows(alignment)
            if self.layout.angular_frame is Frame.WORLD:
                angular = to_body(self.attitude_of(self.angular, alignment), angular)
        if not alignment.exact:
            stamps = alignment.stamps_ns
            slopes = resampling.linear(at_linear, linear, at_position)
            rates = resampling.linear(at_angular, angular, at_attitude)
            position = resampling.cubic(at_position, position, slopes, stamps)
            attitude = resampling.attitude(at_attitude, attitude, rates, stamps)
            linear = resampling.linear(at_linear, linear, stamps)
            angular = resampling.linear(at_angular, angular, stamps)
        return np.hstack([position, attitude, linear, angular])

    def attitude_of(self, signal: Signal, alignment: Alignment) -> FloatArray:
        """Attitude at the samples of another signal."""
        attitude = self.orientation.rows(alignment)
        if alignment.exact or signal.stream == self.orientation.stream:
            return attitude
        times = self.orientation.times(alignment)
        at = resampling.Bracket.find(times, signal.times(alignment))
        turn = resampling.rotation_between(attitude[at.index], attitude[at.index + 1])
        return resampling.multiply(attitude[at.index], resampling.from_rotation(at.share * turn))


def _rates(times_ns: IntArray, values: FloatArray, ends_with_velocity: bool) -> FloatArray:
    """Velocities of samples from their differences, never across a gap [1/s], shape (n, width)."""
    return _of_steps(times_ns, np.diff(values, axis=0), ends_with_velocity)


def _turn_rates(times_ns: IntArray, wxyz: FloatArray, ends_with_velocity: bool) -> FloatArray:
    """Turn rates in the body from differences of attitudes [rad/s], shape (n, 3)."""
    return _of_steps(times_ns, resampling.rotation_between(wxyz[:-1], wxyz[1:]), ends_with_velocity)


def _of_steps(times_ns: IntArray, moved: FloatArray, ends_with_velocity: bool) -> FloatArray:
    """The rate at each sample: of the step before it, or of those on both sides; at a gap, of the one that is there."""
    steps = np.diff(times_ns)
    sound = steps < _GAP_PERIODS * np.median(steps)
    step_s = (steps / NANOSECONDS)[:, None]
    before, after = np.zeros(len(times_ns), dtype=bool), np.zeros(len(times_ns), dtype=bool)
    before[1:], after[:-1] = sound, sound
    if ends_with_velocity:
        after &= ~before
    path, time_s = np.zeros((len(times_ns), moved.shape[1])), np.zeros((len(times_ns), 1))
    path[1:] += np.where(before[1:, None], moved, 0.0)
    time_s[1:] += np.where(before[1:, None], step_s, 0.0)
    path[:-1] += np.where(after[:-1, None], moved, 0.0)
    time_s[:-1] += np.where(after[:-1, None], step_s, 0.0)
    return np.asarray(np.divide(path, time_s, out=np.zeros_like(path), where=time_s > 0.0))


def read_base(layout: BaseMap, topics: Mapping[str, TopicColumns], warnings: list[str]) -> Base:
    """Take the base's signals from the columns of their topics."""
    signals = {}
    for quantity, source in layout.sources.items():
        columns, key = topics[source.topic], f"{BASE_STATE} {quantity}"
        is_quaternion = quantity == "orientation" and layout.order is not Order.RPY
        width = 4 if is_quaternion else 3
        found = columns.widths(key).most_common(1)[0][0]
        if found != width:
            raise LogError(
                f"{columns.where}: {quantity.replace('_', ' ')} ({', '.join(source.fields)}) has {found} values, "
                f"expected {width}."
            )
        values = columns.values(key, width)
        what = source.fields if len(source.fields) == width else [f"{source.fields[0]}[{k}]" for k in range(width)]
        check_finite(columns, values, what)
        signals[quantity] = Signal(columns, values * source.scale if source.scale != 1.0 else values)
    attitude = signals["orientation"]
    attitude.values = _attitude(attitude, layout.order, warnings)
    attitude.is_attitude = True
    derived = [quantity for quantity in ("linear_velocity", "angular_velocity") if quantity not in signals]
    if derived:
        warnings.append(
            f"{layout.position.topic} has no {' and no '.join(derived).replace('_', ' ')} of the base; "
            "derived from the poses, whose noise it multiplies. A state estimator's nav_msgs/msg/Odometry is better."
        )
    return Base(layout, signals["position"], attitude, signals.get("linear_velocity"), signals.get("angular_velocity"))


def _attitude(signal: Signal, order: Order, warnings: list[str]) -> FloatArray:
    """Return unit quaternions (wxyz); those of no sound norm are left out."""
    columns = signal.columns
    if order is Order.RPY:  # any three angles are an attitude
        return rpy_to_wxyz(signal.values)
    quaternion = xyzw_to_wxyz(signal.values) if order is Order.XYZW else signal.values
    norm = np.linalg.norm(quaternion, axis=1)
    off = np.abs(norm - 1.0)
    unsound = (off > _SOUND_NORM) & ~columns.left_out
    if unsound.any():
        row = int(np.argmax(unsound))
        reason = f"sample {row}: orientation has norm {norm[row]:.6g}, expected 1 within {_SOUND_NORM}"
        columns.leave_out(unsound, reason)
    loose = (off > _EXACT_NORM) & (off <= _SOUND_NORM)
    if loose.any():
        warnings.append(
            f"{columns.name}: {int(loose.sum())} quaternions are off unit norm by up to {off[loose].max():.2g}; "
            "normalised."
        )
        quaternion = np.where(loose[:, None], quaternion / np.where(norm > 0, norm, 1.0)[:, None], quaternion)
    return quaternion


@dataclass
class Contact:
    """The wrench on one body."""

    layout: ContactMap
    signal: Signal


def read_contact(layout: ContactMap, key: str, columns: TopicColumns, lag_s: float) -> Contact:
    """Take a wrench from the columns of its topic: on the robot, about the body's origin."""
    found = columns.widths(key).most_common(1)[0][0]
    if found != 6:
        raise LogError(
            f"{columns.where}: {', '.join((*layout.force, *layout.torque))} have {found} values, expected 6."
        )
    values = columns.values(key, 6)
    paths = (*layout.force, *layout.torque)
    names = list(paths) if len(paths) == found else [f"{path}.{axis}" for path in paths for axis in "xyz"]
    check_finite(columns, values, names)
    if (layout.force_scale, layout.torque_scale) != (1.0, 1.0):
        values *= np.repeat([layout.force_scale, layout.torque_scale], 3)
    if layout.on is On.GROUND:
        np.negative(values, out=values)
    if layout.rotation != ContactMap.rotation:
        rotation = np.broadcast_to(np.array(layout.rotation), (len(values), 4))
        values = np.hstack([to_world(rotation, values[:, :3]), to_world(rotation, values[:, 3:])])
    if layout.position != ContactMap.position:
        values[:, 3:] += np.cross(np.array(layout.position), values[:, :3])
    return Contact(layout, Signal(columns, values, held=True, lag_s=lag_s))
