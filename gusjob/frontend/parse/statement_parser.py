"""One line of a job to its statement: lark parses it, the table of forms says which words it takes and needs."""

from __future__ import annotations

import math

from lark import Token, Tree, UnexpectedInput
from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule, Span
from gusjob.frontend.parse.expressions import (
    Apply,
    Constant,
    Expression,
    Literal,
    NamedFunction,
    PostfixStep,
    postfix,
)
from gusjob.frontend.parse.forms import CHANNEL_WORD, FORMS, RATIO_WORD, REF_WORD, StatementForm, Word
from gusjob.frontend.parse.grammar import JOB_GRAMMAR, keywords, parser, subtrees, tokens
from gusjob.frontend.parse.operators import FUNCTIONS, NAMED_NUMBERS, NEGATE, Function
from gusjob.frontend.parse.statement import CONTROL_FORMS, Quantity, Statement
from gusjob.frontend.parse.unread_numbers import EXPECTED_KIND, POWER_KINDS, hexadecimal
from gusjob.frontend.scan.shapes import MAX_LINE, MAX_NUMBER, MIN_NUMBER
from gusjob.i18n.phrases import Phrase, all_of, any_of, did_you_mean, plural
from gusjob.kinematics.units import UNITS, QuantityKind, spelling
from gusjob.patterns import lazy_pattern

_NOT_ZERO = lazy_pattern(r"[0.]*[1-9]")


def strip_comment(line: str) -> str:
    """Remove the comment of a line."""
    cut = min((i for i in (line.find(";"), line.find("//")) if i >= 0), default=len(line))
    return line[:cut]


def parse_statement(text: str, line: int) -> tuple[Statement | None, list[Diagnostic]]:
    """Parse a line.

    Args:
        text: The line, with or without its comment.
        line: Its number, for the diagnostics.

    Returns:
        The statement, or None with diagnostics. A blank line is None without diagnostics.
    """
    if len(text) > MAX_LINE:
        span = Span(line=line, column=1, end_line=line, end_column=2)
        return None, [Diagnostic(rule=rules.LINE_TOO_LONG, span=span, fields={"size": len(text), "limit": MAX_LINE})]
    text = strip_comment(text)
    try:
        tree = parser(JOB_GRAMMAR).parse(text)
    except UnexpectedInput as error:
        from gusjob.frontend.parse.syntax_errors import syntax_error  # Start-up time is part of the tool.

        return None, [syntax_error(error, text, line)]
    if not tree.children:
        return None, []
    root = tree.children[0]
    assert isinstance(root, Tree)
    found = _StatementParser(line=line, text=text)
    statement = found.statement(root)
    return (None, found.diagnostics) if found.diagnostics else (statement, [])


