"""Blank the comments of a C text, and mark its strings and octal numbers.

All replacements keep the length, so lines and columns stay those of the source.
"""

from __future__ import annotations

import re

import numpy as np
from msgspec import Struct

from gusjob.frontend.scan.line_table import without_comments
from gusjob.i18n.phrases import Phrase
from gusjob.patterns import lazy_pattern

_NOT_CODE = lazy_pattern(
    r"//[^\n]*"  # To the end of its line, whatever it holds.
    r"|/\*.*?(?:\*/|\Z)"
    r'|"(?:\\.|[^"\\\n])*"?'
    r"|'(?:\\.|[^'\\\n])*'?"
    r"|\\(?<![^\s,;(){}]\\)[ \t\r]*\n",  # A line that goes on; inside of a word it is left, and not read.
    re.DOTALL,
)
_PART_BYTES = 1 << 16
"""Bytes of a text that are looked at together: only parts with something to clean are written again."""
_IN_NUMBER = np.zeros(256, dtype=np.bool_)
_IN_NUMBER[list(b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz_.")] = True
"""Bytes after which a zero does not begin a number."""
_GOES_ON = lazy_pattern(rb"\\[ \t\r]*\n\Z")
"""The end of a line that goes on in the next one, maybe inside of a string."""
# A pattern that begins with a character is searched for fastest, so what may not be before it comes after it.
_ZEROS = lazy_pattern(r"0(?<![0-9A-Za-z_.]0)(?<![eE][-+]0)0*(?=0(?![0-9.xX]))")
_OCTAL = lazy_pattern(r"0(?<![0-9A-Za-z_.]0)(?<![eE][-+]0)(?=[0-9]+(?![0-9.eE]))")
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

    A comment mark inside a string or inside another comment is none, as in C. A text without all that is not copied.
    """
    problems: list[tuple[int, str]] = []
    cleaned: list[bytes | memoryview] = []
    copied, start = 0, 0
    while start < len(data):
        end = _part_end(data, start, _PART_BYTES)
        if _needs_cleaning(data[start:end]):
            part, end = _cleaned_part(data, start, end)
            first = data.count(b"\n", 0, start) + 1 if part.problems else 0
            problems += [(first + line - 1, found) for line, found in part.problems]
            cleaned += [memoryview(data)[copied:start], part.data]
            copied = end
        start = end
    if cleaned:
        data = b"".join([*cleaned, memoryview(data)[copied:]])
    return CleanText(data=data, problems=tuple(problems))


def _part_end(data: bytes, start: int, size: int) -> int:
    """Return where a part of whole lines ends that has at least `size` bytes; its last line does not go on."""
    end = start + size
    while end := data.find(b"\n", end - 1) + 1:
        if not _GOES_ON.search(data, data.rfind(b"\n", start, end - 1) + 1, end):
            return end
        end += 1
    return len(data)


def _needs_cleaning(part: bytes) -> bool:
    """Whether a part of a text has anything to clean outside of its comments with //, or a backslash anywhere."""
    if b"\\" in part:
        return True
    if not _may_need_cleaning(part):
        return False
    return b"//" not in part or _may_need_cleaning(without_comments(part + b"\n", semicolon_comments=False))


def _may_need_cleaning(code: bytes) -> bool:
    """Whether a text has marks of comments within lines, strings or octal numbers."""
    return b'"' in code or b"'" in code or (b"*" in code and b"/*" in code) or _has_leading_zero(code)


def _cleaned_part(data: bytes, start: int, end: int) -> tuple[CleanText, int]:
    """Clean a part of a text; return where it ends: a comment that begins in it ends in it, too."""
    while True:
        cleaned, is_open = _cleaned(data[start:end])
        if not is_open or end == len(data):
            return cleaned, end
        close = data.find(b"*/", end)
        # Twice as long at least, so that few parts are cleaned again.
        end = len(data) if close < 0 else _part_end(data, start, max(close + 2 - start, 2 * (end - start)))


def _cleaned(data: bytes) -> tuple[CleanText, bool]:
    """Clean lines of a text; return whether they end within a comment."""
    problems: list[tuple[int, str]] = []
    text, is_open = data.decode("utf-8"), False

    def report(position: int, found: str) -> None:
        problems.append((text.count("\n", 0, position) + 1, found))

    def is_of_directive(position: int) -> bool:
        """Whether the line of a position is one of the preprocessor."""
        return text[text.rfind("\n", 0, position) + 1 : position].lstrip().startswith("#")

    def blanked(match: re.Match[str]) -> str:
        nonlocal is_open
        found, start = match[0], match.start()
        if found.startswith("//"):
            if found.rstrip().endswith("\\"):
                report(start, JOINS_LINES)
            return found
        if found.startswith("\\"):
            return found if is_of_directive(start) else " " + found[1:]
        if found.startswith("/*"):
            if len(found) < 4 or not found.endswith("*/"):
                is_open = True
                report(start, Phrase("a comment that never ends"))
            if "\n" in found and is_of_directive(start):
                report(start, JOINS_LINES)
            return re.sub(r"[^\n]", " ", found)
        return found[0] + re.sub(r"[^\n]", "_", found[1:-1]) + found[-1] if len(found) > 1 else found

    cleaned = _NOT_CODE.sub(blanked, text)
    # 00 is 0 in C as well. Any other whole number with a leading zero is octal.
    cleaned = _OCTAL.sub(OCTAL_MARK, _ZEROS.sub(lambda m: " " * len(m[0]), cleaned))
    return CleanText(data=cleaned.encode(), problems=tuple(problems)), is_open


def _has_leading_zero(data: bytes) -> bool:
    """Whether a number begins with a zero before another digit; the exponent of a number is none."""
    raw = np.frombuffer(b"  " + data, dtype=np.uint8)
    digits = raw - np.uint8(ord("0"))
    is_digit = digits < 10
    # Most zeros are within a number.
    at = np.flatnonzero((is_digit[1:-2] < (digits[2:-1] == 0)) & is_digit[3:])
    at = at[~_IN_NUMBER[raw[at + 1]]]
    is_exponent = np.isin(raw[at + 1], (ord("+"), ord("-"))) & np.isin(raw[at], (ord("e"), ord("E")))
    return not is_exponent.all()


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
