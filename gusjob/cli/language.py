"""Commands that speak the user's language: --lang, and helps from the catalogue.

click itself takes its own texts ("Usage:", "No such option") from gettext; what it knows nothing of is that a Chinese
character is two columns wide and that a line may break behind any of them.
"""

from __future__ import annotations

import gettext
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from typing import Any

import click
from click.core import ParameterSource

from gusjob.i18n.language import CATALOGUES, DOMAIN, LANGUAGES, language, set_language, system_language, translated
from gusjob.i18n.width import width, wrapped

_OPTION = "--lang"
_SAMPLES = {"zh": "中"}
LANGUAGE_HELP = "Language of messages, helps and reports. Default: that of the system."


def speak_as_asked(arguments: Sequence[str]) -> None:
    """Speak the language of --lang, wherever it stands, else the system's: before a help or a wrong usage is told."""
    pairs = zip(arguments, [*arguments[1:], ""], strict=True)
    asked = [after if word == _OPTION else word.removeprefix(f"{_OPTION}=") for word, after in pairs if _OPTION in word]
    known = [one for one in asked if one in LANGUAGES]
    spoken = known[-1] if known else _shown(system_language())
    set_language(spoken)
    _let_click_speak(spoken)


@contextmanager
def language_of_a_command() -> Iterator[None]:
    """What a command speaks is its own: a program that calls it has its language and its gettext back."""
    spoken, domain, variable = language(), gettext.textdomain(), os.environ.get("LANGUAGE")
    try:
        yield
    finally:
        set_language(spoken)
        gettext.textdomain(domain)
        os.environ.pop("LANGUAGE", None)
        if variable is not None:
            os.environ["LANGUAGE"] = variable


def _shown(name: str) -> str:
    """A language that nobody asked for, if standard output and error can show it; else English."""
    try:
        for stream in (sys.stdout, sys.stderr):
            _SAMPLES.get(name, "").encode((stream and stream.encoding) or "utf-8")
    except UnicodeEncodeError:
        return "en"
    return name


def _let_click_speak(name: str) -> None:
    """click takes its own texts from gettext's domain, in the language of this variable."""
    if folder := LANGUAGES[name]:
        os.environ["LANGUAGE"] = folder
        gettext.bindtextdomain(DOMAIN, CATALOGUES)
    gettext.textdomain(DOMAIN if folder else "messages")


def language_was_asked() -> bool:
    """Whether the command that runs was called with --lang."""
    context: click.Context | None = click.get_current_context()
    while context is not None:
        if context.get_parameter_source("lang") is ParameterSource.COMMANDLINE:
            return True
        context = context.parent
    return False


def _language_option() -> click.Option:
    """--lang as click sees it: to judge its value and to list it; it was heeded before."""
    about = translated(LANGUAGE_HELP)
    return click.Option([_OPTION], type=click.Choice(list(LANGUAGES)), expose_value=False, is_eager=True, help=about)


class _Formatter(click.HelpFormatter):
    """Wraps wide characters by columns."""

    def write_text(self, text: str) -> None:
        super().write_text(_laid(text, self.width - self.current_indent))

    def write_dl(self, rows: Any, col_max: int = 30, col_spacing: int = 2) -> None:
        pairs = list(rows)
        first = min(max((width(term) for term, _ in pairs), default=0), col_max) + col_spacing
        columns = max(self.width - first - 2, 10)
        super().write_dl([(term, _laid(text, columns)) for term, text in pairs], col_max, col_spacing)


def _laid(text: str, columns: int) -> str:
    """A text whose paragraphs click is to take as they are (\\b), if it has wide characters."""
    if width(text) == len(text):
        return text
    return "\n\n".join("\b\n" + wrapped(part, columns) for part in text.split("\n\n"))


class _Context(click.Context):
    formatter_class = _Formatter


class Command(click.Command):
    """A command with --lang, whose help is in the user's language."""

    context_class = _Context

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        *own, last = super().get_params(ctx)
        return [*own, _language_option(), last]

    def get_help_option(self, ctx: click.Context) -> click.Option | None:
        self._help_option = None  # click keeps it, in the language of the first time.
        return super().get_help_option(ctx)

    def get_help(self, ctx: click.Context) -> str:
        return super(Command, _in_language(self)).get_help(ctx)

    def get_short_help_str(self, limit: int = 45) -> str:
        spoken = _in_language(self)
        if language() == "en" or spoken.help is None:
            return super().get_short_help_str(limit)
        return spoken.help.partition("\n\n")[0].partition("。")[0]


def paragraphs(text: str) -> str:
    """A help as the catalogue has it: lines of a paragraph joined, since where they end is the code's matter."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def _in_language(command: Command) -> Command:
    """A command with its texts in the user's language."""
    spoken = copy(command)
    if command.help and language() != "en":
        spoken.help = translated(paragraphs(command.help))
    spoken.params = [_parameter(parameter) for parameter in command.params]
    return spoken


def _parameter(parameter: click.Parameter) -> click.Parameter:
    if not isinstance(parameter, click.Option) or not parameter.help:
        return parameter
    spoken = copy(parameter)
    spoken.help = translated(parameter.help)
    return spoken