class _StatementParser(Struct):
    line: int
    text: str
    diagnostics: list[Diagnostic] = field(default_factory=list)

    def report(self, rule: Rule, column: int, end_column: int, **fields: object) -> None:
        """Add a diagnostic; of a text within a number that is not decimal there is one already."""
        last = self.diagnostics[-1] if self.diagnostics else None
        if last is not None and last.rule is rules.NOT_DECIMAL and column < last.span.end_column:
            return
        span = Span(line=self.line, column=column, end_line=self.line, end_column=end_column)
        self.diagnostics.append(Diagnostic(rule=rule, span=span, fields=fields))

    def report_at(self, rule: Rule, token: Token, **fields: object) -> None:
        """Add a diagnostic at a token."""
        start = token.column or 1
        self.report(rule, start, start + len(token), **fields)

    def report_twice(self, token: Token) -> None:
        """Add a diagnostic for a word that is given twice, the first one: another word may be missing between them."""
        if any(diagnostic.rule is rules.DUPLICATE_WORD for diagnostic in self.diagnostics):
            return
        self.report_at(rules.DUPLICATE_WORD, token, word=str(token))

    # Statements.

    def statement(self, tree: Tree[Token]) -> Statement:
        """The statement of a tree; not to be used if there are diagnostics."""
        channel = None
        if tree.data == "laser":
            for tail in (t for t in subtrees(tree) if t.data == "tail"):
                channel = self.quantity(subtrees(tail)[0], CHANNEL_WORD, "CHANNEL")
            tree = next(t for t in subtrees(tree) if t.data != "tail")
        form_key = str(tree.data)
        heads = [t.type for t in tokens(tree)]
        if form_key == "modal":
            form_key = heads[0]
        elif form_key == "laser_mode":
            form_key = heads[1]
        bare = Statement(
            form=form_key,
            name=FORMS[form_key].name,
            channel=channel,
            column=len(self.text) - len(self.text.lstrip()) + 1,
            end_column=len(self.text.rstrip()) + 1,
        )
        if form_key in CONTROL_FORMS and form_key != "frame":
            return self.control(tree, bare)
        return self.with_words(tree, bare, heads)

    def with_words(self, tree: Tree[Token], bare: Statement, heads: list[str]) -> Statement:
        """A statement with its words and options. `heads`: the keywords at its beginning."""
        form = FORMS[bare.form]
        options = [head for head in heads if bare.form == "laser_switch" or head not in form.name.split()]
        words: dict[str, Quantity] = {}
        axes: dict[str, dict[str, Quantity]] = {}
        chosen: set[str] = set()
        for part in subtrees(tree):
            if part.data == "value":
                self.word(form, "", part, words)
            elif part.data == "word":
                if tokens(part)[0].type in chosen:
                    self.report_twice(tokens(part)[0])
                self.word(form, tokens(part)[0].type, subtrees(part)[0], words, tokens(part)[0])
            elif part.data == "choice":
                head, choice = tokens(part)[:2]
                if head.type in chosen or head.type in words:
                    self.report_twice(head)
                chosen.add(head.type)
                options.append(f"{head.type} {choice.type}")
            elif bare.form == "frame":
                self.shift(tokens(part)[0], part, form, words)
            else:
                self.axes(tokens(part)[0], part, axes)
        self.check_needs(form, {**words, **axes}, options, bare)
        return replace(bare, options=tuple(options), words=words, axes=axes)

    def control(self, tree: Tree[Token], bare: Statement) -> Statement:
        """A control statement: bare expressions, names, a text."""
        names: list[Token] = []
        arguments: list[Expression] = []
        text = ""
        for child in tree.children:
            if isinstance(child, Tree) and child.data == "given":
                names += tokens(child)
            elif isinstance(child, Tree) or child.type in ("NAME", "QUANTITY"):
                expression = self.expression(child)
                arguments += [expression] if expression else []
            elif child.type == "STRING":
                text = child[1:-1]
        for i, name in enumerate(names):
            if bare.form != "call":
                self.check_name(name)
            if bare.form == "def" and name in names[1:i]:
                self.report_twice(name)
        return replace(bare, names=tuple(map(str, names)), arguments=tuple(arguments), text=text)

    def check_name(self, token: Token) -> None:
        """A name for a number or a routine must not be a keyword, except for those of one letter."""
        is_keyword = len(token) > 1 and token.upper() in keywords(JOB_GRAMMAR)
        if is_keyword or token in FUNCTIONS or token in NAMED_NUMBERS:
            hint = Phrase("write {name} or another name", name=f"{token}_1")
            self.report_at(rules.RESERVED_NAME, token, word=str(token), hint=hint)

    # Words.

    def word(
        self, form: StatementForm, name: str, value: Tree[Token], words: dict[str, Quantity], token: Token | None = None
    ) -> None:
        """Add a word to `words`. `token`: its keyword."""
        if token is not None and name not in form.words:
            hint = form.hints.get(name) or _words_of(form)
            self.report_at(rules.WORD_NOT_ALLOWED, token, word=name, statement=form.name, hint=hint)
            return
        if name in words and token is not None:
            self.report_twice(token)
            return
        quantity = self.quantity(value, form.words[name], f"{form.name} {name}".strip())
        if quantity is not None:
            words[name] = quantity

    def shift(self, head: Token, part: Tree[Token], form: StatementForm, words: dict[str, Quantity]) -> None:
        """Add SHIFT X x Y y of FRAME to `words`."""
        if not subtrees(part):
            self.report_at(rules.MISSING_WORD, head, statement="FRAME SHIFT", word=any_of(("X", "Y")), hint="")
        for axis in subtrees(part):
            self.word(form, tokens(axis)[0].type, subtrees(axis)[0], words, tokens(axis)[0])

    def axes(self, head: Token, part: Tree[Token], axes: dict[str, dict[str, Quantity]]) -> None:
        """Add the numbers of REF or RATIO of LASER DISTANCE to `axes`."""
        if head.type in axes:
            self.report_twice(head)
        found: dict[str, Quantity] = {}
        for word in subtrees(part):
            axis = tokens(word)[0]
            kind = REF_WORD if head.type == "REF" else RATIO_WORD
            if axis.type in found:
                self.report_twice(axis)
            quantity = self.quantity(subtrees(word)[0], kind, f"{head.type} {axis.type}")
            if quantity:
                found[axis.type] = quantity
        for name in "XY":
            if name not in found and not self.diagnostics:
                hint = Phrase("; X and Y are required, Z and A are optional")
                statement = f"LASER DISTANCE {head.type}"
                self.report_at(rules.MISSING_WORD, head, statement=statement, word=name, hint=hint)
        axes[head.type] = found

    def check_needs(
        self, form: StatementForm, words: dict[str, object], options: list[str], statement: Statement
    ) -> None:
        """Report a word that is missing."""
        if "OFF" in options:
            return
        missing = [word for word in form.needs if word not in words]
        hint = ""
        if form.name in ("LINE", "JUMP") and not {"X", "Y"} & words.keys():
            missing = [any_of(("X", "Y"))]
        if form.name == "ARC":
            missing, hint = _arc_needs(words)
        if form.name == "LASER FOLLOW" and not missing and ("RATIO" in words) == ("AT" in words):
            missing = [_either("RATIO", "AT") if "AT" in words else any_of(("RATIO", "AT"))]
            hint = Phrase("; RATIO r, or AT v for the ratio that reaches MAX at velocity v")
        for word in missing:
            if not self.diagnostics:
                start, end = statement.column, statement.end_column
                self.report(rules.MISSING_WORD, start, end, statement=form.name, word=word, hint=hint)

    # Numbers.

    def quantity(self, value: Tree[Token], word: Word, what: str) -> Quantity | None:
        """A number, or an expression in parentheses; None with a diagnostic. `what`: what messages call it."""
        if subtrees(value):
            return self.group(value)
        parts = tokens(value)
        token = parts[-1]
        sign = parts[0] if len(parts) > 1 else token
        start, end = sign.column or 1, (token.column or 1) + len(token)
        if (found := hexadecimal(self.text, (token.column or 1) - 1, end - 1, self.line)) is not None:
            self.diagnostics.append(found)
            return None
        number_text, unit_text = _split_unit(str(token))
        times, over, system = 1.0, 1.0, 0
        if unit_text:
            unit = UNITS[unit_text.lower()]
            if unit.kind is not word.kind and not (word.kind is QuantityKind.POWER and unit.kind in POWER_KINDS):
                fields = {"what": what, "wanted": EXPECTED_KIND[word.kind], "unit": spelling(unit_text)}
                self.report(rules.WRONG_UNIT, start, end, **fields, kind=unit.kind.words, hint="")
                return None
            times, over, system = unit.times, unit.over * (1000.0 if word.ms else 1.0), unit.system
        magnitude = float(number_text)
        if self.report_size(number_text, max(magnitude, magnitude * times / over), token, start, end):
            return None
        signed = (-magnitude if sign.type == "MINUS" else magnitude) + 0.0
        return Quantity(
            value=signed * times / over,
            times=times,
            over=over,
            system=system,
            column=start,
            end_column=end,
        )

    def report_size(self, written: str, value: float, token: Token, start: int, end: int) -> bool:
        """Add a diagnostic for a number above MAX_NUMBER, or nearer to 0 than MIN_NUMBER; return whether it is one."""
        shown = f"{token[:20]}{'...' * (len(token) > 20)}"
        if value > MAX_NUMBER:
            self.report(rules.NUMBER_TOO_LARGE, start, end, value=shown, limit=MAX_NUMBER)
            return True
        if float(written) < MIN_NUMBER and _NOT_ZERO.match(written):
            self.report(rules.NUMBER_TOO_SMALL, start, end, value=shown, limit=MIN_NUMBER)
            return True
        return False

    def group(self, value: Tree[Token]) -> Quantity | None:
        """An expression in parentheses, with or without a sign before it."""
        group = subtrees(value)[0]
        sign = next(iter(tokens(value)), None)
        left, right = tokens(group)[0], tokens(group)[-1]
        inner = next(c for c in group.children[1:-1])
        start, end = (sign or left).column or 1, (right.column or 1) + 1
        expression = self.expression(inner, start, end)
        if expression is None:
            return None
        if sign is not None and sign.type == "MINUS":
            expression = replace(expression, code=(*expression.code, Apply(NEGATE, 1)))
        return Quantity(
            value=math.nan,
            times=1.0,
            over=1.0,
            system=0,
            column=start,
            end_column=end,
            expression=expression,
        )

    # Expressions.

    def expression(self, root: Tree[Token] | Token, start: int = 0, end: int = 0) -> Expression | None:
        """An expression as postfix code; it spans its own numbers and names unless columns are given."""
        code: list[PostfixStep] = []
        constants: list[Literal] = []
        diagnostics_before = len(self.diagnostics)
        first, last = MAX_LINE, 0
        for part in postfix(root):
            if isinstance(part, Apply):
                code.append(part)
                continue
            if isinstance(part, NamedFunction):
                function = self.function(part.token, part.count)
                code += [Apply(function, part.count)] if function else []
                part = part.token
            elif part.type == "QUANTITY":
                literal = self.literal(part)
                code.append(Constant(len(constants)))
                constants += [literal] if literal else []
            else:
                code.append(str(part))
            first, last = min(first, part.column or 1), max(last, (part.column or 1) + len(part))
        if len(self.diagnostics) > diagnostics_before:
            return None
        names = dict.fromkeys(step for step in code if isinstance(step, str) and step not in NAMED_NUMBERS)
        return Expression(
            code=tuple(code),
            constants=tuple(constants),
            names=tuple(names),
            column=start or first,
            end_column=end or last,
        )

    def function(self, token: Token, count: int) -> Function | None:
        """A function by its name, if it takes `count` numbers."""
        found = FUNCTIONS.get(token)
        if found is None:
            from gusjob.i18n.spelling import nearest

            near = nearest(token, FUNCTIONS)
            hint = did_you_mean(near) or Phrase("; the functions are {words}", words=all_of(FUNCTIONS))
            self.report_at(rules.UNKNOWN_FUNCTION, token, word=str(token), hint=hint)
        elif count != (found.arity or max(count, 1)):
            self.report_at(
                rules.OPERAND_COUNT, token, word=str(token), wanted=_count_of_numbers(found.arity), found=count
            )
        return found

    def literal(self, token: Token) -> Literal | None:
        """A number in an expression."""
        number_text, unit = _split_unit(str(token))
        start = token.column or 1
        kind, system, times, over = QuantityKind.PLAIN, 0, 1.0, 1.0
        if unit:
            known = UNITS[unit.lower()]
            kind, system, times, over = known.kind, known.system, known.times, known.over
        value = float(number_text) * times / over
        if self.report_size(number_text, max(value, float(number_text)), token, start, start + len(token)):
            return None
        return Literal(
            value=value,
            type=(kind, system),
            times=times,
            over=over,
            column=start,
        )


