"""Read a listing: each line shape is parsed once, and the numbers of all its lines are read together.

What is not a plain call is parsed and run line by line. Only straight-line code is read: what could change which calls
are made, or with which values, and is not evaluated, is an error.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from lark import Token, Tree, UnexpectedInput, UnexpectedToken
from msgspec import Struct, field

from gusjob.config.machine import Abi
from gusjob.controllers.gus.calls import Stream
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.characters import report_hidden, without_consequences
from gusjob.diagnostics.model import Diagnostic, Span, has_errors
from gusjob.frontend.listing.c_evaluator import CEvaluator, CMacro, no_library
from gusjob.frontend.listing.c_numbers import CNumber, literal
from gusjob.frontend.listing.c_statements import CStatements
from gusjob.frontend.listing.c_trees import depth_of, first_token, has_effect, is_library_name, logged_call, only_begins
from gusjob.frontend.listing.call_reader import CallReader
from gusjob.frontend.listing.call_rows import stream_of
from gusjob.frontend.listing.clean_text import JOINS_LINES, OCTAL_MARK, clean_text, program_kind
from gusjob.frontend.listing.listing_diagnostics import ListingDiagnostics, control_flow
from gusjob.frontend.parse.grammar import LISTING_GRAMMAR, parser, subtrees, tokens
from gusjob.frontend.parse.misread import misread
from gusjob.frontend.scan.rows import Row, Rows, Template, TemplateBuilder, rows_of
from gusjob.frontend.scan.scanner import MAX_DIAGNOSTICS, scan_parts
from gusjob.frontend.scan.shapes import MAX_LINE
from gusjob.frontend.source import Source
from gusjob.i18n.characters import quoted
from gusjob.i18n.phrases import Phrase
from gusjob.patterns import lazy_pattern

_TERMINALS = {
    "NAME": "a name",
    "NUMBER": "a number",
    "STRING": "a text",
    "TYPE": "a C type",
    "ELIDED": "...",
    "LPAR": "(",
    "RPAR": ")",
    "LBRACE": "{",
    "RBRACE": "}",
    "LSQB": "[",
    "RSQB": "]",
    "ASSIGN": "=",
    "_COMMA": ",",
    "_SEMI": ";",
}
_CONTROL = lazy_pattern(
    r"(?<![\w.])(?:if|else|while|for|do|switch|case|default|break|continue|goto|return|exit|try|catch|throw|finally|"
    r"foreach|lock|yield|await|asm|and|or|not)(?!\w)|\?(?!\?)|^\s*\w+\s*:(?!:)"
)
"""Words that decide which calls are made, and marks of a choice and of a label."""
_BRACES = lazy_pattern(r"[\s{};]*")
_TYPE_WORDS = lazy_pattern(
    r"\b(?:const|static|unsigned|signed|short|long|int|double|float|char|bool|void|auto|volatile)\b"
)
_CODE = lazy_pattern(r"GTN?_|[;={}#\[\]\\\"]|[A-Za-z_]\w*\s*\(|\+\+|--")
"""Characters that most code has, but no comment of the manual."""
_HEADER = lazy_pattern(r"\s*#\s*include\s*(?:<[^<>]*>|\"[^\"]*\.h(?:h|pp|xx)?\")", re.IGNORECASE)
"""An #include of a header, which has no calls."""
_STARTS_ALONE = lazy_pattern(r"\s*[^\W_]")
"""How a text begins that can't go on with a statement before it."""
_RECORDED = b"// recorded by gusjob record"
_LAST_BYTES = 1000
"""Of a recorded listing, with its last comments."""
_PROBED_BYTES = 1 << 16
_MAX_JOINED_LINES, _MAX_BROKEN_LINES = 200, 20
"""Lines that one statement may take, with and without open brackets."""
_MAX_DEPTH, _MAX_MACRO_DEPTH = 100, 20
"""Levels of an expression, and of a macro."""
_MAX_KEPT = 500
"""Parsed lines that are kept, and how long they may be."""
_GOES_ON = lazy_pattern(r"\s*[-+&(!~]")
"""How a text begins that may go on with a statement before it."""
_LOOK_BACK = 50
"""Blank lines that may be between the lines of a comment."""
_PROGRAM_ERRORS, _TEXT_ERRORS = 25, 100
"""Lines that can't be read, above which a text with braces, or any text, is no listing."""


