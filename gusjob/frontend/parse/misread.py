"""The reason why a line can't be parsed, in terms of the user's text."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from lark import Lark, UnexpectedCharacters, UnexpectedInput, UnexpectedToken
from lark.parsers.lalr_interactive_parser import InteractiveParser
from msgspec import Struct

from gusjob.frontend.parse.grammar import parser
from gusjob.i18n.characters import quoted
from gusjob.i18n.phrases import Phrase, any_of, did_you_mean
from gusjob.i18n.spelling import nearest
from gusjob.patterns import lazy_pattern

END_OF_LINE = Phrase("the end of the line")
_LOGICAL = {"AND", "OR", "NOT"}
_WORD = lazy_pattern(r"[A-Za-z_]\w*|\S")


class Misread(Struct, frozen=True, kw_only=True):
    """The found text and the expected words.

    Attributes:
        word: The text.
        found: The text as messages show it.
        column: Where it begins, from 1.
        end_column: The column after it.
        expected: What the grammar accepts there, as the user calls it.
        near: The accepted keyword that `found` resembles; '' if there is none.
    """

    word: str
    found: str
    column: int
    end_column: int
    expected: tuple[str, ...]
    near: str

    @property
    def expectation(self) -> str:
        """'expected X, Y or the end of the line'."""
        if not self.expected:
            return Phrase("nothing is allowed here")
        return Phrase("expected {words}", words=any_of(self.expected))

    @property
    def hint(self) -> str:
        """'; did you mean LINE?' where a word resembles one that the grammar accepts."""
        return did_you_mean(self.near)


def misread(
    error: UnexpectedInput, grammar: str, text: str, names: dict[str, str], out_of_place: Collection[str] = ()
) -> Misread:
    """Explain an error of lark.

    Args:
        error: The error.
        grammar: File name of the grammar.
        text: The line that was parsed.
        names: Readable names of terminals that are not keywords.
        out_of_place: Keywords that the grammar accepts, but not the statement.
    """
    accepted: Sequence[str] = ()
    if isinstance(error, UnexpectedToken):
        state = error.interactive_parser
        accepts = error.expected if state is None else _accepts(state)
        accepted = sorted({*(accepts or error.expected)}.difference(out_of_place))
        if error.token.type == "$END":
            column = len(text.rstrip()) + 1
            return _misread(END_OF_LINE, column, column + 1, accepted, names)
        start, word = error.token.column or 1, str(error.token)
        whole = _WORD.match(text, start - 1) if error.token.type == "NAME" else None
        word = whole[0] if whole else word  # A name ends before a letter outside ASCII, a word does not.
        return _misread(word, start, start + len(word), accepted, names)
    column = error.column if isinstance(error, UnexpectedCharacters) else 1
    if isinstance(error, UnexpectedCharacters):
        accepted = [a for a in accepted_after(parser(grammar), text[: column - 1]) if a not in out_of_place]
    match = _WORD.match(text, column - 1)
    word = match[0] if match else text[column - 1 : column]
    return _misread(word, column, column + max(len(word), 1), accepted, names)


def accepted_after(lark: Lark, text: str) -> Sequence[str]:
    """The terminals that the parser accepts after `text`, where the lexer stopped."""
    try:
        interactive = lark.parse_interactive(text)
        for _ in interactive.iter_parse():
            pass
        return sorted(_accepts(interactive))
    except UnexpectedInput:
        return ()


_known_accepts: dict[tuple[int, ...], frozenset[str]] = {}
"""What the parser accepts, by its tables and states: lark finds it by trying every terminal."""


def _accepts(interactive: InteractiveParser) -> frozenset[str]:
    """The terminals that a parser accepts next."""
    state = interactive.parser_state
    key = (id(state.parse_conf.parse_table), *map(int, state.state_stack))
    if key not in _known_accepts:
        _known_accepts[key] = frozenset(interactive.accepts())  # type: ignore[no-untyped-call]  # lark's
    return _known_accepts[key]


def _misread(found: str, start: int, end: int, accepted: Sequence[str], names: dict[str, str]) -> Misread:
    keywords = [a for a in accepted if a not in names and not a.startswith("_") and a != "$END"]
    readable = [*dict.fromkeys(names[a] for a in accepted if a in names), *keywords]
    if len(readable) > len(keywords) + 1:  # Inside an expression much can follow: name what is likely.
        readable = [word for word in readable if word not in _LOGICAL]
    if "$END" in accepted:
        readable.append(END_OF_LINE)
    shown = quoted(found[:40]) if found is not END_OF_LINE else found
    near = nearest(found.upper(), keywords)
    return Misread(word=found, found=shown, column=start, end_column=end, expected=tuple(readable), near=near)
