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
            form = f"{signature.name}({','.join(['%s'] * len(signature.args))})"
            columns = [number_texts(calls.column(arg.column)[at]) for arg in signature.args]
            lines[at] = list(map(form.__mod__, zip(*columns, strict=True)))
    found: list[str] = lines.tolist()
    return found


def number_texts(values: npt.NDArray[np.generic]) -> list[str]:
    """Write numbers as the shortest texts that read back to the same values: 50, 0.1."""
    flat = np.ascontiguousarray(values)
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
