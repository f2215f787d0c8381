"""Columns of topics to the signals of a walk: base, joints and wrenches in MuJoCo's conventions, on one clock."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

import numpy as np

from massid.errors import LogError
from massid.log.alignment import Alignment
from massid.log.columns import TopicColumns
from massid.log.topics.map import BASE_STATE, JOINT_STATE, BaseMap, ContactMap, Frame, JointMap, On, Order, TextField
from massid.typing import FloatArray, IntArray
from massid.walk import resampling
from massid.walk.conventions import rpy_to_wxyz, to_body, to_world, xyzw_to_wxyz

_EXACT_NORM = 1e-6  # farther from 1 than a float32 quaternion gets: normalised, and said
_LARGEST = 1e100  # its square is still a number
_SOUND_NORM = 1e-3  # farther off than this it is no attitude


@dataclass
class Signal:
    """One quantity over all messages of its topic.

    Attributes:
        columns: the topic.
        values: shape (n, width).
        held: each value acts until the next one.
        lag_s: how much later than they should be its samples are stamped [s].
    """

    columns: TopicColumns
    values: FloatArray
    held: bool = False
    lag_s: float = 0.0

    @property
    def stream(self) -> str:
        """Name of the clock: the topic's own, or that less a lag."""
        topic = self.columns.info.topic
        return topic if self.lag_s == 0.0 else f"{topic} (less {self.lag_s * 1e3:g} ms)"

    def rows(self, alignment: Alignment) -> FloatArray:
        """The values that the alignment uses."""
        rows = self.columns.usable()[alignment.rows[self.stream]]
        return self.values if len(rows) == len(self.values) else self.values[rows]

    def times(self, alignment: Alignment) -> IntArray:
        """Stamps of these values [ns]."""
        return alignment.times_ns[self.stream]

    def on(self, alignment: Alignment) -> FloatArray:
        """The signal on the alignment's clock: itself, a straight line, or the mean of what was held."""
        values = self.rows(alignment)
        if not alignment.resampled:
            return values
        if self.held:
            return resampling.held_mean(self.times(alignment), values, alignment.stamps_ns, alignment.period_ns)
        return resampling.linear(self.times(alignment), values, alignment.stamps_ns)


def check_finite(columns: TopicColumns, values: FloatArray, names: Sequence[str]) -> None:
    """Leave out rows that are not finite, and put zeros there; `names` says what each column is."""
    bad = ~(np.abs(values) < _LARGEST)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        value = values[row, column]
        expected = f"a number below {_LARGEST:g}" if np.isfinite(value) else "a finite number"
        reason = f"sample {row}: {names[column]} is {value}, expected {expected}"
        columns.leave_out(np.asarray(bad.any(axis=1)), reason)
        values[bad] = 0.0


@dataclass
class Base:
    """State of the floating base."""

    layout: BaseMap
    position: Signal
    orientation: Signal
    linear: Signal
    angular: Signal

    @property
    def signals(self) -> list[Signal]:
        """All of them."""
        return [self.position, self.orientation, self.linear, self.angular]

    def on(self, alignment: Alignment) -> FloatArray:
        """Position, attitude (wxyz), world velocity and body turn rate on the alignment's clock, shape (n, 13)."""
        linear, angular = self.linear.rows(alignment), self.angular.rows(alignment)
        if self.layout.linear_frame is Frame.BODY:
            linear = to_world(self.attitude_of(self.linear, alignment), linear)
        if self.layout.angular_frame is Frame.WORLD:
            angular = to_body(self.attitude_of(self.angular, alignment), angular)
        position, attitude = self.position.rows(alignment), self.orientation.rows(alignment)
        if alignment.resampled:
            stamps = alignment.stamps_ns
            at = {
                name: getattr(self, name).times(alignment) for name in ("position", "orientation", "linear", "angular")
            }
            slopes = resampling.linear(at["linear"], linear, at["position"])
            rates = resampling.linear(at["angular"], angular, at["orientation"])
            position = resampling.cubic(at["position"], position, slopes, stamps)
            attitude = resampling.attitude(at["orientation"], attitude, rates, stamps)
            linear = resampling.linear(at["linear"], linear, stamps)
            angular = resampling.linear(at["angular"], angular, stamps)
        return np.hstack([position, attitude, linear, angular])

    def attitude_of(self, signal: Signal, alignment: Alignment) -> FloatArray:
        """Attitude at the samples of another signal."""
        attitude = self.orientation.rows(alignment)
        if not alignment.resampled or signal.stream == self.orientation.stream:
            return attitude
        times = self.orientation.times(alignment)
        at = resampling.Bracket.find(times, signal.times(alignment))
        turn = resampling.rotation_between(attitude[at.index], attitude[at.index + 1])
        return resampling.multiply(attitude[at.index], resampling.from_rotation(at.share * turn))


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
    return Base(layout, signals["position"], attitude, signals["linear_velocity"], signals["angular_velocity"])


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
            f"{columns.info.topic}: {int(loose.sum())} quaternions are off unit norm by up to {off[loose].max():.2g}; "
            "normalised."
        )
        quaternion = np.where(loose[:, None], quaternion / np.where(norm > 0, norm, 1.0)[:, None], quaternion)
    return quaternion


