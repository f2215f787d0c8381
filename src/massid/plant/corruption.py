"""What imperfect sensors would have logged of a walk that was recorded without noise."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from massid.errors import BadInputError, unknown_name
from massid.inputs import LARGEST_TEXT, problem_of
from massid.log import read_walk, write_walk
from massid.log.mcap.sink import partial_path
from massid.outputs import check_outputs
from massid.plant.truth import as_json, truth_path
from massid.walk import Walk
from massid.walk.noise import PRESETS, NoisePreset, Sensors
from massid.walk.white_noise import looks_noisy

SIMULATED_NOISE = "simulated"
"""What a log says of its sensor noise: which noise it was, only the truth file knows."""
_SENSOR_SEEDS = (2,)
"""A recording's seed has spawned two other generators, for masses and gait."""


@dataclass(frozen=True)
class Corruption:
    """What was written.

    Attributes:
        path: the log.
        truth_path: the truth of the clean log, with what the sensors do wrong.
        walk: what the new log holds, with the warnings of the clean one.
    """

    path: Path
    truth_path: Path
    walk: Walk


def check_noise(noise: str) -> None:
    """Pass if there is such a preset.

    Raises:
        BadInputError: there is none.
    """
    if noise not in PRESETS:
        raise BadInputError(unknown_name("sensor noise", noise, PRESETS, "massid"))


def sensors_of(walk: Walk, noise: NoisePreset, seed: int) -> Sensors:
    """The sensors that a seed stands for; they can measure one walk.

    Raises:
        BadInputError: no such preset, or a negative seed.
    """
    check_noise(noise)
    if seed < 0:
        raise BadInputError(f"The seed of the sensor noise is {seed}; it must not be negative.")
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=_SENSOR_SEEDS))
    return Sensors(PRESETS[noise], len(walk.joint_names), walk.contact_bodies, rng)


def corrupt_log(
    source: Path | str, path: Path | str, noise: NoisePreset, seed: int = 0, *, wrenches: bool = True
) -> Corruption:
    """Write what noisy sensors would have logged, and the truth beside it.

    The log keeps its model, gaps and end. Preset, seed and the drawn offsets and gains go into the truth file alone.

    Args:
        source: a log without noise, NAME.mcap; NAME.truth.json beside it is taken along if it is there.
        path: the log to write; replaced if it exists.
        noise: clean, white, realistic or harsh.
        seed: of the sensors.
        wrenches: whether there are contact sensors; feet without are named in the log's metadata.

    Raises:
        BadInputError: no such preset, a negative seed, the same file, a log with simulated noise already, a truth file
            that is not JSON, or a file that cannot be written.
        LogError: the log cannot be read or written.
    """
    source, path = Path(source), Path(path)
    check_outputs(
        [("the clean log", source), (f"the truth file of {source.name}", truth_path(source))],
        [
            ("the noisy log", path),
            ("the noisy log, NAME.partial until it is complete,", partial_path(path)),
            ("the noisy log, whose truth file lies beside it,", truth_path(path)),
        ],
    )
    walk = read_walk(source)
    if noise != "clean" and walk.metadata.get("sensor_noise") == SIMULATED_NOISE:
        raise BadInputError(f"{source} has simulated sensor noise already; name the clean log that it was made from.")
    sensors = sensors_of(walk, noise, seed)
    truth = _load(truth_path(source))
    measured = sensors.measure(walk)
    if not wrenches:
        measured = without_wrenches(measured)
    if noise != "clean" and looks_noisy(walk):
        doubled = f"{source}: velocities shake as if sensors had noise already; `noise={noise}` comes on top of it."
        measured = replace(measured, warnings=(*measured.warnings, doubled))
    drawn = {"preset": noise, "seed": seed, "std": asdict(sensors.noise), "drawn": sensors.drawn()}
    said = {} if noise == "clean" else {"sensor_noise": SIMULATED_NOISE}
    if noise != "clean" or "sensors" not in truth:
        truth = truth | {"sensors": drawn}
    write_walk(measured, path, said, {truth_path(path): as_json(truth)})
    return Corruption(path, truth_path(path), measured)


def without_wrenches(walk: Walk) -> Walk:
    """What a robot without contact sensors would have logged."""
    return replace(walk, wrench=np.zeros_like(walk.wrench), open_axes=tuple(range(6 * len(walk.contact_bodies))))


def _load(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {}
    if problem := problem_of(path, LARGEST_TEXT):
        raise BadInputError(f"Truth file {path} {problem}.")
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BadInputError(f"Truth file {path} cannot be read as JSON ({error}).") from error
    if not isinstance(document, dict):
        raise BadInputError(f"Truth file {path} holds a {type(document).__name__}, expected an object.")
    return document
