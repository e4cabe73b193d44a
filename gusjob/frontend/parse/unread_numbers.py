"""Numbers that the language does not have, such as 0x10, 1_000 and 10cm: what to write instead."""

from __future__ import annotations

import re

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule, Span
from gusjob.frontend.parse.forms import FORMS, StatementForm
from gusjob.frontend.parse.grammar import JOB_GRAMMAR, keywords
from gusjob.i18n.characters import quoted
from gusjob.i18n.phrases import Phrase, all_of
from gusjob.kinematics.units import UNITS, QuantityKind, spelling
from gusjob.patterns import lazy_pattern

Word = tuple[str, int, int]
"""A word of a line: its terminal in the grammar, its start and its end (grammar.words_of)."""

EXPECTED_KIND = {
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
"""What a word takes, by the kind of its number."""
POWER_KINDS = {QuantityKind.SHARE, QuantityKind.FREQUENCY, QuantityKind.VOLTAGE}
"""Kinds that a power can be written in."""

_DIGITS = lazy_pattern(r"[0-9.]*(?:e[-+]?[0-9]+)?", re.IGNORECASE | re.ASCII)
_RUN = lazy_pattern(r"[0-9A-Za-z_.,]+")
_BASES = (
    (lazy_pattern(r"0x[0-9a-f]+", re.IGNORECASE | re.ASCII), 16),
    (lazy_pattern(r"0o[0-7]+", re.IGNORECASE | re.ASCII), 8),
    (lazy_pattern(r"0b[01]+", re.IGNORECASE | re.ASCII), 2),
)
_GROUPED = lazy_pattern(r"[0-9]+(?:_[0-9]+)+(?:\.[0-9]*)?")
_COMMA = lazy_pattern(r"[0-9]+,[0-9][0-9.,]*")
_NO_EXPONENT = lazy_pattern(r"[0-9]*\.?[0-9]*e", re.IGNORECASE | re.ASCII)
_TWO_POINTS = lazy_pattern(r"[0-9]*\.[0-9]*\.[0-9.]*")
_UNIT = lazy_pattern(r"[A-Za-zµμ°²³\"'′″/%]+[0-9]?(?![0-9A-Za-z_])")
_OTHER_UNITS = frozenset(
    (
        *("nm", "cm", "dm", "km", "in", "inch", "inches", "mil", "thou", "ft", "µm", "μm"),
        *("ns", "min", "µs", "μs", "cm/s", "km/h", "in/s", "in/min", "m/min", "cm/min", "rpm"),
        *("ghz", "kw", "mw", "ma", "mj", "rad", "grad"),
    )
)
"""Units that the language has not. Apart from a number, any other word may be a misspelt one."""
_MAX_SHOWN = 40


def form_of(words: list[Word]) -> StatementForm | None:
    """The form of a line by its first words, None if they are not enough."""
    first, second, third = (*(kind for kind, _, _ in words[:3]), "", "", "")[:3]
    if first != "LASER":
        return FORMS.get(first) or FORMS.get(first.lower())
    if second == "MODE":
        return FORMS.get(third)
    return FORMS.get("laser_switch" if second in ("ON", "OFF") else f"laser_{second.lower()}")


def out_of_place(words: list[Word]) -> set[str]:
    """Keywords that the grammar accepts after these words, but not their statement: others' words, and given ones."""
    form = form_of(words)
    if form is None:
        return set()
    given = {kind for kind, _, _ in words} & {*form.words, *form.needs}
    other = {"I", "J"} if "R" in given else {"R"} if given & {"I", "J"} else set()
    return {*form.hints, *given, *other}


def not_decimal(text: str, words: list[Word], at: int, line: int) -> Diagnostic | None:
    """The diagnostic of a number that touches the offset which can't be read; None if it is decimal."""
    numbers = [(start, end) for kind, start, end in words if kind == "QUANTITY" and start < at]
    for start, end in numbers:
        run = _RUN.match(text, start)
        if run is not None and run.end() > at and (found := hexadecimal(text, start, end, line)) is not None:
            return found
    start = numbers[-1][0] if numbers else at
    run = _RUN.match(text, start)
    if run is None or not start < at < run.end() or not text[run.end() :].lstrip("+-")[:1].isascii():
        return None  # A character outside ASCII is another cause: 1E＋4, 1e+４.
    hint = _not_decimal(run[0])
    return None if hint is None else _diagnostic(rules.NOT_DECIMAL, line, start, run[0], hint=hint)


def unknown_unit(text: str, words: list[Word], at: int, line: int) -> Diagnostic | None:
    """The diagnostic of a text after a number that is none of the units; None if it may be something else."""
    numbers = [word for word in words if word[0] == "QUANTITY" and word[1] < at]
    if not numbers or text[numbers[-1][2] : at].strip():
        return None
    _, start, end = numbers[-1]
    digits = _DIGITS.match(text, start)
    first = digits.end() if end == at and digits is not None else at
    unit = _UNIT.match(text, first)
    if unit is None:
        return None
    known = unit[0].lower() in _OTHER_UNITS
    if not known and (end < at or unit[0].upper() in keywords(JOB_GRAMMAR)):
        return None
    kind = _kind_of([word for word in words if word[1] < start and word[0] not in ("PLUS", "MINUS")])
    return _diagnostic(rules.UNKNOWN_UNIT, line, first, unit[0], units=_units(kind))


def hexadecimal(text: str, start: int, end: int, line: int) -> Diagnostic | None:
    """The diagnostic of a number 0 that touches X and a hexadecimal digit: 0x10 is not 0 and X 10."""
    run = _RUN.match(text, start)
    if run is None or end - start != 1 or _BASES[0][0].match(text, start) is None:
        return None
    hint = _not_decimal(run[0]) or Phrase("; write a blank before {word}", word="X")
    return _diagnostic(rules.NOT_DECIMAL, line, start, run[0], hint=hint)


def _diagnostic(rule: Rule, line: int, start: int, text: str, **fields: object) -> Diagnostic:
    span = Span(line=line, column=start + 1, end_line=line, end_column=start + len(text) + 1)
    return Diagnostic(rule=rule, span=span, fields={"found": quoted(text[:_MAX_SHOWN]), **fields})


def _not_decimal(run: str) -> str | None:
    """What to write instead of a number that is not decimal; None for another text."""
    for pattern, base in _BASES:
        if pattern.fullmatch(run):
            value = str(int(run[2:], base)) if len(run) <= _MAX_SHOWN else Phrase("the decimal number")
            if base == 16:
                return Phrase("; write {value}, or a blank before {word}", value=value, word="X")
            return Phrase("; write {value}", value=value)
    if _GROUPED.fullmatch(run):
        return Phrase("; write {value}", value=run.replace("_", "")[:_MAX_SHOWN])
    if _COMMA.fullmatch(run):
        return Phrase("; write a decimal point, and no separator of thousands")
    if _NO_EXPONENT.fullmatch(run):
        return Phrase("; digits are missing after {letter}", letter=run[-1])
    return Phrase("; it has two decimal points") if _TWO_POINTS.fullmatch(run) else None


def _kind_of(words: list[Word]) -> QuantityKind | None:
    """The kind of the number that follows some words; None if it is not known, as in an expression."""
    form = form_of(words)
    if form is None:
        return None
    last = words[-1][0]
    name = last if last in form.words else "" if form.name.split()[-1] == last else None
    word = None if name is None else form.words.get(name)
    return None if word is None else word.kind


def _units(kind: QuantityKind | None) -> str:
    """The units for a kind, then all others."""
    own = POWER_KINDS if kind is QuantityKind.POWER else {kind}
    others = all_of(spelling(name) for name, unit in UNITS.items() if unit.kind not in own)
    if kind is None:
        return Phrase("the units are {others}", others=others)
    return Phrase("expected {expected}; other units are {others}", expected=EXPECTED_KIND[kind], others=others)
