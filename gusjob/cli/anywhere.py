"""Options that are valid before and after a command's name: their values are needed before click parses a word."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import pairwise, takewhile


def value_given(arguments: Sequence[str], option: str, values: Collection[str]) -> str | None:
    """Return the last valid value of an option in a command line, None if there is none.

    Words after -- are no options. A value that is not valid is reported when the command parses its words.
    """
    own = takewhile(lambda word: word != "--", arguments)
    joined = f"{option}="
    given = [
        after if word == option else word.removeprefix(joined)
        for word, after in pairwise([*own, ""])
        if word == option or word.startswith(joined)
    ]
    return next((value for value in reversed(given) if value in values), None)
