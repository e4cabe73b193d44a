"""Characters that an input method or a drawing program inserts instead of those of the language.

Full-width letters, digits and signs, the ideographic space, the quotes of a word processor, the micro sign of a unit:
each stands for exactly one text of the language. (NFKC would change too much: it turns 5 squared into 52.)
"""

from __future__ import annotations

import re

from gusjob.patterns import lazy_pattern

_FULL_WIDTH = {chr(c): chr(c - 0xFEE0) for c in range(0xFF01, 0xFF5F)}
_REPLACEMENTS = {
    **_FULL_WIDTH,
    **dict.fromkeys("\u3000\u00a0\u2002\u2003\u2009\u202f", " "),  # Ideographic, hard and typographic spaces.
    **dict.fromkeys("\u200b\ufeff", ""),  # Zero-width.
    **dict.fromkeys("\u201c\u201d\u201e\u201f\u301d\u301e", '"'),
    "\u3001": ",",
    "\u2212": "-",
    "\u00b5": "u",  # Micro sign.
    "\u03bc": "u",  # Greek mu.
    "\u00b0": "deg",
    "\u00d7": "*",
    "\u00f7": "/",
    "\u2264": "<=",
    "\u2265": ">=",
    "\u2260": "!=",
}
_PER_TIME = lazy_pattern(r"\d\s*(?:mm|m|pulse)/m?s$", re.IGNORECASE | re.ASCII)
_SQUARE = "\u00b2"


def normalized(line: str) -> str:
    """Replace such characters in a line. Quoted text and the comment stay as they are."""
    found: list[str] = []
    quoted = False
    for i, c in enumerate(line):
        new = _REPLACEMENTS.get(c, c)
        if quoted:
            quoted = new != '"'
            found.append(c if quoted else new)
        elif new == ";" or (new == "/" and _REPLACEMENTS.get(line[i + 1 : i + 2], line[i + 1 : i + 2]) == "/"):
            comment = i + 1 if new == ";" else i + 2
            return "".join([*found, ";" if new == ";" else "//", line[comment:]])
        elif c == _SQUARE and _PER_TIME.search("".join(found)):  # mm/s2; elsewhere it may be a power of a name.
            found.append("2")
        else:
            quoted = new == '"'
            found.append(new)
    return "".join(found)
