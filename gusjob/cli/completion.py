"""What a shell completes: files and rule codes. click completes commands, options and choices."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gusjob.diagnostics.rules import RULES
from gusjob.i18n.language import translated

if TYPE_CHECKING:  # Start-up time is part of the tool.
    from click.shell_completion import CompletionItem


def complete_files(_context: click.Context, _parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Let the shell complete a file's name."""
    from click.shell_completion import CompletionItem

    return [CompletionItem(incomplete, type="file")]


def complete_code(_context: click.Context, _parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the code of a rule, with its title."""
    return _codes("", incomplete)


def complete_codes(_context: click.Context, _parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the last code of a list: GJ401,GJ5."""
    before, comma, last = incomplete.rpartition(",")
    return _codes(before + comma, last)


def _codes(before: str, incomplete: str) -> list[CompletionItem]:
    from click.shell_completion import CompletionItem

    fitting = (rule for code, rule in RULES.items() if code.startswith(incomplete.upper()))
    return [CompletionItem(before + rule.code, help=translated(rule.title)) for rule in fitting]
