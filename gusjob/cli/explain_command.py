"""gusjob explain."""

from __future__ import annotations

import json
import sys
from textwrap import indent
from typing import Any

import click

from gusjob.cli.completion import complete_code
from gusjob.cli.formats import FormatChoice
from gusjob.cli.language import Command
from gusjob.diagnostics.model import Rule, name_of
from gusjob.diagnostics.rules import RULES
from gusjob.diagnostics.rules.fixable import FIX_OF_RULE
from gusjob.diagnostics.rules.messages import example_message
from gusjob.i18n.language import translated
from gusjob.i18n.phrases import Phrase, any_of, localized, printable
from gusjob.i18n.spelling import nearest_ones
from gusjob.i18n.width import padded, wrapped
from gusjob.patterns import lazy_pattern

EXPLAIN_SCHEMA = "gusjob-explain/1"


@click.command(name="explain", cls=Command)
@click.argument("codes", metavar="[RULE]...", nargs=-1, shell_complete=complete_code)
@click.option(
    "--format", "form", type=FormatChoice(["text", "json"]), default="text", show_default=True,
    help="text for people, json for programs.",
)  # fmt: skip
def command(codes: tuple[str, ...], form: str) -> None:
    """Explain rules, each with a message, a bad and a good example.

    A RULE is a code, such as GJ402, or a name: the rule's title with hyphens, jump-with-the-laser-on. Without a RULE,
    list all rules; with a prefix of codes, such as GJ4, list the rules that it matches.
    """
    by_name = {rule.name: rule.code for rule in RULES.values()}
    names = tuple(by_name.get(name_of(code), code.upper()) for code in codes)
    are_prefixes = all(any(known.startswith(name) for known in RULES) for name in names)
    is_list = are_prefixes and not any(name in RULES for name in names)
    unknown = [] if is_list else [code for code, name in zip(codes, names, strict=True) if name not in RULES]
    for code in unknown:
        near = nearest_ones(code.upper(), RULES, 3) or nearest_ones(name_of(code), by_name, 3)
        hint = Phrase("; did you mean {near}?", near=any_of(near)) if near else ""
        text = Phrase("there is no rule {code}{hint}", code=printable(code), hint=hint)
        click.echo(f"gusjob: {localized(text)}", err=True)
    if unknown:
        sys.exit(2)
    rules = [rule for rule in RULES.values() if not names or rule.code.startswith(names)]
    rules = rules if is_list else [RULES[name] for name in names]
    if form == "json":
        explained = {"schema": EXPLAIN_SCHEMA, "rules": [_rule_object(rule) for rule in rules]}
        click.echo(json.dumps(explained, indent=2, ensure_ascii=False))
    elif is_list:
        for rule in rules:
            click.echo(f"{rule.code}  {padded(rule.severity.localized, 7)}  {translated(rule.title)}")
    else:
        click.echo("\n".join(explanation(rule) for rule in rules), nl=False)


def explanation(rule: Rule) -> str:
    """Return the description of a rule with its examples."""
    section = localized(Phrase(" (manual, {section})", section=rule.section)) if rule.section else ""
    name = f" ({rule.name})" if translated(rule.title) != rule.title else ""
    message = example_message(rule)
    text = _FIELD.sub("...", translated(rule.text)) if message is None else localized(message)
    parts = [
        f"{rule.code} {rule.severity.localized}: {translated(rule.title)}{name}{section}\n",
        indent(wrapped(text, _COLUMNS), "  ") + "\n",
        wrapped(translated(rule.why), _COLUMNS) + "\n",
    ]
    if rule.code in FIX_OF_RULE:
        parts.append(localized(_FIXABLE) + "\n")
    if rule.bad:
        parts.append(localized(_BAD) + "\n" + _example(rule.bad))
    if rule.good:
        parts.append(localized(_GOOD) + "\n" + _example(rule.good))
    return "\n".join(parts)


_COLUMNS = 100
_MAX_LINES = 16
"""Of a longer example the middle is left out."""
_FIELD = lazy_pattern(r"\{\w+\}")
_BAD, _GOOD = Phrase("bad:"), Phrase("good:")
_FIXABLE = Phrase("`gusjob check --fix` corrects it where only one correction is possible.")


def _rule_object(rule: Rule) -> dict[str, Any]:
    """Return a rule as it is in the JSON, in English."""
    message = example_message(rule)
    return {
        "code": rule.code,
        "name": rule.name,
        "severity": rule.severity.value,
        "title": rule.title,
        "text": rule.text,
        "message": None if message is None else str(message),
        "why": rule.why,
        "fixable": rule.code in FIX_OF_RULE,
        "bad": rule.bad,
        "good": rule.good,
        "section": rule.section,
    }


def _example(text: str) -> str:
    lines = text.splitlines()
    if len(lines) > _MAX_LINES:
        lines = [*lines[:3], "...", *lines[-3:]]
    return indent("\n".join(lines), "    ") + "\n"
