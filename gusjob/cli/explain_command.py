"""gusjob explain."""

from __future__ import annotations

import sys
from textwrap import fill, indent

import click

from gusjob.diagnostics import Rule
from gusjob.rules import RULES
from gusjob.syntax.lines import nearest


@click.command(name="explain")
@click.argument("codes", metavar="[CODE]...", nargs=-1)
def command(codes: tuple[str, ...]) -> None:
    """Explain rules: what each means, why it hurts, a bad and a good example. Without a CODE: list
    all rules; with the beginning of codes, such as GJ4, those."""
    families = [code for code in codes if any(known.startswith(code.upper()) for known in RULES)]
    if len(families) == len(codes) and not any(code.upper() in RULES for code in codes):
        for rule in RULES.values():
            if not codes or rule.code.startswith(tuple(code.upper() for code in codes)):
                click.echo(f"{rule.code}  {rule.severity.value:<7}  {rule.title}")
        return
    unknown = [code for code in codes if code.upper() not in RULES]
    for code in unknown:
        near = nearest(code.upper(), RULES)
        click.echo(f"gusjob: there is no rule {code}{f'; did you mean {near}?' if near else ''}", err=True)
    if unknown:
        sys.exit(2)
    click.echo("\n".join(explained(RULES[code.upper()]) for code in codes), nl=False)


def explained(rule: Rule) -> str:
    """A rule as text."""
    section = f" (manual, {rule.section})" if rule.section else ""
    parts = [
        f"{rule.code} {rule.severity.value}: {rule.title}{section}\n",
        indent(fill(rule.text, 100, break_long_words=False), "  ") + "\n",
        fill(rule.why, 100) + "\n",
    ]
    if rule.bad:
        parts.append("bad:\n" + _example(rule.bad))
    if rule.good:
        parts.append("good:\n" + _example(rule.good))
    return "\n".join(parts)


_LONGEST = 16


def _example(text: str) -> str:
    lines = text.splitlines()
    if len(lines) > _LONGEST:
        lines = [*lines[:3], "...", *lines[-3:]]
    return indent("\n".join(lines), "    ") + "\n"
