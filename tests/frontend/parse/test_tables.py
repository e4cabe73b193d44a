"""The kept tables of the parser are those of the grammar: what they give reads and refuses the same lines."""

from __future__ import annotations

import json
from typing import Any

import lark
import pytest
from lark import Lark
from lark.exceptions import UnexpectedInput
from lark.grammar import Rule
from lark.lexer import TerminalDef
from support.tools import ROOT

from gusjob.frontend.parse.lines import fresh_parser, grammar_path, parser, tables_key, tables_path

NAME = "job.lark"


def kept() -> dict[str, Any]:
    if not tables_path(NAME).is_file():
        return {"key": ["", 0]}
    found: dict[str, Any] = json.loads(tables_path(NAME).read_text(encoding="utf-8"))
    return found


def test_tables_belong_to_the_grammar(rewrite: bool) -> None:
    text = grammar_path(NAME).read_text(encoding="utf-8")
    if rewrite and (not tables_path(NAME).is_file() or kept()["key"] != tables_key(text)):
        data, memo = fresh_parser(text).memo_serialize([TerminalDef, Rule])
        tables = json.dumps({"key": tables_key(text), "parser": {"data": data, "memo": memo}}, separators=(",", ":"))
        tables_path(NAME).write_text(tables + "\n", encoding="utf-8", newline="\n")
    assert kept()["key"][1] == tables_key(text)[1], "run pytest --rewrite"


def lines() -> list[str]:
    folders = (ROOT / "jobs", ROOT / "tests" / "bad")
    texts = [p.read_text(encoding="utf-8") for folder in folders for p in sorted(folder.rglob("*.job"))]
    return sorted({line.split(";")[0] for text in texts if len(text) < 20_000 for line in text.splitlines()})


def localized(reader: Lark, line: str) -> str:
    try:
        return reader.parse(line).pretty()
    except UnexpectedInput as error:
        accepts = getattr(error, "accepts", None) or getattr(error, "allowed", None) or set()
        return f"{type(error).__name__} {error.column} {sorted(map(str, accepts))}"


@pytest.mark.skipif(kept()["key"][0] != lark.__version__, reason="the tables are for another version of lark")
def test_tables_give_the_same_parser() -> None:
    fresh = fresh_parser(grammar_path(NAME).read_text(encoding="utf-8"))
    assert len(lines()) > 300
    for line in lines():
        assert localized(parser(NAME), line) == localized(fresh, line)
    assert tables_path(NAME).stat().st_size < 300_000
