"""The TextMate grammar of jobs, generated from the grammar's keywords, the units and the functions."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from gusjob.frontend.parse.forms import FORMS
from gusjob.frontend.parse.grammar import JOB_GRAMMAR, keywords
from gusjob.frontend.parse.operators import FUNCTIONS, NAMED_NUMBERS
from gusjob.frontend.parse.statement import CONTROL_FORMS
from gusjob.kinematics.units import UNITS

GRAMMAR_PATH = Path(__file__).with_name("static") / "gusjob.tmLanguage.json"
_OPERATORS = {"AND", "OR", "NOT"}


def _any_of(words: list[str]) -> str:
    return "|".join(re.escape(word) for word in sorted(words, key=lambda word: (-len(word), word)))


def textmate() -> str:
    """Generate the grammar as JSON. A keyword may be followed by a digit (X10), as in grammar/job.lark."""
    control_words = sorted(
        {word for form in CONTROL_FORMS for word in FORMS[form].name.split()} | {"AS", "FROM", "TO", "STEP"}
    )
    words = keywords(JOB_GRAMMAR)
    others = sorted(words - set(control_words) - _OPERATORS)
    number = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:e[+-]?[0-9]+)?"
    units = _any_of(list(UNITS))
    patterns: list[dict[str, Any]] = [
        {"name": "comment.line.gusjob", "match": r"(?:;|//).*$"},
        {"name": "string.quoted.double.gusjob", "match": '"[^"]*"'},
        {
            "match": rf"(?i)({number})(?:({units})(?![a-z0-9_]))?",
            "captures": {"1": {"name": "constant.numeric.gusjob"}, "2": {"name": "keyword.other.unit.gusjob"}},
        },
        {"name": "keyword.control.gusjob", "match": rf"(?i)\b(?:{_any_of(control_words)})(?![A-Za-z_])"},
        {"name": "keyword.operator.word.gusjob", "match": rf"(?i)\b(?:{_any_of(sorted(_OPERATORS))})\b"},
        {"name": "support.function.gusjob", "match": rf"\b(?:{_any_of(list(FUNCTIONS))})(?=\s*\()"},
        {"name": "constant.language.gusjob", "match": rf"\b(?:{_any_of(list(NAMED_NUMBERS))})\b"},
        {"name": "keyword.other.gusjob", "match": rf"(?i)(?<![A-Za-z_])(?:{_any_of(others)})(?![A-Za-z_])"},
        {"name": "variable.other.gusjob", "match": r"\b[A-Za-z_][A-Za-z0-9_]*\b"},
    ]
    grammar = {
        "$schema": "https://raw.githubusercontent.com/martinring/tmlanguage/master/tmlanguage.json",
        "name": "gusjob",
        "scopeName": "source.gusjob",
        "fileTypes": ["job"],
        "patterns": patterns,
    }
    return json.dumps(grammar, indent=2) + "\n"
