"""Listings to streams: `.gts` files, and GT_ calls as C programs and the vendor's manual hold them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Any

import numpy as np
from lark import Token, Tree, UnexpectedInput, UnexpectedToken

from gusjob.controllers.gus.calls import (
    BUFFERED,
    IGNORED_CALLS,
    SIGNATURES,
    Arg,
    ArgKind,
    Buffered,
    BufferedCalls,
    Call,
    Signature,
    Stream,
    Value,
)
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule, Span
from gusjob.frontend.parse.lines import misread, parser, subtrees, tokens
from gusjob.frontend.scan.shapes import MAX_DIAGNOSTICS, MAX_LINE, Row, Rows, Slot, Template, number_runs, scan
from gusjob.frontend.source import Source
from gusjob.i18n.phrases import Phrase, did_you_mean

GRAMMAR = "listing.lark"
_TERMINALS = {
    "NAME": "a name",
    "NUMBER": "a number",
    "TYPE": "a C type",
    "STRUCT_TYPE": "a C type",
    "ELIDED": "...",
    "LPAR": "(",
    "RPAR": ")",
    "LBRACE": "{",
    "RBRACE": "}",
    "LSQB": "[",
    "RSQB": "]",
    "EQUAL": "=",
    "AMPERSAND": "&",
    "STAR": "*",
    "DOT": ".",
}
_COLUMNS = ("crd", "fifo", "channel", "x", "y", "p", "q", "r", "vel", "acc", "vel_end")
_SHORT_COLUMNS = _COLUMNS[:3]
_CALL_OP = 100
"""Row op of a call that is not buffered; column 0 holds its index."""
_CODE = re.compile(r"GT_|[;={}#]|[A-Za-z_][A-Za-z0-9_]*\s*\(")
"""What no comment of M's has and most code does."""
_JOINED_LINES = 20
_LONGEST_ARRAY = 64
_LOOK_BACK = 50
_BLOCK_COMMENT = re.compile(rb"/\*.*?\*/", re.DOTALL)
_ZEROS = re.compile(rb"(?<![0-9A-Za-z_.])0+(?=0(?![0-9.xX]))")
_OCTAL = re.compile(rb"(?<![0-9A-Za-z_.])[+-]?0(?=[0-9]+(?![0-9.]))")
_CRD_FIELDS = ("dimension", "profile", "synVelMax", "synAccMax", "evenTime", "setOriginFlag", "originPos")


def looks_like_listing(data: bytes) -> bool:
    """Whether a text of unknown kind holds GT_ calls."""
    return re.search(rb"\bGT_[A-Za-z]+\s*\(", data[:200_000]) is not None


def read_listing(source: Source) -> tuple[Stream, list[Diagnostic]]:
    """All calls of a listing; after a diagnostic the rest is still read."""
    data = source.data
    if b"/*" in data:
        data = _BLOCK_COMMENT.sub(lambda m: re.sub(rb"[^\n]", b" ", m[0]), data)
    if _ZEROS.search(data) or _OCTAL.search(data):
        # 00 is 0 in C as well; any other number with a leading zero is octal: as a name, o10, no template reads it.
        data = _OCTAL.sub(lambda m: b"o" * len(m[0]), _ZEROS.sub(lambda m: b" " * len(m[0]), data))
    reader = _ListingReader(source=source, text=Source(name=source.name, data=data))
    rows = scan(data, semicolon_comments=False, learn=reader.learn, read_line=reader.read_line)
    reader.finish()
    rows = _without_odd_numbers(rows, reader)
    return _stream(source.name, rows, reader.calls), reader.diagnostics


def _without_odd_numbers(rows: Rows, reader: _ListingReader) -> Rows:
    """Rows whose coordinate system, FIFO and channel are numbers that a C short could be; the others are
    diagnostics."""
    odd = np.zeros(len(rows.op), dtype=np.bool_)
    for name in _SHORT_COLUMNS:
        values = rows.column(_COLUMNS.index(name))
        mine = (rows.op != _CALL_OP) & ~np.isnan(values) & ((np.abs(values) > 100) | (values != np.floor(values)))
        for i in np.flatnonzero(mine & ~odd)[:MAX_DIAGNOSTICS].tolist():
            call = BUFFERED[Buffered(int(rows.op[i]))].name
            found = f"{values[i]:g}"
            fields = {"argument": name, "call": call, "wanted": _WANTED[ArgKind.WHOLE], "found": found}
            reader.diagnostic(rules.CALL_VALUE, int(rows.line[i]), 1, 1, **fields)
        odd |= mine
    return rows if not odd.any() else rows.pick(~odd)


