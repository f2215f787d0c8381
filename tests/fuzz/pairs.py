"""Results and sidecars that somebody made up: their checksums agree, and their numbers, types and shapes do not."""

from __future__ import annotations

import copy
import hashlib
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from massid.errors import BadInputError
from massid.result.file import plain
from massid.view.report import write_report
from tests.fuzz.fuzzing import CRASHED, REFUSED, WHOLE, Outcome
from tests.result.samples import document, entries

VALUES: tuple[Any, ...] = (
    None, "x", "", True, -3, 0, 0.0, [], [[]], {}, {"": {}}, 10**400, 1e308, -1e308, 5e-324, 1e100, -1e99, 1e-13,
    float("nan"), float("inf"), [1.0], [2.0, 1.0], "<script>", "\ud800", "\x1b[2J", "$x", 2**63, ["a"] * 100,
)  # fmt: skip


def sound() -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """A document and arrays that belong to it."""
    rng = np.random.default_rng(0)
    times = np.linspace(0.0, 1.0, 20)
    arrays = {
        "estimate": np.array([4.4, 2.3]),
        "covariance": np.diag([0.01, 1.0]),
        "predicted_covariance": np.eye(2),
        "torque_time_s": times,
        **{f"torque_{name}": rng.normal(size=(20, 1)) for name in ("measured", "nominal", "identified")},
        "residual_channels": np.array(["knee", "sole"]),
        "residual_nominal": np.array([1.0, 2.0]),
        "residual_identified": np.array([1.0, 1.1]),
    }
    return plain(document()), arrays


def _spoiled_array(array: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    choices = [
        lambda: array[:-1],
        lambda: np.concatenate([array, array]),
        lambda: array[None],
        lambda: array.ravel()[0],
        lambda: np.zeros(array.shape),
        lambda: np.full(array.shape, np.nan),
        lambda: np.full(array.shape, 1e308),
        lambda: -np.ones(array.shape),
        lambda: np.zeros((0,) * array.ndim),
        lambda: np.zeros(array.shape, dtype=complex),
        lambda: np.zeros(array.shape, dtype=[("a", "f8")]),
        lambda: np.zeros(array.shape, dtype="M8[s]"),
        lambda: array.astype("U3"),
        lambda: np.zeros(array.shape, dtype="f2"),
        lambda: np.zeros(array.shape, dtype="i8"),
        lambda: np.zeros(array.shape, dtype="O"),
        lambda: np.array(["<b>\x1b"] * array.size).reshape(array.shape),
    ]
    return np.asarray(choices[int(rng.integers(len(choices)))]())


def _archive(arrays: dict[str, np.ndarray], rng: np.random.Generator) -> bytes:
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    content = out.getvalue()
    match int(rng.integers(20)):
        case 0:
            data = bytearray(content)
            for _ in range(int(rng.integers(1, 20))):
                data[int(rng.integers(len(data)))] ^= int(rng.integers(1, 256))
            return bytes(data)
        case 1:
            return content[: int(rng.integers(len(content)))]
        case 2:  # a header that claims more than there is
            out = io.BytesIO()
            with zipfile.ZipFile(out, "w") as archive:
                for name in arrays:
                    head = io.BytesIO()
                    shape = (10 ** int(rng.integers(0, 16)),)
                    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": shape})
                    archive.writestr(f"{name}.npy", head.getvalue() + bytes(80))
            return out.getvalue()
        case 3:
            out = io.BytesIO()
            with zipfile.ZipFile(out, "w") as archive:
                archive.writestr("../estimate.npy", rng.bytes(100))
            return out.getvalue()
    return content


def write_pair(folder: Path, rng: np.random.Generator) -> Path:
    """Spoil a sound pair in a few places, let the checksums agree, and write it."""
    entries_of, arrays = sound()
    whole = copy.deepcopy(entries_of)
    for _ in range(int(rng.integers(0, 3))):
        places = list(entries(whole))
        where = places[int(rng.integers(len(places)))]
        inner: Any = whole
        for name in where[:-1]:
            inner = inner[name]
        if rng.random() < 0.2:
            del inner[where[-1]]
        else:
            inner[where[-1]] = copy.deepcopy(VALUES[int(rng.integers(len(VALUES)))])
    for name in rng.permutation(sorted(arrays))[: int(rng.integers(0, 3))].tolist():
        if rng.random() < 0.2 or arrays[name].size < 2:
            del arrays[name]
        else:
            arrays[name] = _spoiled_array(arrays[name], rng)
    content = _archive(arrays, rng)
    (folder / "r.npz").write_bytes(content)
    whole["sidecar_sha256"] = hashlib.sha256(content).hexdigest()
    (folder / "r.json").write_text(json.dumps(whole))
    return folder / "r.json"


def judge_pair(path: Path) -> Outcome:
    """Make a page of a pair."""
    try:
        write_report(path, path.with_suffix(".html"))
    except BadInputError as error:
        return Outcome(CRASHED, str(error)) if "\n" in str(error) else Outcome(REFUSED, str(error))
    except BaseException as error:  # whatever escapes is what this looks for
        return Outcome(CRASHED, f"{type(error).__name__}: {error}")
    return Outcome(WHOLE)
