"""Encoding of columns as text: shuffled bytes, one gzip stream, base64. static/data.js decodes it."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, TypedDict

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.kinematics.arrays import Floats

Column = npt.NDArray[Any]
Tables = Mapping[str, Mapping[str, Column]]

COORDINATES = ("x_mm", "y_mm", "beam_x_mm", "beam_y_mm")
UNITS_PER_MM = 10_000.0
"""Coordinates are stored as integers in units of (by default) 0.1 um: their differences compress well."""
DELTA = ("line", "row", "stage")
"""Integer columns that are stored as differences, which are mostly small."""
DROPPED = ("start_ms",)
"""Columns of rows that are not stored: the page sums the durations in double precision."""
MANTISSA_BITS = (23, 16, 12, 8)
"""Bits of a float32's mantissa that are kept, in order of preference."""
TIME_BITS = 16
"""Durations keep at least so many bits, since they are summed."""
_DIGITS = {23: 6, 16: 5, 12: 4, 8: 3}
_LEVEL = 6
_CHUNK = 3 << 18
"""Bytes per piece of base64; a multiple of three, so that the pieces can be concatenated."""
_SAMPLED = 1 << 21
"""Bytes; the size of more is first estimated from samples, since compressing all takes seconds."""
_PARTS = 16
_SLACK = 0.97
"""Share of the budget that an estimate may take: it is off by a few per cent."""


_RELATIVE_ERROR = 2e-6
"""Relative error that is allowed in a computed column: less than the sixth digit."""


class ColumnEntry(TypedDict):
    """One column in the directory.

    Attributes:
        table: Name of the table.
        name: Name of the column.
        type: Kind and bits: "f32", "i8", "i16" or "i32".
        count: Number of values.
        delta: Whether differences are stored.
        scale: Factor from values to stored integers; 0 if values are stored as they are.
        same: Index of an entry with the same bytes, which are stored once; else -1.
        how: "" for a stored column; "quotient" or "product" for a column that the page computes from the columns `of`
            of the same table, times `factor`.
        of: See `how`.
        factor: See `how`.
    """

    table: str
    name: str
    type: str
    count: int
    delta: bool
    scale: float
    same: int
    how: str
    of: list[str]
    factor: float


class Encoded(Struct, frozen=True, kw_only=True):
    """Encoded columns. `packed`: the gzip stream in pieces. `digits`: number of correct digits of the values."""

    directory: list[ColumnEntry]
    packed: list[bytes]
    bits: int
    digits: int

    @property
    def size(self) -> int:
        """Length of the base64 text, bytes."""
        return (sum(map(len, self.packed)) + 2) // 3 * 4

    def text(self) -> Iterator[bytes]:
        """Yield the base64 text in pieces, to save memory."""
        left = b""
        for piece in self.packed:
            left += piece
            whole = len(left) // _CHUNK * _CHUNK
            for first in range(0, whole, _CHUNK):
                yield base64.b64encode(left[first : first + _CHUNK])
            left = left[whole:]
        if left:
            yield base64.b64encode(left)


def encode(tables: Tables, budget_bytes: int, units_per_mm: float = UNITS_PER_MM) -> Encoded:
    """Encode tables, with as many bits of mantissa as fit into a budget.

    Args:
        tables: Columns by table and name.
        budget_bytes: Limit of the base64 text; 8 bits of mantissa may exceed it.
        units_per_mm: Units of coordinates, which must fit into 32 bits.
    """
    rules = _computed_columns(tables)
    bits = _choose_bits(tables, budget_bytes, rules, units_per_mm)
    while True:
        found = _encode(tables, bits, rules, units_per_mm)
        lower = [b for b in MANTISSA_BITS if b < bits]
        if found.size <= budget_bytes or not lower:
            return found
        bits = lower[0]


def stored(table: str, name: str, column: Column, bits: int, units_per_mm: float) -> tuple[Column, float]:
    """Return a column's stored values, before differences are taken, and their scale."""
    if name in COORDINATES and table in ("rows", "strokes"):
        return _in_units(column, units_per_mm), units_per_mm
    if column.dtype.kind == "f":
        return rounded(column, _kept(name, bits)), 0
    if column.dtype.kind in "iub":
        return _whole(column), 0
    raise TypeError(f"{table}.{name}: a column of {column.dtype} can't be stored")


def _kept(name: str, bits: int) -> int:
    """Return the bits for a column: times keep more, since they are summed, or large beside their differences."""
    if name == "start_ms":
        return MANTISSA_BITS[0]
    return max(bits, TIME_BITS) if name == "duration_ms" else bits


