"""The scan for positions agrees with tomllib: on every key and value, in every spelling of TOML."""

from __future__ import annotations

import datetime
import math
import tomllib
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gusjob.config.toml_spans import TomlNode, _Spans, _SpanScanner, parse_toml
from gusjob.diagnostics.model import Span


def text_at(text: str, span: Span) -> str:
    lines = text.split("\n")
    inside = lines[span.line - 1 : span.end_line]
    inside[-1] = inside[-1][: span.end_column - 1]
    inside[0] = inside[0][span.column - 1 :]
    return "\n".join(inside)


def same(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return one == other or (math.isnan(one) and math.isnan(other))
    if isinstance(one, dict) and isinstance(other, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    return type(one) is type(other) and one == other


def check_structure(data: Any, spans: _Spans) -> None:
    """The scan has found just the keys and items that tomllib has."""
    if isinstance(data, dict):
        assert isinstance(spans.items, dict)
        assert set(spans.items) == set(data)
        for key, value in data.items():
            check_structure(value, spans.items[key])
    elif isinstance(data, list):
        assert isinstance(spans.items, list)
        assert len(spans.items) == len(data)
        for value, inner in zip(data, spans.items, strict=True):
            check_structure(value, inner)
    else:
        assert not spans.items


def check_texts(text: str, node: TomlNode, key: str | None = None) -> None:
    """The text at a value's span is the value; that at a key's span is the key."""
    if key is not None:
        assert key in tomllib.loads(f"{text_at(text, node.key_span)} = 0")
    if isinstance(node.value, dict):
        for name, child in node.value.items():
            check_texts(text, child, name)
        if text_at(text, node.span).startswith("{"):
            assert same(tomllib.loads(f"a = {text_at(text, node.span)}")["a"], node.plain)
        return
    if isinstance(node.value, list):
        for child in node.value:
            check_texts(text, child)
        if not text_at(text, node.span).startswith("["):
            return  # Of tables with headers.
    assert same(tomllib.loads(f"a = {text_at(text, node.span)}")["a"], node.plain)


def check(text: str) -> None:
    data = tomllib.loads(text)
    node = parse_toml(text)
    assert same(node.plain, data)
    check_structure(data, _SpanScanner(text).scan())
    for key, child in node.value.items():
        check_texts(text, child, key)


ODD = (
    "",
    "# only a comment",
    "a=1",
    "a = 1 # b = 2\r\n\r\nb = 2\r\n",
    'a = "x # y" # z\nb = \'[c]\'\n[d]\ne = """\n[f]\ng = 1\n"""\nh = 2',
    'a = \'\'\'\'\'x\'\'\'\'\'\nb = \'\'\'\n\'\'\'\nc = """""x"""""\nd = """\\""""\ne = ""\nf = \'\'',
    "a = [[1, [2]], [], [{}, {b = 1}], # c\n [ # d\n3 , 4 ,\n] ,\n]",
    "a.b.c = 1\na.b.d = 2\na . \"e.f\" . 'g' = 3",
    "a = {b.c = 1, b.d = {e = [1, 2]}, 'f g' = {}}",
    "[a.b]\nc = 1\n[a]\nd = 2\n[ a . e ]\nf = 3\n",
    "[[a]]\nb = 1\n[[a]]\n[a.c]\nd = 2\n[[a.e]]\nf = 1\n[[a.e]]\nf = 2\n[[a]]\n[[a.e]]\n",
    "a = 1979-05-27 07:32:00\nb = 1979-05-27T07:32:00.999-07:00 # c\nd = [07:32:00, 1979-05-27]",
    "a = -inf\nb = +nan\nc = 0xDEAD_BEEF\nd = 1_000e-2\ne = true",
    '"" = 1\n"\\u00e9\\t" = 2\n\'"\' = 3\n1234 = 4\n3.14 = 5\n-_ = 6',
    "\ta\t=\t1\t\n\t[b]\t\n\tc\t=\t2\t",
    "[[a]] # b\n[[a]]# c\n[d]# e",
)


@pytest.mark.parametrize("text", ODD)
def test_odd_spellings(text: str) -> None:
    check(text)


KEYS = st.one_of(
    st.text("abz019_-", min_size=1, max_size=4),
    st.text(st.characters(blacklist_categories=("Cs", "Cc")), max_size=5),
)
SCALARS = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(),
    st.text(st.characters(blacklist_categories=("Cs", "Cc")), max_size=8),
    st.datetimes(min_value=datetime.datetime(1000, 1, 1)),
    st.dates(min_value=datetime.date(1000, 1, 1)),
    st.times(),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(KEYS, inner, max_size=3)),
    max_leaves=12,
)
TABLES = st.dictionaries(KEYS, VALUES, max_size=5)