def _stream(name: str, rows: Rows, calls: list[tuple[str, tuple[Value, ...]]]) -> Stream:
    is_call = rows.op == _CALL_OP
    keep = ~is_call
    before = np.cumsum(keep)
    index = rows.column(0)

    def cut(column: str, dtype: type) -> Any:
        return np.nan_to_num(rows.column(_COLUMNS.index(column))[keep]).astype(dtype)

    buffered = BufferedCalls(
        kind=rows.op[keep],
        line=rows.line[keep],
        **{c: cut(c, np.int8) for c in _SHORT_COLUMNS},
        **{c: cut(c, np.float64) for c in _COLUMNS[3:]},
    )
    others = [
        Call(name=calls[int(index[i])][0], args=calls[int(index[i])][1], at=int(before[i]), line=int(rows.line[i]))
        for i in np.flatnonzero(is_call).tolist()
    ]
    return Stream(name=name, buffered=buffered, calls=tuple(others))


@dataclass(slots=True)
class _ListingReader:
    source: Source
    text: Source
    diagnostics: list[Diagnostic] = field(default_factory=list)
    calls: list[tuple[str, tuple[Value, ...]]] = field(default_factory=list)
    arrays: dict[str, Value] = field(default_factory=dict)
    fields: dict[str, dict[str, Value]] = field(default_factory=dict)
    run_ons: set[int] = field(default_factory=set)
    pending: list[str] = field(default_factory=list)
    pending_line: int = 0
    not_listed: int = 0

    def learn(self, line: str) -> Template | None:
        """The template of a line with one buffered call whose arguments are all plain numbers."""
        runs = number_runs(line.encode()) if line.isascii() else None
        if runs is None:
            return None
        try:
            tree = parser(GRAMMAR).parse(line)
        except UnexpectedInput:
            return None
        items = subtrees(tree)
        if len(items) != 1 or items[0].data != "call":
            return None
        signature = SIGNATURES.get(str(tokens(items[0])[-1]))
        args = subtrees(items[0])
        if signature is None or signature.buffered is None or len(args) != len(signature.args):
            return None
        if any(a.data != "number" for a in args):
            return None
        run_at = {start: i for i, (start, _) in enumerate(runs)}
        slots = []
        for arg, value in zip(signature.args, args, strict=True):
            token = tokens(value)[0]
            run = run_at.pop((token.column or 1) - 1, None)
            if run is None or runs[run][1] - runs[run][0] != len(token):
                return None
            slots.append(Slot(column=_COLUMNS.index(arg.column), run=run))
        fixed = tuple((i, float(line[start : runs[i][1]])) for start, i in run_at.items())
        return Template(op=signature.buffered, slots=tuple(slots), fixed=fixed)

    def read_line(self, number: int, text: str) -> Sequence[Row]:
        """One line through the grammar, joined to the lines before it where a call goes on."""
        if len(self.diagnostics) >= MAX_DIAGNOSTICS:
            self.not_listed += 1
            return ()
        if len(text) > MAX_LINE:
            self.diagnostic(rules.NO_END, number, 1, 2, size=len(text), limit=MAX_LINE)
            return ()
        code = text.split("//")[0]
        if self.pending:
            code = " ".join([*self.pending, code])
        line = self.pending_line if self.pending else number
        try:
            tree = parser(GRAMMAR).parse(code)
        except UnexpectedInput as error:
            return self.unreadable(error, code, line, number)
        self.pending = []
        rows: list[Row] = []
        for item in subtrees(tree):
            rows += self.item(item, line)
        return rows

    def unreadable(self, error: UnexpectedInput, code: str, line: int, number: int) -> Sequence[Row]:
        """A line that is no code: the rest of a comment, the first part of a call, or a diagnostic."""
        ends_early = isinstance(error, UnexpectedToken) and error.token.type == "$END"
        if ends_early and code.count("(") > code.count(")") and number - line < _JOINED_LINES:
            self.pending, self.pending_line = [code], line
            return ()
        self.pending = []
        if line == number and self.is_run_on(number, code):
            self.run_ons.add(number)
            return ()
        diagnostic = misread(error, GRAMMAR, code, _TERMINALS)
        found = diagnostic.found
        if found.strip("'") not in self.source.line(line):  # An octal number: o10 is what stands for it.
            found = re.sub("^'oo?(?=[0-9])", "'0", found)
        self.diagnostic(rules.CALL_SYNTAX, line, diagnostic.column, diagnostic.end_column, found=found)
        return ()

    def is_run_on(self, number: int, code: str) -> bool:
        """Whether a line goes on with the comment of the line above, as M's do (四.3): no code stands in it."""
        if _CODE.search(code):
            return False
        for above in range(number - 1, max(number - _LOOK_BACK, 0), -1):
            text = self.text.line(above)
            if text.strip():
                return "//" in text or above in self.run_ons
        return False

    def finish(self) -> None:
        """A call that never ended is a diagnostic."""
        if self.pending:
            self.diagnostic(
                rules.CALL_SYNTAX, self.pending_line, 1, 2, found=Phrase("the end of the file inside a call")
            )
        if self.not_listed:
            fields = {"count": self.not_listed, "code": Phrase("the lines"), "shown": len(self.diagnostics)}
            self.diagnostics.append(Diagnostic(rule=rules.MORE, span=d.NOWHERE, fields=fields, path=self.source.name))

    def diagnostic(self, rule: Rule, line: int, column: int, end_column: int, **fields: object) -> None:
        span = Span(line=line, column=column, end_line=line, end_column=end_column)
        self.diagnostics.append(Diagnostic(rule=rule, span=span, fields=fields, path=self.source.name))

    def at(self, rule: Rule, token: Token, line: int, **fields: object) -> None:
        start = token.column or 1
        self.diagnostic(rule, line, start, start + len(token), **fields)

    def item(self, item: Tree[Token], line: int) -> list[Row]:
        match item.data:
            case "call":
                return self.call(item, line)
            case "array":
                self.array(item)
            case "declare":
                for name in (t for t in subtrees(item) if t.data == "pointer_name"):
                    values = [v for v in subtrees(name) if v.data == "number"]
                    if values:
                        self.arrays[str(tokens(name)[0])] = self.value(values[-1])
            case "assign":
                self.assign(item)
            case _:
                pass
        return []

    def array(self, item: Tree[Token]) -> None:
        """long pos[4] = {0}; the rest is 0, as in C."""
        parts = [part for part in subtrees(item) if part.data != "type"]
        value = self.value(parts[-1])
        size = self.value(parts[0]) if len(parts) > 1 else 0.0
        if isinstance(value, tuple) and isinstance(size, float) and len(value) < size <= _LONGEST_ARRAY:
            value = (*value, *(0.0,) * (int(size) - len(value)))
        self.arrays[str(tokens(item)[0])] = value

    def assign(self, item: Tree[Token]) -> None:
        """name = value; crdPrm.synVelMax = 500; crdPrm.profile[0] = 1."""
        names, parts = [str(t) for t in tokens(item)], subtrees(item)
        value = self.value(parts[-1])
        if len(names) == 1:
            self.arrays[names[0]] = value
            return
        fields = self.fields.setdefault(names[0], {})
        if len(parts) == 1:
            fields[names[1]] = value
            return
        index = self.value(parts[0])
        found = fields.get(names[1])
        held: list[Value] = list(found) if isinstance(found, tuple) else [0.0] * 8
        if isinstance(index, float) and 0 <= index < len(held):
            held[int(index)] = value
        fields[names[1]] = tuple(held)

    def value(self, tree: Tree[Token]) -> Value:
        """A number, a struct or array, or a name (its array if one is known)."""
        if tree.data == "number":
            return _number(tokens(tree)[0])
        if tree.data == "struct":
            return tuple(self.value(part) for part in subtrees(tree))
        name = str(tokens(tree)[0])
        if name in self.fields:
            return tuple(
                self.fields[name].get(f, (0.0,) * 8 if f in ("profile", "originPos") else 0.0) for f in _CRD_FIELDS
            )
        return self.arrays.get(name, name)

    def call(self, item: Tree[Token], line: int) -> list[Row]:
        token = tokens(item)[-1]
        name, args = str(token), subtrees(item)
        signature = SIGNATURES.get(name)
        if signature is None:
            if name in IGNORED_CALLS or not name.startswith("GT_"):
                self.at(rules.CALL_IGNORED, token, line, call=name)
            else:
                near = get_close_matches(name, SIGNATURES, 1, cutoff=0.8)
                self.at(rules.CALL_UNKNOWN, token, line, call=name, hint=did_you_mean(near[0] if near else ""))
            return []
        if len(args) != len(signature.args):
            names = ", ".join(a.name for a in signature.args)
            self.at(
                rules.CALL_ARGUMENTS, token, line, call=name, wanted=len(signature.args), names=names, found=len(args)
            )
            return []
        values = [self.argument(signature, arg, tree, line) for arg, tree in zip(signature.args, args, strict=True)]
        if any(v is None for v in values):
            return []
        if signature.buffered is not None:
            columns = (_COLUMNS.index(arg.column) for arg in signature.args)
            return [Row(op=signature.buffered, values=dict(zip(columns, map(_real, values), strict=True)))]
        self.calls.append((name, tuple(v for v in values if v is not None)))
        return [Row(op=_CALL_OP, values={0: float(len(self.calls) - 1)})]

    def argument(self, signature: Signature, arg: Arg, tree: Tree[Token], line: int) -> Value | None:
        """One argument's value, or None with a diagnostic."""
        first = next((t for t in tree.scan_values(lambda _: True) if isinstance(t, Token)), None)
        if first is not None and (octal := re.fullmatch("oo?([0-9]+)", first)):
            no_octal = bool(set(octal[1]) & set("89"))
            worth = Phrase("nothing (8 and 9 are no octal digits)") if no_octal else str(int(octal[1], 8))
            self.at(rules.CALL_OCTAL, first, line, found=f"0{octal[1]}", value=worth)
            return None
        if arg.kind is ArgKind.POINTER and tree.data == "pointer":
            return str(first)
        value = self.value(tree)
        if _fits(arg.kind, value):
            return value
        fields = {"argument": arg.name, "call": signature.name, "wanted": _WANTED[arg.kind]}
        if first is None:
            self.diagnostic(rules.CALL_VALUE, line, 1, 2, **fields, found=Phrase("nothing"))
        else:
            self.at(rules.CALL_VALUE, first, line, **fields, found=str(first)[:40])
        return None


