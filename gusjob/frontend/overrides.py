"""Overrides of LETs: what a value may be. It is read as the right side of a LET is, with the same parser."""

from __future__ import annotations

from collections.abc import Iterable
from types import MappingProxyType

from gusjob.frontend.parse.statement import Statement
from gusjob.frontend.parse.statement_parser import parse_statement, strip_comment
from gusjob.frontend.scan.shapes import MAX_LINE
from gusjob.i18n.phrases import Phrase, printable
from gusjob.ir.overrides import Overrides
from gusjob.patterns import lazy_pattern

_NAME = lazy_pattern(r"[A-Za-z_][A-Za-z0-9_]*")
_SHOWN = 40
_EXPECTED = Phrase("a value is a number (60), a number with a unit (60%, 500mm/s) or an expression (2*pitch)")


def checked_overrides(pairs: Iterable[tuple[str, str]]) -> Overrides | Phrase:
    """Check names and values.

    Args:
        pairs: Names and values, in the user's order.

    Returns:
        The overrides; or a phrase that says why one of them can't be used.
    """
    found: dict[str, str] = {}
    for name, value in pairs:
        value = value.strip()
        if not _NAME.fullmatch(name):
            return Phrase("{name} is not a name: write NAME=VALUE, such as pitch=0.5mm", name=_shown(name) or "''")
        if name in found:
            return Phrase("{name} is given twice: {first} and {second}", name=name, first=found[name], second=value)
        if reason := _reserved(name) or _fault(name, value):
            return reason
        found[name] = value
    return MappingProxyType(found)


def override_statement(name: str, value: str) -> Statement:
    """Parse a checked override: the statement that takes the place of the LET in the text."""
    statement, _ = parse_statement(_let(name, value), 1)
    assert statement is not None
    return statement


def _let(name: str, value: str) -> str:
    return f"LET {name} = {value}"


def _reserved(name: str) -> Phrase | None:
    """Return why a name can't be that of a LET."""
    _, found = parse_statement(_let(name, "0"), 1)
    return found[0].phrase if found else None


def _fault(name: str, value: str) -> Phrase | None:
    """Return why a value is none."""
    text, name, shown = _let(name, value), _shown(name), _shown(value)
    if not value:
        return Phrase("{name} has no value: {expected}", name=name, expected=_EXPECTED)
    if len(text) > MAX_LINE:
        return Phrase("the value of {name} has more than {limit} characters", name=name, limit=MAX_LINE)
    if not value.isprintable() or strip_comment(text) != text:
        return Phrase("{name}={value} is not a value: {expected}", name=name, value=shown, expected=_EXPECTED)
    statement, found = parse_statement(text, 1)
    if statement is not None:
        return None
    return Phrase(
        "{name}={value} can't be read: {reason}; {expected}",
        name=name,
        value=shown,
        reason=found[0].phrase,
        expected=_EXPECTED,
    )


def _shown(text: str) -> str:
    shown = printable(text)
    return shown if len(shown) <= _SHOWN else f"{shown[: _SHOWN - 3]}..."
