"""TOML with the position of every key and value: the values come from tomllib, the positions from a scan of the text.

tomllib gives no positions, and neither does tomlkit. The scan runs only on a text that tomllib has accepted, so it
finds where keys and values begin and end and leaves all checks to tomllib.
"""

from __future__ import annotations

import re
import sys
from bisect import bisect_right
from contextlib import suppress
from typing import Any

from msgspec import Struct, field

from gusjob.diagnostics.model import Span
from gusjob.patterns import lazy_pattern


class TomlNode(Struct, frozen=True, kw_only=True):
    """A value with its position.

    `value`: a scalar, a dict of nodes (a table) or a list of nodes. `span`: the value as it is written; of a table with
    a header the name in the header, of a table made by dotted keys the part of the key. `key_span`: the key.
    """

    value: Any
    span: Span
    key_span: Span

    @property
    def plain(self) -> Any:
        """The value without positions."""
        match self.value:
            case dict():
                return {key: node.plain for key, node in self.value.items()}
            case list():
                return [node.plain for node in self.value]
            case _:
                return self.value


def parse_toml(text: str) -> TomlNode:
    """Parse a TOML text.

    Raises:
        tomllib.TOMLDecodeError: The text is not TOML.
        ValueError: An integer has more digits than Python converts.
        RecursionError: Its arrays are nested too deep.
    """
    import tomllib  # Most jobs have no profile: start-up time is part of the tool.

    return _joined(tomllib.loads(text), _SpanScanner(text).scan())


def error_span(message: str, text: str) -> Span:
    """Return the position in the message of a TOMLDecodeError; the end of the text if it names none."""
    found = re.search(r"at line (\d+), column (\d+)", message)
    lines = text.split("\n")
    line, column = (int(found[1]), int(found[2])) if found else (len(lines), len(lines[-1]) + 1)
    return Span(line=line, column=column, end_line=line, end_column=column + 1)


def long_integer_span(text: str) -> Span:
    """Return the position of the first integer that has more digits than Python converts; else the whole text."""
    found = re.search(rf"(?<=[=\[,\s])[+-]?\d(?:_?\d){{{sys.get_int_max_str_digits()},}}", text)
    if found is None:
        return Span(line=1)
    line, column = text.count("\n", 0, found.start()) + 1, found.start() - text.rfind("\n", 0, found.start())
    return Span(line=line, column=column, end_line=line, end_column=column + len(found[0]))


class _Spans(Struct):
    """The positions of a value and, in a table or an array, of its items."""

    key: Span
    value: Span
    items: dict[str, _Spans] | list[_Spans] = field(default_factory=dict)


def _joined(value: Any, spans: _Spans) -> TomlNode:
    """Join the values of tomllib with their positions. An item without a position has that of its container."""

    def of(key: str | int) -> _Spans:
        try:
            return spans.items[key]  # type: ignore[index]  # of a list by number, of a dict by name
        except (KeyError, IndexError):
            return _Spans(spans.key, spans.value)

    if isinstance(value, dict):
        value = {key: _joined(item, of(key)) for key, item in value.items()}
    elif isinstance(value, list):
        value = [_joined(item, of(index)) for index, item in enumerate(value)]
    return TomlNode(value=value, span=spans.value, key_span=spans.key)


_BLANKS = lazy_pattern(r"[ \t]*")
_SPACE = lazy_pattern(r"(?:[ \t\r\n]+|#[^\n]*)*")
"""Blanks, line ends and comments."""
_KEY = lazy_pattern(r"""[A-Za-z0-9_-]+|"(?:\\.|[^"\\\n])*"|'[^'\n]*'""")
_STRING = lazy_pattern(
    "|".join((r'"""(?:\\.|[^\\])*?""""{0,2}', r"'''.*?''''{0,2}", r'"(?:\\.|[^"\\\n])*"', r"'[^'\n]*'")), re.DOTALL
)
"""A string; a multi-line string may end in one or two quotes of its own."""
_SCALAR = lazy_pattern(r"[^,\]}#\r\n]+")

_Path = list[tuple[str, Span]]
"""The parts of a dotted key, each with its position."""


class _UnknownSyntaxError(Exception):
    """The text has a form that the scan does not know: of a newer TOML than 1.0."""


