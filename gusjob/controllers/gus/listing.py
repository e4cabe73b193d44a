"""Write a stream as text: one call a line with all arguments, numbers in the shortest form that reads back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt
import orjson

from gusjob.controllers.gus.calls import BUFFERED, Buffered, BufferedCalls, Stream, Value
from gusjob.diagnostics.formats.check_json import diagnostic_object
from gusjob.diagnostics.model import Diagnostic
from gusjob.ir.overrides import NO_OVERRIDES, Overrides, overrides_text

_CHUNK = 1 << 16
_WHOLE = 1e15
"""Whole numbers below it are written with all their digits."""


def listing(stream: Stream, overrides: Overrides = NO_OVERRIDES) -> Iterator[str]:
    """Write the listing, in pieces that end with a line end. `overrides`: named in a comment at the head."""
    if overrides:
        yield f"// {overridden_text(overrides)}\n"
    for first, last, call in stream.parts():
        for start in range(first, last, _CHUNK):
            yield "\n".join(buffered_lines(stream.buffered.pick(np.arange(start, min(start + _CHUNK, last))))) + "\n"
        if call is not None:
            yield f"{call.name}({','.join(map(value_text, call.args))})\n"


def buffered_lines(calls: BufferedCalls) -> list[str]:
    """Write one text a buffered call, (n,)."""
    lines = np.empty(len(calls), dtype=object)
    for kind, signature in BUFFERED.items():
        at = np.flatnonzero(calls.kind == kind)
        if len(at):
            lines[at] = _call_texts(signature.name, [calls.column(arg.column)[at] for arg in signature.args])
    found: list[str] = lines.tolist()
    return found


def _call_texts(name: str, columns: list[npt.NDArray[np.generic]]) -> list[str]:
    """Write calls of one function with their columns of arguments."""
    is_constant = [bool((column == column[0]).all()) for column in columns]
    form = ",".join(number_texts(c[:1])[0] if same else "%s" for c, same in zip(columns, is_constant, strict=True))
    changing = [number_texts(column) for column, same in zip(columns, is_constant, strict=True) if not same]
    form = f"{name}({form})"
    return list(map(form.__mod__, zip(*changing, strict=True))) if changing else [form] * len(columns[0])


def number_texts(values: npt.NDArray[np.generic]) -> list[str]:
    """Write numbers as the shortest texts that read back to the same values: 50, 0.1."""
    flat = np.ascontiguousarray(values)
    if flat.dtype.kind == "f":
        flat = flat + 0.0  # -0 is 0.
        if ((flat == np.rint(flat)) & (np.abs(flat) < _WHOLE)).all():
            flat = flat.astype(np.int64)
    texts = orjson.dumps(flat, option=orjson.OPT_SERIALIZE_NUMPY).decode("ascii")[1:-1].split(",")
    if flat.dtype.kind == "f":
        texts = [t[:-2] if t.endswith(".0") else t for t in texts]
    return texts


def value_text(value: Value) -> str:
    """Write one argument as text: 50, run, {1,2,0,0}."""
    if isinstance(value, str):
        return value
    if isinstance(value, tuple):
        return f"{{{','.join(map(value_text, value))}}}"
    return number_texts(np.array([value], dtype=np.float64))[0]


def overridden_text(overrides: Overrides) -> str:
    """Write the overrides for the head of a listing or program."""
    return f"-D {overrides_text(overrides)}"


def listing_json(
    stream: Stream | None, name: str, diagnostics: Iterable[Diagnostic], overrides: Overrides = NO_OVERRIDES
) -> Iterator[bytes]:
    """Write the JSON schema gusjob-calls/1, in pieces.

    Calls that are not buffered are objects, each with `at`, the number of buffered calls before it; buffered calls are
    columns. Without a stream, for a job that was not compiled, both are null.
    """
    yield b'{"schema": "gusjob-calls/1", "job": ' + orjson.dumps(name)
    if overrides:
        yield b', "overrides": ' + orjson.dumps(dict(overrides))
    if stream is None:
        yield b', "calls": null, "buffered": null'
    else:
        yield from _calls_json(stream)
    yield b', "diagnostics": ' + orjson.dumps([diagnostic_object(diagnostic) for diagnostic in diagnostics]) + b"}\n"


def _calls_json(stream: Stream) -> Iterator[bytes]:
    calls = [{"call": c.name, "args": c.args, "at": c.at, "line": c.line} for c in stream.calls]
    yield b', "calls": ' + orjson.dumps(calls)
    names = [BUFFERED[Buffered(kind)].name.encode() for kind in Buffered]
    yield b', "buffered": {"call": ['
    yield b",".join([b'"' + names[kind] + b'"' for kind in stream.buffered.kind.tolist()]) + b"]"
    for name in stream.buffered.__struct_fields__[1:]:
        column = np.ascontiguousarray(stream.buffered.column(name))
        yield b", " + orjson.dumps(name) + b": " + orjson.dumps(column, option=orjson.OPT_SERIALIZE_NUMPY)
    yield b"}"