def _split_unit(token: str) -> tuple[str, str]:
    lower = token.lower()
    unit = max((u for u in UNITS if lower.endswith(u)), key=len, default="")
    return (token[: -len(unit)], token[-len(unit) :]) if unit else (token, "")


def _count_of_numbers(count: int | None) -> str:
    """How many numbers a function takes; None: one or more."""
    if count is None:
        return Phrase("at least one number")
    return plural(count, Phrase("{count} number", count=count), Phrase("{count} numbers", count=count))


def _words_of(form: StatementForm) -> str:
    """Which words a statement takes."""
    words = [word for word in form.words if word]
    return Phrase("it takes {words}", words=all_of(words)) if words else Phrase("it takes no words")


def _either(first: str, second: str) -> str:
    return Phrase("either {first} or {second}, not both", first=first, second=second)


def _arc_needs(words: dict[str, object]) -> tuple[list[str], str]:
    """The words that an ARC lacks, and a hint."""
    ends, centre, radius = {"X", "Y"} & words.keys(), {"I", "J"} & words.keys(), "R" in words
    if radius and centre:
        return [_either("R", "I J")], ""
    if not radius and not centre:
        return [Phrase("I and J, or R")], Phrase("; I J is the centre relative to the start, R the radius")
    if radius and not ends:
        return [any_of(("X", "Y"))], Phrase("; write a full circle with I J")
    return [], ""
