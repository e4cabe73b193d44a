"""One line of a job to a Statement: which words a statement takes, of which kind, and which it needs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from lark import Token, Tree, UnexpectedInput

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule, Span
from gusjob.frontend.parse.expressions import (
    FUNCTIONS,
    NAMED_NUMBERS,
    NEGATE,
    Apply,
    Constant,
    Expression,
    Function,
    Literal,
    Named,
    Step,
    postfix,
)
from gusjob.frontend.parse.forms import CHANNEL_WORD, FORMS, RATIO_WORD, REF_WORD, Form, Word
from gusjob.frontend.parse.lines import END_OF_LINE, Misread, keywords, misread, nearest, parser, subtrees, tokens
from gusjob.frontend.scan.shapes import MAX_LINE, MAX_NUMBER
from gusjob.i18n.phrases import Phrase, all_of, any_of, did_you_mean, plural
from gusjob.kinematics.units import UNITS, PowerUnit, QuantityKind, spelling

GRAMMAR = "job.lark"
COMPARED = Phrase("; a comparison is written ==")
_TERMINALS = {
    **dict.fromkeys(("QUANTITY", "PLUS", "MINUS", "LPAR"), Phrase("a number")),
    **dict.fromkeys(("STAR", "SLASH", "MODULO", "POWER_OF"), Phrase("an operator")),
    **dict.fromkeys(("LT", "LE", "GT", "GE", "EQ", "NE"), Phrase("a comparison")),
    "RPAR": "')'",
    "COMMA": "','",
    "NAME": Phrase("a name"),
    "STRING": Phrase('a file in quotes, "setup.job"'),
}
CONTROLS = {"let", "repeat", "for", "if", "else", "end", "def", "call", "frame", "include"}
"""Forms that steer which statements are carried out, and how often."""

POWER_KINDS = {QuantityKind.SHARE, QuantityKind.FREQUENCY, QuantityKind.VOLTAGE}
WANTED = {
    QuantityKind.LENGTH: Phrase("a length (um, mm, pulse)"),
    QuantityKind.VELOCITY: Phrase("a velocity (mm/s, m/s, mm/min, pulse/ms)"),
    QuantityKind.ACCELERATION: Phrase("an acceleration (mm/s2, m/s2, pulse/ms2)"),
    QuantityKind.TIME: Phrase("a time (us, ms, s)"),
    QuantityKind.FREQUENCY: Phrase("a frequency (Hz, kHz, MHz)"),
    QuantityKind.SHARE: Phrase("a share (%)"),
    QuantityKind.VOLTAGE: Phrase("a voltage (V, mV)"),
    QuantityKind.ANGLE: Phrase("an angle (deg)"),
    QuantityKind.PLAIN: Phrase("a plain number without unit"),
    QuantityKind.POWER: Phrase("a power (%, kHz, V)"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """A number in canonical units of its kind, and where it stands (columns from 1, end behind).

    `times`, `over`: its unit's factors; `system`: a units.System, or a PowerUnit where the kind is POWER; `text` as
    written.
    """

    value: float
    times: float
    over: float
    system: int
    column: int
    end_column: int
    plain: bool
    """Sign and digits are one run and nothing else but a unit follows: a template may read it."""
    expression: Expression | None = None
    """Stands in parentheses: the value is found when the statement is carried out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """A line that was read.

    `form` is the key in FORMS; `options` the keywords that are no words with numbers (CW, OFF, NOW ...); `words` by
    keyword, '' for a positional number; `axes` of REF and RATIO of LASER DISTANCE; `channel` of CHANNEL at the end.

    Of those that steer: `names` (of a routine and its parameters, of a LET, of a loop's variable), `arguments` (bare
    expressions in their order), `text` of INCLUDE.
    """

    form: str
    name: str
    options: tuple[str, ...] = ()
    words: dict[str, Quantity] = field(default_factory=dict)
    axes: dict[str, dict[str, Quantity]] = field(default_factory=dict)
    channel: Quantity | None = None
    names: tuple[str, ...] = ()
    arguments: tuple[Expression, ...] = ()
    text: str = ""
    column: int = 1
    end_column: int = 1

    def span(self, line: int, word: str, path: str = "") -> Span:
        """Where `word` stands ('#0': the first argument); the whole statement if it has no such word."""
        found: Quantity | Expression | None = self.words.get(word) if word else None
        head, _, axis = word.partition(" ")
        if axis:
            found = self.axes.get(head, {}).get(axis)
        if word == "CHANNEL" and self.channel:
            found = self.channel
        elif word == "value":
            found = self.words.get("")
        elif word.startswith("#"):
            found = self.arguments[int(word[1:])] if int(word[1:]) < len(self.arguments) else None
        start, end = (found.column, found.end_column) if found else (self.column, self.end_column)
        return Span(line=line, column=start, end_line=line, end_column=end, path=path)

    @property
    def has_expressions(self) -> bool:
        """Whether a number of it is found when it is carried out."""
        quantities = [*self.words.values(), *(q for places in self.axes.values() for q in places.values())]
        quantities += [self.channel] if self.channel else []
        return any(q.expression is not None for q in quantities)


