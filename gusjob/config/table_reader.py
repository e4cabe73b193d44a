"""Read TOML tables into records by the entries in the annotations of their fields."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Any

from msgspec import Struct, field

from gusjob.config.entry import Entry, entries_of
from gusjob.config.machine import SCANNER_FORM, Scanner, parse_scanner
from gusjob.config.toml_spans import TomlNode
from gusjob.controllers.gus.ranges import Range
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule, Span
from gusjob.i18n.phrases import Phrase, all_of, did_you_mean, number, printable
from gusjob.kinematics.float_noise import settled_one

_NUMBER, _TEXT, _TABLE, _BOOLEAN = Phrase("a number"), Phrase("a text"), Phrase("a table"), Phrase("true or false")
_TWO_NUMBERS = Phrase("a list of two numbers")
_SCANNER_TEXT = Phrase('a text such as "first-order:250us"')
_ASCENDING, _UNIQUE = Phrase("[low, high] with low < high"), Phrase("unique: another table has this value")
MISSING = Phrase("missing")
_TYPES: dict[str, str] = {
    "bool": _BOOLEAN,
    "int": _NUMBER,
    "float": _NUMBER,
    "str": _TEXT,
    "list": Phrase("a list"),
    "dict": _TABLE,
    "date": Phrase("date"),
    "time": Phrase("time"),
    "datetime": Phrase("datetime"),
}
_MAX_QUOTED = 40
"""The number of characters of a wrong text that are shown."""


class TableReader(Struct, kw_only=True):
    """Reads tables and collects the diagnostics of one profile. What is wrong is left out of the result."""

    path: str
    diagnostics: list[Diagnostic] = field(default_factory=list)

    def report(self, rule: Rule, span: Span, key: str, **fields: Any) -> None:
        """Report what is wrong with an entry."""
        self.diagnostics.append(Diagnostic(rule=rule, span=span, fields={"key": key, **fields}, path=self.path))

    def report_type(self, node: TomlNode, key: str, wanted: str) -> None:
        """Report a value of the wrong type."""
        self.report(rules.PROFILE_TYPE, node.span, key, wanted=wanted, found=type_name(node.value))

    def report_range(self, node: TomlNode, key: str, value: str, allowed: str) -> None:
        """Report a value out of range."""
        self.report(rules.PROFILE_RANGE, node.span, key, value=value, range=allowed)

    def fields(
        self, node: TomlNode, table: type, name: str = "", prefix: str = "", extra: tuple[str, ...] = ()
    ) -> dict[str, Any]:
        """Read a table into the arguments of a record.

        Args:
            node: The table.
            table: The type of the record.
            name: The name of the table in the profile.
            prefix: The part of the record's dotted keys that names this table.
            extra: Keys that are read elsewhere.
        """
        if not isinstance(node.value, dict):
            self.report_type(node, name, _TABLE)
            return {}
        entries = {key.removeprefix(prefix): e for key, e in entries_of(table).items() if key.startswith(prefix)}
        known = [*dict.fromkeys(key.partition(".")[0] for key in entries), *extra]
        found: dict[str, Any] = {}
        for key, child in node.value.items():
            full_key = f"{name}.{key}" if name else key
            if key in entries and "." not in key:  # A quoted key with a dot is not a dotted key.
                field_name, entry = entries[key]
                value = self.value(child, entry, full_key)
                if value is not None:
                    found[field_name] = value
            elif key not in known:
                self.report_unknown(child, full_key, key, known)
            elif key not in extra:
                found |= self.fields(child, table, full_key, prefix=f"{prefix}{key}.")
        return found

    def report_unknown(self, node: TomlNode, full_key: str, key: str, known: list[str]) -> None:
        """Report an entry that the profile does not have."""
        from difflib import get_close_matches

        near = get_close_matches(key, known, 1)
        self.report(rules.PROFILE_UNKNOWN, node.key_span, full_key, hint=did_you_mean(near[0] if near else ""))

    def value(self, node: TomlNode, entry: Entry, key: str) -> Any:
        """Return the value of an entry, None with a diagnostic if it is wrong."""
        kind = entry.kind
        if isinstance(kind, Range):
            return self._pair(node, entry, kind, key) if entry.pair else self._number(node, kind, key)
        if issubclass(kind, Struct) and kind is not Scanner:
            return self._tables(node, kind, key) if entry.repeated else self._table(node, kind, key)
        if kind is bool:
            if isinstance(node.value, bool):
                return node.value
            self.report_type(node, key, _BOOLEAN)
            return None
        if not isinstance(node.value, str):
            self.report_type(node, key, _SCANNER_TEXT if kind is Scanner else _TEXT)
            return None
        if kind is Scanner:
            scanner = parse_scanner(node.value)
            if isinstance(scanner, Scanner):
                return scanner
            self.report_range(node, key, quoted(node.value), SCANNER_FORM)
            return None
        if issubclass(kind, StrEnum):
            if node.value in list(kind):
                return kind(node.value)
            self.report_range(node, key, quoted(node.value), Phrase("one of {names}", names=all_of(kind)))
            return None
        return node.value

    def _table(self, node: TomlNode, table: type, key: str) -> Any:
        before = len(self.diagnostics)
        found = self.fields(node, table, key)
        return table(**found) if len(self.diagnostics) == before else None

    def _tables(self, node: TomlNode, table: type, key: str) -> Any:
        """Read an array of tables; a value that is to be unique counts for the first one that has it."""
        if not isinstance(node.value, list):
            self.report_type(node, key, Phrase("a list of tables, [[{key}]]", key=key))
            return None
        unique = [(k, name) for k, (name, entry) in entries_of(table).items() if entry.unique]
        found: list[Any] = []
        for child in node.value:
            row = self._table(child, table, key)
            if row is None:
                continue
            found.append(row)
            for inner, name in unique:
                value = getattr(row, name)
                if any(getattr(other, name) == value for other in found[:-1]):
                    written = child.value.get(inner)
                    shown = Phrase("{value} (the default)", value=value) if written is None else number(value)
                    self.report_range(written or child, f"{key}.{inner}", shown, _UNIQUE)
        return tuple(found)

    def _pair(self, node: TomlNode, entry: Entry, limits: Range, key: str) -> tuple[float, float] | None:
        single = entry.single and not isinstance(node.value, list)
        items = [node] if single else node.value
        if not isinstance(items, list) or (len(items) != 2 and not single):
            found = Phrase("a list of {count}", count=len(items)) if isinstance(items, list) else type_name(node.value)
            self.report(rules.PROFILE_TYPE, node.span, key, wanted=_TWO_NUMBERS, found=found)
            return None
        values = [self._number(item, limits, key) for item in items]
        first, second = values[0], values[-1]
        if first is None or second is None:
            return None
        if entry.ascending and first >= second:
            self.report_range(node, key, str([first, second]), _ASCENDING)
            return None
        return first, second

    def _number(self, node: TomlNode, limits: Range, key: str) -> float | None:
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            self.report_type(node, key, _NUMBER)
            return None
        try:
            value = settled_one(float(node.value))
        except OverflowError:
            value = math.inf
        if limits.classify_one(value) or not limits.carries(value):
            self.report_range(node, key, number(value), within(limits))
            return None
        return int(value) if limits.whole else value


def type_name(value: object) -> str:
    """Return the type of a TOML value in words."""
    name = type(value).__name__
    return _TYPES.get(name, name)


def quoted(text: str) -> str:
    """Return a wrong text as it is shown in a message."""
    return f'"{printable(text)[:_MAX_QUOTED]}"'


def within(allowed: Range) -> str:
    """Return a range as it is shown in a message."""
    return Phrase("in {range}", range=str(allowed))