def read_listing(source: Source, abi: Abi | None = None) -> tuple[Stream, list[Diagnostic]]:
    """Read all calls of a listing; after a diagnostic the rest is still read.

    Args:
        source: The text.
        abi: The library's ABI. None: what fits only a library for several cards is read as its calls.
    """
    if source.data.startswith(_RECORDED):
        recorded = _read(source, None, several_cards=False)  # The recorder leaves the card's number out.
        if not _is_whole(source.data):
            recorded.diagnostics.add_for_file(rules.RECORDING_CUT)
        return recorded.result()
    if abi is not None:
        return _read(source, abi, several_cards=abi is Abi.GTS_MULTI).result()
    single = _read(source, None, several_cards=False)
    if single.calls.misfits:
        several = _read(source, None, several_cards=True)
        if not several.calls.misfits and several.calls.card_calls:
            several.calls.note_cards()
            return several.result()
    elif not has_errors(single.diagnostics.found) and _fits_several_cards(source):
        single.diagnostics.add_for_file(rules.EITHER_ABI)
    return single.result()


def _is_whole(data: bytes) -> bool:
    """Whether a recorded listing has an end, and was not cut before."""
    last = data[-_LAST_BYTES:]
    return b"\n// ended " in last and b"\n// stopped" not in last


def _fits_several_cards(source: Source) -> bool:
    """Whether a text's calls fit a library for several cards, too."""
    data = source.data
    if len(data) > _PROBED_BYTES:  # Nearly always one of the first calls tells.
        start = Source(name=source.name, data=data[: data.rfind(b"\n", 0, _PROBED_BYTES) + 1])
        if _read(start, None, several_cards=True).calls.misfits:
            return False
    several = _read(source, None, several_cards=True)
    return not several.calls.misfits and several.calls.card_calls > 0


def _read(source: Source, abi: Abi | None, *, several_cards: bool) -> _ListingReader:
    text = Source(name=source.name, data=source.data)
    diagnostics = ListingDiagnostics(name=source.name)
    is_c = source.name.endswith(".c")
    is_c_sharp = source.name.lower().endswith(".cs")
    evaluator = CEvaluator(report=diagnostics.add_at, has_references=not is_c, shares_arrays=is_c_sharp)
    calls = CallReader(
        text=text,
        abi=abi,
        several_cards=several_cards,
        has_defaults=not is_c,
        diagnostics=diagnostics,
        evaluator=evaluator,
    )
    evaluator.call_library = calls.call
    reader = _ListingReader(
        source=source,
        text=text,
        diagnostics=diagnostics,
        evaluator=evaluator,
        statements=CStatements(evaluator=evaluator),
        calls=calls,
    )
    reader.read()
    evaluator.call_library = no_library  # Else they refer to each other, and the text stays in memory.
    return reader