class _SpanScanner:
    """Finds the positions in a valid TOML text."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.line_starts = [0, *(found.end() for found in re.finditer("\n", text))]
        start = Span(line=1)
        self.root = _Spans(start, start)

    def scan(self) -> _Spans:
        """Return the positions in the whole text."""
        with suppress(_UnknownSyntaxError):  # What was found until there is right.
            self._document()
        return self.root

    def _document(self) -> None:
        table = self.root
        while self._skip(_SPACE) < len(self.text):
            if self.text[self.at] == "[":
                table = self._header()
            else:
                self._key_and_value(table)

    def _header(self) -> _Spans:
        """Scan `[a.b]` or `[[a.b]]` and return the table that it begins."""
        repeated = self.text.startswith("[[", self.at)
        self.at += 2 if repeated else 1
        path = self._path()
        self._expect("]]" if repeated else "]")
        whole = _between(path[0][1], path[-1][1])
        parent = _descend(self.root, path[:-1])
        name, span = path[-1]
        if not repeated:
            table = _table(parent, name, span)
            table.key, table.value = span, whole
            return table
        array = _items(parent).setdefault(name, _Spans(span, whole, []))
        table = _Spans(span, whole)
        if isinstance(array.items, list):
            array.items.append(table)
        return table

    def _key_and_value(self, table: _Spans) -> None:
        path = self._path()
        self._skip(_BLANKS)
        self._expect("=")
        self._skip(_BLANKS)
        name, span = path[-1]
        _items(_descend(table, path[:-1]))[name] = self._value(span)

    def _path(self) -> _Path:
        """Scan a key: its parts between dots."""
        parts: _Path = []
        while True:
            start = self._skip(_BLANKS)
            key = self._match(_KEY)
            parts.append((_unquoted(key), self._span(start, self.at)))
            self._skip(_BLANKS)
            if not self.text.startswith(".", self.at):
                return parts
            self.at += 1

    def _value(self, key: Span | None) -> _Spans:
        """Scan a value. `key`: the position of its key; an item of an array has none but its own."""
        start = self.at
        items: dict[str, _Spans] | list[_Spans] = {}
        match self.text[start : start + 1]:
            case "[":
                items = self._array()
            case "{":
                items = self._inline_table()
            case '"' | "'":
                self._match(_STRING)
            case _:
                self.at = start + len(self._match(_SCALAR).rstrip())
        span = self._span(start, self.at)
        return _Spans(key or span, span, items)

    def _array(self) -> list[_Spans]:
        items: list[_Spans] = []
        self._expect("[")
        while not self._ends("]"):
            items.append(self._value(None))
            self._comma()
        return items

    def _inline_table(self) -> dict[str, _Spans]:
        start = self._span(self.at, self.at)
        table = _Spans(start, start)
        self._expect("{")
        while not self._ends("}"):
            self._key_and_value(table)
            self._comma()
        return _items(table)

    def _ends(self, bracket: str) -> bool:
        """Skip to the next item; skip the closing bracket, if it is there instead."""
        self._skip(_SPACE)
        if not self.text.startswith(bracket, self.at):
            return False
        self.at += 1
        return True

    def _comma(self) -> None:
        self._skip(_SPACE)
        self.at += self.text.startswith(",", self.at)

    def _expect(self, text: str) -> None:
        if not self.text.startswith(text, self.at):
            raise _UnknownSyntaxError
        self.at += len(text)

    def _skip(self, pattern: re.Pattern[str]) -> int:
        """Skip what a pattern matches, perhaps nothing, and return the offset after it."""
        found = pattern.match(self.text, self.at)
        self.at = found.end() if found else self.at
        return self.at

    def _match(self, pattern: re.Pattern[str]) -> str:
        """Return the text that a pattern matches here, and skip it."""
        found = pattern.match(self.text, self.at)
        if found is None or not found[0]:
            raise _UnknownSyntaxError
        self.at = found.end()
        return found[0]

    def _span(self, start: int, end: int) -> Span:
        line, column = self._position(start)
        end_line, end_column = self._position(end)
        return Span(line=line, column=column, end_line=end_line, end_column=end_column)

    def _position(self, offset: int) -> tuple[int, int]:
        """Return line and column, from 1."""
        line = bisect_right(self.line_starts, offset)
        return line, offset - self.line_starts[line - 1] + 1


def _unquoted(key: str) -> str:
    """Return a part of a key without its quotes and escapes."""
    if key[0] == "'":
        return key[1:-1]
    if key[0] != '"':
        return key
    import tomllib

    try:
        (name,) = tomllib.loads(f"{key} = 0")
    except tomllib.TOMLDecodeError as error:
        raise _UnknownSyntaxError from error
    return name


def _between(first: Span, last: Span) -> Span:
    return Span(line=first.line, column=first.column, end_line=last.end_line, end_column=last.end_column)


def _items(table: _Spans) -> dict[str, _Spans]:
    """Return the items of a table; of an array of tables those of the last one."""
    while isinstance(table.items, list):
        if not table.items:
            raise _UnknownSyntaxError
        table = table.items[-1]
    return table.items


def _descend(table: _Spans, path: _Path) -> _Spans:
    """Follow the parts of a key; tables that are missing begin here."""
    for name, span in path:
        table = _table(table, name, span)
    return table


def _table(parent: _Spans, name: str, span: Span) -> _Spans:
    return _items(parent).setdefault(name, _Spans(span, span))
