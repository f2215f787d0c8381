"""Inputs that are small and claim, or become, very much: each must end in one line, soon, and in little memory."""

from __future__ import annotations

import io
import json
import os
import struct
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard

from massid.log.files import MAGIC
from tests.pushed_robot import XML

DIGITS = "9" * 5000
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 3, 4, 5, 6
_ODOMETRY = "nav_msgs/msg/Odometry"


def _text(text: str | bytes) -> bytes:
    data = text.encode() if isinstance(text, str) else text
    return struct.pack("<I", len(data)) + data


def record(opcode: int, content: bytes) -> bytes:
    """A record of an MCAP file."""
    return struct.pack("<BQ", opcode, len(content)) + content


def schema(number: int = 1, text: str = "float64 x\n", name: str = _ODOMETRY, encoding: str = "ros2msg") -> bytes:
    """A schema record."""
    return record(_SCHEMA, struct.pack("<H", number) + _text(name) + _text(encoding) + _text(text))


def channel(number: int = 1, topic: str = "/odom", encoding: str = "cdr") -> bytes:
    """A channel record of schema 1."""
    return record(_CHANNEL, struct.pack("<HH", number, 1) + _text(topic) + _text(encoding) + _text(b""))


def message(number: int = 1, data: bytes = bytes([0, 1, 0, 0]) + bytes(60)) -> bytes:
    """A message record."""
    return record(_MESSAGE, struct.pack("<HIQQ", number, 0, 1, 1) + data)


def chunk(data: bytes, size: int, compression: str) -> bytes:
    """A chunk that claims to inflate to a size."""
    times = struct.pack("<QQQI", 1, 1, size, 0)
    return record(_CHUNK, times + _text(compression) + struct.pack("<Q", len(data)) + data)


def mcap(*parts: bytes) -> bytes:
    """A log that was never closed."""
    return MAGIC + record(1, _text("ros2") + _text("x")) + b"".join(parts)


def zeros_zstd(megabytes: int, *, says_size: bool) -> bytes:
    """Zeros, of which a hundred megabytes take ten kilobytes."""
    out = io.BytesIO()
    block = bytes(1 << 20)
    size = megabytes << 20 if says_size else -1
    packer = zstandard.ZstdCompressor(level=3, write_content_size=says_size)
    with packer.stream_writer(out, size=size, closefd=False) as stream:
        for _ in range(megabytes):
            stream.write(block)
    return out.getvalue()


def _repeated(data: bytes) -> bytes:
    return zstandard.ZstdCompressor(level=3).compress(data)


def _fifo(path: Path) -> None:
    os.mkfifo(path)