_WANTED = {
    ArgKind.WHOLE: Phrase("a whole number"),
    ArgKind.REAL: Phrase("a number"),
    ArgKind.ARRAY: Phrase("an array of four numbers"),
    ArgKind.POINTER: Phrase("a variable"),
    ArgKind.STRUCT: Phrase("a TCrdPrm"),
}


def _fits(kind: ArgKind, value: Value) -> bool:
    """Whether a value is of an argument's kind, and finite."""
    match kind:
        case ArgKind.WHOLE | ArgKind.REAL:
            return _finite(value)
        case ArgKind.ARRAY:
            return isinstance(value, tuple) and len(value) == 4 and all(map(_finite, value))
        case ArgKind.STRUCT:
            return isinstance(value, str) or _is_crd(value)
        case ArgKind.POINTER:
            return False


def _finite(value: Value) -> bool:
    return isinstance(value, float) and math.isfinite(value)


def _real(value: Value | None) -> float:
    return value if isinstance(value, float) else float("nan")


def _is_crd(value: Value) -> bool:
    """A TCrdPrm as a struct: dimension, profile[8], synVelMax, synAccMax, evenTime, setOriginFlag, originPos[8]."""
    if not isinstance(value, tuple) or len(value) != len(_CRD_FIELDS):
        return False
    return all(
        isinstance(part, tuple) and len(part) == 8 and all(map(_finite, part))
        if name in ("profile", "originPos")
        else _finite(part)
        for name, part in zip(_CRD_FIELDS, value, strict=True)
    )


def _number(token: Token) -> float:
    text = str(token).rstrip("uUlL")
    sign = -1.0 if text.startswith("-") else 1.0
    text = text.lstrip("+-")
    if text.lower().startswith("0x"):
        return sign * float(int(text, 16)) if len(text) < 300 else float("inf")
    return sign * float(text.rstrip("fF"))
