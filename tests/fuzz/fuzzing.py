"""Damaged logs and topic maps made from sound ones, and what the reader makes of them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

from massid.errors import LogError
from massid.log import TopicMap, load_topics, preset_names, read_walk
from massid.walk import Walk
from tests.log.protobuf_samples import write_protobuf
from tests.log.samples import JOINTS, ROOT, Foreign, Samples, make_samples, rotation, write_samples

SLOW_S = 5.0
REFUSED, WHOLE, STATED, WRONG, CRASHED, SLOW = "refused", "whole", "loss stated", "WRONG", "CRASHED", "SLOW"
BAD = (WRONG, CRASHED, SLOW)


@dataclass(frozen=True)
class Seed:
    """A sound log.

    Attributes:
        name: what wrote it.
        content: the file.
        walk: what it holds.
        topics: the topic map it is read with.
    """

    name: str
    content: bytes
    walk: Walk
    topics: TopicMap


@dataclass(frozen=True)
class Outcome:
    """What came of one input."""

    kind: str
    detail: str = ""


def write_json(path: Path, samples: Samples) -> Path:
    """Write samples as JSON channels, the base of one object, as a recorder in a scripting language might."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("state", "jsonschema", b'{"type": "object"}')
        channels = {
            t: writer.register_channel(t, "json", schema) for t in ("/odom", "/joint_states", "/contact/l_foot")
        }
        for k in range(len(samples)):
            stamp = int(samples.stamps[k])
            header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "l_foot"}
            w, x, y, z = samples.qpos[k, 3:7].tolist()
            in_body = rotation(samples.qpos[k, 3:7]).T @ samples.qvel[k, :3]
            vectors = {name: dict(zip("xyz", v.tolist(), strict=True)) for name, v in (
                ("p", samples.qpos[k, :3]), ("v", in_body), ("w", samples.qvel[k, 3:6]),
                ("f", samples.wrenches["l_foot"][k, :3]), ("m", samples.wrenches["l_foot"][k, 3:]))}  # fmt: skip
            messages = {
                "/odom": {
                    "header": header,
                    "child_frame_id": ROOT,
                    "pose": {"pose": {"position": vectors["p"], "orientation": {"x": x, "y": y, "z": z, "w": w}}},
                    "twist": {"twist": {"linear": vectors["v"], "angular": vectors["w"]}},
                },
                "/joint_states": {
                    "header": header,
                    "name": list(JOINTS),
                    "position": samples.qpos[k, 7:].tolist(),
                    "velocity": samples.qvel[k, 6:].tolist(),
                    "effort": samples.effort[k].tolist(),
                },
                "/contact/l_foot": {"header": header, "wrench": {"force": vectors["f"], "torque": vectors["m"]}},
            }
            for topic, message in messages.items():
                writer.add_message(channels[topic], stamp, json.dumps(message).encode(), stamp)
        writer.finish()
    return path


def make_seeds(folder: Path) -> list[Seed]:
    """Logs of several writers, encodings and compressions."""
    samples = make_samples(40)
    default = TopicMap()
    made: list[tuple[str, Path, TopicMap]] = [
        ("massid", write_samples(folder / "own.mcap", samples, block=10), default)
    ]
    kinds = {
        "foreign": {},
        "foreign, lz4": {"compression": CompressionType.LZ4},
        "foreign, plain": {"compression": CompressionType.NONE},
        "foreign, no checksums": {"compression": CompressionType.NONE, "enable_crcs": False},
        "foreign, no chunks": {"use_chunking": False},
    }
    for name, options in kinds.items():
        path = Foreign(folder / f"{name}.mcap", samples).write(**options)
        made.append((name, path, default))
    made.append(("json", write_json(folder / "json.mcap", samples), default))
    made.append(("protobuf", write_protobuf(folder / "protobuf.mcap", samples), default))
    return [Seed(name, path.read_bytes(), read_walk(path, topics), topics) for name, path, topics in made]


def _flip(data: bytearray, rng: np.random.Generator) -> None:
    for _ in range(int(rng.integers(1, 5))):
        data[int(rng.integers(len(data)))] ^= int(rng.integers(1, 256))


def _truncate(data: bytearray, rng: np.random.Generator) -> None:
    del data[int(rng.integers(len(data))) :]


def _cut_out(data: bytearray, rng: np.random.Generator) -> None:
    start = int(rng.integers(len(data)))
    del data[start : start + int(rng.integers(1, 400))]


def _insert(data: bytearray, rng: np.random.Generator) -> None:
    start = int(rng.integers(len(data)))
    data[start:start] = rng.bytes(int(rng.integers(1, 200)))


def _blank(data: bytearray, rng: np.random.Generator) -> None:
    start, length = int(rng.integers(len(data))), int(rng.integers(1, 400))
    data[start : start + length] = bytes(len(data[start : start + length]))


def _repeat(data: bytearray, rng: np.random.Generator) -> None:
    start, length = int(rng.integers(len(data))), int(rng.integers(1, 2000))
    data[start:start] = data[start : start + length]


def _huge(data: bytearray, rng: np.random.Generator) -> None:
    start = int(rng.integers(len(data)))
    value = int(rng.choice([0, 0x7F, 0x80, 0xFF]))
    data[start : start + 8] = bytes([value] * len(data[start : start + 8]))


