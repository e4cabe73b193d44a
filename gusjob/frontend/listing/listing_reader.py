"""A listing's text to its calls: each line shape is parsed once, and the numbers of all its lines are read together.

What is not a plain call goes to the parser and the evaluator, line by line. They accept straight-line code only: what
could change which calls are made, or with which values, and is not evaluated, is an error.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from difflib import get_close_matches

import numpy as np
from lark import Token, Tree, UnexpectedInput, UnexpectedToken

from gusjob.config.machine import Abi
from gusjob.controllers.gus import ranges
from gusjob.controllers.gus.calls import BUFFERED, SIGNATURES, Arg, ArgKind, Buffered, Signature, Stream, Value
from gusjob.controllers.gus.functions import GSN_PREFIX, functions
from gusjob.controllers.gus.ranges import Membership, Range
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule, Span, has_errors
from gusjob.frontend.listing.c_evaluator import CEvaluator, CMacro, first_token, is_library_name
from gusjob.frontend.listing.c_numbers import CNumber
from gusjob.frontend.listing.c_variables import (
    CArray,
    CStruct,
    CValue,
    UnknownValue,
    plain,
    sets_it,
    unknown,
    why_unknown,
)
from gusjob.frontend.listing.call_rows import (
    CALL_OP,
    COLUMNS,
    LEADING_COLUMN,
    NAME_COLUMN,
    PASSED_OVER_OP,
    SHORT_COLUMNS,
    UNUSED_COLUMN,
    ImmediateCall,
    buffered_row,
    call_row,
    not_short,
    stream_of,
)
from gusjob.frontend.listing.clean_text import OCTAL_MARK, clean_text, program_kind
from gusjob.frontend.listing.library_calls import AT_REST, LibraryCall, Reading, library_call
from gusjob.frontend.parse.grammar import LISTING_GRAMMAR, parser, subtrees, tokens
from gusjob.frontend.parse.misread import misread
from gusjob.frontend.scan.rows import Row, Rows, Template, TemplateBuilder, join_rows, rows_of
from gusjob.frontend.scan.scanner import MAX_DIAGNOSTICS, scan
from gusjob.frontend.scan.shapes import MAX_LINE
from gusjob.frontend.source import Source
from gusjob.i18n.phrases import Phrase, did_you_mean

EXPECTED_ARGUMENT = {
    ArgKind.WHOLE: Phrase("a whole number"),
    ArgKind.REAL: Phrase("a number"),
    ArgKind.ARRAY: Phrase("an array of four numbers"),
    ArgKind.POINTER: Phrase("a variable"),
    ArgKind.STRUCT: Phrase("a TCrdPrm"),
}
"""What an argument takes, by its kind."""
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
_CONTROL = re.compile(
    r"(?<![\w.])(?:if|else|while|for|do|switch|case|default|break|continue|goto|return|exit|try|catch|throw|finally|"
    r"foreach|lock|yield|await|asm|and|or|not)(?!\w)|\?(?!\?)|^\s*\w+\s*:(?!:)"
)
"""Words that decide which calls are made, and marks of a choice and of a label."""
_BRACES = re.compile(r"[\s{};]*")
_TYPE_WORDS = re.compile(
    r"\b(?:const|static|unsigned|signed|short|long|int|double|float|char|bool|void|auto|volatile)\b"
)
_CODE = re.compile(r"GTN?_|[;={}#\[\]\\\"]|[A-Za-z_]\w*\s*\(|\+\+|--")
"""Characters that most code has, but no comment of the manual."""
_HEADER = re.compile(r"\s*#\s*include\s*(?:<[^<>]*>|\"[^\"]*\.h(?:h|pp|xx)?\")", re.IGNORECASE)
"""An #include of a header, which has no calls."""
_STARTS_ALONE = re.compile(r"\s*[^\W_]")
"""How a text begins that can't go on with a statement before it."""
_LEADING_RANGE = (0.0, 15.0)
_SMALL_RANGE = 8.0
"""Whole arguments up to here tell a call with a leading card number from one without."""
_TELLING = (
    ("crd", ranges.CRD),
    ("fifo", ranges.FIFO),
    ("channel", ranges.CHANNEL),
    ("vel", ranges.VELOCITY),
    ("acc", ranges.ACCELERATION),
)
"""Arguments of buffered calls whose values tell the same."""
_PROBED_BYTES = 1 << 16
_MAX_JOINED_LINES = 200
"""Lines that one statement may take."""
_LOOK_BACK = 50
"""Blank lines that may be between the lines of a comment."""
_PROGRAM_ERRORS = 25
"""Lines that can't be read, above which a text with control flow is a whole program."""


