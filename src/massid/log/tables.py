"""Logs that are tables: CSV files, NumPy archives and Parquet files. A topic map names their columns.

A table is one topic whose messages are its rows, under any name that the map has for topics.
"""

from __future__ import annotations

import csv
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from massid.errors import LogError
from massid.log.cycles import evened
from massid.log.files import Kind
from massid.log.mcap.container import MOST_INFLATED, MOST_INFLATED_AT_LEAST, TopicInfo
from massid.log.messages.decoding import Block
from massid.log.messages.paths import PathError, find_paths
from massid.log.topics.map import TimeColumn
from massid.typing import AnyArray, FloatArray, IntArray
from massid.walk.conventions import NANOSECONDS

TABLES = (Kind.CSV, Kind.NPZ, Kind.PARQUET)
_LARGEST_BYTES = 1 << 31
_TIMES = {
    "stamp_ns": 1e-9,
    "stamps_ns": 1e-9,
    "timestamp_ns": 1e-9,
    "time_ns": 1e-9,
    "time_s": 1.0,
    "timestamp": 1.0,
    "time": 1.0,
    "stamp": 1.0,
    "t": 1.0,
}
"""Usual names of the column of time, with its unit [s]."""
_LATEST_S = 9.2e9


@dataclass(frozen=True)
class Table:
    """Rows of numbers.

    Attributes:
        source: name of the file, for messages.
        columns: by name, shape (n,) or (n, width); an element of an array of arrays has its index in its name.
    """

    source: str
    columns: Mapping[str, AnyArray]

    @property
    def info(self) -> TopicInfo:
        """The table as a topic."""
        return TopicInfo("table", f"table of {len(self.columns)} columns", "table", "", b"")

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def times_ns(self, time: TimeColumn | None) -> IntArray:
        """Time of each row [ns], shape (n,).

        Args:
            time: which column it is, and its unit; by default one with a usual name.

        Raises:
            LogError: there is none, or it holds no times.
        """
        if time is None:
            name = next((name for name in _TIMES if name in self.columns), None)
            if name is None:
                raise LogError(
                    f"{self.source}: no column of time: none is named like {', '.join(_TIMES)}; `time: {{field: NAME, "
                    f"scale: 1}}` in a topic map names it. The columns are: {self.listed()}."
                )
            time = TimeColumn(name, _TIMES[name])
        values = self.columns.get(time.field)
        if values is None or values.ndim > 1:
            raise LogError(f"{self.source}: no column '{time.field}' of times; the columns are: {self.listed()}.")
        if np.issubdtype(values.dtype, np.datetime64):
            return values.astype("datetime64[ns]").astype(np.int64)
        if np.issubdtype(values.dtype, np.integer) and time.scale == 1.0 / NANOSECONDS:
            return values.astype(np.int64)
        seconds = values.astype(np.float64) * time.scale
        wrong = ~(np.abs(seconds) < _LATEST_S)
        if wrong.any():
            raise LogError(
                f"{self.source}: column '{time.field}' holds no times in seconds (row {int(np.argmax(wrong))}); `time: "
                "{field, scale}` in a topic map says its unit."
            )
        whole = np.floor(seconds)  # nanoseconds since the epoch are more than a double holds
        stamps = whole.astype(np.int64) * NANOSECONDS + np.rint((seconds - whole) * NANOSECONDS).astype(np.int64)
        rounding_s = float(np.spacing(np.abs(values).max())) * time.scale if values.dtype.kind == "f" else 0.0
        return evened(stamps, rounding_s * NANOSECONDS)

    def block(self, wanted: Mapping[str, Sequence[str]], times_ns: IntArray) -> Block:
        """The columns that are wanted, as decoded messages are.

        Raises:
            LogError: there is no such column.
        """
        known = {name: None if values.ndim == 1 else values.shape[1] for name, values in self.columns.items()}
        columns: dict[str, FloatArray] = {}
        for key, paths in wanted.items():
            try:
                picks = find_paths(known, paths)
            except PathError as error:
                raise LogError(f"{self.source}: {key}: {error}.") from error
            parts = [self.columns[p.path] if p.part is None else self.columns[p.path][:, p.part] for p in picks]
            try:
                tables = [np.asarray(part, dtype=np.float64).reshape(len(self), -1) for part in parts]
            except (TypeError, ValueError) as error:
                raise LogError(f"{self.source}: {key}: {', '.join(paths)} holds no numbers.") from error
            columns[key] = np.concatenate(tables, axis=1)
        return Block(times_ns, times_ns, columns, {})

    def listed(self) -> str:
        """Names of the columns."""
        names = list(self.columns)
        return ", ".join(names[:30]) + (f" and {len(names) - 30} more" if len(names) > 30 else "")


