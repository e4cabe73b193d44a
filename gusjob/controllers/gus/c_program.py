"""Write a stream as a C program that sends it: the template c_program.c with the job's calls at its mark.

Buffered calls are rows of tables, since a C compiler needs seconds for a million rows of numbers and minutes for a
million statements. All other calls are statements, in functions of bounded length.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from gusjob.controllers.gus import ranges
from gusjob.controllers.gus.calls import (
    BUFFERED,
    CRD_FIELDS,
    SIGNATURES,
    Arg,
    ArgKind,
    BufferedCalls,
    Call,
    Signature,
    Stream,
    Value,
)
from gusjob.controllers.gus.listing import number_texts, overridden_text, value_text
from gusjob.controllers.gus.ranges import Membership, Range
from gusjob.ir.overrides import NO_OVERRIDES, Overrides
from gusjob.version import __version__

_TEMPLATE = Path(__file__).with_name("c_program.c")
_MARK = "/* @job@ */\n\n"
_CHUNK = 1 << 16
_STEPS = 200
_MAX_NAME_LENGTH = 80
_MAX_ERRORS = 20


def c_program(stream: Stream, overrides: Overrides = NO_OVERRIDES) -> Iterator[str]:
    """Write the program's text, in pieces that end with a line end; plain ASCII.

    A number that its C type cannot hold, and a struct whose fields the listing does not give, become an #error with
    their line: C would silently convert the number to another one.
    """
    before, after = _TEMPLATE.read_text(encoding="ascii").split(_MARK)
    yield _head(stream, overrides)
    yield before
    yield from _functions(stream)
    yield after


def _head(stream: Stream, overrides: Overrides) -> str:
    """Write the head: the file's origin, and the macros of the template: channels, coordinate systems, axes, calls."""
    name = re.split(r"[/\\]", stream.name)[-1]
    rows, starts = len(stream.buffered), sum(call.name == "GT_CrdStart" for call in stream.calls)
    kinds = [BUFFERED[kind] for kind in BUFFERED if np.any(stream.buffered.kind == kind)]
    lines = [
        "/*",
        f" * Job: {_in_comment(name)[:_MAX_NAME_LENGTH]}",
        *([f" * {_expressions_in_comment(overridden_text(overrides))}"] if overrides else []),
        f" * Buffered calls: {rows}, stages: {starts}. Written by gusjob {__version__}.",
        " */",
        *(f"#error {_in_comment(error)}" for error in _errors(stream)),
        f"#define GUSJOB_CHANNELS {_list(_named(stream, 'channel'))}",
        f"#define GUSJOB_CRDS {_list(_named(stream, 'crd'))}",
        f"#define GUSJOB_AXES {_list(_axes(stream))}",
        f"#define GUSJOB_ARGUMENTS {max((len(s.args) for s in kinds), default=1)}",
        *(f"#define GUSJOB_{_short(s)}" for s in kinds),
    ]
    return "\n".join(lines) + "\n\n"


def _functions(stream: Stream) -> Iterator[str]:
    """Write tables, functions that send them and make the other calls, and run_job, which calls these in order."""
    steps, parts, tables = list[str](), 0, 0
    for first, last, call in stream.parts():
        for start in range(first, last, _CHUNK):
            end, tables = min(start + _CHUNK, last), tables + 1
            rows = _rows(stream.buffered.pick(np.arange(start, end)))
            yield f"static const Row calls_{tables}[] = {{\n" + "\n".join(rows) + "\n};\n\n"
            steps.append(f"    RUN(feed(calls_{tables}, {end - start}));\n")
        if call is not None:
            steps.append(_step(call))
        if len(steps) >= _STEPS or call is None:
            parts += 1
            yield f"static int part_{parts}(void)\n{{\n{''.join(steps)}    return 1;\n}}\n\n"
            steps = []
    names = "".join(f"    part_{number},\n" for number in range(1, parts + 1))
    yield (
        f"static int (*const PARTS[])(void) = {{\n{names}}};\n\n"
        "static int run_job(void)\n{\n    int i;\n"
        f"    for (i = 0; i < {parts}; i++)\n        RUN(PARTS[i]());\n    return 1;\n}}\n\n"
    )