class _ListingReader(Struct):
    """Reads the lines of a text.

    Attributes:
        text: The source as it is parsed.
        rows: Rows of all calls, in parts.
        comment_lines: Lines without `//` that continue a comment.
        pending_from: First line of a statement that has not ended yet, 0 for none.
        joined: First and last line that belong to the statement of a later line: templates must not read them.
        open_braces: Braces that a refused statement has left open.
        awaits_block: The block of the control flow that was refused may be in the next lines.
        left: The first statement that ends the program.
        unterminated: The last statement has no semicolon.
    """

    source: Source
    text: Source
    diagnostics: ListingDiagnostics
    evaluator: CEvaluator
    statements: CStatements
    calls: CallReader
    rows: list[Rows] = field(default_factory=list)
    comment_lines: set[int] = field(default_factory=set)
    pending_from: int = 0
    joined: list[tuple[int, int]] = field(default_factory=list)
    open_braces: int = 0
    awaits_block: bool = False
    has_conditional_text: bool = False
    first_check: int = 0
    left: Span | None = None
    goes_on_after_leaving: bool = False
    named_by_templates: set[str] = field(default_factory=set)
    unterminated: bool = False
    not_listed: int = 0
    parsed: dict[str, Tree[Token]] = field(default_factory=dict)

    def read(self) -> None:
        """Read the whole text."""
        clean = clean_text(self.source.data)
        self.text.data = clean.data
        joined = [(self.source.joined_line, JOINS_LINES)] if self.source.joined_line else []
        for line, found in (*clean.problems, *joined):
            self.diagnostics.add(rules.CALL_SYNTAX, line, 1, 2, found=found)
        parts = scan_parts(clean.data, semicolon_comments=False, learn=self.learn, parse_line=self.parse_line)
        further = self.finish()
        parts = [*map(self.without_joined, parts), *further]
        left = self.left
        if left is not None and (self.goes_on_after_leaving or any((rows.line > left.line).any() for rows in parts)):
            self.diagnostics.add(
                rules.CONTROL_FLOW,
                left.line,
                left.column,
                left.end_column,
                what=Phrase("code follows 'return'"),
            )
        self.rows = self.calls.checked(parts)

    def result(self) -> tuple[Stream, list[Diagnostic]]:
        """Return the calls and the diagnostics."""
        hidden = report_hidden(self.source.data, self.source.name)
        found = self.diagnostics.found
        if self.statements.checks:
            self.diagnostics.add(rules.ERROR_CHECKS, self.first_check, 1, 2, count=self.statements.checks)
        if self.calls.refused_when_recorded:
            self.diagnostics.add_for_file(rules.RECORDED_REFUSALS, count=self.calls.refused_when_recorded)
        unread = sum(f.rule in (rules.CALL_SYNTAX, rules.CONTROL_FLOW) for f in found)
        if unread and (kind := self.whole_program(unread)) is not None:
            name, line = kind
            found.clear()
            self.diagnostics.add(rules.WHOLE_PROGRAM, line, 1, 2, kind=name)
            return stream_of(self.source.name, [], []), found
        stream = stream_of(self.source.name, self.rows, self.calls.calls, self.calls.converter.found)
        return stream, without_consequences([*found, *hidden])

    def whole_program(self, unread: int) -> tuple[str, int] | None:
        """Find out whether the text is a whole program: its kind, and the line that shows it."""
        found = program_kind(self.text.data)
        if found is None and unread > _PROGRAM_ERRORS and b"{" in self.text.data:
            return "C", 1
        if found is None and unread > _TEXT_ERRORS:
            return Phrase("or some other text"), 1
        return found

    def learn(self, line: str) -> Template | None:
        """Make the template of a line with one call whose arguments are all plain numbers."""
        builder = TemplateBuilder.of_line(line)
        if builder is None or "<|" in line:
            return None
        try:
            items = subtrees(parser(LISTING_GRAMMAR).parse(line))
        except UnexpectedInput:
            return None
        logged = logged_call(items[0]) if len(items) == 1 else None
        if logged is None or (logged.set_name is not None and logged.set_name in self.evaluator.macros):
            return None
        # A number in the name would be one of the numbers of the line's shape.
        if logged.set_name is not None and re.search("[0-9]", logged.set_name):
            return None
        template = self.calls.template(builder, logged)
        if template is not None and logged.set_name is not None:
            self.named_by_templates.add(logged.set_name)
            self.evaluator.variables.codes[logged.set_name] = self.first_code_line(logged.set_name)
        return template

    def first_code_line(self, name: str) -> int:
        """Return the first line that sets a name to the code of a call."""
        pattern = rb"^(?:[^/\n]*;)?\s*" + name.encode() + rb"\s*=\s*GTN?_"
        match = re.search(pattern, self.text.data, re.MULTILINE)
        return self.text.count_lines() if match is None else self.text.data.count(b"\n", 0, match.end()) + 1

    def parse_line(self, number: int, text: str) -> Sequence[Row]:
        """Parse one line, joined to the lines before it where a statement goes on."""
        if len(self.diagnostics.found) >= MAX_DIAGNOSTICS:
            self.not_listed += 1
            return ()
        if len(text) > MAX_LINE:
            self.diagnostics.add(rules.LINE_TOO_LONG, number, 1, 2, size=len(text), limit=MAX_LINE)
            return ()
        self.diagnostics.first_line = self.pending_from or number
        self.calls.rows = []
        code = text.split("//")[0]
        if code.lstrip().startswith("#") and not self.pending_from:
            self.directive(code, number)
            return ()
        if self.pending_from:
            code = self.code_between(self.pending_from, number)
        if not self.is_complete(code, number):
            self.pending_from = self.diagnostics.first_line
            return ()
        self.parse(code, number)
        return self.calls.rows

    def code_between(self, first: int, last: int) -> str:
        """Return the code of some lines, without their comments."""
        return "\n".join(line.split("//")[0] for line in self.text.lines(first, last))

    def is_complete(self, code: str, number: int) -> bool:
        """Whether all brackets of a statement are closed, or it is too long to go on."""
        depth = sum(map(code.count, "([{")) - sum(map(code.count, ")]}"))
        return depth <= 0 or number - self.diagnostics.first_line >= _MAX_JOINED_LINES

    def parse(self, code: str, number: int) -> None:
        """Parse and run the code of the lines from `first_line` to `number`."""
        self.evaluator.variables.line = self.diagnostics.first_line
        try:
            tree = self.parsed_code(code)
        except UnexpectedInput as error:
            self.not_code(error, code, number)
            return
        items = subtrees(tree)
        too_deep = depth_of(tree) > _MAX_DEPTH
        if too_deep or (self.unterminated and _GOES_ON.match(code)):
            found = Phrase("a line that may continue the statement before it; is a semicolon missing?")
            if too_deep:
                found = Phrase("an expression with more than {limit} levels", limit=_MAX_DEPTH)
            self.end_statement(number)
            self.diagnostics.add(rules.CALL_SYNTAX, self.diagnostics.first_line, 1, 2, found=found)
            return
        unterminated = not code.rstrip().endswith((";", "}"))
        if (
            items
            and unterminated
            and only_begins(items[-1])
            and number - self.diagnostics.first_line < _MAX_BROKEN_LINES
        ):
            self.pending_from = self.diagnostics.first_line
            return
        self.end_statement(number)
        if self.awaits_block and code.lstrip().startswith("{"):
            self.diagnostics.refused_line, self.awaits_block = number, False
            return
        self.awaits_block = self.awaits_block and not code.strip()
        refused = self.diagnostics.refused_line
        for item, following in zip(items, [*items[1:], None], strict=True):
            if following is not None and self.lacks_semicolon(item, following):
                break
            self.item(item)
        if self.diagnostics.refused_line != refused:
            self.diagnostics.refused_line = number
        if code.strip():
            self.unterminated = unterminated

    def parsed_code(self, code: str) -> Tree[Token]:
        """Parse some code; a program has many lines that are the same. The trees are not changed."""
        tree = self.parsed.get(code)
        if tree is None:
            tree = parser(LISTING_GRAMMAR).parse(code)
            if len(code) < _MAX_KEPT and len(self.parsed) < _MAX_KEPT:
                self.parsed[code] = tree
        return tree

    def lacks_semicolon(self, item: Tree[Token], following: Tree[Token]) -> bool:
        """Whether a statement does not end before another one in its line; it is reported."""
        token = first_token(following)
        if token is None or item.data not in ("statement", "stamped") or subtrees(item)[-1].data == "end":
            return False
        *_, last = item.scan_values(lambda t: isinstance(t, Token))
        if last.line != token.line:
            return False
        self.diagnostics.add_at(rules.CALL_SYNTAX, token, found=f"'{token}'")
        return True

    def end_statement(self, number: int) -> None:
        """Note that the lines up to this one are read; the first of them was pending."""
        if self.pending_from and self.pending_from < number:
            self.joined.append((self.pending_from, number - 1))
        self.pending_from = 0

    def not_code(self, error: UnexpectedInput, code: str, number: int) -> None:
        """Handle a line that can't be parsed: part of a comment, of a statement, or an error."""
        ends_early = isinstance(error, UnexpectedToken) and error.token.type == "$END"
        if ends_early and number - self.diagnostics.first_line < _MAX_BROKEN_LINES:
            self.pending_from = self.diagnostics.first_line
            return
        starts = self.diagnostics.first_line
        self.end_statement(number)
        if starts == number and self.continues_comment(number, code):
            self.comment_lines.add(number)
            return
        if self.open_braces > 0 and _BRACES.fullmatch(code):
            self.open_braces = max(0, self.open_braces + code.count("{") - code.count("}"))
            return
        if self.awaits_block and code.lstrip().startswith("{"):
            self.diagnostics.refused_line, self.awaits_block = number, False
            return
        self.open_braces += max(0, code.count("{") - code.count("}"))
        control = _CONTROL.search(code)
        if control is None and code.strip().startswith("{"):
            control = re.search("{", code)
        if control is not None:
            self.report_control_flow(control, code, number)
            return
        found = misread(error, LISTING_GRAMMAR, code, _TERMINALS)
        line, column = _place(error, code, found.column)
        text = quoted(found.word.replace(OCTAL_MARK, "0")[:40]) if OCTAL_MARK in found.word else found.found
        width = max(found.end_column - found.column, 1)
        self.diagnostics.add(rules.CALL_SYNTAX, starts + line, column, column + width, found=text)

    def report_control_flow(self, control: re.Match[str], code: str, number: int) -> None:
        """Report control flow, once for an if with its else."""
        word = control[0].strip()
        self.awaits_block = "{" not in code
        if (
            word == "else"
            and self.diagnostics.refused_line
            and self.is_next_code(self.diagnostics.refused_line, self.diagnostics.first_line)
        ):
            self.diagnostics.refused_line = number
            return
        start = control.start() + len(control[0]) - len(control[0].lstrip())
        line = code.count("\n", 0, start)
        column = start - code.rfind("\n", 0, start)
        self.diagnostics.add(
            rules.CONTROL_FLOW, self.diagnostics.first_line + line, column, column + len(word), what=control_flow(word)
        )
        self.diagnostics.refused_line = number

    def is_next_code(self, line: int, later: int) -> bool:
        """Whether nothing but braces and blanks is between two lines."""
        return later - line < _LOOK_BACK and all(
            _BRACES.fullmatch(between.split("//")[0]) for between in self.text.lines(line + 1, later - 1)
        )

    def continues_comment(self, number: int, code: str) -> bool:
        """Whether a line that can't be code continues the comment above, as in the manual's examples (四.3)."""
        original = self.source.line(number)
        if _CODE.search(original) or _CONTROL.search(original) or _TYPE_WORDS.search(original):
            return False
        words = original.split()
        if len(words) == 1 and words[0].isascii():  # It may be a macro.
            return False
        if self.unterminated and not _STARTS_ALONE.match(original):
            return False
        for above in range(number - 1, max(number - _LOOK_BACK, 0), -1):
            text = self.text.line(above)
            if text.strip():
                return "//" in text or above in self.comment_lines
        return False

    def directive(self, code: str, number: int) -> None:
        """Read a line of the preprocessor."""
        match = re.match(r"\s*#\s*(\w*)\s*", code)
        word, rest = (match[1], code[match.end() :]) if match else ("", "")
        if "\\" in code:
            self.diagnostics.add(
                rules.CALL_SYNTAX, number, 1, len(code) + 1, found=Phrase("a line that a backslash continues")
            )
        elif word == "define":
            self.define(rest.rstrip(), number, code)
        elif word == "undef" and re.fullmatch(r"\w+", rest.strip()):
            self.evaluator.macros.pop(rest.strip(), None)
        elif word == "undef" or (word == "pragma" and "macro" in rest):
            found = Phrase("an #undef or a #pragma that changes macros")
            self.diagnostics.add(rules.CALL_SYNTAX, number, 1, len(code) + 1, found=found)
        elif word in ("else", "elif", "endif") and self.has_conditional_text:
            pass
        elif word == "include" and not _HEADER.match(self.source.line(number)):
            self.diagnostics.add(
                rules.CALL_SYNTAX,
                number,
                1,
                len(code) + 1,
                found=Phrase("an included file that may contain calls; insert its calls here"),
            )
        elif word not in ("include", "pragma", "region", "endregion", ""):
            self.has_conditional_text = True
            column = code.index("#") + 1
            self.diagnostics.add(
                rules.CONTROL_FLOW, number, column, column + len(word) + 1, what=control_flow(f"#{word}")
            )

    def define(self, rest: str, number: int, code: str) -> None:
        """Define a macro without arguments; others are not read."""
        match = re.fullmatch(r"([A-Za-z_]\w*)(?:\s+(.*))?", rest)
        name = match[1] if match else ""
        if match is None or name in self.named_by_templates or not _is_free_name(name):
            column = len(code) - len(code.lstrip()) + 1
            if (called := re.match(r"[A-Za-z_]\w*", rest)) is not None:
                self.evaluator.reported_functions.add(called[0])
            found = (
                Phrase("a macro with arguments") if match is None else Phrase("a macro named like a C word or a call")
            )
            self.diagnostics.add(rules.CALL_SYNTAX, number, column, len(code.rstrip()) + 1, found=found)
            return
        macro = _macro((match[2] or "").strip())
        if macro.tree is not None and has_effect(macro.tree):
            found = Phrase("a macro that makes calls")
            self.diagnostics.add(rules.CALL_SYNTAX, number, 1, len(code.rstrip()) + 1, found=found)
        self.evaluator.macros[name] = macro

    def finish(self) -> list[Rows]:
        """End the text: its last statement, and lines that were not parsed. Returns further rows."""
        further: list[Rows] = []
        if self.pending_from:
            last = self.text.count_lines()
            code = self.code_between(self.pending_from, min(last, self.pending_from + _MAX_JOINED_LINES))
            is_too_long = last - self.pending_from > _MAX_JOINED_LINES
            self.diagnostics.first_line, self.calls.rows = self.pending_from, []
            started = self.pending_from
            if not is_too_long:
                self.parse(code, last + 1)
            if self.pending_from:
                control = _CONTROL.search(code)
                if control is not None:
                    self.report_control_flow(control, code, last)
                else:
                    found = Phrase("the end of the file inside a statement")
                    self.diagnostics.add(rules.CALL_SYNTAX, started, 1, 2, found=found)
            further = [rows_of([(last, row) for row in self.calls.rows])] if self.calls.rows else []
        if self.not_listed:
            fields = {"count": self.not_listed, "code": Phrase("the lines"), "shown": len(self.diagnostics.found)}
            self.diagnostics.found.append(
                Diagnostic(rule=rules.NOT_LISTED, span=d.NOWHERE, fields=fields, path=self.source.name)
            )
        return further

    def without_joined(self, rows: Rows) -> Rows:
        """Remove the rows of lines that belong to a statement of several lines."""
        if not self.joined:
            return rows
        first, last = np.array(self.joined, dtype=np.int32).T
        at = np.searchsorted(first, rows.line, side="right") - 1
        return rows.pick((at < 0) | (rows.line > last[at]))

    def item(self, item: Tree[Token]) -> None:
        """Run one item of a line."""
        if self.left is not None:
            self.goes_on_after_leaving = True
        if item.data == "leave":
            token = tokens(item)[0]
            line, column = self.diagnostics.line_of(token), token.column or 1
            self.left = self.left or Span(line=line, column=column, end_column=column + len(token))
            for returned in subtrees(item):
                self.evaluator.expression(returned)
            return
        self.calls.code, self.calls.time_ms = 0.0, math.nan
        checks = self.statements.checks
        inner = subtrees(item)[0] if item.data in ("statement", "stamped") else None
        if item.data == "stamped":
            stamp = literal(str(tokens(item)[0]))
            self.calls.time_ms = stamp.value if stamp is not None else math.nan
            item = Tree("statement", [*subtrees(item)])
        if inner is not None and inner.data == "assign" and subtrees(inner)[0].data == "call":
            code = self.evaluator.expression(subtrees(inner)[1])
            if not isinstance(code, CNumber) or tokens(inner)[0] != "=" or code.is_code or code.value % 1:
                self.diagnostics.add_at(rules.CALL_SYNTAX, tokens(inner)[0], found="'='")
                return
            self.calls.code = code.value
            item = Tree("statement", [subtrees(inner)[0]])
        self.statements.run(item)
        if self.statements.checks > checks and not self.first_check:
            self.first_check = self.diagnostics.first_line


