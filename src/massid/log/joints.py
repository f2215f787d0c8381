"""States and torques of the joints, which may come in messages of several publishers, in MuJoCo's conventions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from massid.errors import LogError
from massid.log.alignment import Alignment
from massid.log.columns import TopicColumns
from massid.log.signals import Signal, check_finite
from massid.log.topics.map import JOINT_STATE, JointMap, Seldom, TextField
from massid.typing import FloatArray
from massid.walk import resampling

_NO_EFFORT = (
    "What acts there is not known: if these joints have no actuator, name them under `joints: passive`; if they were "
    "held still, under `joints: ignore` and their position under `joints: locked`"
)
_NAMED = 3
_OFTEN = 0.4  # of the messages of most joints: those of others that come less often would slow the walk down


@dataclass
class Part:
    """A quantity of those joints that one publisher sends.

    Attributes:
        signal: shape (n, joints of the part).
        places: where these stand among all joints.
    """

    signal: Signal
    places: list[int]


@dataclass
class Joints:
    """States and torques of the joints, in the order of `names`; each quantity in one part or several."""

    names: tuple[str, ...]
    position: list[Part]
    velocity: list[Part]
    effort: list[Part]

    @property
    def signals(self) -> list[Signal]:
        """All of them."""
        return [part.signal for part in (*self.position, *self.velocity, *self.effort)]

    def states(self, alignment: Alignment) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities on the alignment's clock, each of shape (n, n_j)."""
        velocity = self._joined(self.velocity, alignment)
        if alignment.exact:
            return self._joined(self.position, alignment), velocity
        position = np.empty_like(velocity)
        for part in self.position:
            times = part.signal.times(alignment)
            slopes = np.empty((len(times), len(self.names)))
            for other in self.velocity:
                rates = other.signal.rows(alignment)
                slopes[:, other.places] = resampling.linear(other.signal.times(alignment), rates, times)
            position[:, part.places] = resampling.cubic(
                times, part.signal.rows(alignment), slopes[:, part.places], alignment.stamps_ns
            )
        return position, velocity

    def torques(self, alignment: Alignment) -> FloatArray:
        """Torques on the alignment's clock, shape (n, n_j)."""
        return self._joined(self.effort, alignment)

    def _joined(self, parts: Sequence[Part], alignment: Alignment) -> FloatArray:
        if len(parts) == 1:
            return parts[0].signal.on(alignment)
        out = np.empty((len(alignment.stamps_ns), len(self.names)))
        for part in parts:
            out[:, part.places] = part.signal.on(alignment)
        return out


def read_joints(layout: JointMap, topics: Mapping[str, TopicColumns], lag_s: Mapping[str, float]) -> Joints:
    """Take the joints' signals from the columns of their topics."""
    lead = topics[layout.position.topic]
    groups = _groups(layout, lead)
    logged = tuple(name for group in groups for name in group)
    kept = [n for n in logged if n != "-" and not _any(layout.ignore, n, layout.rename.get(n, n))]
    names = tuple(layout.rename.get(name, name) for name in kept)
    for name in names:
        if names.count(name) > 1:
            raise LogError(f"{lead.where}: joint '{name}' occurs {names.count(name)} times, expected once.")
    if not names:
        raise LogError(f"{lead.where}: every joint is ignored by the topic map; it has: {', '.join(logged)}.")
    parts: dict[str, list[Part]] = {}
    split: dict[int, list[TopicColumns]] = {}
    for quantity, source in layout.sources.items():
        columns = topics[source.topic]
        if id(columns) not in split:
            split[id(columns)] = _split(layout, columns, groups, kept)
        parts[quantity] = []
        held = quantity == "effort"
        shared = [group for group in groups if set(group) & set(kept)]
        for group, own in zip(shared, split[id(columns)], strict=True):
            here = [name for name in kept if name in group]
            values = _joint_values(own, f"{JOINT_STATE} {quantity}", quantity, layout, tuple(group), here)
            called = [layout.rename.get(name, name) for name in here]
            if held:
                _silence(values, [k for k, name in enumerate(called) if _any(layout.passive, name)])
            what = [f"{quantity} of joint '{name}'" for name in called]
            holes = check_finite(own, values, what, _NO_EFFORT if held else "", apart=True)
            if source.scale != 1.0:
                values *= source.scale
            if held and layout.gears:
                values *= [_gear(layout.gears, name) for name in called]
            signal = Signal(own, values, held, lag_s.get("effort" if held else "joints", 0.0), holes)
            parts[quantity].append(Part(signal, [kept.index(name) for name in here]))
    return Joints(names, parts["position"], parts["velocity"], parts["effort"])


def _silence(effort: FloatArray, passive: list[int]) -> None:
    """Take the efforts of passive joints for zero, in every row that holds any effort."""
    if passive:
        bad = np.isnan(effort).all(axis=1)
        effort[:, passive] = 0.0
        effort[bad] = np.nan


def _gear(gears: Mapping[str, float], name: str) -> float:
    return next((ratio for pattern, ratio in gears.items() if fnmatchcase(name, pattern)), 1.0)


def _any(patterns: Sequence[str], *names: str) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns for name in names)


def _groups(layout: JointMap, columns: TopicColumns) -> list[tuple[str, ...]]:
    """Names in the order of the arrays: those of the map, or of each kind of message that adds joints of its own.

    Messages that share joints with others are no such kind, nor are those that come far less often (a gripper's).
    """
    if not isinstance(layout.names, TextField):
        return [layout.names]
    sets: Counter[frozenset[str]] = Counter()
    for texts, count in columns.texts(layout.names.path).items():
        sets[frozenset(texts)] += count
    groups: list[tuple[str, ...]] = []
    taken: set[str] = set()
    most = 0
    for names, count in sorted(sets.items(), key=lambda item: -item[1] * len(item[0])):
        ignored = all(_any(layout.ignore, name, layout.rename.get(name, name)) for name in names)
        if names & taken or not names or (ignored and groups):
            continue
        if count < _OFTEN * most and layout.seldom is Seldom.LEAVE:
            continue
        most = most or count
        groups.append(next(t for t in columns.texts(layout.names.path) if frozenset(t) == names))
        taken |= names
    if not groups:
        raise LogError(f"{columns.where}: sample 0: no joint names (field '{layout.names.path}').")
    return groups


def _split(
    layout: JointMap, columns: TopicColumns, groups: Sequence[tuple[str, ...]], kept: Sequence[str]
) -> list[TopicColumns]:
    """The messages of each group that holds joints in use; those of none stay with the first, which refuses them."""
    used = [group for group in groups if set(group) & set(kept)]
    if len(used) <= 1 or not isinstance(layout.names, TextField):
        return [columns] * len(used)
    path = layout.names.path
    kinds = list(columns.texts(path))
    found = []
    for k, group in enumerate(used):
        others = {name for other in groups if other is not group for name in other}
        mine = [kind for kind in kinds if set(kind) & set(group) or (k == 0 and not set(kind) & others)]
        listed = ", ".join(group[:_NAMED]) + (", ..." if len(group) > _NAMED else "")
        found.append(columns.part(mine, path, listed))
    return found


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
            apart = not set(here) & set(logged)
            cure = "; `joints: seldom: keep` in a topic map takes what comes less often, too" if apart else ""
            other_reason = other_reason or (
                f"sample {rows.start}: the joints differ from those of most samples "
                f"(missing: {', '.join(missing)}; new: {', '.join(new) or 'none'}{cure})"
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
