"""One recorded walk as immutable arrays, in MuJoCo's conventions.

Sample k is the state at time t_k, before the step; effort and wrench act from t_k until t_{k+1} (zero-order hold).
The reader converts from ROS conventions once; nothing behind this class sees an xyzw quaternion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from massid.errors import LogError, unknown_name
from massid.typing import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Segment:
    """A run of samples without a gap: samples start .. stop - 1."""

    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


@dataclass(frozen=True)
class Sample:
    """One sample of a walk, as a live stream delivers it; the rows are those of `Walk`.

    Attributes:
        stamp_ns: time [ns].
        qpos: shape (7 + n_j,).
        qvel: shape (6 + n_j,).
        effort: shape (n_j,).
        wrench: shape (n_c, 6).
    """

    stamp_ns: int
    qpos: FloatArray
    qvel: FloatArray
    effort: FloatArray
    wrench: FloatArray

    @property
    def is_finite(self) -> bool:
        """Whether it holds nothing but numbers."""
        return all(np.isfinite(part).all() for part in (self.qpos, self.qvel, self.effort, self.wrench))


@dataclass(frozen=True)
class Walk:
    """Joint states, joint torques and contact wrenches of one walk.

    Attributes:
        root_body: name of the floating base body.
        joint_names: the n_j actuated or passive one-axis joints, in column order.
        contact_bodies: the n_c bodies whose contact wrench was measured, in column order.
        stamps_ns: sample times since the Unix epoch [ns], shape (n_samples,), strictly increasing.
        qpos: base position [m], base quaternion (wxyz), joint positions [rad or m], shape (n_samples, 7 + n_j).
        qvel: base linear velocity in the world [m/s], base angular velocity in the base frame [rad/s], joint
            velocities [rad/s or m/s], shape (n_samples, 6 + n_j).
        effort: torque that each joint's actuator exerted over the step [N m or N], shape (n_samples, n_j).
        wrench: force [N] and moment [N m] about the body frame's origin that the environment exerts on the body,
            both in the body frame, shape (n_samples, n_c, 6).
        timestep_s: sample period [s].
        segments: runs without a gap, in order; windows never cross from one to the next.
        metadata: what the recorder said about the log (model file, hash, sensor noise), never any truth.
        warnings: what was lost or repaired while reading, one line each.
        source: where the walk came from, for messages.
        world_wrenches: contact bodies whose wrench is still expressed in the world: turning it into the body takes the
            robot's model (`Robot.align`).
        open_axes: columns of the wrenches, six for each contact body, that no sensor measured. Their values are zero,
            or what was found for them otherwise; where all of a foot's are zero, it is taken to be off the ground.
    """

    root_body: str
    joint_names: tuple[str, ...]
    contact_bodies: tuple[str, ...]
    stamps_ns: IntArray
    qpos: FloatArray
    qvel: FloatArray
    effort: FloatArray
    wrench: FloatArray
    timestep_s: float
    segments: tuple[Segment, ...] = ()
    metadata: dict[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    source: str = "walk"
    world_wrenches: tuple[str, ...] = ()
    open_axes: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        n, n_j, n_c = len(self.stamps_ns), len(self.joint_names), len(self.contact_bodies)
        expected = {
            "qpos": (n, 7 + n_j),
            "qvel": (n, 6 + n_j),
            "effort": (n, n_j),
            "wrench": (n, n_c, 6),
        }
        for name, shape in expected.items():
            found = getattr(self, name).shape
            if found != shape:
                raise LogError(f"{self.source}: {name} has shape {found}, expected {shape}.")
        for name in ("stamps_ns", *expected):
            array = np.ascontiguousarray(getattr(self, name))
            if array.flags.writeable:
                array = array.copy()
                array.flags.writeable = False
            object.__setattr__(self, name, array)
        if not self.segments:
            object.__setattr__(self, "segments", (Segment(0, n),))
        self._check_axes()
        self._check_samples()

    def _check_axes(self) -> None:
        """Pass if the columns without a sensor are columns."""
        n_axes = 6 * len(self.contact_bodies)
        if strange := [axis for axis in self.open_axes if not 0 <= axis < n_axes]:
            raise LogError(f"{self.source}: open axis {strange[0]}; the wrenches have columns 0 .. {n_axes - 1}.")

    def _check_samples(self) -> None:
        """Pass if there are samples, all numbers in use are finite and no sample is in use twice."""
        if not (math.isfinite(self.timestep_s) and self.timestep_s > 0.0):
            raise LogError(f"{self.source}: the sample period is {self.timestep_s} s; expected a finite time above 0.")
        if not len(self):
            raise LogError(f"{self.source}: there is no sample.")
        stop = 0
        for segment in self.segments:
            if not stop <= segment.start < segment.stop <= len(self):
                raise LogError(
                    f"{self.source}: segment {segment.start} .. {segment.stop} of {len(self)} samples; expected "
                    "segments in order that do not overlap."
                )
            stop = segment.stop
            for name in ("qpos", "qvel", "effort", "wrench"):
                part = getattr(self, name)[segment.start : segment.stop]
                if not np.isfinite(part).all():
                    row = segment.start + int(np.argwhere(~np.isfinite(part))[0][0])
                    raise LogError(
                        f"{self.source}: sample {row} has a {name} that is not finite; leave such samples out of the "
                        "segments."
                    )

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def measured(self) -> BoolArray:
        """Which components of the wrenches have a sensor, shape (n_c, 6)."""
        out = np.ones((len(self.contact_bodies), 6), dtype=np.bool_)
        out.flat[list(self.open_axes)] = False
        return out

    @property
    def duration_s(self) -> float:
        """Time covered by the samples, gaps left out [s]."""
        return sum(len(segment) for segment in self.segments) * self.timestep_s

    @property
    def time_s(self) -> FloatArray:
        """Seconds since the first sample, shape (n_samples,)."""
        return np.asarray((self.stamps_ns - self.stamps_ns[0]) * 1e-9, dtype=np.float64)

    def samples(self) -> Iterator[Sample]:
        """Yield the samples one by one, as a robot would."""
        for segment in self.segments:
            for k in range(segment.start, segment.stop):
                yield Sample(int(self.stamps_ns[k]), self.qpos[k], self.qvel[k], self.effort[k], self.wrench[k])

    def windows(self, dwell_s: float) -> Iterator[Segment]:
        """Yield dwell windows of equal length, none of which crosses a gap; a shorter rest is left out.

        A window of n steps needs n + 1 samples: its last sample is the first of the next window.

        Raises:
            LogError: dwell_s is shorter than two samples.
        """
        steps = round(dwell_s / self.timestep_s)
        if steps < 2:
            raise LogError(
                f"A dwell time of {dwell_s} s is shorter than two samples of {self.timestep_s} s; use a longer one."
            )
        for segment in self.segments:
            for start in range(segment.start, segment.stop - steps, steps):
                yield Segment(start, start + steps + 1)

    def filled_windows(self, dwell_s: float) -> list[Segment]:
        """The dwell windows, of which there is one at least.

        Raises:
            LogError: dwell_s is shorter than two samples, or no segment is as long.
        """
        windows = list(self.windows(dwell_s))
        if not windows:
            longest = max(len(segment) for segment in self.segments) * self.timestep_s
            if len(self.segments) > 1 and self.duration_s > dwell_s:
                lost = next((line for line in reversed(self.warnings) if "left out" in line or "gap" in line), "")
                raise LogError(
                    f"{self.source}: {len(self.segments) - 1} gaps cut {self.duration_s:.4g} s of samples into pieces "
                    f"of at most {longest:.4g} s, which do not fill one dwell window of {dwell_s} s; use a shorter "
                    f"`dwell_s`, or mend what cuts the log{': ' + lost if lost else '.'}"
                )
            raise LogError(
                f"{self.source}: {longest:.4g} s of samples without a gap do not fill one dwell window of {dwell_s} s; "
                "record a longer walk or use a shorter `dwell_s`."
            )
        return windows

    def between(self, start: int, stop: int) -> Walk:
        """Samples start .. stop - 1, some of which are in use, as a walk of its own that shares their memory."""
        rows = slice(start, stop)
        clipped = ((max(one.start, start) - start, min(one.stop, stop) - start) for one in self.segments)
        return replace(
            self,
            stamps_ns=self.stamps_ns[rows],
            qpos=self.qpos[rows],
            qvel=self.qvel[rows],
            effort=self.effort[rows],
            wrench=self.wrench[rows],
            segments=tuple(Segment(first, last) for first, last in clipped if first < last),
        )

    def with_joint_order(self, joint_names: tuple[str, ...]) -> Walk:
        """Return the walk with its joint columns in the given order; joints not named are dropped.

        Raises:
            LogError: a joint is missing from the log.
        """
        columns = []
        for name in joint_names:
            if name not in self.joint_names:
                raise LogError(unknown_name("joint", name, self.joint_names, self.source))
            columns.append(self.joint_names.index(name))
        if columns == list(range(len(self.joint_names))):
            return self
        picked = np.asarray(columns, dtype=np.int64)
        return replace(
            self,
            joint_names=joint_names,
            qpos=np.hstack([self.qpos[:, :7], self.qpos[:, 7 + picked]]),
            qvel=np.hstack([self.qvel[:, :6], self.qvel[:, 6 + picked]]),
            effort=self.effort[:, picked],
        )
