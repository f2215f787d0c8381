"""Tables: the columns that a topic map names are a walk, whatever the file is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from massid.errors import LogError
from massid.log import load_topics, read_walk, summarise_log
from tests.log.samples import FEET, JOINTS, ROOT, START_NS, STEP_NS, assert_same, make_samples

N = 60
SAMPLES = make_samples(N)


def columns() -> dict[str, np.ndarray]:
    """One column for each number, as in a CSV file."""
    found = {f"p{axis}": SAMPLES.qpos[:, k] for k, axis in enumerate("xyz")}
    found |= {f"q{axis}": SAMPLES.qpos[:, 3 + k] for k, axis in enumerate("wxyz")}
    found |= {f"v{axis}": SAMPLES.qvel[:, k] for k, axis in enumerate("xyz")}
    found |= {f"w{axis}": SAMPLES.qvel[:, 3 + k] for k, axis in enumerate("xyz")}
    for k, joint in enumerate(JOINTS):
        found |= {f"{joint}.q": SAMPLES.qpos[:, 7 + k], f"{joint}.dq": SAMPLES.qvel[:, 6 + k]}
        found[f"{joint}.tau"] = SAMPLES.effort[:, k]
    for foot in FEET:
        for k, part in enumerate(("fx", "fy", "fz", "mx", "my", "mz")):
            found[f"{foot}.{part}"] = SAMPLES.wrenches[foot][:, k]
    return found


def singly() -> str:
    """The map of such columns."""
    joints = {part: ", ".join(f"{joint}.{part}" for joint in JOINTS) for part in ("q", "dq", "tau")}
    feet = "\n".join(
        f"  - {{topic: table, body: {foot}, force: [{foot}.fx, {foot}.fy, {foot}.fz], "
        f"torque: [{foot}.mx, {foot}.my, {foot}.mz]}}"
        for foot in FEET
    )
    return f"""
base:
  topic: table
  body: {ROOT}
  position: [px, py, pz]
  orientation: {{field: [qw, qx, qy, qz], order: wxyz}}
  linear_velocity: {{field: [vx, vy, vz], frame: world}}
  angular_velocity: [wx, wy, wz]
joints:
  topic: table
  names: [{", ".join(JOINTS)}]
  position: [{joints["q"]}]
  velocity: [{joints["dq"]}]
  effort: [{joints["tau"]}]
contacts:
{feet}
"""


def save(path: Path, values: dict[str, np.ndarray], delimiter: str = ",") -> None:
    rows = np.column_stack(list(values.values()))
    np.savetxt(path, rows, "%.17g", delimiter, header=delimiter.join(values), comments="")


ARRAYS = f"""
base:
  topic: table
  body: {ROOT}
  position: observation.base[0:3]
  orientation: {{field: "observation.base[3:7]", order: wxyz}}
  linear_velocity: {{field: "observation.twist[0:3]", frame: world}}
  angular_velocity: observation.twist[3:6]
joints:
  topic: table
  names: [{", ".join(JOINTS)}]
  position: observation.state[0:4]
  velocity: observation.state[4:8]
  effort: observation.effort
contacts:
  - {{topic: table, body: l_foot, force: "wrench[0][0:3]", torque: "wrench[0][3:6]"}}
  - {{topic: table, body: r_foot, force: "wrench[1][0:3]", torque: "wrench[1][3:6]"}}