def strip_comment(line: str) -> str:
    """A line without its comment."""
    cut = min((i for i in (line.find(";"), line.find("//")) if i >= 0), default=len(line))
    return line[:cut]


def read_statement(text: str, line: int) -> tuple[Statement | None, list[Diagnostic]]:
    """A line (with or without comment) to its statement; None with diagnostics, or without any if the line is blank."""
    if len(text) > MAX_LINE:
        return None, [_at(rules.NO_END, line, 1, 2, size=len(text), limit=MAX_LINE)]
    text = strip_comment(text)
    try:
        tree = parser(GRAMMAR).parse(text)
    except UnexpectedInput as error:
        return None, [_unreadable(error, text, line)]
    if not tree.children:
        return None, []
    root = tree.children[0]
    assert isinstance(root, Tree)
    return _Reader(line=line, text=text).statement(root)


def _at(rule: Rule, line: int, column: int, end_column: int, **fields: object) -> Diagnostic:
    return Diagnostic(
        rule=rule, span=Span(line=line, column=column, end_line=line, end_column=end_column), fields=fields
    )


def _unreadable(error: UnexpectedInput, text: str, line: int) -> Diagnostic:
    diagnostic = misread(error, GRAMMAR, text, _TERMINALS)
    if not text[: diagnostic.column - 1].strip():
        return _at(
            rules.UNKNOWN_STATEMENT,
            line,
            diagnostic.column,
            diagnostic.end_column,
            found=diagnostic.found,
            hint=diagnostic.hint,
        )
    return _at(
        rules.UNEXPECTED,
        line,
        diagnostic.column,
        diagnostic.end_column,
        found=diagnostic.found,
        expected=diagnostic.expectation,
        hint=diagnostic.hint or _hint(text, diagnostic),
    )


def _hint(text: str, diagnostic: Misread) -> str:
    """What was probably meant."""
    if diagnostic.found is END_OF_LINE:
        return ""
    found = diagnostic.found.strip("'")
    before = text[: diagnostic.column - 1].split()
    if found == "=" and before and before[0].upper() == "IF":
        return COMPARED
    if found.lower() in UNITS and before and before[-1][-1:].isdigit():
        return Phrase("; a unit is glued to its number: {glued}", glued=f"{before[-1]}{found}")
    if before and before[0].upper() in ("ELSE", "END"):
        return Phrase("; {word} stands alone in its line", word=before[0].upper())
    if "a number" in diagnostic.expected and (found[:1].isalpha() or found[:1] == "_"):
        return Phrase("; a name or expression stands in parentheses: ({found})", found=found)
    if found in ("*", "/", "%", "+", "-", "**") and before:
        return Phrase("; an expression stands in parentheses")
    return ""


