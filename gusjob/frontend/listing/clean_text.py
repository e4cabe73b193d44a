"""Blank the comments of a C text, and mark its strings and octal numbers.

All replacements keep the length, so lines and columns stay those of the source.
"""

from __future__ import annotations

import re

import numpy as np
from msgspec import Struct

from gusjob.i18n.phrases import Phrase
from gusjob.patterns import lazy_pattern

_NOT_CODE = lazy_pattern(
    r"//[^\n]*"  # To the end of its line, whatever it holds.
    r"|/\*.*?(?:\*/|\Z)"
    r'|"(?:\\.|[^"\\\n])*"?'
    r"|'(?:\\.|[^'\\\n])*'?"
    r"|(?<=[\s,;(){}])\\[ \t\r]*\n",  # A line that goes on; inside of a word it is left, and not read.
    re.DOTALL,
)
_NOT_PLAIN = (b"/*", b'"', b"'", b"\\")
"""What a text has that needs cleaning, other than octal numbers."""
_PROBED_BYTES = 1 << 20
_IN_NUMBER = np.zeros(256, dtype=np.bool_)
_IN_NUMBER[list(b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz_.")] = True
"""Bytes after which a zero does not begin a number."""
_ZEROS = lazy_pattern(r"(?<![0-9A-Za-z_.])(?<![eE][-+])0+(?=0(?![0-9.xX]))")
_OCTAL = lazy_pattern(r"(?<![0-9A-Za-z_.])(?<![eE][-+])0(?=[0-9]+(?![0-9.eE]))")
JOINS_LINES = Phrase("a comment that joins this line with the next one")
OCTAL_MARK = "⓪"
"""Stands for the leading zero of an octal number, so that no line with one has the shape of a line without."""


class CleanText(Struct, frozen=True, kw_only=True):
    """A text in UTF-8 without comments that end before their line does; those that begin with // are left.

    `problems`: places where compilers differ, or that nobody expects: a line from 1, and what it has.
    """

    data: bytes
    problems: tuple[tuple[int, str], ...] = ()


def clean_text(data: bytes) -> CleanText:
    """Blank comments within lines, hide the content of strings and mark octal numbers.

    A comment mark inside a string or inside another comment is none, as in C.
    """
    problems: list[tuple[int, str]] = []
    if not any(mark in data for mark in _NOT_PLAIN) and not _has_leading_zero(data):
        return CleanText(data=data, problems=tuple(problems))
    text = data.decode("utf-8")

    def report(position: int, found: str) -> None:
        problems.append((text.count("\n", 0, position) + 1, found))

    def is_of_directive(position: int) -> bool:
        """Whether the line of a position is one of the preprocessor."""
        return text[text.rfind("\n", 0, position) + 1 : position].lstrip().startswith("#")

    def blanked(match: re.Match[str]) -> str:
        found, start = match[0], match.start()
        if found.startswith("//"):
            if found.rstrip().endswith("\\"):
                report(start, JOINS_LINES)
            return found
        if found.startswith("\\"):
            return found if is_of_directive(start) else " " + found[1:]
        if found.startswith("/*"):
            if len(found) < 4 or not found.endswith("*/"):
                report(start, Phrase("a comment that never ends"))
            if "\n" in found and is_of_directive(start):
                report(start, JOINS_LINES)
            return re.sub(r"[^\n]", " ", found)
        return found[0] + re.sub(r"[^\n]", "_", found[1:-1]) + found[-1] if len(found) > 1 else found

    cleaned = _NOT_CODE.sub(blanked, text)
    # 00 is 0 in C as well. Any other whole number with a leading zero is octal.
    cleaned = _OCTAL.sub(OCTAL_MARK, _ZEROS.sub(lambda m: " " * len(m[0]), cleaned))
    return CleanText(data=cleaned.encode(), problems=tuple(problems))


def _has_leading_zero(data: bytes) -> bool:
    """Whether a number begins with a zero before another digit; the exponent of a number is none."""
    for start in range(0, len(data), _PROBED_BYTES):
        before = (b"  " + data[max(start - 2, 0) : start])[-2:]
        part = np.frombuffer(before + data[start : start + _PROBED_BYTES + 1], dtype=np.uint8)
        at = np.flatnonzero((part[2:-1] == ord("0")) & (part[3:] - np.uint8(ord("0")) < 10))
        at = at[~_IN_NUMBER[part[at + 1]]]
        is_exponent = np.isin(part[at + 1], (ord("+"), ord("-"))) & np.isin(part[at], (ord("e"), ord("E")))
        if not is_exponent.all():
            return True
    return False


_FUNCTION = lazy_pattern(
    r"^[^\S\n]*(?!(?:if|else|while|for|switch|do|return)\b)[A-Za-z_][\w:<>,*&. \t]{0,100}?[ \t*&\n]"
    r"(?!(?:if|while|for|switch|return)\b)[A-Za-z_~][\w:~]*[^\S\n]*\([^;{}()]{0,1000}\)\s*"
    r"(?:const\s*|override\s*|noexcept\s*)?\{",
    re.MULTILINE,
)
_OF_PROGRAMS = lazy_pattern(
    r"^[^\S\n]*(?:(?:public|private|protected|internal|static|partial|sealed|abstract)\s+)*"
    r"(?:namespace|using|class|struct\s+\w+\s*\{|interface|template|def|import|function|procedure|Public\s+Class)\b",
    re.MULTILINE,
)
_C_SHARP = lazy_pattern(r"^[^\S\n]*(?:using\s+System|namespace\b)|\[DllImport", re.MULTILINE)
_LINE_COMMENT = lazy_pattern(r"//[^\n]*")
_SEARCHED = 300_000
"""Characters in which signs of a whole program are looked for."""


def program_kind(data: bytes) -> tuple[str, int] | None:
    """Find out whether a clean text is a whole program.

    Returns:
        "C#" or "C", and the line with the first sign of it; None for straight-line code.
    """
    text = _LINE_COMMENT.sub(lambda m: " " * len(m[0]), data[:_SEARCHED].decode("utf-8", "replace"))
    signs = [m.start() for m in (_FUNCTION.search(text), _OF_PROGRAMS.search(text)) if m is not None]
    if not signs:
        return None
    return ("C#" if _C_SHARP.search(text) else "C"), text.count("\n", 0, min(signs)) + 1