MUTATIONS: Sequence[Callable[[bytearray, np.random.Generator], None]] = (
    _flip, _flip, _flip, _truncate, _cut_out, _insert, _blank, _repeat, _huge,
)  # fmt: skip


def damage(content: bytes, rng: np.random.Generator) -> bytes:
    """Damage a file in one or two ways, or replace it by noise after its first mark."""
    if rng.random() < 0.01:
        return content[:8] + rng.bytes(int(rng.integers(0, 3000)))
    data = bytearray(content)
    for _ in range(1 + int(rng.random() < 0.2)):
        if data:
            MUTATIONS[int(rng.integers(len(MUTATIONS)))](data, rng)
    return bytes(data)


def judge_log(path: Path, seed: Seed) -> Outcome:
    """Read a damaged file and compare what comes out with what was written."""
    started = time.perf_counter()
    try:
        walk = read_walk(path, seed.topics)
    except LogError as error:
        text = str(error)
        return Outcome(CRASHED, f"message of several lines: {text}") if "\n" in text else Outcome(REFUSED, text)
    except Exception as error:  # whatever escapes is what this looks for
        return Outcome(CRASHED, f"{type(error).__name__}: {error}")
    finally:
        took = time.perf_counter() - started
    if took > SLOW_S:
        return Outcome(SLOW, f"{took:.1f} s")
    if walk.warnings:
        unchecked = any("carry no checksum" in line for line in seed.walk.warnings)
        return Outcome(STATED) if unchecked or _is_part(walk, seed.walk) else Outcome(WRONG, "; ".join(walk.warnings))
    return Outcome(WHOLE) if _is_part(walk, seed.walk) and len(walk) == len(seed.walk) else Outcome(WRONG, "in silence")


def _is_part(walk: Walk, whole: Walk) -> bool:
    """Whether every sample of a walk is one of the whole, to the last bit."""
    if (walk.root_body, walk.joint_names) != (whole.root_body, whole.joint_names):
        return False
    if not set(walk.contact_bodies) <= set(whole.contact_bodies):
        return False
    rows = np.searchsorted(whole.stamps_ns, walk.stamps_ns)
    if (rows >= len(whole)).any() or not np.array_equal(whole.stamps_ns[rows], walk.stamps_ns):
        return False
    same = all(np.array_equal(getattr(walk, n), getattr(whole, n)[rows]) for n in ("qpos", "qvel", "effort"))
    columns = [whole.contact_bodies.index(body) for body in walk.contact_bodies]
    return same and np.array_equal(walk.wrench, whole.wrench[rows][:, columns])


TOKENS = (
    "null", "[]", "{}", "-1", "1e999", ".nan", "true", '"*"', "/odom", "wxyz", "world", "header", "[a, b, c]",
    "{field: x}", "{topic: /odom, field: position}", "preset: ros2", "!!python/object:os.system", "&a [*a]", "\t",
    "0x7fffffffffffffffffff", "2026-01-01", "name[99999999]", "name[:", "'", "pose..x", "\x00", "é", "? a", "<<: *x",
)  # fmt: skip


def damage_text(text: str, rng: np.random.Generator) -> bytes:
    """Damage a topic map."""
    lines = text.splitlines()
    for _ in range(int(rng.integers(1, 4))):
        row = int(rng.integers(len(lines)))
        match int(rng.integers(6)):
            case 0:
                del lines[row]
            case 1:
                lines.insert(row, lines[int(rng.integers(len(lines)))])
            case 2:
                key = lines[row].split(":")[0]
                lines[row] = f"{key}: {TOKENS[int(rng.integers(len(TOKENS)))]}"
            case 3:
                lines[row] = " " * int(rng.integers(0, 6)) + lines[row].strip()
            case 4:
                lines.insert(row, TOKENS[int(rng.integers(len(TOKENS)))])
            case _:
                letters = list(lines[row]) or [" "]
                letters[int(rng.integers(len(letters)))] = chr(int(rng.integers(1, 0x250)))
                lines[row] = "".join(letters)
        if not lines:
            lines = [""]
    data = bytearray("\n".join(lines).encode())
    if rng.random() < 0.1 and data:
        _flip(data, rng)
    return bytes(data)


def map_texts() -> list[str]:
    """Topic maps to damage: all presets."""
    from importlib import resources

    folder = resources.files("massid.log.topics") / "presets"
    return [(folder / f"{name}.yaml").read_text() for name in preset_names()]


def judge_map(path: Path, log: Path) -> Outcome:
    """Load a damaged topic map, and read a log with it if it loads."""
    started = time.perf_counter()
    try:
        topics = load_topics(path)
        read_walk(log, topics)
        kind = Outcome(STATED, "loads and reads")
    except LogError as error:
        text = str(error)
        kind = Outcome(CRASHED, f"message of several lines: {text}") if "\n" in text else Outcome(REFUSED, text)
    except Exception as error:  # whatever escapes is what this looks for
        kind = Outcome(CRASHED, f"{type(error).__name__}: {error}")
    took = time.perf_counter() - started
    return kind if took < SLOW_S else Outcome(SLOW, f"{took:.1f} s")