@dataclass(slots=True)
class _Reader:
    line: int
    text: str
    diagnostics: list[Diagnostic] = field(default_factory=list)

    def statement(self, tree: Tree[Token]) -> tuple[Statement | None, list[Diagnostic]]:
        column = len(self.text) - len(self.text.lstrip()) + 1
        end_column = len(self.text.rstrip()) + 1
        channel = None
        if tree.data == "laser":
            for tail in (t for t in subtrees(tree) if t.data == "tail"):
                channel = self.quantity(subtrees(tail)[0], CHANNEL_WORD, "CHANNEL")
            tree = next(t for t in subtrees(tree) if t.data != "tail")
        heads = [t.type for t in tokens(tree)]
        form_key = str(tree.data)
        if form_key == "modal":
            form_key = heads[0]
        elif form_key == "laser_mode":
            form_key = heads[1]
        form = FORMS[form_key]
        if form_key in CONTROLS and form_key != "frame":
            return self.control(tree, form_key, form, column, end_column)
        words: dict[str, Quantity] = {}
        axes: dict[str, dict[str, Quantity]] = {}
        chosen: set[str] = set()
        options = [h for h in heads if h not in form.name.split() or form_key in ("modal", "laser_switch")]
        for part in subtrees(tree):
            if part.data == "value":
                self.word(form, "", part, words)
            elif part.data == "word":
                if tokens(part)[0].type in chosen:
                    self.twice(tokens(part)[0])
                self.word(form, tokens(part)[0].type, subtrees(part)[0], words, tokens(part)[0])
            elif part.data == "choice":
                head, choice = tokens(part)[:2]
                if head.type in chosen or head.type in words:
                    self.twice(head)
                chosen.add(head.type)
                options.append(f"{head.type} {choice.type}")
            elif form_key == "frame":
                self.shift(tokens(part)[0], part, form, words)
            else:
                self.axes(tokens(part)[0], part, axes)
        self.needs(form, {**words, **axes}, options, column, end_column)
        if self.diagnostics:
            return None, self.diagnostics
        return Statement(
            form=form_key,
            name=form.name,
            options=tuple(options),
            words=words,
            axes=axes,
            channel=channel,
            column=column,
            end_column=end_column,
        ), []

    def control(
        self, tree: Tree[Token], form_key: str, form: Form, column: int, end_column: int
    ) -> tuple[Statement | None, list[Diagnostic]]:
        """A statement that steers: bare expressions, names, a text."""
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
            if form_key != "call":
                self.name(name)
            if form_key == "def" and name in names[1:i]:
                self.twice(name)
        if self.diagnostics:
            return None, self.diagnostics
        return Statement(
            form=form_key,
            name=form.name,
            names=tuple(map(str, names)),
            arguments=tuple(arguments),
            text=text,
            column=column,
            end_column=end_column,
        ), []

    def name(self, token: Token) -> None:
        """A name that a user gives to a number or a routine: no keyword, save those of one letter."""
        is_keyword = len(token) > 1 and token.upper() in keywords(GRAMMAR)
        if is_keyword or token in FUNCTIONS or token in NAMED_NUMBERS:
            hint = Phrase("write {name} or another name", name=f"{token}_1")
            self.diagnostics.append(self.token_fault(rules.RESERVED, token, word=str(token), hint=hint))

    def expression(self, root: Tree[Token] | Token, start: int = 0, end: int = 0) -> Expression | None:
        """A parsed expression as postfix code; it spans its own numbers and names, unless columns are given."""
        code: list[Step] = []
        constants: list[Literal] = []
        faults_before = len(self.diagnostics)
        first, last = MAX_LINE, 0
        for part in postfix(root):
            if isinstance(part, Apply):
                code.append(part)
                continue
            if isinstance(part, Named):
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
        if len(self.diagnostics) > faults_before:
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
        """A function by its name, if it takes so many numbers."""
        found = FUNCTIONS.get(token)
        if found is None:
            near = nearest(token, FUNCTIONS)
            hint = did_you_mean(near) or Phrase("; there are {words}", words=all_of(FUNCTIONS))
            self.diagnostics.append(self.token_fault(rules.NO_FUNCTION, token, word=str(token), hint=hint))
        elif count != (found.arity or max(count, 1)):
            wanted = _numbers(found.arity)
            self.diagnostics.append(self.token_fault(rules.ARITY, token, word=str(token), wanted=wanted, found=count))
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
        if max(value, float(number_text)) > MAX_NUMBER:
            self.too_big(token, start, start + len(token))
            return None
        # A sign in front belongs to the same run of digits where it touches them.
        sign = self.text[start - 2] if start > 1 else ""
        return Literal(
            value=value,
            type=(kind, system),
            times=-times if sign == "-" else times,
            over=over,
            column=start - (sign in ("+", "-") and sign != ""),
            plain="e" not in number_text.lower(),
        )

    def too_big(self, token: Token, start: int, end: int) -> None:
        shown = f"{token[:20]}{'...' * (len(token) > 20)}"
        self.diagnostics.append(_at(rules.TOO_BIG, self.line, start, end, value=shown, limit=MAX_NUMBER))

    def shift(self, head: Token, part: Tree[Token], form: Form, words: dict[str, Quantity]) -> None:
        """SHIFT X x Y y of FRAME."""
        if not subtrees(part):
            word = any_of(("X", "Y"))
            self.diagnostics.append(self.token_fault(rules.MISSING, head, statement="FRAME SHIFT", word=word, hint=""))
        for place in subtrees(part):
            self.word(form, tokens(place)[0].type, subtrees(place)[0], words, tokens(place)[0])

    def twice(self, token: Token) -> None:
        self.diagnostics.append(self.token_fault(rules.TWICE, token, word=str(token)))

    def token_fault(self, rule: Rule, token: Token, **fields: object) -> Diagnostic:
        start = token.column or 1
        return _at(rule, self.line, start, start + len(token), **fields)

    def axes(self, head: Token, part: Tree[Token], axes: dict[str, dict[str, Quantity]]) -> None:
        if head.type in axes:
            self.twice(head)
        found: dict[str, Quantity] = {}
        for word in subtrees(part):
            axis = tokens(word)[0]
            kind = REF_WORD if head.type == "REF" else RATIO_WORD
            if axis.type in found:
                self.twice(axis)
            quantity = self.quantity(subtrees(word)[0], kind, f"{head.type} {axis.type}")
            if quantity:
                found[axis.type] = quantity
        for axis_name in "XY":
            if axis_name not in found and not self.diagnostics:
                hint = Phrase("; it needs X and Y, Z and A are free")
                self.diagnostics.append(
                    self.token_fault(
                        rules.MISSING, head, statement=f"LASER DISTANCE {head.type}", word=axis_name, hint=hint
                    )
                )
        axes[head.type] = found

    def word(
        self, form: Form, name: str, value: Tree[Token], words: dict[str, Quantity], token: Token | None = None
    ) -> None:
        if token is not None and name not in form.words:
            hint = form.hints.get(name) or _takes(form)
            self.diagnostics.append(self.token_fault(rules.FOREIGN, token, word=name, statement=form.name, hint=hint))
            return
        if name in words and token is not None:
            self.twice(token)
            return
        quantity = self.quantity(value, form.words[name], f"{form.name} {name}".strip())
        if quantity is not None:
            words[name] = quantity

    def needs(self, form: Form, words: dict[str, object], options: list[str], column: int, end_column: int) -> None:
        if "OFF" in options:
            return
        missing = [w for w in form.needs if w not in words]
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
                self.diagnostics.append(
                    _at(rules.MISSING, self.line, column, end_column, statement=form.name, word=word, hint=hint)
                )

    def group(self, value: Tree[Token]) -> Quantity | None:
        """An expression in parentheses, with or without a sign in front."""
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
            value=math.nan, times=1.0, over=1.0, system=0, column=start, end_column=end, plain=False,
            expression=expression,
        )  # fmt: skip

    def quantity(self, value: Tree[Token], word: Word, what: str) -> Quantity | None:
        if subtrees(value):
            return self.group(value)
        parts = tokens(value)
        token = parts[-1]
        sign = parts[0] if len(parts) > 1 else token
        start, end = sign.column or 1, (token.column or 1) + len(token)
        number_text, unit_text = _split_unit(str(token))
        times, over, system = 1.0, 1.0, 0
        if unit_text:
            unit = UNITS[unit_text.lower()]
            if unit.kind is not word.kind and not (word.kind is QuantityKind.POWER and unit.kind in POWER_KINDS):
                self.diagnostics.append(
                    _at(
                        rules.WRONG_UNIT,
                        self.line,
                        start,
                        end,
                        what=what,
                        wanted=WANTED[word.kind],
                        unit=spelling(unit_text),
                        kind=unit.kind.words,
                        hint="",
                    )
                )
                return None
            times, over, system = unit.times, unit.over * (1000.0 if word.ms else 1.0), unit.system
        magnitude = float(number_text)
        if magnitude > MAX_NUMBER or magnitude * times / over > MAX_NUMBER:
            self.too_big(token, start, end)
            return None
        signed = (-magnitude if sign.type == "MINUS" else magnitude) + 0.0
        glued = sign is token or (sign.column or 0) + 1 == token.column
        return Quantity(
            value=signed * times / over,
            times=times,
            over=over,
            system=system,
            column=start,
            end_column=end,
            plain=glued and "e" not in number_text.lower(),
        )


