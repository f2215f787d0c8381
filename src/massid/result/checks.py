"""What the checks of a result against its own log found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massid.result.document import TorqueErrorEntry, TorquesEntry, ValidationEntry, WeightEntry
from massid.result.posterior import INTERVAL_95
from massid.typing import FloatArray

CUTOFF_HZ = 5.0
"""Of the low-pass under which torques are compared: accelerations of noisy velocities say nothing above."""
LARGEST_DISAGREEMENT = 3.0
"""Standard errors by which the mass found and the mass that the ground carried may differ."""
WORSE = 1.1
"""Factor by which predicted torques may get worse before it is worth a warning."""


@dataclass(frozen=True)
class TorquePrediction:
    """Joint torques of the held-out part, measured and predicted.

    Attributes:
        joints: names.
        time_s: of the instants compared, since the log's first sample, shape (n,).
        measured: shape (n, n_joints) [N m].
        nominal: predicted with the model file's masses, shape (n, n_joints) [N m].
        identified: predicted with what was found, sensor errors included, shape (n, n_joints) [N m].
    """

    joints: tuple[str, ...]
    time_s: FloatArray
    measured: FloatArray
    nominal: FloatArray
    identified: FloatArray

    @property
    def rms_nominal(self) -> FloatArray:
        """Root mean square error of each joint's torque before, shape (n_joints,) [N m]."""
        return np.asarray(np.sqrt(np.mean((self.nominal - self.measured) ** 2, axis=0)))

    @property
    def rms_identified(self) -> FloatArray:
        """Root mean square error of each joint's torque after, shape (n_joints,) [N m]."""
        return np.asarray(np.sqrt(np.mean((self.identified - self.measured) ** 2, axis=0)))

    @property
    def rms(self) -> tuple[float, float]:
        """The same over all joints: before, after [N m]."""
        before, after = (float(np.sqrt(np.mean(each**2))) for each in (self.rms_nominal, self.rms_identified))
        return before, after

    def entry(self) -> TorquesEntry:
        """As a document holds it: the errors without the curves."""
        before, after = self.rms
        rows = zip(self.joints, self.rms_nominal.tolist(), self.rms_identified.tolist(), strict=True)
        return TorquesEntry(
            cutoff_hz=CUTOFF_HZ,
            rms_nominal_nm=before,
            rms_identified_nm=after,
            joints={
                joint: TorqueErrorEntry(rms_nominal_nm=nominal, rms_identified_nm=identified)
                for joint, nominal, identified in rows
            },
        )


@dataclass(frozen=True)
class WeightCheck:
    """Mass of the whole robot, found and carried.

    Attributes:
        found_kg: model file with the masses found in it [kg].
        found_std_kg: its standard deviation; 0 for a log without noise [kg].
        carried_kg: mean vertical force over g, corrected by the change of momentum [kg].
        carried_std_kg: standard error of that, from the noise of the sensors [kg].
    """

    found_kg: float
    found_std_kg: float
    carried_kg: float
    carried_std_kg: float

    @property
    def found_text(self) -> str:
        """What was found, in words, with its 95 % interval."""
        half = f" +-{INTERVAL_95 * self.found_std_kg:.2g}" if self.found_std_kg else ""
        return f"{self.found_kg:.2f}{half} kg"

    @property
    def carried_text(self) -> str:
        """What the ground carried, in words, with its 95 % interval."""
        return f"{self.carried_kg:.2f} +-{INTERVAL_95 * self.carried_std_kg:.2g} kg"

    @property
    def agrees(self) -> bool:
        """Whether the two differ by no more than their errors allow."""
        error = float(np.hypot(self.carried_std_kg, self.found_std_kg))
        return abs(self.found_kg - self.carried_kg) <= LARGEST_DISAGREEMENT * error

    def entry(self) -> WeightEntry:
        """As a document holds it."""
        return WeightEntry(
            found_kg=self.found_kg,
            found_std_kg=self.found_std_kg,
            carried_kg=self.carried_kg,
            carried_std_kg=self.carried_std_kg,
            agrees=self.agrees,
        )


@dataclass(frozen=True)
class Residuals:
    """Mean squares of whitened innovations; 1 where model and noise explain the channel.

    Attributes:
        channels: the base's position, attitude, velocity and turn rate, then every joint's position and velocity.
        nominal: with the model file's masses, shape (n_channels,).
        identified: with what was found, shape (n_channels,).
        seconds: of the log they were taken from [s].
    """

    channels: tuple[str, ...]
    nominal: FloatArray
    identified: FloatArray
    seconds: float


@dataclass(frozen=True)
class Validation:
    """What the log says about the result.

    Attributes:
        held_out_s: length of the part that was not fitted [s]; 0 for none.
        torques: prediction of its joint torques; None if nothing was held out.
        weight: of the first log; None if nothing carries the robot.
        residuals: channel by channel; None for a log without noise.
    """

    held_out_s: float
    torques: TorquePrediction | None
    weight: WeightCheck | None
    residuals: Residuals | None = None

    def lines(self) -> list[str]:
        """One line for each check."""
        found = []
        if self.torques is not None:
            before, after = self.torques.rms
            found.append(
                f"held-out torques ({self.held_out_s:.1f} s): off by {before:.3g} N m with the model file, "
                f"{after:.2g} N m with the masses found (root mean square over joints, below {CUTOFF_HZ:g} Hz)"
            )
        if self.weight is not None:
            weight = self.weight
            found.append(f"whole robot: {weight.found_text} found, the ground carried {weight.carried_text} (+-: 95 %)")
        return found

    def warnings(self) -> tuple[str, ...]:
        """What went wrong, one line each."""
        found = []
        if self.weight is not None and not self.weight.agrees:
            found.append(
                f"the masses found add up to {self.weight.found_text}, but the ground carried "
                f"{self.weight.carried_text}: the model, the force sensors or a contact that was not measured is wrong."
            )
        if self.torques is not None and self.torques.rms[1] > WORSE * self.torques.rms[0]:
            before, after = self.torques.rms
            found.append(
                f"the masses found predict the held-out joint torques worse ({after:.3g} N m) than the model file "
                f"({before:.3g} N m): do not use them."
            )
        return tuple(found)

    def entry(self) -> ValidationEntry:
        """As a document holds it."""
        return ValidationEntry(
            held_out_s=self.held_out_s,
            torques=None if self.torques is None else self.torques.entry(),
            weight=None if self.weight is None else self.weight.entry(),
        )