def read_listing(source: Source, abi: Abi | None = None) -> tuple[Stream, list[Diagnostic]]:
    """Read all calls of a listing; after a diagnostic the rest is still read.

    Args:
        source: The text.
        abi: The library's ABI. None: what fits only a library for several cards is read as its calls.
    """
    if abi is not None:
        return _read(source, abi, several_cards=abi is Abi.GTS_MULTI).result()
    single = _read(source, None, several_cards=False)
    if single.misfits:
        several = _read(source, None, several_cards=True)
        if not several.misfits and several.card_calls:
            several.note_cards()
            return several.result()
    elif not has_errors(single.diagnostics) and _fits_several_cards(source):
        single.report(rules.EITHER_ABI, 1, 1, 2)
    return single.result()


def _fits_several_cards(source: Source) -> bool:
    """Whether a text's calls fit a library for several cards, too."""
    data = source.data
    if len(data) > _PROBED_BYTES:  # Nearly always one of the first calls tells.
        start = Source(name=source.name, data=data[: data.rfind(b"\n", 0, _PROBED_BYTES) + 1])
        if _read(start, None, several_cards=True).misfits:
            return False
    several = _read(source, None, several_cards=True)
    return not several.misfits and several.card_calls > 0


def _read(source: Source, abi: Abi | None, *, several_cards: bool) -> _ListingReader:
    reader = _ListingReader(source=source, abi=abi, several_cards=several_cards)
    reader.read()
    return reader


