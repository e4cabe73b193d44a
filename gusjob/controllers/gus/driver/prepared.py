"""Rows of a stream prepared as calls: everything that the sending loop would have to compute for each call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.controllers.gus.calls import BUFFERED, Arg, ArgKind, BufferedCalls, CType, Signature
from gusjob.controllers.gus.driver.abi import Prototype
from gusjob.controllers.gus.driver.library import Library
from gusjob.controllers.gus.listing import number_texts
from gusjob.kinematics.arrays import Indices

PreparedCall = tuple[Callable[..., int], tuple[int | float, ...], bytes]
"""A buffered call: function, all arguments, the rest of its journal line without the closing brace."""


def prepare(library: Library, calls: BufferedCalls, job_rows: Indices) -> list[PreparedCall]:
    """Prepare calls column by column.

    Args:
        library: the library that is called.
        calls: n calls.
        job_rows: (n,), the whole job's row of each call, -1 for one that rebuilds the state of a resumed run.
    """
    made: list[PreparedCall] = [_NOTHING] * len(calls)
    for kind, signature in BUFFERED.items():
        at = np.flatnonzero(calls.kind == kind)
        if len(at):
            function, prototype = library.functions[signature.name], library.prototypes[signature.name]
            arguments = zip(*_columns(calls, at, prototype), strict=True)
            texts = _journal_texts(calls, at, signature, job_rows)
            for i, args, text in zip(at.tolist(), arguments, texts, strict=True):
                made[i] = (function, args, text)
    return made


def _nothing(*_args: object) -> int:
    raise AssertionError("every buffered call has a signature")


_NOTHING: PreparedCall = (_nothing, (), b"")


def _columns(calls: BufferedCalls, at: Indices, prototype: Prototype) -> list[list[int | float]]:
    """Return a list for each argument, in the library's order."""

    def column(arg: Arg) -> list[int | float]:
        values = calls.column(arg.column)[at]
        whole = arg.kind is ArgKind.WHOLE and arg.c is not CType.DOUBLE
        found: list[int | float] = (values.astype(np.int64) if whole else values.astype(np.float64)).tolist()
        return found

    def constants(values: tuple[int, ...]) -> list[list[int | float]]:
        return [[value] * len(at) for value in values]

    return [*constants(prototype.leading), *map(column, prototype.args), *constants(prototype.trailing)]


def _journal_texts(calls: BufferedCalls, at: Indices, signature: Signature, job_rows: Indices) -> list[bytes]:
    """Return what follows time and code in a journal line."""
    args = signature.args
    form = f'"row":%s,"line":%s,"call":"{signature.name}","args":[{",".join(["%s"] * len(args))}]'
    columns: list[npt.NDArray[Any]] = [job_rows[at], calls.line[at], *(calls.column(a.column)[at] for a in args)]
    return [text.encode() for text in map(form.__mod__, zip(*map(number_texts, columns), strict=True))]
