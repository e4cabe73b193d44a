"""A listing's text to its calls: each line shape is parsed once, and the numbers of all its lines are read together."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches

import numpy as np
from lark import Token, Tree, UnexpectedInput, UnexpectedToken

from gusjob.controllers.gus.calls import (
    BUFFERED,
    IGNORED_CALLS,
    SIGNATURES,
    Arg,
    ArgKind,
    Buffered,
    Signature,
    Stream,
    Value,
)
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule, Span
from gusjob.frontend.listing.c_values import EXPECTED_ARGUMENT, CVariables, fits_argument
from gusjob.frontend.listing.call_rows import (
    COLUMNS,
    SHORT_COLUMNS,
    buffered_row,
    call_row,
    not_short,
    stream_of,
)
from gusjob.frontend.parse.grammar import LISTING_GRAMMAR, parser, subtrees, tokens
from gusjob.frontend.parse.misread import misread
from gusjob.frontend.scan.rows import Row, Rows, Template, TemplateBuilder
from gusjob.frontend.scan.scanner import MAX_DIAGNOSTICS, scan
from gusjob.frontend.scan.shapes import MAX_LINE
from gusjob.frontend.source import Source
from gusjob.i18n.phrases import Phrase, did_you_mean

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
_CODE = re.compile(r"GT_|[;={}#]|[A-Za-z_][A-Za-z0-9_]*\s*\(")
"""Characters that most code has, but no comment of the manual."""
_MAX_JOINED_LINES = 20
"""Lines that one call may take."""
_LOOK_BACK = 50
"""Blank lines that may be between the lines of a comment."""
_BLOCK_COMMENT = re.compile(rb"/\*.*?\*/", re.DOTALL)
_ZEROS = re.compile(rb"(?<![0-9A-Za-z_.])0+(?=0(?![0-9.xX]))")
_OCTAL = re.compile(rb"(?<![0-9A-Za-z_.])[+-]?0(?=[0-9]+(?![0-9.]))")


def looks_like_listing(data: bytes) -> bool:
    """Whether a text of unknown kind has GT_ calls."""
    return re.search(rb"\bGT_[A-Za-z]+\s*\(", data[:200_000]) is not None


def read_listing(source: Source) -> tuple[Stream, list[Diagnostic]]:
    """Read all calls of a listing; after a diagnostic the rest is still read."""
    data = source.data
    if b"/*" in data:
        data = _BLOCK_COMMENT.sub(lambda m: re.sub(rb"[^\n]", b" ", m[0]), data)
    if _ZEROS.search(data) or _OCTAL.search(data):
        # 00 is 0 in C as well. Any other number with a leading zero is octal: it becomes a name, o10, which no
        # template reads.
        data = _OCTAL.sub(lambda m: b"o" * len(m[0]), _ZEROS.sub(lambda m: b" " * len(m[0]), data))
    reader = _ListingReader(source=source, text=Source(name=source.name, data=data))
    rows = scan(data, semicolon_comments=False, learn=reader.learn, parse_line=reader.parse_line)
    reader.finish()
    rows = reader.without_odd_numbers(rows)
    return stream_of(source.name, rows, reader.calls), reader.diagnostics


@dataclass(slots=True)
class _ListingReader:
    source: Source
    text: Source
    """The source as it is parsed, with block comments and octal numbers replaced."""
    diagnostics: list[Diagnostic] = field(default_factory=list)
    calls: list[tuple[str, tuple[Value, ...]]] = field(default_factory=list)
    variables: CVariables = field(default_factory=CVariables)
    comment_lines: set[int] = field(default_factory=set)
    """Lines without `//` that continue a comment."""
    pending: list[str] = field(default_factory=list)
    """Lines of a call that has not ended yet."""
    pending_line: int = 0
    not_listed: int = 0

    def report(self, rule: Rule, line: int, column: int, end_column: int, **fields: object) -> None:
        """Add a diagnostic."""
        span = Span(line=line, column=column, end_line=line, end_column=end_column)
        self.diagnostics.append(Diagnostic(rule=rule, span=span, fields=fields, path=self.source.name))

    def report_at(self, rule: Rule, token: Token, line: int, **fields: object) -> None:
        """Add a diagnostic at a token."""
        start = token.column or 1
        self.report(rule, line, start, start + len(token), **fields)

    # Lines.

    def learn(self, line: str) -> Template | None:
        """The template of a line with one buffered call whose arguments are all plain numbers."""
        builder = TemplateBuilder.of_line(line)
        if builder is None:
            return None
        try:
            tree = parser(LISTING_GRAMMAR).parse(line)
        except UnexpectedInput:
            return None
        items = subtrees(tree)
        if len(items) != 1 or items[0].data != "call":
            return None
        signature = SIGNATURES.get(str(tokens(items[0])[-1]))
        args = subtrees(items[0])
        if signature is None or signature.buffered is None or len(args) != len(signature.args):
            return None
        if any(arg.data != "number" for arg in args):
            return None
        for arg, value in zip(signature.args, args, strict=True):
            token = tokens(value)[0]
            start = (token.column or 1) - 1
            if not builder.add(COLUMNS.index(arg.column), start, start + len(token)):
                return None
        return builder.build(signature.buffered)

    def parse_line(self, number: int, text: str) -> Sequence[Row]:
        """Parse one line, joined to the lines before it where a call continues."""
        if len(self.diagnostics) >= MAX_DIAGNOSTICS:
            self.not_listed += 1
            return ()
        if len(text) > MAX_LINE:
            self.report(rules.LINE_TOO_LONG, number, 1, 2, size=len(text), limit=MAX_LINE)
            return ()
        code = text.split("//")[0]
        if self.pending:
            code = " ".join([*self.pending, code])
        line = self.pending_line if self.pending else number
        try:
            tree = parser(LISTING_GRAMMAR).parse(code)
        except UnexpectedInput as error:
            self.not_code(error, code, line, number)
            return ()
        self.pending = []
        rows: list[Row] = []
        for item in subtrees(tree):
            rows += self.item(item, line)
        return rows

    def not_code(self, error: UnexpectedInput, code: str, line: int, number: int) -> None:
        """Handle a line that can't be parsed: part of a comment, the first part of a call, or an error."""
        ends_early = isinstance(error, UnexpectedToken) and error.token.type == "$END"
        if ends_early and code.count("(") > code.count(")") and number - line < _MAX_JOINED_LINES:
            self.pending, self.pending_line = [code], line
            return
        self.pending = []
        if line == number and self.continues_comment(number, code):
            self.comment_lines.add(number)
            return
        found = misread(error, LISTING_GRAMMAR, code, _TERMINALS)
        shown = found.found
        if shown.strip("'") not in self.source.line(line):  # An octal number: o10 stands for it.
            shown = re.sub("^'oo?(?=[0-9])", "'0", shown)
        self.report(rules.CALL_SYNTAX, line, found.column, found.end_column, found=shown)

    def continues_comment(self, number: int, code: str) -> bool:
        """Whether a line without code continues the comment of the line above, as in the manual's examples (四.3)."""
        if _CODE.search(code):
            return False
        for above in range(number - 1, max(number - _LOOK_BACK, 0), -1):
            text = self.text.line(above)
            if text.strip():
                return "//" in text or above in self.comment_lines
        return False

    def finish(self) -> None:
        """Report a call that never ends, and lines that were not parsed."""
        if self.pending:
            found = Phrase("the end of the file inside a call")
            self.report(rules.CALL_SYNTAX, self.pending_line, 1, 2, found=found)
        if self.not_listed:
            fields = {"count": self.not_listed, "code": Phrase("the lines"), "shown": len(self.diagnostics)}
            self.diagnostics.append(
                Diagnostic(rule=rules.NOT_LISTED, span=d.NOWHERE, fields=fields, path=self.source.name)
            )

    def without_odd_numbers(self, rows: Rows) -> Rows:
        """Report and remove rows whose coordinate system, FIFO or channel can't be a C short."""
        odd = np.zeros(len(rows.op), dtype=np.bool_)
        for name in SHORT_COLUMNS:
            found = not_short(rows, name)
            for row in np.flatnonzero(found & ~odd)[:MAX_DIAGNOSTICS].tolist():
                value = f"{rows.column(COLUMNS.index(name))[row]:g}"
                call = BUFFERED[Buffered(int(rows.op[row]))].name
                fields = {"argument": name, "call": call, "wanted": EXPECTED_ARGUMENT[ArgKind.WHOLE], "found": value}
                self.report(rules.CALL_VALUE, int(rows.line[row]), 1, 1, **fields)
            odd |= found
        return rows if not odd.any() else rows.pick(~odd)

    # Calls.

    def item(self, item: Tree[Token], line: int) -> list[Row]:
        """Run one item of C code; returns the rows of a call."""
        match item.data:
            case "call":
                return self.call(item, line)
            case "array":
                self.variables.declare_array(item)
            case "declare":
                self.variables.declare(item)
            case "assign":
                self.variables.assign(item)
            case _:
                pass
        return []

    def call(self, item: Tree[Token], line: int) -> list[Row]:
        """The row of a call; none with a diagnostic."""
        token = tokens(item)[-1]
        name, args = str(token), subtrees(item)
        signature = SIGNATURES.get(name)
        if signature is None:
            self.report_unknown_call(name, token, line)
            return []
        if len(args) != len(signature.args):
            fields = {"wanted": len(signature.args), "names": ", ".join(arg.name for arg in signature.args)}
            self.report_at(rules.CALL_ARGUMENTS, token, line, call=name, **fields, found=len(args))
            return []
        values = [self.argument(signature, arg, tree, line) for arg, tree in zip(signature.args, args, strict=True)]
        if any(value is None for value in values):
            return []
        if signature.buffered is not None:
            return [buffered_row(signature.buffered, signature, values)]
        self.calls.append((name, tuple(value for value in values if value is not None)))
        return [call_row(len(self.calls) - 1)]

    def report_unknown_call(self, name: str, token: Token, line: int) -> None:
        """Report a call that is ignored, or one that is not known."""
        if name in IGNORED_CALLS or not name.startswith("GT_"):
            self.report_at(rules.CALL_IGNORED, token, line, call=name)
        else:
            near = get_close_matches(name, SIGNATURES, 1, cutoff=0.8)
            self.report_at(rules.CALL_UNKNOWN, token, line, call=name, hint=did_you_mean(near[0] if near else ""))

    def argument(self, signature: Signature, arg: Arg, tree: Tree[Token], line: int) -> Value | None:
        """One argument's value, or None with a diagnostic."""
        first = next((t for t in tree.scan_values(lambda _: True) if isinstance(t, Token)), None)
        if first is not None and (octal := re.fullmatch("oo?([0-9]+)", first)):
            no_octal = bool(set(octal[1]) & set("89"))
            value = Phrase("not defined (8 and 9 are not octal digits)") if no_octal else str(int(octal[1], 8))
            self.report_at(rules.CALL_OCTAL, first, line, found=f"0{octal[1]}", value=value)
            return None
        if arg.kind is ArgKind.POINTER and tree.data == "pointer":
            return str(first)
        found = self.variables.value(tree)
        if fits_argument(arg.kind, found):
            return found
        fields = {"argument": arg.name, "call": signature.name, "wanted": EXPECTED_ARGUMENT[arg.kind]}
        if first is None:
            self.report(rules.CALL_VALUE, line, 1, 2, **fields, found=Phrase("nothing"))
        else:
            self.report_at(rules.CALL_VALUE, first, line, **fields, found=str(first)[:40])
        return None
