"""Characters that an input method or a drawing program has put in the place of those that the language is written in.

Full-width letters, digits and signs, the ideographic space, the quotes of a word processor, the micro sign of a unit:
each stands for one character of the language and can mean no other. (NFKC would do too much: it makes 52 of 5 squared.)
"""

from __future__ import annotations

import re

_FULL_WIDTH = {chr(c): chr(c - 0xFEE0) for c in range(0xFF01, 0xFF5F)}
_MEANT = {
    **_FULL_WIDTH,
    **dict.fromkeys("\u3000\u00a0\u2002\u2003\u2009\u202f", " "),  # Ideographic, hard and typographic spaces.
    **dict.fromkeys("\u200b\ufeff", ""),  # Of no width.
    **dict.fromkeys("\u201c\u201d\u201e\u201f\u301d\u301e", '"'),
    "\u3001": ",",
    "\u2212": "-",
    "\u00b5": "u", "\u03bc": "u",  # Micro sign and Greek mu.
    "\u00b0": "deg",
    "\u00d7": "*", "\u00f7": "/",
    "\u2264": "<=", "\u2265": ">=", "\u2260": "!=",
}  # fmt: skip
_PER_TIME = re.compile(r"\d\s*(?:mm|m|pulse)/m?s$", re.IGNORECASE)
_SQUARE = "\u00b2"


def as_meant(line: str) -> str:
    """A line with the characters that were meant. What stands in quotes and in its comment stays as it is."""
    found: list[str] = []
    quoted = False
    for i, c in enumerate(line):
        meant = _MEANT.get(c, c)
        if quoted:
            quoted = meant != '"'
            found.append(c if quoted else meant)
        elif meant == ";" or (meant == "/" and _MEANT.get(line[i + 1 : i + 2], line[i + 1 : i + 2]) == "/"):
            behind = i + 1 if meant == ";" else i + 2
            return "".join([*found, ";" if meant == ";" else "//", line[behind:]])
        elif c == _SQUARE and _PER_TIME.search("".join(found)):  # mm/s2; elsewhere it is a power, of a name perhaps.
            found.append("2")
        else:
            quoted = meant == '"'
            found.append(meant)
    return "".join(found)