def rounded(column: Column, bits: int) -> npt.NDArray[np.float32]:
    """Round to float32 with so many bits of mantissa, ties to even."""
    most = float(np.finfo(np.float32).max)
    values = np.ascontiguousarray(np.where(np.isinf(column), np.nan, np.clip(column, -most, most)), dtype="<f4")
    drop = MANTISSA_BITS[0] - bits
    if not drop:
        return values
    raw = values.view("<u4")
    half = np.uint32((1 << (drop - 1)) - 1)
    up = raw + half + ((raw >> np.uint32(drop)) & np.uint32(1))
    kept = up >> np.uint32(drop) << np.uint32(drop)
    # A value at the end of the range must not become infinite, and NaN must stay NaN.
    kept = np.where(np.isnan(values) | np.isinf(kept.view("<f4")), raw, kept)
    return kept.view("<f4")


def _in_units(column: Column, units_per_mm: float) -> npt.NDArray[np.int32]:
    most = float(np.iinfo(np.int32).max)
    units: npt.NDArray[np.int32] = np.nan_to_num(np.clip(np.rint(column * units_per_mm), -most, most)).astype("<i4")
    return units


def _whole(column: Column) -> Column:
    """Keep int8, int16 and int32; convert wider or unsigned integers to the narrowest of them that fits."""
    if column.dtype.kind == "i" and column.dtype.itemsize <= 4:
        return column.astype(column.dtype.newbyteorder("<"), copy=False)
    low, high = (int(column.min()), int(column.max())) if len(column) else (0, 0)
    for kind in ("<i1", "<i2", "<i4"):
        info = np.iinfo(kind)
        if info.min <= low and high <= info.max:
            return column.astype(kind)
    raise OverflowError(f"{low}..{high} is more than 32 bits hold")


def _bytes_of(values: Column, *, delta: bool) -> bytes:
    """Return all first bytes, then all second ones, and so on: similar bytes side by side compress better."""
    if delta and len(values):
        raw = values.view(np.dtype(f"<u{values.dtype.itemsize}"))
        values = np.concatenate([raw[:1], raw[1:] - raw[:-1]])
    return np.ascontiguousarray(values).view(np.uint8).reshape(-1, values.dtype.itemsize).T.tobytes()


def _all_columns(tables: Tables) -> Iterator[tuple[str, str, Column]]:
    for table, columns in tables.items():
        for name, column in columns.items():
            if not (table == "rows" and name in DROPPED):
                yield table, name, column


class _ComputedColumn(Struct, frozen=True, kw_only=True):
    """A rule that computes a column from others of its table. `factor`: 0 if it is yet to be found."""

    how: str
    of: tuple[str, ...]
    factor: float = 1.0

    def values(self, columns: Mapping[str, Column]) -> Floats:
        """Compute the column. A product with 0 is 0, even of NaN (the power while the laser is off)."""
        first, *others = (columns[name].astype(np.float64) for name in self.of)
        with np.errstate(divide="ignore", invalid="ignore"):
            for other in others:
                first = first / other if self.how == "quotient" else np.where(other == 0, 0.0, first * other)
            found: Floats = first * self.factor
        return found


def _computed_column(columns: Mapping[str, Column], name: str) -> _ComputedColumn | None:
    """Return the rule for a column of rows; None if there is none, or its result differs."""
    head = name.partition("_")[0]
    rules = {
        "vel_mean_mm_s": _ComputedColumn(how="quotient", of=("length_mm", "duration_ms"), factor=1e3),
        f"{head}_power_ms": _ComputedColumn(how="product", of=(f"{head}_power_mean", f"{head}_emission_ms")),
        f"{head}_joules": _ComputedColumn(how="product", of=(f"{head}_power_ms",), factor=0.0),
    }
    rule = rules.get(name)
    if rule is None or not all(part in columns for part in rule.of) or not len(columns[name]):
        return None
    column = columns[name]
    if not rule.factor:
        power = columns[rule.of[0]]
        largest = int(np.argmax(power))
        if not power[largest] > 0 or np.isnan(column[largest]):
            return None
        rule = _ComputedColumn(how=rule.how, of=rule.of, factor=float(column[largest] / power[largest]))
    return rule if np.allclose(rule.values(columns), column, rtol=_RELATIVE_ERROR, atol=0, equal_nan=True) else None


def _computed_columns(tables: Tables) -> dict[tuple[str, str], _ComputedColumn]:
    rows = tables.get("rows", {})
    found = {("rows", name): _computed_column(rows, name) for name in rows if name not in DROPPED}
    return {place: rule for place, rule in found.items() if rule is not None}