def _rows(calls: BufferedCalls) -> list[str]:
    """Write one row a buffered call, (n,): {line,call,{arguments}}, numbers as in a listing."""
    rows = np.empty(len(calls), dtype=object)
    for kind, signature in BUFFERED.items():
        at = np.flatnonzero(calls.kind == kind)
        if len(at):
            form = f"{{%s,{_short(signature)},{{{','.join(['%s'] * len(signature.args))}}}}},"
            columns = [number_texts(calls.column(name)[at]) for name in ("line", *(a.column for a in signature.args))]
            rows[at] = list(map(form.__mod__, zip(*columns, strict=True)))
    found: list[str] = rows.tolist()
    return found


def _step(call: Call) -> str:
    """Write one call that is not buffered."""
    texts = list(map(value_text, call.args))
    match call.name:
        case "GT_CrdClear":
            return f"    RUN(crd_clear({call.line}, {', '.join(texts)}));\n"
        case "GT_CrdStart":
            return f"    RUN(crd_start({call.line}, {', '.join(texts)}));\n"
        case "GT_CrdStatus":
            return f"    RUN(crd_wait({call.line}, {texts[0]}, {texts[-1]}));\n" if call.waits else ""
        case _:
            return _statement(call, texts)


def _statement(call: Call, texts: list[str]) -> str:
    """Write a call, with the targets of its pointers in variables of its own."""
    before = list[str]()
    for i, (arg, value) in enumerate(zip(SIGNATURES[call.name].args, call.args, strict=True)):
        match arg.kind:
            case ArgKind.ARRAY:
                before.append(f"{arg.c} {arg.name}[] = {texts[i]};")
                texts[i] = arg.name
            case ArgKind.POINTER:
                before.append("unsigned short value = 0;")
                texts[i] = "&value"
            case ArgKind.STRUCT:
                before += ["TCrdPrm crdPrm;", "memset(&crdPrm, 0, sizeof crdPrm);", *_fields(value)]
                texts[i] = "&crdPrm"
            case _:
                pass
    line = f"DO({call.line}, {call.name}({','.join(texts)}));"
    if not before:
        return f"    {line}\n"
    return "    {\n" + "".join(f"        {text}\n" for text in (*before, line)) + "    }\n"


def _fields(value: Value) -> Iterator[str]:
    """Assign the fields of a TCrdPrm that are not 0 by name, since their order depends on the header."""
    if isinstance(value, tuple):
        for (name, *_), part in zip(CRD_FIELDS, value, strict=True):
            if isinstance(part, tuple):
                yield from (f"crdPrm.{name}[{i}] = {value_text(one)};" for i, one in enumerate(part) if one)
            elif part:
                yield f"crdPrm.{name} = {value_text(part)};"


def _named(stream: Stream, name: str) -> list[int]:
    """Find the channels or coordinate systems that any call names."""
    found = set[float]()
    for kind, signature in BUFFERED.items():
        if any(arg.name == name for arg in signature.args):
            found |= set(np.unique(stream.buffered.column(name)[stream.buffered.kind == kind]).tolist())
    for call in stream.calls:
        for arg, value in zip(SIGNATURES[call.name].args, call.args, strict=True):
            if arg.name == name and isinstance(value, float):
                found.add(value)
    return sorted(map(int, found))


def _axes(stream: Stream) -> list[int]:
    """Find the axes of the coordinate systems: those with a profile."""
    profiles = [
        call.args[1][1] for call in stream.calls if call.name == "GT_SetCrdPrm" and isinstance(call.args[1], tuple)
    ]
    return sorted({axis for p in profiles if isinstance(p, tuple) for axis, use in enumerate(p, start=1) if use})