class Speller:
    """Writes data as TOML, in a spelling that is drawn for each key and value."""

    def __init__(self, draw: st.DrawFn) -> None:
        self.draw = draw

    def one_of(self, *choices: str) -> str:
        return self.draw(st.sampled_from(choices))

    def basic(self, text: str) -> str:
        return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'

    def key(self, key: str) -> str:
        spellings = [self.basic(key)]
        if key and all(c.isascii() and (c.isalnum() or c in "_-") for c in key):
            spellings.append(key)
        if "'" not in key:
            spellings.append(f"'{key}'")
        return self.one_of(*spellings)

    def space(self) -> str:
        return self.one_of("", "", " ", "\n", " # ] } , = \" '''\n", "\r\n\t")

    def value(self, value: Any) -> str:
        match value:
            case bool():
                return str(value).lower()
            case float():
                return str(value)
            case int():
                return self.one_of(str(value), f"{value:_}")
            case str():
                spellings = [self.basic(value), f'"""\n{self.basic(value)[1:-1]}"""']
                if "'" not in value:
                    spellings += [f"'{value}'", f"'''{value}'''"]
                return self.one_of(*spellings)
            case list():
                items = "".join(f"{self.space()}{self.value(item)}{self.space()}," for item in value)
                return f"[{items[: -1 if value and self.one_of('', ',') else None]}{self.space()}]"
            case dict():
                return "{" + ", ".join(f"{self.key(k)} = {self.value(v)}" for k, v in value.items()) + "}"
            case datetime.datetime():
                return value.isoformat(self.one_of("T", " "))
            case _:
                return str(value.isoformat())

    def table(self, table: dict[str, Any], path: tuple[str, ...] = ()) -> str:
        """First the entries of a table, then its tables with headers; some tables are inline or dotted."""
        lines, tables = list[str](), list[str]()
        for key, value in table.items():
            inner = (*path, key)
            header = self.one_of(".", " . ").join(map(self.key, inner))
            style = self.one_of("inline", "header", "dotted")
            if isinstance(value, dict) and style == "header":
                tables.append(f"[{self.one_of('', ' ')}{header}] # {key!r}\n" + self.table(value, inner))
            elif isinstance(value, dict) and value and style == "dotted":
                lines += [f"{self.key(key)}.{self.key(k)} = {self.value(v)}" for k, v in value.items()]
            elif isinstance(value, list) and value and all(isinstance(v, dict) for v in value) and style == "header":
                tables += [f"[[{header}]]\n" + self.table(v, inner) for v in value]
            else:
                lines.append(f"{self.key(key)}{self.one_of('=', ' = ')}{self.value(value)}{self.one_of('', ' # = ]')}")
        return "\n".join([*lines, *tables]) + "\n"


@st.composite
def documents(draw: st.DrawFn) -> tuple[str, dict[str, Any]]:
    data = draw(TABLES)
    return Speller(draw).table(data), data


@given(documents())
@settings(max_examples=300)
def test_every_spelling(document: tuple[str, dict[str, Any]]) -> None:
    text, data = document
    assert same(sorted_tables(tomllib.loads(text)), sorted_tables(data)), "the speller is wrong"
    check(text)


def sorted_tables(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: sorted_tables(data[key]) for key in sorted(data)}
    return [sorted_tables(item) for item in data] if isinstance(data, list) else data


@given(st.text("a.b=[]{}\"'#,\\ \n1-:", max_size=40))
@settings(max_examples=300)
def test_a_scan_ends_on_any_text(text: str) -> None:
    """Also on a text that tomllib refuses; on one that it takes, the scan agrees with it."""
    scanned = _SpanScanner(text).scan()
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    check_structure(data, scanned)