def _encode(
    tables: Tables, bits: int, rules: Mapping[tuple[str, str], _ComputedColumn], units_per_mm: float
) -> Encoded:
    directory: list[ColumnEntry] = []
    packed: list[bytes] = []
    seen: dict[int, list[int]] = {}
    kept: dict[int, tuple[str, str]] = {}
    pack = zlib.compressobj(_LEVEL, zlib.DEFLATED, 16 + zlib.MAX_WBITS)
    for table, name, column in _all_columns(tables):
        rule = rules.get((table, name))
        if rule is not None:
            directory.append(_computed_entry(table, name, len(column), rule))
            continue
        values, scale = stored(table, name, column, bits, units_per_mm)
        entry = _entry(table, name, values, scale)
        data = _bytes_of(values, delta=entry["delta"])
        # gzip looks back 32 KiB only, and would store equal columns (minimum and maximum of a constant power) twice.
        mark = zlib.crc32(data)
        for place in seen.get(mark, ()):
            other = directory[place]
            if (other["type"], other["count"], other["delta"]) == (entry["type"], entry["count"], entry["delta"]):
                theirs, _ = stored(*kept[place], tables[kept[place][0]][kept[place][1]], bits, units_per_mm)
                if _bytes_of(theirs, delta=other["delta"]) == data:
                    entry["same"] = place
                    break
        if entry["same"] < 0:
            seen.setdefault(mark, []).append(len(directory))
            kept[len(directory)] = (table, name)
            packed.append(pack.compress(data))
        directory.append(entry)
    packed.append(pack.flush())
    return Encoded(directory=directory, packed=[p for p in packed if p], bits=bits, digits=_DIGITS[bits])


def _entry(table: str, name: str, values: Column, scale: float) -> ColumnEntry:
    return ColumnEntry(
        table=table,
        name=name,
        type=f"{values.dtype.kind}{values.dtype.itemsize * 8}",
        count=len(values),
        delta=bool(scale) or (name in DELTA and values.dtype.kind == "i"),
        scale=scale,
        same=-1,
        how="",
        of=[],
        factor=1.0,
    )


def _computed_entry(table: str, name: str, count: int, rule: _ComputedColumn) -> ColumnEntry:
    return ColumnEntry(
        table=table,
        name=name,
        type="f32",
        count=count,
        delta=False,
        scale=0,
        same=-1,
        how=rule.how,
        of=list(rule.of),
        factor=rule.factor,
    )


def _choose_bits(
    tables: Tables, budget_bytes: int, rules: Mapping[tuple[str, str], _ComputedColumn], units_per_mm: float
) -> int:
    """Return the most bits with which the columns fit, as estimated from samples."""
    raw = sum(column.nbytes for _, _, column in _all_columns(tables))
    if raw <= _SAMPLED:
        return MANTISSA_BITS[0]
    for bits in MANTISSA_BITS:
        if _estimate(tables, bits, rules, units_per_mm) <= budget_bytes * _SLACK:
            return bits
    return MANTISSA_BITS[-1]


def _estimate(
    tables: Tables, bits: int, rules: Mapping[tuple[str, str], _ComputedColumn], units_per_mm: float
) -> float:
    """Estimate the length of the base64 text from samples of each column."""
    total, seen = 0.0, set()
    for table, name, column in _all_columns(tables):
        if (table, name) in rules:
            continue
        part = _sample(column)
        values, scale = stored(table, name, part, bits, units_per_mm)
        data = _bytes_of(values, delta=_entry(table, name, values, scale)["delta"])
        if (len(column), data) not in seen:
            seen.add((len(column), data))
            total += len(zlib.compress(data, _LEVEL)) * len(column) / max(len(part), 1)
    return total * 4 / 3


def _sample(column: Column) -> Column:
    """Return samples from all over a column, about 6 % of it."""
    run = len(column) // (_PARTS * _PARTS)
    if run < 64:
        return column
    return np.concatenate([column[i * len(column) // _PARTS :][:run] for i in range(_PARTS)])


def decode(directory: list[ColumnEntry], packed: bytes) -> dict[str, dict[str, Column]]:
    """Decode the columns; scaled ones in mm. Used by tests, and the reference of the format."""
    data = memoryview(zlib.decompress(packed, 16 + zlib.MAX_WBITS))
    tables: dict[str, dict[str, Column]] = {}
    raws: list[Column] = []
    at = 0
    for entry in directory:
        if entry["how"]:
            rule = _ComputedColumn(how=entry["how"], of=tuple(entry["of"]), factor=entry["factor"])
            raw = rule.values(tables[entry["table"]]).astype(np.float32)
        elif entry["same"] >= 0:
            raw = raws[entry["same"]]
        else:
            width, count = int(entry["type"][1:]) // 8, entry["count"]
            part = np.frombuffer(data[at : at + width * count], dtype=np.uint8).reshape(width, count)
            at += width * count
            raw = np.ascontiguousarray(part.T).view(f"<{entry['type'][0]}{width}").reshape(-1)
            if entry["delta"]:
                raw = np.cumsum(raw, dtype=raw.dtype)
        raws.append(raw)
        tables.setdefault(entry["table"], {})[entry["name"]] = raw / entry["scale"] if entry["scale"] else raw
    return tables
