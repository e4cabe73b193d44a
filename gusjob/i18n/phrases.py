"""Texts for users: phrases that can be translated, lists of words, and numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from typing import Any, Self

from gusjob.i18n.language import translated, typeset

_FLOAT_NOISE = 1e-12
"""Error of a number by float arithmetic, as a share of it."""


def _filled(text: str, fields: dict[str, Any]) -> str:
    """Fill fields into a template; a field that is empty takes its blank with it."""
    shown = {k: number(v) if isinstance(v, float) else v for k, v in fields.items()}
    for name in (name for name, value in shown.items() if value == ""):
        text = text.replace(f" {{{name}}} ", " ")  # A number without a unit leaves one blank.
    return text.format_map(shown)


def number(value: float) -> str:
    """Format a number: no trailing .0, at most ten significant digits.

    A number that is almost a short one, but not by float noise, has all its digits: 150.0000000002 is not 150.
    """
    if value != value or value in (float("inf"), float("-inf")):
        return str(value)
    if value == int(value) and abs(value) < 1e15:
        return f"{value:.0f}"
    shown = f"{value:.10g}"
    is_short = float(shown) in (float(f"{value:.7g}"), round(value))
    return repr(value) if is_short and abs(float(shown) - value) > _FLOAT_NOISE * abs(value) else shown


class Phrase(str):
    """An English text that can be translated: it keeps its template and the fields filled into it."""

    __slots__ = ("fields", "template")
    template: str
    fields: dict[str, Any]

    def __new__(cls, template: str, /, **fields: Any) -> Self:
        """Fill the fields into a template with braces."""
        phrase = super().__new__(cls, _filled(template, fields))
        phrase.template, phrase.fields = template, fields
        return phrase

    def __getnewargs_ex__(self) -> tuple[tuple[str], dict[str, Any]]:
        """Return the arguments of a copy: the text alone may contain a user's braces."""
        return (self.template,), self.fields


def localized(text: str) -> str:
    """Translate a phrase into the user's language. Other texts, such as a user's names, stay as they are."""
    if not isinstance(text, Phrase):
        return text
    fields = {k: localized(v) if isinstance(v, str) else v for k, v in text.fields.items()}
    return _filled(typeset(translated(text.template), fields), fields)


def did_you_mean(near: str) -> str:
    """Return the hint that another word was meant, '' if there is none."""
    return Phrase("; did you mean {near}?", near=near) if near else ""


def any_of(words: Sequence[str]) -> str:
    """Join words: A, B or C."""
    return Phrase("{first} or {last}", first=all_of(words[:-1]), last=words[-1]) if len(words) > 1 else words[0]


def both_of(words: Iterable[str]) -> str:
    """Join words: A and B and C."""
    return reduce(lambda first, second: Phrase("{first} and {second}", first=first, second=second), words)


def all_of(words: Iterable[str]) -> str:
    """Join words: A, B, C."""
    first, *others = [*words] or [""]
    for other in others:
        first = Phrase("{first}, {second}", first=first, second=other)
    return first


_SYSTEM = {
    str(phrase): phrase
    for phrase in (
        Phrase("no such file or directory"),
        Phrase("permission denied"),
        Phrase("is a directory"),
        Phrase("not a directory"),
        Phrase("file exists"),
        Phrase("no space left on device"),
        Phrase("read-only file system"),
        Phrase("input/output error"),
        Phrase("file name too long"),
        Phrase("operation not permitted"),
        Phrase("address already in use"),
        Phrase("too many levels of symbolic links"),
    )
}
"""Messages of POSIX systems that are translated. Windows has messages in its own language."""


def reason_of(error: OSError) -> str:
    """Return the system's message about a file in lower case, as a phrase if it is known or is one already."""
    if isinstance(error.strerror, Phrase):
        return error.strerror
    message = (error.strerror or "").lower()
    return _SYSTEM.get(message, message) or Phrase("unknown error")


def plural(count: int, one: Phrase, many: Phrase) -> Phrase:
    """Choose the text for one or for another number."""
    return one if count == 1 else many


def figure(value: float | None, digits: int = 6) -> str:
    """Format a number with so many significant digits; -0 is 0, an unknown number is a dash."""
    return "-" if value is None or value != value else number(float(f"{value:.{digits}g}") + 0.0)


def printable(text: str) -> str:
    """Replace control characters in a user's text: a job must not control the terminal that shows it."""
    return "".join(c if c.isprintable() else " " if c == "\t" else "�" for c in text)