def read_table(path: Path, kind: Kind) -> Table:
    """Read a table.

    Raises:
        LogError: it cannot be read; says what is wrong.
    """
    try:
        columns = {Kind.CSV: _csv, Kind.NPZ: _npz, Kind.PARQUET: _parquet}[kind](path)
    except LogError:
        raise
    except Exception as error:  # whatever a damaged file makes of the libraries that read it
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise LogError(f"{path}: {kind} that cannot be read: {said}.") from error
    columns = dict(_flat(columns))
    if not columns:
        raise LogError(f"{path}: holds no column of numbers.")
    lengths = {name: len(values) for name, values in columns.items()}
    usual = max(lengths.values())
    rows = {name: values for name, values in columns.items() if len(values) == usual}
    if not usual:
        raise LogError(f"{path}: holds no row.")
    return Table(str(path), rows)


def _flat(columns: Mapping[str, AnyArray]) -> list[tuple[str, AnyArray]]:
    """Columns with at most two axes: of an array of arrays every element is one of its own."""
    found: list[tuple[str, AnyArray]] = []
    for name, values in columns.items():
        if values.ndim in (1, 2):
            found.append((name, values))
        elif values.ndim > 2:
            found += _flat({f"{name}[{k}]": values[:, k] for k in range(values.shape[1])})
    return found


def _csv(path: Path) -> dict[str, AnyArray]:
    _check_size(path, path.stat().st_size)
    with path.open(encoding="utf-8-sig", newline="") as stream:
        first = stream.readline()
        delimiter = max(",;\t", key=first.count)
        names = [name.strip().lstrip("#").strip() for name in next(csv.reader([first], delimiter=delimiter), [])]
        if len(names) < 2 or all(_is_number(name) for name in names):
            raise ValueError("its first line names no columns")
        values = np.genfromtxt(stream, delimiter=delimiter, dtype=np.float64, ndmin=2)
    if values.shape[1] != len(names):
        raise ValueError(f"{len(names)} columns are named, and rows have {values.shape[1]}")
    return dict(zip(names, values.T, strict=True))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _npz(path: Path) -> dict[str, AnyArray]:
    with zipfile.ZipFile(path) as archive:
        _check_size(path, sum(entry.file_size for entry in archive.infolist()))
    with np.load(path, allow_pickle=False) as arrays:
        members = {name: arrays[name] for name in arrays.files}  # other files in the archive are bytes
    return {name: one for name, one in members.items() if isinstance(one, np.ndarray) and one.dtype.kind in "fiubM"}


def _parquet(path: Path) -> dict[str, AnyArray]:
    parquet: Any = import_module("pyarrow.parquet")  # only who needs it waits for it
    file = parquet.ParquetFile(path)
    sizes = [file.metadata.row_group(k).total_byte_size for k in range(file.metadata.num_row_groups)]
    numbers = file.metadata.num_rows * file.metadata.num_columns  # what does not change takes no bytes in the file
    _check_size(path, max(8 * numbers, sum(sizes)))
    table = file.read()
    found: dict[str, AnyArray] = {}
    for name in table.column_names:
        values = table[name].to_numpy()
        if values.dtype.kind == "O":  # lists, each of the same length
            try:
                values = np.array([np.stack(row) if row.dtype == object else row for row in values], dtype=np.float64)
            except (AttributeError, TypeError, ValueError):  # texts, or lists of several lengths: no numbers of a walk
                continue
        found[name] = values
    return found


def _check_size(path: Path, size: int) -> None:
    most = min(_LARGEST_BYTES, max(MOST_INFLATED_AT_LEAST, MOST_INFLATED * path.stat().st_size))
    if size > most:
        raise LogError(f"{path}: holds {size} bytes of numbers, more than {most} for a file of its size.")
