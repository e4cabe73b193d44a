"""Calls of the library in a listing: from their names and arguments to the rows and calls of a stream."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from functools import cached_property

import numpy as np
from lark import Token, Tree
from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.config.machine import Abi
from gusjob.controllers.gus import ranges
from gusjob.controllers.gus.calls import SIGNATURES, Arg, ArgKind, Signature, Value
from gusjob.controllers.gus.functions import GSN_PREFIX, functions
from gusjob.controllers.gus.ranges import Membership
from gusjob.diagnostics import rules
from gusjob.frontend.listing.c_arguments import ArgumentConverter, is_real, reals_mask
from gusjob.frontend.listing.c_evaluator import CEvaluator
from gusjob.frontend.listing.c_numbers import CNumber
from gusjob.frontend.listing.c_structs import printed_array, printed_struct
from gusjob.frontend.listing.c_trees import LoggedCall, first_token, names_in, number_token, variable_of
from gusjob.frontend.listing.c_variables import CArray, CValue, UnknownValue, plain, sets_it, unknown, why_unknown
from gusjob.frontend.listing.call_rows import (
    CALL_OP,
    COLUMNS,
    LEADING_COLUMN,
    NAME_COLUMN,
    PASSED_OVER_OP,
    REALS_COLUMN,
    UNUSED_COLUMN,
    ImmediateCall,
    buffered_row,
    call_row,
)
from gusjob.frontend.listing.library_calls import AT_REST, LibraryCall, Reading, library_call
from gusjob.frontend.listing.listing_diagnostics import ListingDiagnostics
from gusjob.frontend.parse.grammar import subtrees
from gusjob.frontend.scan.rows import Row, Rows, Template, TemplateBuilder
from gusjob.frontend.source import Source
from gusjob.i18n.phrases import Phrase, did_you_mean
from gusjob.kinematics.arrays import Indices, distinct, picked, unrepeated, where_true
from gusjob.patterns import lazy_pattern

EXPECTED_ARGUMENT = {
    ArgKind.WHOLE: Phrase("a whole number"),
    ArgKind.REAL: Phrase("a number"),
    ArgKind.ARRAY: Phrase("an array of four numbers"),
    ArgKind.POINTER: Phrase("a variable"),
    ArgKind.STRUCT: Phrase("a TCrdPrm"),
}
"""What an argument takes, by its kind."""
_LEADING_RANGE = (0.0, 15.0)
_MAX_CARDS = 200
_SMALL_RANGE = 8.0
"""Whole arguments up to here tell a call with a leading card number from one without."""
_TELLING = (
    ("crd", ranges.CRD),
    ("fifo", ranges.FIFO),
    ("channel", ranges.CHANNEL),
    ("vel", ranges.VELOCITY),
    ("acc", ranges.ACCELERATION),
)
"""Arguments of buffered calls whose values show whether a card number is first."""


_REAL = lazy_pattern("[.eE]")
"""A mark of a floating number among plain numbers."""


class _Argument(Struct, frozen=True, kw_only=True):
    """An argument that is read. `in_c`: what C makes of its expression."""

    value: Value | None
    in_c: CValue | None = None


class CallReader(Struct, dict=True):
    """Reads calls, with or without a leading card number.

    Attributes:
        text: The text, as it is parsed.
        rows: Rows of the line that is read now.
        calls: Calls that are not buffered.
        misfits: Number of calls, or of columns of calls, with too few or too many arguments, or with values outside the
            range of one: they suggest another argument list.
        has_defaults: Arguments may be left out (C++).
        card_calls: Number of lines, or shapes of lines, with a card number.
        leading: Leading arguments (cards, cores) of the calls.
        owners: Objects and namespaces whose calls they are.
        passed_over: Names of calls that are passed over, in the order in which templates number them.
        refused_when_recorded: Number of calls that a log gives another code than 0.
        code, time_ms: What a log says of the call that is read now.
    """

    text: Source
    abi: Abi | None
    has_defaults: bool
    several_cards: bool
    diagnostics: ListingDiagnostics
    evaluator: CEvaluator
    rows: list[Row] = field(default_factory=list)
    calls: list[ImmediateCall] = field(default_factory=list)
    misfits: int = 0
    card_calls: int = 0
    leading: set[float] = field(default_factory=set)
    passed_over: list[str] = field(default_factory=list)
    owners: list[str] = field(default_factory=list)
    refused_when_recorded: int = 0
    code: float = 0.0
    time_ms: float = math.nan

    @cached_property
    def converter(self) -> ArgumentConverter:
        """Converts arguments to the types of the calls."""
        return ArgumentConverter(wide_pulse_width=self.abi in (Abi.GTS, Abi.GTS_MULTI))

    def library_call(self, text: str) -> LibraryCall:
        """Find a call by its name."""
        return library_call(text, self.abi, several_cards=self.several_cards, has_defaults=self.has_defaults)

    def call(self, token: Token, text: str, owner: str, args: Sequence[Tree[Token]]) -> None:
        """Read one call of the library. `owner`: the object or namespace that it is of."""
        found = self.library_call(text)
        if owner not in self.owners:
            self.owners.append(owner)
            named = [name for name in self.owners if name]
            if len(named) == 2:
                self.diagnostics.add_at(rules.SEVERAL_CARDS, token, cards=", ".join(named))
        if found.reading is Reading.UNKNOWN:
            near = get_close_matches(text, [*SIGNATURES, *functions()], 1, cutoff=0.8)
            self.diagnostics.add_at(rules.CALL_UNKNOWN, token, call=text, hint=did_you_mean(near[0] if near else ""))
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
            self.diagnostics.add_at(rule, token, call=text, reason=found.reason)
        elif found.reading is Reading.OUTPUT:
            self.diagnostics.add_at(rules.OUTPUT_CALL, token, call=text)
        else:
            self.note_call(text, self.diagnostics.line_of(token))
        self.lose_results(text, args)

    def template(self, builder: TemplateBuilder, logged: LoggedCall) -> Template | None:
        """Make the template of a call with plain numbers; None if it must be parsed."""
        name = str(logged.name)
        found = self.library_call(name)
        numbers = [token for token in map(number_token, logged.args) if token is not None]
        if len(numbers) < len(logged.args) or not found.fits(len(numbers)) or name in self.evaluator.macros:
            return None
        signature = found.signature
        if found.reading is Reading.PASSED_OVER or (signature is not None and signature.name == "GT_CrdStatus"):
            columns, op = [UNUSED_COLUMN] * len(numbers), PASSED_OVER_OP
            constants = [(NAME_COLUMN, float(self.number_of(found.name)))]
        elif signature is not None and signature.buffered is not None and found.trailing == 0:
            own = [COLUMNS.index(arg.column) for arg in signature.args]
            columns, op = [*[LEADING_COLUMN] * found.leading, *own][: len(numbers)], signature.buffered
            missing = own[len(numbers) - found.leading :]
            constants = [(column, 0.0) for column in missing]
            reals = reals_mask(signature, [_REAL.search(token) is not None for token in numbers[found.leading :]])
            constants += [(REALS_COLUMN, reals)] if reals else []
        else:
            return None
        if logged.time is not None:
            numbers, columns = [logged.time, *numbers], [UNUSED_COLUMN, *columns]
        for column, token in zip(columns, numbers, strict=True):
            start = (token.column or 1) - 1
            if not builder.add(column, start, start + len(token)):
                return None
        self.card_calls += self.several_cards and not name.startswith(GSN_PREFIX)
        template = builder.build(op, constants=tuple(constants))
        # The code of a log is the only number left: only a call with code 0 had an effect.
        return template and replace(template, fixed=tuple((run, "0") for run, _ in template.fixed))

    def number_of(self, name: str) -> int:
        """Return the number of a call that is passed over; a reading of the status needs no word."""
        if name not in self.passed_over:
            self.passed_over.append(name)
        return self.passed_over.index(name)

    def is_harmless(self, found: LibraryCall, args: Sequence[Tree[Token]]) -> bool:
        """Whether a call without a model does nothing here."""
        if found.name == "GT_CrdData":  # Without a segment it only sends what the card's look-ahead still holds.
            return any(arg.data == "null" for arg in args)
        return found.name == "GT_ZeroPos" and not any(c.name == "GT_CrdStart" for c in self.calls)

    def lose_results(self, text: str, args: Sequence[Tree[Token]]) -> None:
        """Forget the variables that a call sets, after what its arguments do."""
        reason = Phrase("{function}() may have changed it", function=text)
        for arg in args:
            self.evaluator.expression(arg)
            given = self.evaluator.addressed(arg)
            self.evaluator.variables.lose(given, reason)
            if not given and set(names_in(arg)) - self.evaluator.variables.types.keys():  # One may be a pointer.
                self.evaluator.variables.lose_escaped(reason)

    def at_rest(self, token: Token, args: Sequence[Tree[Token]]) -> None:
        """Read that a recorded motion has ended: the program has waited for it."""
        crd = self.evaluator.expression(args[0]) if len(args) == 1 else None
        if not isinstance(crd, CNumber) or crd.value not in (1, 2) or self.code:
            self.diagnostics.add_at(rules.CALL_ARGUMENTS, token, call=AT_REST, wanted=1, names="crd", found=len(args))
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
            self.diagnostics.add_at(rules.CALL_ARGUMENTS, token, call=str(token), names=names, **fields)
            self.lose_results(str(token), args)
            return
        if not self.read_leading(token, args[: found.leading]):
            return
        own = args[found.leading :]
        read = [self.argument(signature, arg, tree) for arg, tree in zip(signature.args, own, strict=False)]
        values = [argument.value for argument in read]
        self.count_misfits(signature, values)
        if found.trailing and len(own) > len(signature.args) and not self.is_zero(own[-1]):
            reason = Phrase("its last argument must be 0")
            self.diagnostics.add_at(rules.NO_MODEL, token, call=str(token), reason=reason)
            return
        if any(value is None for value in values):
            return
        given = [value for value in values if value is not None]
        given += [0.0] * (len(signature.args) - len(given))
        found_in_c = [argument.in_c for argument in read]
        if signature.buffered is not None:
            reals = reals_mask(signature, [is_real(value) for value in found_in_c])
            self.rows.append(buffered_row(signature.buffered, signature, given, reals))
        elif not (signature.name == "GT_CrdStatus" and isinstance(given[1], float)):
            given = self.converter.call(signature, found_in_c, given, self.diagnostics.line_of(token))
            if given or not signature.args:
                self.add_call(signature.name, tuple(given))

    def add_call(self, name: str, args: tuple[Value, ...]) -> None:
        """Add a call that is not buffered."""
        self.calls.append(ImmediateCall(name=name, args=args, time_ms=self.time_ms))
        self.rows.append(call_row(len(self.calls) - 1))

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
                self._report_value(fields, tree, value)
                return False
            self.leading.add(value.value)
            self.card_calls += self.several_cards and not str(token).startswith(GSN_PREFIX)
        return True

    def count_misfits(self, signature: Signature, values: list[Value | None]) -> None:
        """Count values outside the range of an argument: they suggest another argument list."""
        for arg, value in zip(signature.args, values, strict=False):
            allowed = arg.range
            if allowed is not None and (allowed.whole and allowed.high <= _SMALL_RANGE) and isinstance(value, float):
                self.misfits += not allowed.low <= value <= allowed.high

    def argument(self, signature: Signature, arg: Arg, tree: Tree[Token]) -> _Argument:
        """Read one argument; its value is None with a diagnostic."""
        fields = {"argument": arg.name, "call": signature.name, "wanted": EXPECTED_ARGUMENT[arg.kind]}
        if arg.kind is ArgKind.POINTER:
            return _Argument(value=self.result_argument(signature, tree))
        is_block = arg.kind in (ArgKind.ARRAY, ArgKind.STRUCT)
        self.misfits += tree.data in (("number",) if is_block else ("members", "address", "by_reference"))
        value = self.block_argument(arg, tree) if is_block else self.evaluator.expression(tree)
        found = plain(value)
        fits = isinstance(found, float) if arg.kind in (ArgKind.WHOLE, ArgKind.REAL) else isinstance(found, tuple)
        if fits:
            return _Argument(value=found, in_c=value)
        self._report_value(fields, tree, value)
        return _Argument(value=None)

    def block_argument(self, arg: Arg, tree: Tree[Token]) -> CValue:
        """Return the array or struct that a call reads."""
        if tree.data == "members":
            if arg.kind is ArgKind.STRUCT:
                return printed_struct(tree, self.evaluator.expression)
            values = printed_array(tree, self.evaluator.expression).values
        else:
            if tree.data in ("address", "by_reference"):
                tree = subtrees(tree)[0]
            if arg.kind is ArgKind.STRUCT:
                return self.crd_of(tree)
            if tree.data == "index" and self.is_zero(subtrees(tree)[1]):
                tree = subtrees(tree)[0]
            value = self.evaluator.expression(tree)
            if not isinstance(value, CArray):
                return value
            if (value.element.c if value.element is not None else "") != arg.c:
                return unknown(Phrase("it is not declared as an array of {type}", type=arg.c.value))
            values = value.values[: arg.count]
        return CArray(values=values) if len(values) == arg.count else UnknownValue(reason="")

    def crd_of(self, tree: Tree[Token]) -> CValue:
        """Return a TCrdPrm; report a field that it does not have."""
        value = self.evaluator.expression(tree)
        wrong = self.evaluator.wrong_field(value)
        if wrong is not None:
            token = first_token(tree)
            assert token is not None
            self.evaluator.report_field(token, wrong)
            return UnknownValue(reason="", is_reported=True)
        return value

    def result_argument(self, signature: Signature, tree: Tree[Token]) -> Value | None:
        """Return the variable that a call sets: its name, or the number that a log gives in its place."""
        number = number_token(tree)
        value = self.evaluator.expression(tree) if number is not None else None
        if isinstance(value, CNumber):
            return value.value
        if tree.data == "null":
            return "NULL"
        name = variable_of(tree) if number is None else None
        if name is None:
            fields = {"argument": "pointer", "call": signature.name, "wanted": EXPECTED_ARGUMENT[ArgKind.POINTER]}
            self._report_value(fields, tree, UnknownValue(reason=""))
            return None
        self.forget(tree, name, sets_it(signature.name))
        return name

    def forget(self, tree: Tree[Token], name: str, reason: str) -> None:
        """Forget what a call sets: a variable, or what a pointer may point to."""
        variables = self.evaluator.variables
        given = self.evaluator.addressed(tree)
        variables.lose({name, *given}, reason)
        if not given:
            variables.lose_escaped(reason)

    def _report_value(self, fields: dict[str, str], tree: Tree[Token], value: CValue) -> None:
        """Report an argument that has no value."""
        reason = why_unknown(value)
        if reason is not None and reason.is_reported:
            return
        named = (t for t in tree.scan_values(lambda t: isinstance(t, Token) and t.type == "NAME"))
        token = next(named, first_token(tree))
        found: str = str(token)[:40] if token is not None else Phrase("nothing")
        if reason is not None and reason.reason:
            found = Phrase("{text}, whose value is not known ({reason})", text=found, reason=reason.reason)
        if token is None:
            self.diagnostics.add(rules.CALL_VALUE, self.diagnostics.first_line, 1, 2, **fields, found=found)
        else:
            self.diagnostics.add_at(rules.CALL_VALUE, token, **fields, found=found)

    def checked(self, parts: Sequence[Rows]) -> list[Rows]:
        """Check the rows of a whole text, and report what is passed over; return the rows of the other calls."""
        made = []
        for rows in parts:
            passed_over = rows.op == PASSED_OVER_OP
            if passed_over.any():
                self.note_passed_over(rows, np.flatnonzero(passed_over))
            made.append(rows.pick(~passed_over) if passed_over.any() else rows)
            self.check_rows(made[-1])
        self.check_leading()
        return self.converter.rows(made)

    def note_passed_over(self, rows: Rows, where: Indices) -> None:
        """Report each call that is passed over, once."""
        names, firsts = np.unique(rows.column(NAME_COLUMN)[where], return_index=True)
        for number, first in zip(names.tolist(), firsts.tolist(), strict=True):
            self.note_call(self.passed_over[int(number)], int(rows.line[where[first]]))

    def note_call(self, name: str, line: int) -> None:
        """Report a call that is passed over, at its first line."""
        if name == "GT_CrdStatus":
            return
        known = [f for f in self.diagnostics.found if f.rule is rules.CALL_IGNORED and f.fields["call"] == name]
        if known and known[0].span.line <= line:
            return
        self.diagnostics.found = [f for f in self.diagnostics.found if f not in known]
        column = max(self.text.line(line).find(name), 0) + 1
        self.diagnostics.add(rules.CALL_IGNORED, line, column, column + len(name), call=name)

    def check_rows(self, rows: Rows) -> None:
        """Find leading arguments of plain calls, and what fits no library."""
        buffered = where_true(rows.op < CALL_OP)
        if len(self.leading) < _MAX_CARDS:
            given = unrepeated(picked(rows.column(LEADING_COLUMN), buffered))
            self.leading |= set(distinct(given[~np.isnan(given)])[:_MAX_CARDS].tolist())
        for name, allowed in _TELLING:
            values = unrepeated(picked(rows.column(COLUMNS.index(name)), buffered))
            self.misfits += int(np.count_nonzero(allowed.classify(values[~np.isnan(values)]) == Membership.OUTSIDE))

    def check_leading(self) -> None:
        """Find leading arguments that fit no library; report calls for several cards."""
        self.misfits += sum(not _LEADING_RANGE[0] <= card <= _LEADING_RANGE[1] for card in self.leading)
        if len(self.leading) > 1 and not self.misfits:
            cards = ", ".join(f"{card:g}" for card in sorted(self.leading)[:5])
            self.diagnostics.add_for_file(rules.SEVERAL_CARDS, cards=cards)

    def note_cards(self) -> None:
        """Report that the calls are read as those of a library for several cards."""
        if len(self.leading) == 1:
            self.diagnostics.add_for_file(rules.LEADING_CARD, card=f"{next(iter(self.leading)):g}")
