"""gusjob explain."""

from __future__ import annotations

import sys
from textwrap import indent

import click

from gusjob.cli.completion import complete_code
from gusjob.cli.language import Command
from gusjob.diagnostics.model import Rule
from gusjob.diagnostics.rules import RULES
from gusjob.i18n.language import translated
from gusjob.i18n.phrases import Phrase, did_you_mean, localized, nearest, printable
from gusjob.i18n.width import padded, wrapped


@click.command(name="explain", cls=Command)
@click.argument("codes", metavar="[CODE]...", nargs=-1, shell_complete=complete_code)
def command(codes: tuple[str, ...]) -> None:
    """Explain rules, each with a bad and a good example.

    Without a CODE, list all rules; with a prefix of codes, such as GJ4, list the rules that it matches.
    """
    names = tuple(code.upper() for code in codes)
    are_prefixes = all(any(known.startswith(name) for known in RULES) for name in names)
    if are_prefixes and not any(name in RULES for name in names):
        for rule in RULES.values():
            if not names or rule.code.startswith(names):
                click.echo(f"{rule.code}  {padded(rule.severity.localized, 7)}  {translated(rule.title)}")
        return
    unknown = [code for code in codes if code.upper() not in RULES]
    for code in unknown:
        hint = did_you_mean(nearest(code.upper(), RULES))
        text = Phrase("there is no rule {code}{hint}", code=printable(code), hint=hint)
        click.echo(f"gusjob: {localized(text)}", err=True)
    if unknown:
        sys.exit(2)
    click.echo("\n".join(explanation(RULES[name]) for name in names), nl=False)


def explanation(rule: Rule) -> str:
    """Return the description of a rule with its examples."""
    section = localized(Phrase(" (manual, {section})", section=rule.section)) if rule.section else ""
    parts = [
        f"{rule.code} {rule.severity.localized}: {translated(rule.title)}{section}\n",
        indent(wrapped(translated(rule.text), _COLUMNS), "  ") + "\n",
        wrapped(translated(rule.why), _COLUMNS) + "\n",
    ]
    if rule.bad:
        parts.append(localized(_BAD) + "\n" + _example(rule.bad))
    if rule.good:
        parts.append(localized(_GOOD) + "\n" + _example(rule.good))
    return "\n".join(parts)


_COLUMNS = 100
_MAX_LINES = 16
"""Of a longer example the middle is left out."""
_BAD, _GOOD = Phrase("bad:"), Phrase("good:")


def _example(text: str) -> str:
    lines = text.splitlines()
    if len(lines) > _MAX_LINES:
        lines = [*lines[:3], "...", *lines[-3:]]
    return indent("\n".join(lines), "    ") + "\n"