def _errors(stream: Stream) -> list[str]:
    """Describe the arguments that cannot be written in C, with their lines."""
    errors = [*_conversion_errors(stream), *_buffered_errors(stream.buffered), *_call_errors(stream.calls)]
    return errors[:_MAX_ERRORS]


def _conversion_errors(stream: Stream) -> Iterator[str]:
    """Describe the numbers of a listing that C converts: in another program they would be converted again, unseen."""
    for found in stream.conversions:
        allowed = _range_of(found.call, found.argument)
        for line, written in zip(found.line[:_MAX_ERRORS].tolist(), found.written[:_MAX_ERRORS].tolist(), strict=True):
            yield _error(line, found.call, found.argument, written, allowed)


def _range_of(call: str, argument: str) -> Range:
    """Return the range of an argument, or of a field of its struct."""
    named = {name: allowed for name, _, _, allowed in CRD_FIELDS} | {a.name: a.range for a in SIGNATURES[call].args}
    return named[argument] or ranges.SHORT


def _buffered_errors(calls: BufferedCalls) -> Iterator[str]:
    for kind, signature in BUFFERED.items():
        at = np.flatnonzero(calls.kind == kind)
        for arg in signature.args:
            if arg.kind is ArgKind.WHOLE and len(at):
                allowed, values = arg.range or ranges.SHORT, calls.column(arg.column)[at]
                bad = (allowed.classify(values) == Membership.OUTSIDE) | ~allowed.carries(values)
                for i in np.flatnonzero(bad)[:_MAX_ERRORS].tolist():
                    yield _error(int(calls.line[at[i]]), signature.name, arg.name, values[i], allowed)


def _call_errors(calls: Iterable[Call]) -> Iterator[str]:
    for call in calls:
        for arg, value in zip(SIGNATURES[call.name].args, call.args, strict=True):
            if arg.kind is ArgKind.STRUCT and isinstance(value, str):
                yield f"line {call.line}: {call.name}: the fields of {value} are not given"
            for name, allowed, number in _whole_numbers(arg, value):
                if allowed.classify_one(number) is Membership.OUTSIDE or not allowed.carries(number):
                    yield _error(call.line, call.name, name, number, allowed)


def _whole_numbers(arg: Arg, value: Value) -> Iterator[tuple[str, Range, float]]:
    """Find the numbers of an argument that must be whole: (name, range, number)."""
    match arg.kind:
        case ArgKind.WHOLE:
            yield from ((arg.name, arg.range or ranges.SHORT, number) for number in _flat(value))
        case ArgKind.ARRAY if arg.range is not None and arg.range.whole:
            for number in _flat(value):
                yield arg.name, arg.range, number
        case ArgKind.STRUCT if isinstance(value, tuple):
            for (name, _, _, allowed), part in zip(CRD_FIELDS, value, strict=True):
                if allowed is not None:
                    yield from ((name, allowed, number) for number in _flat(part))
        case _:
            pass


def _flat(value: Value) -> Iterator[float]:
    if isinstance(value, float):
        yield value
    elif isinstance(value, tuple):
        for part in value:
            yield from _flat(part)


def _error(line: int, call: str, argument: str, value: float, allowed: Range) -> str:
    return f"line {line}: {call}: {argument} is {value:.17g}, it must be whole and in {allowed}"


def _short(signature: Signature) -> str:
    return signature.name.removeprefix("GT_")


def _list(values: list[int]) -> str:
    """Write a list for the template: -1 ends it."""
    return ", ".join(map(str, [*values, -1]))


def _expressions_in_comment(text: str) -> str:
    """Keep the operators of expressions, but nothing that could end a comment, join lines or form a trigraph."""
    return re.sub(r"[^A-Za-z0-9 ._+()*/%<>=!,-]|\*(?=/)", "_", text)


def _in_comment(text: str) -> str:
    """Replace characters that could end a comment, join lines or form a trigraph."""
    return re.sub(r"[^A-Za-z0-9 ._+()\[\],:=@#/-]", "_", text)