@dataclass
class Joints:
    """States and torques of the joints, in the order of `names`."""

    names: tuple[str, ...]
    position: Signal
    velocity: Signal
    effort: Signal
    locked: dict[str, float] = field(default_factory=dict)

    @property
    def signals(self) -> list[Signal]:
        """All of them."""
        return [self.position, self.velocity, self.effort]

    def on(self, alignment: Alignment, base: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Join with the base's columns, shape (n, 13), to qpos, shape (n, 7 + n_j), and qvel, shape (n, 6 + n_j)."""
        n, n_j = len(alignment.stamps_ns), len(self.names)
        qpos, qvel = np.empty((n, 7 + n_j)), np.empty((n, 6 + n_j))
        qpos[:, :7], qvel[:, :6] = base[:, :7], base[:, 7:]
        if not alignment.resampled:
            qpos[:, 7:], qvel[:, 6:] = self.position.rows(alignment), self.velocity.rows(alignment)
            return qpos, qvel
        times, velocity = self.position.times(alignment), self.velocity.rows(alignment)
        slopes = resampling.linear(self.velocity.times(alignment), velocity, times)
        qpos[:, 7:] = resampling.cubic(times, self.position.rows(alignment), slopes, alignment.stamps_ns)
        qvel[:, 6:] = self.velocity.on(alignment)
        return qpos, qvel


def read_joints(layout: JointMap, topics: Mapping[str, TopicColumns], lag_s: Mapping[str, float]) -> Joints:
    """Take the joints' signals from the columns of their topics."""
    lead = topics[layout.position.topic]
    logged = _logged_names(layout, lead)
    kept = [n for n in logged if n != "-" and not _any(layout.ignore, n, layout.rename.get(n, n))]
    names = tuple(layout.rename.get(name, name) for name in kept)
    for name in names:
        if names.count(name) > 1:
            raise LogError(f"{lead.where}: joint '{name}' occurs {names.count(name)} times, expected once.")
    if not names:
        raise LogError(f"{lead.where}: every joint is ignored by the topic map; it has: {', '.join(logged)}.")
    passive = [column for column, name in enumerate(names) if _any(layout.passive, name)]
    signals = {}
    for quantity, source in layout.sources.items():
        columns = topics[source.topic]
        values = _joint_values(columns, f"{JOINT_STATE} {quantity}", quantity, layout, logged, kept)
        held = quantity == "effort"
        if held and passive:
            bad = np.isnan(values).all(axis=1)
            values[:, passive] = 0.0
            values[bad] = np.nan
        check_finite(columns, values, [f"{quantity} of joint '{name}'" for name in names])
        if source.scale != 1.0:
            values *= source.scale
        signals[quantity] = Signal(columns, values, held, lag_s.get("effort" if held else "joints", 0.0))
    return Joints(names, signals["position"], signals["velocity"], signals["effort"])


def _any(patterns: Sequence[str], *names: str) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns for name in names)


def _logged_names(layout: JointMap, columns: TopicColumns) -> tuple[str, ...]:
    """Names in the order of the arrays: those of the map, or of most messages."""
    if not isinstance(layout.names, TextField):
        return layout.names
    sets: Counter[frozenset[str]] = Counter()
    for texts, count in columns.texts(layout.names.path).items():
        sets[frozenset(texts)] += count
    usual = sets.most_common(1)[0][0]
    names = next(t for t in columns.texts(layout.names.path) if frozenset(t) == usual)
    if not usual:
        raise LogError(f"{columns.where}: sample 0: no joint names (field '{layout.names.path}').")
    return names


def _joint_values(
    columns: TopicColumns, key: str, quantity: str, layout: JointMap, logged: tuple[str, ...], kept: Sequence[str]
) -> FloatArray:
    """Return a quantity of the kept joints, rows that lack some of them marked as unusable, shape (n, n_j)."""
    orders: list[list[int] | None] = []
    others, wrong_width = np.zeros(len(columns), dtype=bool), np.zeros(len(columns), dtype=bool)
    other_reason = width_reason = ""
    at = 0
    for block in columns.blocks:
        rows = slice(at, at + len(block))
        at += len(block)
        here = block.texts.get(layout.names.path, ()) if isinstance(layout.names, TextField) else logged
        found = block.columns[key].shape[1]
        missing = sorted(set(kept) - set(here))
        orders.append([])
        if missing:
            others[rows] = True
            new = sorted(set(here) - set(logged))
            other_reason = other_reason or (
                f"sample {rows.start}: the joints differ from those of most samples "
                f"(missing: {', '.join(missing)}; new: {', '.join(new) or 'none'})"
            )
        elif found != len(here):
            wrong_width[rows] = True
            width_reason = width_reason or (
                f"sample {rows.start}: {quantity} has {found} values, expected one for each of the {len(here)} joints"
            )
        else:
            orders[-1] = None if tuple(here) == tuple(kept) else [here.index(name) for name in kept]
    values = columns.values(key, len(kept), orders)
    columns.leave_out(others, other_reason)
    columns.leave_out(wrong_width, width_reason)
    values[others | wrong_width] = 0.0  # left out already, for a reason of their own
    return values


@dataclass
class Contact:
    """The wrench on one body."""

    layout: ContactMap
    signal: Signal


def read_contact(layout: ContactMap, columns: TopicColumns, lag_s: float) -> Contact:
    """Take a wrench from the columns of its topic: on the robot, about the body's origin."""
    found = columns.widths("wrench").most_common(1)[0][0]
    if found != 6:
        raise LogError(f"{columns.where}: {layout.force} and {layout.torque} have {found} values, expected 6.")
    values = columns.values("wrench", 6)
    names = [f"{path}.{axis}" for path in (layout.force, layout.torque) for axis in "xyz"]
    check_finite(columns, values, names)
    if layout.on is On.GROUND:
        np.negative(values, out=values)
    if layout.rotation != ContactMap.rotation:
        rotation = np.broadcast_to(np.array(layout.rotation), (len(values), 4))
        values = np.hstack([to_world(rotation, values[:, :3]), to_world(rotation, values[:, 3:])])
    if layout.position != ContactMap.position:
        values[:, 3:] += np.cross(np.array(layout.position), values[:, :3])
    return Contact(layout, Signal(columns, values, held=True, lag_s=lag_s))
