"""gusjob explain."""

from __future__ import annotations

import sys
from textwrap import indent

import click

from gusjob.cli.language import Command
from gusjob.cli.text import padded, wrapped
from gusjob.diagnostics.model import Rule
from gusjob.diagnostics.rules import RULES
from gusjob.frontend.parse.misread import nearest
from gusjob.i18n.language import translated
from gusjob.i18n.phrases import Phrase, localized, printable


@click.command(name="explain", cls=Command)
@click.argument("codes", metavar="[CODE]...", nargs=-1)
def command(codes: tuple[str, ...]) -> None:
    """Explain rules: what each means, why it hurts, a bad and a good example. Without a CODE: list
    all rules; with the beginning of codes, such as GJ4, those."""
    families = [code for code in codes if any(known.startswith(code.upper()) for known in RULES)]
    if len(families) == len(codes) and not any(code.upper() in RULES for code in codes):
        for rule in RULES.values():
            if not codes or rule.code.startswith(tuple(code.upper() for code in codes)):
                click.echo(f"{rule.code}  {padded(rule.severity.localized, 7)}  {translated(rule.title)}")
        return
    unknown = [code for code in codes if code.upper() not in RULES]
    for code in unknown:
        near = nearest(code.upper(), RULES)
        hint = Phrase("; did you mean {near}?", near=near) if near else ""
        text = Phrase("there is no rule {code}{hint}", code=printable(code), hint=hint)
        click.echo(f"gusjob: {localized(text)}", err=True)
    if unknown:
        sys.exit(2)
    click.echo("\n".join(explained(RULES[code.upper()]) for code in codes), nl=False)


def explained(rule: Rule) -> str:
    """A rule as text."""
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
_LONGEST = 16
_BAD, _GOOD = Phrase("bad:"), Phrase("good:")


def _example(text: str) -> str:
    lines = text.splitlines()
    if len(lines) > _LONGEST:
        lines = [*lines[:3], "...", *lines[-3:]]
    return indent("\n".join(lines), "    ") + "\n"