def _npz(path: Path, names: Iterable[str], shape: tuple[int, ...], size: int) -> None:
    """An archive of arrays of a claimed shape that inflate to zeros."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names:
            with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
                header = {"descr": "<f8", "fortran_order": False, "shape": shape}
                np.lib.format.write_array_header_1_0(stream, header)
                for _ in range(size >> 20):
                    stream.write(bytes(1 << 20))


def _bodies(count: int) -> str:
    return "".join(
        f'<body name="b{k}"><joint name="j{k}" type="hinge"/><geom size="0.1" mass="1"/></body>' for k in range(count)
    )


def _robot(inside: str, root: str = "") -> str:
    free = '<body name="torso"><freejoint/><geom size="0.1" mass="1"/>'
    return f"<mujoco>{root}<worldbody>{free}{inside}</body></worldbody></mujoco>"


def _urdf(count: int) -> str:
    inertia = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = "".join(f'<link name="l{k}">{inertia}</link>' for k in range(count))
    joints = "".join(
        f'<joint name="j{k}" type="continuous"><parent link="l0"/><child link="l{k}"/></joint>' for k in range(1, count)
    )
    return f'<robot name="r">{links}{joints}</robot>'


def _laughs(inside: str) -> str:
    entities = '<!ENTITY a0 "ha">' + "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10))
    return f"<!DOCTYPE r [{entities}]>{inside}"


LOGS: dict[str, Callable[[], bytes]] = {
    "zstd chunk, 4 GB, claims 1 kB": lambda: mcap(chunk(zeros_zstd(4096, says_size=False), 1024, "zstd")),
    "zstd chunk, 1.9 GB as claimed": lambda: mcap(chunk(zeros_zstd(1900, says_size=True), 1900 << 20, "zstd")),
    "zstd chunk, 10 kB, claims 1.9 GB": lambda: mcap(chunk(zeros_zstd(1, says_size=False), 1900 << 20, "zstd")),
    "lz4 chunk, 1 GB, claims 1 kB": lambda: mcap(chunk(lz4.frame.compress(bytes(1 << 30)), 1024, "lz4")),
    "lz4 chunk, 1 GB as claimed": lambda: mcap(chunk(lz4.frame.compress(bytes(1 << 30)), 1 << 30, "lz4")),
    "100 zstd chunks of 200 MB each": lambda: mcap(
        *[chunk(zeros_zstd(200, says_size=True), 200 << 20, "zstd")] * 100
    ),
    "2 million tiny messages of a wanted topic": lambda: mcap(
        schema(), channel(), chunk(_repeated(message(data=b"") * 2_000_000), len(message(data=b"")) * 2_000_000, "zstd")
    ),
    "2 million tiny messages of no topic": lambda: mcap(
        chunk(_repeated(message(9, b"") * 2_000_000), len(message(data=b"")) * 2_000_000, "zstd")
    ),
    "3 million empty records": lambda: mcap(chunk(_repeated(record(99, b"") * 3_000_000), 27_000_000, "zstd")),
    "a million channels": lambda: mcap(
        schema(), *(channel(k % 65536, f"/t{k}") for k in range(1_000_000)), message(1)
    ),
    "65,535 channels of one topic": lambda: mcap(
        schema(), *(channel(k) for k in range(1, 65536)), *(message(k) for k in range(1, 65536))
    ),
    "100,000 metadata records": lambda: mcap(
        *(record(12, _text(f"m{k}") + _text(b"")) for k in range(100_000))
    ),
    "a schema line of 200 kB": lambda: mcap(schema(text="x" * 200_000), channel(), message()),
    "a schema line of 200 kB of spaces": lambda: mcap(schema(text="a" + " " * 200_000 + "!"), channel(), message()),
    "a schema of 100,000 types": lambda: mcap(
        schema(text="float64 x\n" + "".join(f"{'=' * 80}\nMSG: p/T{k}\nfloat64 x\n" for k in range(100_000))),
        channel(),
        message(),
    ),
    "a schema of 30,000 types, each of the next": lambda: mcap(
        schema(
            text="p/T0 x\n" + "".join(f"{'=' * 80}\nMSG: p/T{k}\np/T{k + 1} x\n" for k in range(30_000))
            + f"{'=' * 80}\nMSG: p/T30000\nfloat64 x\n"
        ),
        channel(),
        message(data=bytes([0, 1, 0, 0]) + bytes(100)),
    ),
    "a schema whose types double 40 times": lambda: mcap(
        schema(
            text="p/T0 x\n" + "".join(f"{'=' * 80}\nMSG: p/T{k}\np/T{k + 1}[2] x\n" for k in range(28))
            + f"{'=' * 80}\nMSG: p/T28\nfloat64[0] x\n"
        ),
        channel(),
        message(data=bytes([0, 1, 0, 0]) + bytes(100)),
    ),
    "an array length of 5000 digits": lambda: mcap(schema(text=f"float64[{DIGITS}] x\n"), channel(), message()),
    "an array of 10^9 messages of nothing, ROS 1": lambda: mcap(
        schema(text=f"A[1000000000] x\n{'=' * 80}\nMSG: p/A\n", name="p/B", encoding="ros1msg"),
        channel(encoding="ros1"),
        message(data=bytes(40)),
    ),
    "an array of 10^9 texts": lambda: mcap(
        schema(text="string[1000000000] x\n"), channel(), message(data=bytes([0, 1, 0, 0]) + bytes(40))
    ),
    "JSON with numbers of 5000 digits": lambda: mcap(
        schema(), channel(encoding="json"), *[message(data=json.dumps({"x": [1]}).replace("1", DIGITS).encode())] * 200
    ),
    "JSON nested 100,000 deep": lambda: mcap(
        schema(), channel(encoding="json"), message(data=b"[" * 100_000 + b"]" * 100_000)
    ),
    "1000 compressed messages of 16 MB": lambda: mcap(
        schema(), channel(), *[message(data=zeros_zstd(16, says_size=True))] * 1000
    ),
    "a topic name of 5 MB": lambda: mcap(schema(), channel(topic="/" + "x" * 5_000_000), message()),
}  # fmt: skip
"""MCAP files by what is wrong with them."""

MODELS: dict[str, Callable[[], str]] = {
    "20,000 bodies on one": lambda: _robot(_bodies(20_000)),
    "a chain of 20,000 bodies": lambda: _robot('<body><joint type="hinge"/><geom size="0.1" mass="1"/>' * 20_000)[:-1],
    "a chain of 1500 bodies": lambda: _robot(
        '<body><joint type="hinge"/><geom size="0.1" mass="1"/>' * 1500 + "</body>" * 1500
    ),
    "a body replicated a million times": lambda: _robot(
        '<replicate count="1000000" offset="1 0 0"><body><joint/><geom size="0.1" mass="1"/></body></replicate>'
    ),
    "replicas of replicas of replicas": lambda: _robot(
        '<replicate count="300" offset="1 0 0">' * 3 + '<geom size="0.1" mass="1"/>' + "</replicate>" * 3
    ),
    "a height field of 100,000 x 100,000": lambda: _robot(
        "", '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>'
    ),
    "a built-in texture of 100,000 x 100,000": lambda: _robot(
        "", '<asset><texture name="t" type="2d" builtin="flat" width="100000" height="100000"/></asset>'
    ),
    "a stack of 900 GB": lambda: _robot("", '<size memory="900G"/>'),
    "2 billion user data": lambda: _robot("", '<size nuserdata="2000000000"/>'),
    "entities that multiply": lambda: _laughs(_robot("").replace('"torso"', '"&a9;"')),
    "100,000 nested elements": lambda: "<mujoco>" + "<worldbody>" * 100_000 + "</worldbody>" * 100_000 + "</mujoco>",
    "a name of 5 MB": lambda: _robot("").replace("torso", "t" * 5_000_000),
    "a mass of 5000 digits": lambda: _robot("").replace('mass="1"', f'mass="{DIGITS}"'),
}
"""MJCF files."""

URDFS: dict[str, Callable[[], str]] = {
    "URDF of 20,000 links": lambda: _urdf(20_000),
    "URDF whose entities multiply": lambda: _laughs(_urdf(2).replace('name="r"', 'name="&a9;"')),
    "URDF of 100,000 nested elements": lambda: '<robot name="r">' + "<a>" * 100_000 + "</a>" * 100_000 + "</robot>",
}


def make(folder: Path, only: str = "") -> list[tuple[str, list[str]]]:
    """Write the inputs whose name holds a word; names and what to run massid with."""
    made: list[tuple[str, list[str]]] = []

    def add(name: str, file: str, write: Callable[[Path], object], *arguments: str) -> None:
        if only in name:
            path = folder / f"{len(made)}_{file}"
            write(path)
            made.append((name, [str(path) if word == "FILE" else word for word in arguments]))

    for name, content in LOGS.items():
        add(name, "log.mcap", lambda path, of=content: path.write_bytes(of()), "inspect", "FILE", "--model", "atlas")
        add(f"{name} (repair)", "log.mcap", lambda path, of=content: path.write_bytes(of()), "repair", "FILE", "x.mcap")
    for name, text in MODELS.items():
        add(name, "robot.xml", lambda path, of=text: path.write_text(of()), "links", "FILE")
    for name, text in URDFS.items():
        add(name, "robot.urdf", lambda path, of=text: path.write_text(of()), "links", "FILE")
    (folder / "map.yaml").write_text(
        "time: {field: time, scale: 1.0}\n"
        "base: {topic: table, body: torso, position: [x, x, x], orientation: {field: [x, x, x, x], order: wxyz},\n"
        "  linear_velocity: derived, angular_velocity: derived}\n"
        "joints: {topic: table, names: [j], position: [x], velocity: [x], effort: [x]}\n"
        "contacts: [{topic: table, body: foot, force: [x, x, x], torque: [x, x, x]}]\n"
    )
    (folder / "good.xml").write_text(XML)
    add("a pipe as a log", "pipe.mcap", _fifo, "inspect", "FILE")
    add("a pipe as a model", "pipe.xml", _fifo, "links", "FILE")
    add("a pipe as a result", "pipe.json", _fifo, "report", "FILE", "-o", "x.html")
    add("a pipe as a truth", "pipe.truth.json", _fifo, "identify", "SAMPLE", "--truth", "FILE")
    add("a pipe as a topic map", "pipe.yaml", _fifo, "inspect", "SAMPLE", "--topics", "FILE")
    add("a pipe as a bag", "pipe.db3", _fifo, "inspect", "FILE")
    add("a pipe as a recording", "pipe.rrd", _fifo, "view", "FILE")
    wide = ("time", "x")
    add("a table of 1 GB of zeros", "t.npz", lambda path: _npz(path, wide, (1 << 27,), 1 << 30),
        "inspect", "FILE", "--topics", str(folder / "map.yaml"))  # fmt: skip
    add("a table that claims 10^15 rows", "t.npz", lambda path: _npz(path, wide, (10**15,), 1 << 20),
        "inspect", "FILE", "--topics", str(folder / "map.yaml"))  # fmt: skip
    add("a table of 200,000 columns", "t.csv",
        lambda path: path.write_text(",".join(f"c{k}" for k in range(200_000)) + "\n" + "1," * 199_999 + "1\n"),
        "inspect", "FILE", "--topics", str(folder / "map.yaml"))  # fmt: skip
    add("a table of numbers of 5000 digits", "t.csv",
        lambda path: path.write_text("time,x\n" + f"{DIGITS},{DIGITS}\n" * 100),
        "inspect", "FILE", "--topics", str(folder / "map.yaml"))  # fmt: skip
    add("a topic map with a number of 5000 digits", "m.yaml", lambda path: path.write_text(f"rate: {DIGITS}\n"),
        "inspect", "SAMPLE", "--topics", "FILE")  # fmt: skip
    add("a seed of 5000 digits", "x.mcap", lambda path: None, "record", "FILE", "--seed", DIGITS)
    add("a result with a number of 5000 digits", "r.json",
        lambda path: path.write_text(f'{{"links": {DIGITS}, "iterations": 1, "logs": 1, "status": 1}}'),
        "report", "FILE", "-o", "x.html")  # fmt: skip
    add("a result nested 100,000 deep", "r.json", lambda path: path.write_text("[" * 100_000 + "]" * 100_000),
        "report", "FILE", "-o", "x.html")  # fmt: skip
    return made
