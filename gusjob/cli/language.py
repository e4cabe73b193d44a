"""Commands in the user's language: --lang, and help texts from the catalogue.

click takes its own texts ("Usage:", "No such option") from gettext, but does not know that a Chinese character is two
columns wide and that a line may break after any of them.
"""

from __future__ import annotations

import gettext
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from gusjob.cli.anywhere import value_given
from gusjob.cli.color import COLOR_HELP, COLORS, color_decision
from gusjob.i18n.language import CATALOGUES, DOMAIN, LANGUAGES, language, set_language, system_language, translated
from gusjob.i18n.width import width, wrapped

if TYPE_CHECKING:  # Start-up time is part of the tool.
    from click.shell_completion import CompletionItem

_OPTION, _COLOR_OPTION = "--lang", "--color"
_SAMPLES = {"zh": "中"}
LANGUAGE_HELP = "Language of messages, help texts and reports. Default: the system's language."


def apply_language_option(arguments: Sequence[str]) -> None:
    """Set the language of --lang, wherever it is given, else the system's, before a help or a usage error is shown."""
    name = value_given(arguments, _OPTION, LANGUAGES) or _displayable(system_language())
    set_language(name)
    _localize_click(name)


@contextmanager
def own_language_settings() -> Iterator[None]:
    """Keep a command's language its own: a program that calls it gets its language and gettext settings back."""
    before, domain, variable = language(), gettext.textdomain(), os.environ.get("LANGUAGE")
    try:
        yield
    finally:
        set_language(before)
        gettext.textdomain(domain)
        os.environ.pop("LANGUAGE", None)
        if variable is not None:
            os.environ["LANGUAGE"] = variable


def _displayable(name: str) -> str:
    """Return the system's language if standard output and error can show it; else English."""
    try:
        for stream in (sys.stdout, sys.stderr):
            _SAMPLES.get(name, "").encode((stream and stream.encoding) or "utf-8")
    except UnicodeEncodeError:
        return "en"
    return name


def _localize_click(name: str) -> None:
    """Set gettext's domain and the variable from which click takes the language of its own texts."""
    if folder := LANGUAGES[name]:
        os.environ["LANGUAGE"] = folder
        gettext.bindtextdomain(DOMAIN, CATALOGUES)
    gettext.textdomain(DOMAIN if folder else "messages")


def language_was_given() -> bool:
    """Whether the command that runs was called with --lang."""
    context: click.Context | None = click.get_current_context()
    while context is not None:
        if context.get_parameter_source("lang") is ParameterSource.COMMANDLINE:
            return True
        context = context.parent
    return False


def color_given(arguments: Sequence[str]) -> bool | None:
    """Decide on colours by --color, wherever it is given, and by the environment."""
    return color_decision(value_given(arguments, _COLOR_OPTION, COLORS), os.environ)


def _color_option() -> click.Option:
    """--color as click sees it, to validate and list it; it has been applied before."""
    return click.Option(
        [_COLOR_OPTION], type=click.Choice(COLORS), expose_value=False, is_eager=True, help=translated(COLOR_HELP)
    )


def _language_option() -> click.Option:
    """--lang as click sees it, to validate and list it; it has been applied before."""
    return click.Option(
        [_OPTION], type=click.Choice(list(LANGUAGES)), expose_value=False, is_eager=True, help=translated(LANGUAGE_HELP)
    )


class _HelpFormatter(click.HelpFormatter):
    """Wraps wide characters by columns."""

    def write_text(self, text: str) -> None:
        super().write_text(_paragraphs_wrapped(text, self.width - self.current_indent))

    def write_dl(self, rows: Any, col_max: int = 30, col_spacing: int = 2) -> None:
        pairs = list(rows)
        first = min(max((width(term) for term, _ in pairs), default=0), col_max) + col_spacing
        columns = max(self.width - first - 2, 10)
        super().write_dl([(term, _paragraphs_wrapped(text, columns)) for term, text in pairs], col_max, col_spacing)


def _paragraphs_wrapped(text: str, columns: int) -> str:
    r"""A text with wide characters whose lines click takes as they are (\b); others are left to click."""
    if width(text) == len(text):
        return text
    return "\n\n".join("\b\n" + wrapped(part, columns) for part in text.split("\n\n"))


class _LocalizedContext(click.Context):
    formatter_class = _HelpFormatter


class Command(click.Command):
    """A command with --color and --lang, whose help is in the user's language."""

    context_class = _LocalizedContext

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Add --color and --lang before --help."""
        *own, last = super().get_params(ctx)
        return [*own, _color_option(), _language_option(), last]

    def get_help_option(self, ctx: click.Context) -> click.Option | None:
        """Make --help anew: its text depends on the language."""
        self._help_option = None  # click keeps it, in the language of the first time.
        return super().get_help_option(ctx)

    def get_help(self, ctx: click.Context) -> str:
        """Write the help in the user's language."""
        return super(Command, _localized_command(self)).get_help(ctx)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete options and commands, with their help in the user's language."""
        return super(Command, _localized_command(self)).shell_complete(ctx, incomplete)

    def get_short_help_str(self, limit: int = 45) -> str:
        """Cut the help to one line of the list of commands; wide characters count as two."""
        shown = _localized_command(self)
        if language() == "en" or shown.help is None:
            return super().get_short_help_str(limit)
        return shown.help.partition("\n\n")[0].partition("。")[0]


def paragraphs(text: str) -> str:
    """A help text as the catalogue has it: the lines of a paragraph joined."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def _localized_command(command: Command) -> Command:
    """A command with its texts in the user's language."""
    shown = copy(command)
    if command.help and language() != "en":
        shown.help = translated(paragraphs(command.help))
    shown.params = [_localized_parameter(parameter) for parameter in command.params]
    return shown


def _localized_parameter(parameter: click.Parameter) -> click.Parameter:
    if not isinstance(parameter, click.Option) or not parameter.help:
        return parameter
    shown = copy(parameter)
    shown.help = translated(parameter.help)
    return shown
