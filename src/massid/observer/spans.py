"""How far around a sample its neighbours are looked at: times, counted in the samples of a log.

Motion, noise and the settling of a foot know nothing of a log's rate. Counts have a least value below which an average,
or a distance that keeps the noise of neighbours apart, means nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

GAP_S, REACH_S = 0.005, 0.02
"""The motion at a sample is estimated from those more than a gap and at most a reach before and after it [s]. The reach
is that of a walk; slower motion bears a longer one."""
FINER_S = ((0.003, 0.012), (0.002, 0.008), (0.001, 0.005))
"""Gaps and reaches of shorter lines, for what changes faster [s]."""
HALF_WIDTH_S = 0.007
"""Forces that tell load, and velocities that tell friction, are averaged over so much before and after them [s]."""
BRIEF_S = 0.001
"""Torques that tell who sticks are averaged over so much before and after them [s]: they change within milliseconds."""
SETTLING_S = 0.02
"""Time after the last load before a foot counts as unloaded [s]: it may be rolling off the ground, hardly loaded."""
LEAST_NEIGHBOURS = 3
"""On each side: a straight line through fewer says little."""


@dataclass(frozen=True)
class Spans:
    """The spans in samples.

    Attributes:
        gap: neighbours on each side that have no part in the motion at a sample, at least 1.
        reach: the furthest that has, at least `LEAST_NEIGHBOURS` more.
        half_width: neighbours on each side that a reading is averaged with, at least 1.
        brief: likewise, where it changes quickly, at least 1.
        settling: samples after the last load before a foot counts as unloaded, at least 1.
        finer: gaps and reaches of shorter lines, the longest first; those that a log is too slow for are left out.
    """

    gap: int
    reach: int
    half_width: int
    brief: int
    settling: int
    finer: tuple[tuple[int, int], ...] = ()

    @classmethod
    def at(cls, timestep_s: float, reach_s: float = REACH_S) -> Spans:
        """The spans of a log with a sample period, and a reach that suits its motion."""
        gap, reach, half_width, brief, settling = (
            max(1, round(span_s / timestep_s)) for span_s in (GAP_S, reach_s, HALF_WIDTH_S, BRIEF_S, SETTLING_S)
        )
        finer = []
        for gap_s, span_s in FINER_S:
            pair = (max(1, round(gap_s / timestep_s)), max(1, round(span_s / timestep_s)))
            if pair[1] >= pair[0] + 2 and pair not in finer:
                finer.append(pair)
        return cls(gap, max(reach, gap + LEAST_NEIGHBOURS), half_width, brief, settling, tuple(finer))

    @property
    def width(self) -> int:
        """Readings in an average."""
        return 2 * self.half_width + 1

    @property
    def brief_width(self) -> int:
        """Readings in a brief average."""
        return 2 * self.brief + 1

    @property
    def look_ahead(self) -> int:
        """Samples after a block that bear upon it: the furthest wrench in its motion, and what that is judged by."""
        return self.reach + self.half_width

    @property
    def memory(self) -> int:
        """Samples before a block that bear upon it, likewise."""
        return self.reach + self.settling + self.half_width
