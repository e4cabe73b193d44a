"""Texts for people: figures as they are read, and phrases that can be said in the user's language."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from typing import Any, Self

from gusjob.i18n.language import translated, typeset


def _filled(text: str, fields: dict[str, Any]) -> str:
    shown = {k: number(v) if isinstance(v, float) else v for k, v in fields.items()}
    for name in (name for name, value in shown.items() if value == ""):
        text = text.replace(f" {{{name}}} ", " ")  # A number without a unit leaves one blank.
    return text.format_map(shown)


def number(value: float) -> str:
    """A number as people read it: no trailing .0, at most ten significant digits."""
    if value != value or value in (float("inf"), float("-inf")):
        return str(value)
    return f"{value:.0f}" if value == int(value) and abs(value) < 1e15 else f"{value:.10g}"


class Phrase(str):
    """An English text that can be said in the user's language: it remembers its template, and what was filled in."""

    __slots__ = ("fields", "template")
    template: str
    fields: dict[str, Any]

    def __new__(cls, template: str, /, **fields: Any) -> Self:
        """A text, with fields in braces."""
        phrase = super().__new__(cls, _filled(template, fields))
        phrase.template, phrase.fields = template, fields
        return phrase

    def __getnewargs_ex__(self) -> tuple[tuple[str], dict[str, Any]]:
        """What a copy is made of: the text alone may hold a user's braces."""
        return (self.template,), self.fields


def localized(text: str) -> str:
    """A phrase in the user's language. Other texts, a user's names among them, are what they are."""
    if not isinstance(text, Phrase):
        return text
    fields = {k: localized(v) if isinstance(v, str) else v for k, v in text.fields.items()}
    return _filled(typeset(translated(text.template), fields), fields)


def did_you_mean(near: str) -> str:
    """The hint that another word was meant; '' where none is near."""
    return Phrase("; did you mean {near}?", near=near) if near else ""


def any_of(words: Sequence[str]) -> str:
    """One of some words: A, B or C."""
    return Phrase("{first} or {last}", first=all_of(words[:-1]), last=words[-1]) if len(words) > 1 else words[0]


def both_of(words: Iterable[str]) -> str:
    """A and B, perhaps and C."""
    return reduce(lambda first, second: Phrase("{first} and {second}", first=first, second=second), words)


def all_of(words: Iterable[str]) -> str:
    """Words behind each other: A, B, C."""
    first, *others = [*words] or [""]
    for other in others:
        first = Phrase("{first}, {second}", first=first, second=other)
    return first


_SYSTEM = {
    str(phrase): phrase
    for phrase in (
        Phrase("no such file or directory"), Phrase("permission denied"), Phrase("is a directory"),
        Phrase("not a directory"), Phrase("file exists"), Phrase("no space left on device"),
        Phrase("read-only file system"), Phrase("input/output error"), Phrase("file name too long"),
        Phrase("operation not permitted"), Phrase("address already in use"),
        Phrase("too many levels of symbolic links"),
    )
}  # fmt: skip


def reason_of(error: OSError) -> str:
    """What the system says of a file, in small letters, as a phrase where we know it; Windows speaks for itself."""
    told = (error.strerror or "").lower()
    return _SYSTEM.get(told, told) or Phrase("unknown error")


def plural(count: int, one: Phrase, many: Phrase) -> Phrase:
    """What is said of one, or of another number."""
    return one if count == 1 else many


def figure(value: float | None, digits: int = 6) -> str:
    """A figure as people compare it, in so many digits; -0 is 0, and what is not known is a dash."""
    return "-" if value is None or value != value else number(float(f"{value:.{digits}g}") + 0.0)


def printable(text: str) -> str:
    """A user's text without control characters: a job must not steer the terminal that shows it."""
    return "".join(c if c.isprintable() else " " if c == "\t" else "�" for c in text)
