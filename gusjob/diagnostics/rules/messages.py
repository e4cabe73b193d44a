"""An example message of each rule, as gusjob printed it: `gusjob explain` shows it.

messages.json holds the fields of a diagnostic of each rule. tests/diagnostics/test_rules.py writes it (--rewrite) from
the rules' bad examples and from tests/bad, and compares it with what the checker reports.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from gusjob.diagnostics.model import Rule
from gusjob.i18n.phrases import Phrase

MESSAGES_PATH = Path(__file__).with_name("messages.json")


def example_message(rule: Rule) -> Phrase | None:
    """The message of a diagnostic of a rule; None for a rule that only a run on hardware reports."""
    found = _messages().get(rule.code)
    return None if found is None else _phrase(found)


def to_object(phrase: Phrase) -> dict[str, Any]:
    """A message as it is in messages.json."""
    fields = {name: to_object(v) if isinstance(v, Phrase) else _plain(v) for name, v in phrase.fields.items()}
    return {"text": phrase.template, "fields": fields}


def _plain(value: Any) -> Any:
    return value if isinstance(value, (str, int, float)) else str(value)


@cache
def _messages() -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = json.loads(MESSAGES_PATH.read_text(encoding="utf-8"))
    return found


def _phrase(found: dict[str, Any]) -> Phrase:
    fields = {name: _phrase(v) if isinstance(v, dict) else v for name, v in found["fields"].items()}
    return Phrase(found["text"], **fields)
