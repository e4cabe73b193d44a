"""Characters that a text must not have, and names for those that are not seen.

Programs differ in what they show of a control character, of a line end of another system and of a character that
reorders text. A statement behind one may be shown in a comment, or not at all.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator

from gusjob.patterns import lazy_pattern

_CHUNK = 1 << 20
_CONTROLS = bytes(code for code in (*range(32), 127) if code not in b"\t\n\r")
_OUTSIDE_ASCII = (rb"\xc2[\x80-\x9f]", rb"\xd8\x9c", rb"\xe2\x80[\x8e\x8f\xa8-\xae]", rb"\xe2\x81[\xa6-\xa9]")
"""C1 controls with NEL, line and paragraph separator, and the directional marks of Unicode (UAX 9, 2)."""
_ANY = lazy_pattern(b"|".join((b"[%b]" % re.escape(_CONTROLS), *_OUTSIDE_ASCII)))
LINE_ENDS = frozenset("\v\f\x85\u2028\u2029")
"""Line ends of Unicode (UAX 14) that gusjob has not: its lines end at LF, CR LF and CR."""
_BLANK_LETTERS = frozenset("\u115f\u1160\u2800\u3164\uffa0")
"""Letters and symbols that show nothing."""


def hidden_characters(data: bytes) -> Iterator[tuple[int, str]]:
    """Each character of a UTF-8 text that hides text, with its offset in bytes: also in comments and strings."""
    if _may_hide(data):
        yield from ((found.start(), found[0].decode()) for found in _ANY.finditer(data))


def _may_hide(data: bytes) -> bool:
    """Whether there is such a character: two passes over the bytes, as most texts have none."""
    parts = (data[start : start + _CHUNK] for start in range(0, len(data), _CHUNK))
    if any(len(part.translate(None, _CONTROLS)) != len(part) for part in parts):
        return True
    return not data.isascii() and any(re.search(pattern, data) for pattern in _OUTSIDE_ASCII)


def code_point(character: str) -> str:
    """'U+00A0'."""
    return f"U+{ord(character):04X}"


def quoted(text: str) -> str:
    """A piece of a user's text in quotes, with the code point of a character that may be taken for another one.

    A character that shows nothing is named by its code point alone.
    """
    if len(text) == 1 and _is_unseen(text):
        name = unicodedata.name(text, "")
        return f"{code_point(text)} ({name})" if name else code_point(text)
    other = next((c for c in text if not c.isascii() or not c.isprintable()), "")
    shown = "".join(f"<{code_point(c)}>" if _is_unseen(c) and c != " " else c for c in text)
    return f"'{shown}' ({code_point(other)})" if other and shown == text else f"'{shown}'"


def _is_unseen(character: str) -> bool:
    """Whether a character shows nothing, or nothing of its own: a control, a blank, a mark of another one."""
    return character in _BLANK_LETTERS or unicodedata.category(character)[0] in "CMZ"
