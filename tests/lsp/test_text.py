"""Texts as an editor edits them: positions and edits agree with another implementation."""

from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st
from lsprotocol import types as lsp
from pygls.workspace import PositionCodec, TextDocument
from support.editor import SMILE, utf16_units

from gusjob.diagnostics.model import Span
from gusjob.lsp.text import Text, utf8

TEXTS = st.text(st.sampled_from("ab \n\r\té" + SMILE), max_size=30)


PLACES = st.builds(lsp.Position, st.integers(0, 8), st.integers(0, 12))


@given(TEXTS, st.lists(st.tuples(PLACES, PLACES, TEXTS), max_size=4))
def test_edits_are_those_of_another_reader(text: str, edits: list[tuple[lsp.Position, lsp.Position, str]]) -> None:
    """pygls' own text, line by line in Python, is the other reader."""
    other = TextDocument(
        "file:///a", text, version=0, position_codec=PositionCodec(encoding=lsp.PositionEncodingKind.Utf16)
    )
    mine = Text(utf8(text))
    for start, end, new in edits:
        lines = [re.sub(r"[\r\n]+$", "", line) for line in re.split(r"(?<=\n)|(?<=\r)(?!\n)", other.source)]
        places = []
        for place in (start, end):
            # Within the text: where a place is beyond it, the readers may differ; and not between two surrogates.
            line = min(place.line, len(lines) - 1)
            character = min(place.character, utf16_units(lines[line]))
            inside = lines[line].encode("utf-16-le")[: 2 * character].decode("utf-16-le", "ignore")
            places.append(lsp.Position(line, utf16_units(inside)))
        places.sort(key=lambda p: (p.line, p.character))
        change = lsp.TextDocumentContentChangePartial(range=lsp.Range(*places), text=new)
        other.apply_change(change)
        mine = mine.edited(change)
        assert mine.data.decode() == other.source
        assert mine.starts.tolist() == Text(mine.data).starts.tolist()


@given(TEXTS, st.sampled_from(["utf-8", "utf-16", "utf-32"]))
def test_places_there_and_back(text: str, unit: str) -> None:
    mine = Text(utf8(text), lsp.PositionEncodingKind(unit))
    at = 0
    for character in text:
        place = mine.position(at)
        assert mine.offset(place) == at or mine.data[at - 1 : at + 1] == b"\r\n"
        at += len(character.encode())


@given(TEXTS)
def test_spans_stand_where_they_stand(text: str) -> None:
    """A line and column of gusjob's and the editor's place are the same character."""
    mine = Text(utf8(text))
    for number, line in enumerate(re.split("\r\n|\r|\n", text), 1):
        for column, character in enumerate(line, 1):
            place = mine.range(Span(line=number, column=column, end_line=number, end_column=column + 1))
            got = mine.data[mine.offset(place.start) : mine.offset(place.end)].decode()
            assert got == character


def test_half_a_pair_and_a_mark_at_the_start() -> None:
    assert utf8("a\ud83db") == b"a?b"
    text = Text(b"\xef\xbb\xbfQQ 1")
    place = text.range(Span(line=1, column=1, end_line=1, end_column=3))
    assert (place.start.character, place.end.character) == (1, 3)