def _macro(text: str) -> CMacro:
    """Make a macro of its text."""
    tree = None
    with suppress(UnexpectedInput):
        items = subtrees(parser(LISTING_GRAMMAR).parse(text))
        if len(items) == 1 and items[0].data == "statement" and ";" not in text:
            tree = subtrees(items[0])[0]
    if tree is not None and depth_of(tree) > _MAX_MACRO_DEPTH:
        tree = None
    kinds = ("name", "number", "octal", "text", "unary", "cast")
    return CMacro(text=text, tree=tree, is_operand=tree is not None and (tree.data in kinds or _is_enclosed(text)))


def _is_free_name(name: str) -> bool:
    """Whether a name has no meaning of its own: no word of C, and no call."""
    if is_library_name(name):
        return False
    try:
        items = subtrees(parser(LISTING_GRAMMAR).parse(name))
    except UnexpectedInput:
        return False
    return len(items) == 1 and items[0].data == "statement" and subtrees(items[0])[0].data == "name"


def _is_enclosed(text: str) -> bool:
    """Whether one pair of parentheses encloses a whole text."""
    depth = 0
    for i, c in enumerate(text):
        depth += (c == "(") - (c == ")")
        if depth == 0:
            return c == ")" and i == len(text) - 1
    return False


def _place(error: UnexpectedInput, code: str, column: int) -> tuple[int, int]:
    """Return where lark stopped: lines after the first, and the column."""
    if isinstance(error, UnexpectedToken) and error.token.type == "$END":
        return code.count("\n"), len(code.rsplit("\n", 1)[-1].rstrip()) + 1
    line = getattr(error, "line", 1)
    return (line - 1 if line and line > 0 else 0), column