def _split_unit(token: str) -> tuple[str, str]:
    lower = token.lower()
    unit = max((u for u in UNITS if lower.endswith(u)), key=len, default="")
    return (token[: -len(unit)], token[-len(unit) :]) if unit else (token, "")


def _numbers(count: int | None) -> str:
    """How many numbers a function takes; None: one or more."""
    if count is None:
        return Phrase("at least one number")
    return plural(count, Phrase("{count} number", count=count), Phrase("{count} numbers", count=count))


def _takes(form: Form) -> str:
    """Which words a statement takes."""
    words = [word for word in form.words if word]
    return Phrase("it takes {words}", words=all_of(words)) if words else Phrase("it takes no words")


def _either(first: str, second: str) -> str:
    return Phrase("either {first} or {second}, not both", first=first, second=second)


def _arc_needs(words: dict[str, object]) -> tuple[list[str], str]:
    ends, centre, radius = {"X", "Y"} & words.keys(), {"I", "J"} & words.keys(), "R" in words
    if radius and centre:
        return [_either("R", "I J")], ""
    if not radius and not centre:
        return [Phrase("I and J, or R")], Phrase("; I J is the centre relative to the start, R the radius")
    if radius and not ends:
        return [any_of(("X", "Y"))], Phrase("; a full circle is written with I J")
    return [], ""


def unit_of(quantity: Quantity | None) -> PowerUnit:
    """The unit a power was written in."""
    return PowerUnit(quantity.system) if quantity else PowerUnit.NONE