"""


def arrays() -> dict[str, np.ndarray]:
    return {
        "timestamp": SAMPLES.stamps,
        "observation.base": SAMPLES.qpos[:, :7],
        "observation.twist": SAMPLES.qvel[:, :6],
        "observation.state": np.hstack([SAMPLES.qpos[:, 7:], SAMPLES.qvel[:, 6:]]),
        "observation.effort": SAMPLES.effort,
        "wrench": np.stack([SAMPLES.wrenches[foot] for foot in FEET], axis=1),
        "task": np.array(["walk"] * N),
    }


def as_npz(path: Path, values: dict[str, np.ndarray]) -> Path:
    np.savez(path, **values)
    return path


def as_parquet(path: Path, values: dict[str, np.ndarray]) -> Path:
    pa.parquet.write_table(pa.table({name: pa.array(value.tolist()) for name, value in values.items()}), path)
    return path


@pytest.mark.parametrize("write", [as_npz, as_parquet])
def test_arrays_are_read(tmp_path: Path, write: Callable[[Path, dict[str, np.ndarray]], Path]) -> None:
    path = write(tmp_path / ("walk.npz" if write is as_npz else "walk.parquet"), arrays())
    (tmp_path / "map.yaml").write_text("time: {field: timestamp, scale: 1.0e-9}\n" + ARRAYS)
    topics = load_topics(tmp_path / "map.yaml")
    walk = read_walk(path, topics)
    assert_same(walk, SAMPLES)
    assert walk.warnings == ()
    (table,) = summarise_log(path, topics.time).topics
    assert (table.messages, round(table.rate_hz)) == (N, 1000)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_csv_is_read(tmp_path: Path, delimiter: str) -> None:
    values = {"time_s": SAMPLES.stamps * 1e-9, **columns()}
    save(tmp_path / "walk.csv", values, delimiter)
    (tmp_path / "map.yaml").write_text(singly())
    walk = read_walk(tmp_path / "walk.csv", load_topics(tmp_path / "map.yaml"))
    # Seconds since the epoch are good to 0.2 us in a double; the clock was even all the same.
    assert (np.diff(walk.stamps_ns) == STEP_NS).all()
    assert abs(walk.stamps_ns[0] - START_NS) < 240
    assert walk.timestep_s == 1e-3
    np.testing.assert_array_equal(walk.qpos, SAMPLES.qpos)
    np.testing.assert_array_equal(walk.effort, SAMPLES.effort)
    np.testing.assert_array_equal(walk.wrench[:, 1], SAMPLES.wrenches["r_foot"])


def test_a_dropped_row_is_bridged(tmp_path: Path) -> None:
    kept = {name: np.delete(values, 20, axis=0) for name, values in arrays().items()}
    (tmp_path / "map.yaml").write_text("time: {field: timestamp, scale: 1.0e-9}\n" + ARRAYS)
    walk = read_walk(as_npz(tmp_path / "walk.npz", kept), load_topics(tmp_path / "map.yaml"))
    assert len(walk) == N
    assert len(walk.segments) == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("[px, py, pz]", "[px, py, pw]"), "base state position: no field 'pw'.*qw, qx"),
        (lambda text: "time: clock\n" + text, "no column 'clock' of times; the columns are: time_s, px"),
        (lambda text: "time: {field: time_s, scale: 1.0e9}\n" + text, "column 'time_s' holds no times in seconds"),
        (
            lambda text: text.replace(f"body: {ROOT}", "body: {field: frame}"),
            "frame is empty, expected the name of",
        ),
    ],
)
def test_what_does_not_fit_a_table_is_named(tmp_path: Path, change: Callable[[str], str], message: str) -> None:
    values = {"time_s": SAMPLES.stamps * 1e-9, **columns()}
    save(tmp_path / "walk.csv", values)
    (tmp_path / "map.yaml").write_text(change(singly()))
    with pytest.raises(LogError, match=message) as caught:
        read_walk(tmp_path / "walk.csv", load_topics(tmp_path / "map.yaml"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("walk.csv", b"1,2,3\n4,5,6\n"),
        ("walk.csv", b"a,b\n1,2,3\n4\n"),
        ("walk.csv", b"\xff\xfe\x00\x01"),
        ("walk.npz", b"PK\x03\x04" + bytes(200)),
        ("walk.parquet", b"PAR1" + bytes(200)),
    ],
)
def test_a_damaged_table_is_one_line(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(LogError, match="that cannot be read: ") as caught:
        read_walk(tmp_path / name)
    assert "\n" not in str(caught.value)
