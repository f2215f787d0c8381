"""One recorded walk as immutable arrays, and what is done to its signals: frames, rotations, clocks, noise."""

from massid.walk.walk import Sample, Segment, Walk

__all__ = ["Sample", "Segment", "Walk"]