@dataclass(slots=True)
class _ListingReader:
    source: Source
    abi: Abi | None
    several_cards: bool
    text: Source = field(init=False)
    """The source as it is parsed."""
    evaluator: CEvaluator = field(init=False)
    rows: Rows = field(init=False)
    diagnostics: list[Diagnostic] = field(default_factory=list)
    calls: list[ImmediateCall] = field(default_factory=list)
    misfits: int = 0
    """Calls with too few or too many arguments, or with numbers that are none of their arguments."""
    card_calls: int = 0
    """Lines, or shapes of lines, with a card number."""
    leading: set[float] = field(default_factory=set)
    """Leading arguments (cards, cores) of the calls."""
    passed_over: list[str] = field(default_factory=list)
    """Names of calls that are passed over, in the order in which templates number them."""
    refused_when_recorded: int = 0
    first_line: int = 0
    """Line of the text that is parsed now."""
    row_buffer: list[Row] = field(default_factory=list)
    """Rows of the line that is parsed now."""
    code: float = 0.0
    time_ms: float = math.nan
    """What a log says of the call that is read now."""
    comment_lines: set[int] = field(default_factory=set)
    """Lines without `//` that continue a comment."""
    pending_from: int = 0
    """First line of a statement that has not ended yet, 0 for none."""
    joined: list[tuple[int, int]] = field(default_factory=list)
    """First and last line that belong to the statement of a later line: templates must not read them."""
    open_braces: int = 0
    """Braces that a refused statement has left open."""
    awaits_block: bool = False
    """The block of the control flow that was refused may be in the next lines."""
    refused_line: int = 0
    """Last line of the last statement that was refused as control flow."""
    has_conditional_text: bool = False
    first_check: int = 0
    left: Span | None = None
    """The first statement that ends the program."""
    goes_on_after_leaving: bool = False
    named_by_templates: set[str] = field(default_factory=set)
    unterminated: bool = False
    """The last statement has no semicolon."""
    not_listed: int = 0

    def __post_init__(self) -> None:
        self.evaluator = CEvaluator(
            report=self.report_at, call_library=self.call, has_references=not self.source.name.lower().endswith(".c")
        )

    def read(self) -> None:
        """Read the whole text."""
        clean = clean_text(self.source.data)
        self.text = Source(name=self.source.name, data=clean.data)
        if clean.unfinished_comment >= 0:
            line = clean.data.decode("utf-8")[: clean.unfinished_comment].count("\n") + 1
            self.report(rules.CALL_SYNTAX, line, 1, 2, found=Phrase("a comment that never ends"))
        if clean.carriage_return >= 0:
            line = clean.data.count(b"\n", 0, clean.carriage_return) + 1
            found = Phrase("a carriage return inside a line, which some compilers take for a line end")
            self.report(rules.CALL_SYNTAX, line, 1, 2, found=found)
        for line in clean.continued_lines:
            found = Phrase("a comment that joins this line with the next one")
            self.report(rules.CALL_SYNTAX, line, 1, 2, found=found)
        rows = scan(clean.data, semicolon_comments=False, learn=self.learn, parse_line=self.parse_line)
        further = self.finish()
        rows = join_rows([self.without_joined(rows), *further])
        if self.left is not None and (self.goes_on_after_leaving or (rows.line > self.left.line).any()):
            start = self.left.column
            self.report(rules.CONTROL_FLOW, self.left.line, start, start + self.left.end_column, word="return")
        self.note_passed_over(rows)
        rows = rows.pick(rows.op != PASSED_OVER_OP)
        self.check_leading(rows)
        self.rows = self.without_odd_numbers(rows)

    def result(self) -> tuple[Stream, list[Diagnostic]]:
        """Return the calls and the diagnostics."""
        stream = stream_of(self.source.name, self.rows, self.calls)
        if self.evaluator.checks:
            self.report(rules.ERROR_CHECKS, self.first_check, 1, 2, count=self.evaluator.checks)
        if self.refused_when_recorded:
            self.report(rules.RECORDED_REFUSALS, 1, 1, 2, count=self.refused_when_recorded)
        unread = [f for f in self.diagnostics if f.rule in (rules.CALL_SYNTAX, rules.CONTROL_FLOW)]
        if unread and (kind := self.whole_program(len(unread))) is not None:
            name, line = kind
            self.diagnostics = []
            self.report(rules.WHOLE_PROGRAM, line, 1, 2, kind=name)
            empty = self.rows.pick(slice(0, 0))
            return stream_of(self.source.name, empty, []), self.diagnostics
        return stream, self.diagnostics

    def whole_program(self, unread: int) -> tuple[str, int] | None:
        """Find out whether the text is a whole program: its kind, and the line that shows it."""
        found = program_kind(self.text.data)
        if found is None and unread > _PROGRAM_ERRORS and b"{" in self.text.data:
            return "C", 1
        return found

    # Reports.

    def report(self, rule: Rule, line: int, column: int, end_column: int, **fields: object) -> None:
        """Add a diagnostic."""
        span = Span(line=line, column=column, end_line=line, end_column=end_column)
        self.diagnostics.append(Diagnostic(rule=rule, span=span, fields=fields, path=self.source.name))

    def report_at(self, rule: Rule, token: Token, **fields: object) -> None:
        """Add a diagnostic at a token."""
        start = token.column or 1
        self.report(rule, self.line_of(token), start, start + len(token), **fields)
        if rule is rules.CONTROL_FLOW:
            self.refused_line = self.line_of(token)

    def line_of(self, token: Token) -> int:
        """Return the line of a token in the file."""
        return self.first_line + (token.line or 1) - 1

    # Lines.

    def learn(self, line: str) -> Template | None:
        """Make the template of a line with one call whose arguments are all plain numbers."""
        builder = TemplateBuilder.of_line(line)
        if builder is None:
            return None
        try:
            items = subtrees(parser(LISTING_GRAMMAR).parse(line))
        except UnexpectedInput:
            return None
        logged = _logged_call(items[0]) if len(items) == 1 else None
        if logged is None or (logged.set_name is not None and logged.set_name in self.evaluator.macros):
            return None
        found = library_call(str(logged.name), self.abi, several_cards=self.several_cards)
        numbers = [_number_token(arg) for arg in logged.args]
        if None in numbers or not found.fits(len(numbers)) or str(logged.name) in self.evaluator.macros:
            return None
        template = self.template(builder, found, [token for token in numbers if token is not None], logged)
        if template is not None and logged.set_name is not None:
            self.named_by_templates.add(logged.set_name)
            self.evaluator.variables.codes[logged.set_name] = self.first_code_line(logged.set_name)
        return template

    def first_code_line(self, name: str) -> int:
        """Return the first line that sets a name to the code of a call."""
        pattern = rb"^[^/\n]*(?<![\w.])" + name.encode() + rb"\s*=\s*GTN?_"
        match = re.search(pattern, self.text.data, re.MULTILINE)
        return self.text.count_lines() if match is None else self.text.data.count(b"\n", 0, match.end()) + 1

    def template(
        self, builder: TemplateBuilder, found: LibraryCall, numbers: list[Token], logged: _LoggedCall
    ) -> Template | None:
        """Make the template of a call by its numbers; None if it must be parsed."""
        signature = found.signature
        if found.reading is Reading.PASSED_OVER or (signature is not None and signature.name == "GT_CrdStatus"):
            columns, op = [UNUSED_COLUMN] * len(numbers), PASSED_OVER_OP
            constants = [(NAME_COLUMN, float(self.number_of(found.name)))]
        elif signature is not None and signature.buffered is not None and found.trailing == 0:
            own = [COLUMNS.index(arg.column) for arg in signature.args]
            columns, op = [*[LEADING_COLUMN] * found.leading, *own][: len(numbers)], signature.buffered
            missing = own[len(numbers) - found.leading :]
            constants = [(column, 0.0) for column in missing]
        else:
            return None
        if logged.time is not None:
            numbers, columns = [logged.time, *numbers], [UNUSED_COLUMN, *columns]
        for column, token in zip(columns, numbers, strict=True):
            start = (token.column or 1) - 1
            if not builder.add(column, start, start + len(token)):
                return None
        self.card_calls += self.several_cards and not str(logged.name).startswith(GSN_PREFIX)
        template = builder.build(op, constants=tuple(constants))
        # The code of a log is the only number left: only a call with code 0 had an effect.
        return replace(template, fixed=tuple((run, 0.0) for run, _ in template.fixed))

    def number_of(self, name: str) -> int:
        """Return the number of a call that is passed over; a reading of the status needs no word."""
        if name not in self.passed_over:
            self.passed_over.append(name)
        return self.passed_over.index(name)

    def parse_line(self, number: int, text: str) -> Sequence[Row]:
        """Parse one line, joined to the lines before it where a statement goes on."""
        if len(self.diagnostics) >= MAX_DIAGNOSTICS:
            self.not_listed += 1
            return ()
        if len(text) > MAX_LINE:
            self.report(rules.LINE_TOO_LONG, number, 1, 2, size=len(text), limit=MAX_LINE)
            return ()
        self.first_line = self.pending_from or number
        self.row_buffer = []
        code = text.split("//")[0]
        if code.lstrip().startswith("#") and not self.pending_from:
            self.directive(code, number)
            return ()
        if self.pending_from:
            code = self.code_between(self.pending_from, number)
        if not self.is_complete(code, number):
            self.pending_from = self.first_line
            return ()
        self.parse(code, number)
        return self.row_buffer

    def code_between(self, first: int, last: int) -> str:
        """Return the code of some lines, without their comments."""
        return "\n".join(self.text.line(i).split("//")[0] for i in range(first, last + 1))

    def is_complete(self, code: str, number: int) -> bool:
        """Whether all brackets of a statement are closed, or it is too long to go on."""
        depth = sum(map(code.count, "([{")) - sum(map(code.count, ")]}"))
        return depth <= 0 or number - self.first_line >= _MAX_JOINED_LINES

    def parse(self, code: str, number: int) -> None:
        """Parse and run the code of the lines from `first_line` to `number`."""
        self.evaluator.variables.line = self.first_line
        try:
            tree = parser(LISTING_GRAMMAR).parse(code)
        except UnexpectedInput as error:
            self.not_code(error, code, number)
            return
        items = subtrees(tree)
        unterminated = not code.rstrip().endswith((";", "}"))
        if items and unterminated and _only_begins(items[-1]) and number - self.first_line < _MAX_JOINED_LINES:
            self.pending_from = self.first_line
            return
        self.end_statement(number)
        if self.awaits_block and code.lstrip().startswith("{"):
            self.refused_line, self.awaits_block = number, False
            return
        self.awaits_block = self.awaits_block and not code.strip()
        refused = self.refused_line
        for item, following in zip(items, [*items[1:], None], strict=True):
            if following is not None and self.lacks_semicolon(item, following):
                break
            self.item(item)
        if self.refused_line != refused:
            self.refused_line = number
        if code.strip():
            self.unterminated = unterminated

    def lacks_semicolon(self, item: Tree[Token], following: Tree[Token]) -> bool:
        """Whether a statement does not end before another one in its line; it is reported."""
        token = first_token(following)
        if token is None or item.data not in ("statement", "stamped") or subtrees(item)[-1].data == "end":
            return False
        *_, last = item.scan_values(lambda t: isinstance(t, Token))
        if last.line != token.line:
            return False
        self.report_at(rules.CALL_SYNTAX, token, found=f"'{token}'")
        return True

    def end_statement(self, number: int) -> None:
        """Note that the lines up to this one are read; the first of them was pending."""
        if self.pending_from and self.pending_from < number:
            self.joined.append((self.pending_from, number - 1))
        self.pending_from = 0

    def not_code(self, error: UnexpectedInput, code: str, number: int) -> None:
        """Handle a line that can't be parsed: part of a comment, of a statement, or an error."""
        ends_early = isinstance(error, UnexpectedToken) and error.token.type == "$END"
        if ends_early and number - self.first_line < _MAX_JOINED_LINES:
            self.pending_from = self.first_line
            return
        starts = self.first_line
        self.end_statement(number)
        if starts == number and self.continues_comment(number, code):
            self.comment_lines.add(number)
            return
        if self.open_braces > 0 and _BRACES.fullmatch(code):
            self.open_braces = max(0, self.open_braces + code.count("{") - code.count("}"))
            return
        if self.awaits_block and code.lstrip().startswith("{"):
            self.refused_line, self.awaits_block = number, False
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
        text = found.found.replace(OCTAL_MARK, "0")
        width = max(found.end_column - found.column, 1)
        self.report(rules.CALL_SYNTAX, starts + line, column, column + width, found=text)

    def report_control_flow(self, control: re.Match[str], code: str, number: int) -> None:
        """Report control flow, once for an if with its else."""
        word = control[0].strip()
        self.awaits_block = "{" not in code
        if word == "else" and self.refused_line and self.is_next_code(self.refused_line, self.first_line):
            self.refused_line = number
            return
        start = control.start() + len(control[0]) - len(control[0].lstrip())
        line = code.count("\n", 0, start)
        column = start - code.rfind("\n", 0, start)
        self.report(rules.CONTROL_FLOW, self.first_line + line, column, column + len(word), word=word)
        self.refused_line = number

    def is_next_code(self, line: int, later: int) -> bool:
        """Whether nothing but braces and blanks is between two lines."""
        return later - line < _LOOK_BACK and all(
            _BRACES.fullmatch(self.text.line(i).split("//")[0]) for i in range(line + 1, later)
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
            self.report(rules.CALL_SYNTAX, number, 1, len(code) + 1, found=Phrase("a line that a backslash continues"))
        elif word == "define":
            self.define(rest.rstrip(), number, code)
        elif word == "undef":
            self.evaluator.macros.pop(rest.strip(), None)
        elif word in ("else", "elif", "endif") and self.has_conditional_text:
            pass
        elif word == "include" and not _HEADER.match(self.source.line(number)):
            self.report(rules.CALL_SYNTAX, number, 1, len(code) + 1, found=Phrase("a file that may hold calls"))
        elif word not in ("include", "pragma", "region", "endregion", ""):
            self.has_conditional_text = True
            column = code.index("#") + 1
            self.report(rules.CONTROL_FLOW, number, column, column + len(word) + 1, word=f"#{word}")

    def define(self, rest: str, number: int, code: str) -> None:
        """Define a macro without arguments; others are not read."""
        match = re.fullmatch(r"([A-Za-z_]\w*)(?:\s+(.*))?", rest)
        name = match[1] if match else ""
        if match is None or name in self.named_by_templates or not _is_free_name(name):
            column = len(code) - len(code.lstrip()) + 1
            if (called := re.match(r"[A-Za-z_]\w*", rest)) is not None:
                self.evaluator.reported_functions.add(called[0])
            found = Phrase("a macro with arguments, or of a name that has a meaning")
            self.report(rules.CALL_SYNTAX, number, column, len(code.rstrip()) + 1, found=found)
            return
        self.evaluator.macros[name] = _macro((match[2] or "").strip())

    def finish(self) -> list[Rows]:
        """End the text: its last statement, and lines that were not parsed. Returns further rows."""
        further: list[Rows] = []
        if self.pending_from:
            last = self.text.count_lines()
            code = self.code_between(self.pending_from, min(last, self.pending_from + _MAX_JOINED_LINES))
            self.first_line, self.row_buffer = self.pending_from, []
            started = self.pending_from
            self.parse(code, last + 1)
            if self.pending_from:
                control = _CONTROL.search(code)
                if control is not None:
                    self.report_control_flow(control, code, last)
                else:
                    found = Phrase("the end of the file inside a statement")
                    self.report(rules.CALL_SYNTAX, started, 1, 2, found=found)
            further = [rows_of([(last, row) for row in self.row_buffer])] if self.row_buffer else []
        if self.not_listed:
            fields = {"count": self.not_listed, "code": Phrase("the lines"), "shown": len(self.diagnostics)}
            self.diagnostics.append(
                Diagnostic(rule=rules.NOT_LISTED, span=d.NOWHERE, fields=fields, path=self.source.name)
            )
        return further

    # Rows.

    def without_joined(self, rows: Rows) -> Rows:
        """Remove the rows of lines that belong to a statement of several lines."""
        for first, last in self.joined:
            rows = rows.pick((rows.line < first) | (rows.line > last))
        return rows

    def note_passed_over(self, rows: Rows) -> None:
        """Say once of each call that it is passed over."""
        where = np.flatnonzero(rows.op == PASSED_OVER_OP)
        if not len(where):
            return
        names, firsts = np.unique(rows.column(NAME_COLUMN)[where], return_index=True)
        for number, first in zip(names.tolist(), firsts.tolist(), strict=True):
            self.note_call(self.passed_over[int(number)], int(rows.line[where[first]]))

    def note_call(self, name: str, line: int) -> None:
        """Say that a call is passed over, at its first line."""
        if name == "GT_CrdStatus":
            return
        known = [f for f in self.diagnostics if f.rule is rules.CALL_IGNORED and f.fields["call"] == name]
        if known and known[0].span.line <= line:
            return
        self.diagnostics = [f for f in self.diagnostics if f not in known]
        column = max(self.text.line(line).find(name), 0) + 1
        self.report(rules.CALL_IGNORED, line, column, column + len(name), call=name)

    def check_leading(self, rows: Rows) -> None:
        """Find leading arguments of plain calls, and what fits no library; report calls for several cards."""
        buffered = rows.op < CALL_OP
        given = rows.column(LEADING_COLUMN)
        self.leading |= set(np.unique(given[buffered & ~np.isnan(given)])[:_MAX_JOINED_LINES].tolist())
        for name, allowed in _TELLING:
            values = rows.column(COLUMNS.index(name))[buffered]
            self.misfits += int(np.count_nonzero(allowed.classify(values[~np.isnan(values)]) == Membership.OUTSIDE))
        self.misfits += sum(not _LEADING_RANGE[0] <= card <= _LEADING_RANGE[1] for card in self.leading)
        if len(self.leading) > 1 and not self.misfits:
            cards = ", ".join(f"{card:g}" for card in sorted(self.leading)[:5])
            self.report(rules.SEVERAL_CARDS, 1, 1, 2, cards=cards)

    def note_cards(self) -> None:
        """Say that the calls are read as those of a library for several cards."""
        if len(self.leading) == 1:
            self.report(rules.LEADING_CARD, 1, 1, 2, card=f"{next(iter(self.leading)):g}")

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

    def item(self, item: Tree[Token]) -> None:
        """Run one item of a line."""
        if item.data == "leave":
            token = tokens(item)[0]
            self.left = self.left or Span(line=self.line_of(token), column=token.column or 1, end_column=len(token))
            for returned in subtrees(item):
                self.evaluator.expression(returned)
            return
        if self.left is not None:
            self.goes_on_after_leaving = True
        self.code, self.time_ms = 0.0, math.nan
        checks = self.evaluator.checks
        inner = subtrees(item)[0] if item.data in ("statement", "stamped") else None
        if item.data == "stamped":
            self.time_ms = float(tokens(item)[0])
            item = Tree("statement", [*subtrees(item)])
        if inner is not None and inner.data == "assign" and subtrees(inner)[0].data == "call":
            code = self.evaluator.expression(subtrees(inner)[1])
            if not isinstance(code, CNumber) or tokens(inner)[0] != "=" or code.is_code:
                self.report_at(rules.CALL_SYNTAX, tokens(inner)[0], found="'='")
                return
            self.code = code.value
            item = Tree("statement", [subtrees(inner)[0]])
        self.evaluator.run(item)
        if self.evaluator.checks > checks and not self.first_check:
            self.first_check = self.first_line

    def call(self, token: Token, text: str, args: Sequence[Tree[Token]]) -> None:
        """Read one call of the library."""
        found = library_call(text, self.abi, several_cards=self.several_cards)
        if found.reading is Reading.UNKNOWN:
            near = get_close_matches(text, [*SIGNATURES, *functions()], 1, cutoff=0.8)
            self.report_at(rules.CALL_UNKNOWN, token, call=text, hint=did_you_mean(near[0] if near else ""))
        elif found.name == AT_REST:
            self.at_rest(token, args)
        elif self.code != 0:
            self.refused_when_recorded += 1
        elif found.reading is Reading.CALL:
            self.simulated_call(token, found, args)
            return
        elif found.reading is Reading.NO_MODEL and not self.is_harmless(found, args):
            is_recorded = not math.isnan(self.time_ms)
            rule = rules.NOT_SIMULATED if is_recorded and not found.is_essential else rules.NO_MODEL
            self.report_at(rule, token, call=text, reason=found.reason)
        elif found.reading is Reading.OUTPUT:
            self.report_at(rules.OUTPUT_CALL, token, call=text)
        else:
            self.note_call(text, self.line_of(token))
        self.lose_results(text, args)

    def is_harmless(self, found: LibraryCall, args: Sequence[Tree[Token]]) -> bool:
        """Whether a call without a model does nothing here."""
        if found.name == "GT_CrdData":  # Without a segment it only sends what the card's look-ahead still holds.
            return any(arg.data == "null" for arg in args)
        return found.name == "GT_ZeroPos" and not any(c.name == "GT_CrdStart" for c in self.calls)

    def lose_results(self, text: str, args: Sequence[Tree[Token]]) -> None:
        """Forget the variables that a call sets, after what its arguments do."""
        for arg in args:
            self.evaluator.expression(arg)
            reason = Phrase("{function}() may have changed it", function=text)
            self.evaluator.variables.lose(self.evaluator.addressed(arg), reason)

    def at_rest(self, token: Token, args: Sequence[Tree[Token]]) -> None:
        """Read that a recorded motion has ended: the program has waited for it."""
        crd = self.evaluator.expression(args[0]) if len(args) == 1 else None
        if not isinstance(crd, CNumber):
            self.report_at(rules.CALL_ARGUMENTS, token, call=AT_REST, wanted=1, names="crd", found=len(args))
            return
        self.add_call("GT_CrdStatus", (crd.value, "run", "segment", 0.0))

    def simulated_call(self, token: Token, found: LibraryCall, args: Sequence[Tree[Token]]) -> None:
        """Read a call that is simulated; nothing is added with a diagnostic."""
        signature = found.signature
        assert signature is not None
        if not found.fits(len(args)):
            self.misfits += 1
            least, most = found.least - found.leading, len(signature.args)
            fields = {"wanted": most if least == most else f"{least}..{most}", "found": len(args)}
            names = ", ".join([*["card"] * found.leading, *[arg.name for arg in signature.args]])
            self.report_at(rules.CALL_ARGUMENTS, token, call=str(token), names=names, **fields)
            self.lose_results(str(token), args)
            return
        if not self.read_leading(token, args[: found.leading]):
            return
        own = args[found.leading :]
        values: list[Value | None] = [
            self.argument(signature, arg, tree) for arg, tree in zip(signature.args, own, strict=False)
        ]
        self.count_misfits(signature, values)
        if found.trailing and len(own) > len(signature.args) and not self.is_zero(own[-1]):
            reason = Phrase("gusjob has no model of a last argument other than 0")
            self.report_at(rules.NO_MODEL, token, call=str(token), reason=reason)
            return
        if any(value is None for value in values):
            return
        given = [value for value in values if value is not None]
        given += [0.0] * (len(signature.args) - len(given))
        if signature.buffered is not None:
            self.row_buffer.append(buffered_row(signature.buffered, signature, given))
        elif not (signature.name == "GT_CrdStatus" and isinstance(given[1], float)):
            self.add_call(signature.name, tuple(given))

    def add_call(self, name: str, args: tuple[Value, ...]) -> None:
        """Add a call that is not buffered."""
        self.calls.append(ImmediateCall(name=name, args=args, time_ms=self.time_ms))
        self.row_buffer.append(call_row(len(self.calls) - 1))

    def is_zero(self, tree: Tree[Token]) -> bool:
        """Whether an argument is known to be 0."""
        value = self.evaluator.expression(tree)
        return isinstance(value, CNumber) and value.value == 0 and not value.is_code

    def read_leading(self, token: Token, args: Iterable[Tree[Token]]) -> bool:
        """Read the number of the card or the core; False with a diagnostic."""
        for tree in args:
            value = self.evaluator.expression(tree)
            if not isinstance(value, CNumber) or value.is_code:
                fields = {"argument": "card", "call": str(token), "wanted": EXPECTED_ARGUMENT[ArgKind.WHOLE]}
                self.report_value(fields, tree, value)
                return False
            self.leading.add(value.value)
            self.card_calls += self.several_cards and not str(token).startswith(GSN_PREFIX)
        return True

    def count_misfits(self, signature: Signature, values: list[Value | None]) -> None:
        """Count arguments that are none: another number of arguments was meant."""
        for arg, value in zip(signature.args, values, strict=False):
            allowed = arg.range
            if allowed is not None and _is_small(allowed) and isinstance(value, float):
                self.misfits += not allowed.low <= value <= allowed.high

    def argument(self, signature: Signature, arg: Arg, tree: Tree[Token]) -> Value | None:
        """Return one argument's value, or None with a diagnostic."""
        fields = {"argument": arg.name, "call": signature.name, "wanted": EXPECTED_ARGUMENT[arg.kind]}
        if arg.kind is ArgKind.POINTER:
            return self.result_argument(signature, tree)
        is_block = arg.kind in (ArgKind.ARRAY, ArgKind.STRUCT)
        self.misfits += tree.data in (("number",) if is_block else ("members", "address", "by_reference"))
        value = self.block_argument(arg, tree) if is_block else self.evaluator.expression(tree)
        found = plain(value)
        fits = isinstance(found, float) if arg.kind in (ArgKind.WHOLE, ArgKind.REAL) else isinstance(found, tuple)
        if fits:
            return found
        self.report_value(fields, tree, value)
        return None

    def block_argument(self, arg: Arg, tree: Tree[Token]) -> CValue:
        """Return the array or struct that a call reads."""
        if tree.data == "members":
            if arg.kind is ArgKind.STRUCT:
                return self.evaluator.struct_of(tree, is_argument=True)
            values = self.evaluator.array_of(subtrees(tree)).values
        else:
            if tree.data in ("address", "by_reference"):
                tree = subtrees(tree)[0]
            if arg.kind is ArgKind.STRUCT:
                return self.crd_of(tree)
            start = 0
            if tree.data == "index" and self.is_zero(subtrees(tree)[1]):
                tree = subtrees(tree)[0]
            value = self.evaluator.expression(tree)
            if not isinstance(value, CArray):
                return value
            if (value.element.c if value.element is not None else "") != arg.c:
                return unknown(Phrase("it is not declared as an array of {type}", type=arg.c.value))
            values = value.values[start : max(arg.count, 0)]
        wanted = arg.count
        return CArray(values=values) if len(values) == wanted else UnknownValue(reason="")

    def crd_of(self, tree: Tree[Token]) -> CValue:
        """Return a TCrdPrm; report a field that it does not have."""
        value = self.evaluator.expression(tree)
        if isinstance(value, CStruct) and not value.is_crd:
            known = self.evaluator.crd_fields(value)
            if known is not None:
                token = first_token(tree)
                assert token is not None
                self.report_at(rules.UNKNOWN_FIELD, token, field=known[0], hint=known[1])
                return UnknownValue(reason="", is_reported=True)
        return value

    def result_argument(self, signature: Signature, tree: Tree[Token]) -> Value | None:
        """Return the variable that a call sets: its name, or the number that a log gives in its place."""
        number = _number_token(tree)
        if number is not None:
            return float(number)
        name = _variable(tree)
        if name is None:
            fields = {"argument": "pointer", "call": signature.name, "wanted": EXPECTED_ARGUMENT[ArgKind.POINTER]}
            self.report_value(fields, tree, UnknownValue(reason=""))
            return None
        self.evaluator.variables.lose([name], sets_it(signature.name))
        return name

    def report_value(self, fields: dict[str, str], tree: Tree[Token], value: CValue) -> None:
        """Report an argument that has no value."""
        reason = why_unknown(value)
        if reason is not None and reason.is_reported:
            return
        token = first_token(tree)
        found: str = str(token)[:40] if token is not None else Phrase("nothing")
        if reason is not None and reason.reason:
            found = Phrase("{text}: {reason}", text=found, reason=reason.reason)
        if token is None:
            self.report(rules.CALL_VALUE, self.first_line, 1, 2, **fields, found=found)
        else:
            self.report_at(rules.CALL_VALUE, token, **fields, found=found)


@dataclass(frozen=True, slots=True, kw_only=True)
class _LoggedCall:
    """A call that stands alone in its line. `set_name`: the variable that gets its code; `time`: a log's time."""

    name: Token
    args: list[Tree[Token]]
    set_name: str | None = None
    time: Token | None = None


def _logged_call(item: Tree[Token]) -> _LoggedCall | None:
    """Take a line with one call apart: rtn = GT_LnXY(...), or [time] GT_LnXY(...) = 0."""
    if item.data not in ("statement", "stamped"):
        return None
    time = tokens(item)[0] if item.data == "stamped" else None
    tree, set_name = subtrees(item)[0], None
    if tree.data == "assign":
        left, right = subtrees(tree)
        if tokens(tree)[0] != "=":
            return None
        if left.data == "name" and right.data == "call":
            set_name, tree = str(tokens(left)[0]), right
        elif left.data == "call" and right.data == "number":
            tree = left
        else:
            return None
    if tree.data != "call" or subtrees(tree)[0].data != "name":
        return None
    name = tokens(subtrees(tree)[0])[0]
    if not is_library_name(str(name)):
        return None
    return _LoggedCall(name=name, args=subtrees(tree)[1:], set_name=set_name, time=time)


def _only_begins(item: Tree[Token]) -> bool:
    """Whether an item at the end of a line is a place alone: its assignment, or its call, is on the next line."""
    inner = subtrees(item)[0] if item.data == "statement" else None
    while inner is not None and inner.data in ("cast", "assign"):
        if inner.data == "assign":
            last = subtrees(inner)[-1]
            return last.data == "name" and is_library_name(str(tokens(last)[0]))
        inner = subtrees(inner)[-1]
    return inner is not None and inner.data in ("name", "index", "member")


def _number_token(tree: Tree[Token]) -> Token | None:
    """Return a plain number with its sign as one token; None for anything else."""
    if tree.data == "number":
        return tokens(tree)[0]
    if tree.data != "unary" or subtrees(tree)[0].data != "number":
        return None
    sign, number = tokens(tree)[0], tokens(subtrees(tree)[0])[0]
    if sign.type != "SIGN" or sign.end_pos != number.start_pos:
        return None
    return Token("NUMBER", f"{sign}{number}", start_pos=sign.start_pos, line=sign.line, column=sign.column)


def _variable(arg: Tree[Token]) -> str | None:
    """Return the variable that an argument names: run, &run, &pos[1], ref run."""
    tree = subtrees(arg)[0] if arg.data in ("address", "by_reference") else arg
    while tree.data in ("index", "member"):
        tree = subtrees(tree)[0]
    return str(tokens(tree)[0]) if tree.data == "name" else None


def _is_small(allowed: Range) -> bool:
    """Whether an argument's range is so small that its value tells one argument from another."""
    return allowed.whole and allowed.high <= _SMALL_RANGE


def _macro(text: str) -> CMacro:
    """Make a macro of its text."""
    tree = None
    with suppress(UnexpectedInput):
        items = subtrees(parser(LISTING_GRAMMAR).parse(text))
        if len(items) == 1 and items[0].data == "statement" and ";" not in text:
            tree = subtrees(items[0])[0]
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
