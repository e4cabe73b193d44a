"""Quick fixes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lsprotocol import types as lsp
from support.editor import editor, run
from support.tools import MARK

from gusjob.lsp.text import Text, utf8

FIXES = [
    ("LNE X 1", "LINE X 1"),
    ("lne X 1", "line X 1"),
    ("LASER POWR 5", "LASER POWER 5"),
    ("LINE X (sine(30))", "LINE X (sin(30))"),
    ("LINE X 10 mm", "LINE X 10mm"),
    ("IF 1 = 2\nEND", "IF 1 == 2\nEND"),
    ("DEF pause(t)\nDWELL (t)\nEND\nCALL paus(3)", "DEF pause(t)\nDWELL (t)\nEND\nCALL pause(3)"),
    ("LET pitch = 2\nLINE X (ptich)", "LET pitch = 2\nLINE X (pitch)"),
]


def test_quick_fixes(tmp_path: Path) -> None:
    async def session() -> None:
        job = tmp_path / "job.job"
        async with editor() as ed:
            for before, after in FIXES:
                ed.open(job, MARK + before + "\n")
                await ed.published(job, bool)
                whole = lsp.Range(lsp.Position(0, 0), lsp.Position(99, 0))
                locations: Any = await ed.client.text_document_code_action_async(
                    lsp.CodeActionParams(ed.named(job), whole, lsp.CodeActionContext([]))
                )
                text = Text(utf8(MARK + before + "\n"))
                for edit in locations[0].edit.changes[job.as_uri()]:
                    text = text.edited(lsp.TextDocumentContentChangePartial(range=edit.range, text=edit.new_text))
                assert text.data.decode() == MARK + after + "\n"
                ed.close(job)

    run(session())


MENDED = [
    ("LASER DELAY ON 60 OFF 50\nwait", "Fix: off delay below on delay", "LASER DELAY ON 60 OFF 60\nwait"),
    ("LINE X 10；\u00e9\nline X 2", "Fix: unexpected word", "LINE X 10;\u00e9\nline X 2"),
    ("line X 10\r\nLINE x 2 ; line", "Fix: keyword in lower case", "LINE X 10\r\nLINE X 2 ; line"),
    ("LASER POWER 3\nLASER ON\nLINE X 2", "Fix: laser left on", "LASER POWER 3\nLASER ON\nLINE X 2\nLASER OFF"),
]


def test_fixes_are_quick_fixes(tmp_path: Path) -> None:
    """One at a time, of the text in the editor, and only where it keeps its word."""

    async def session() -> None:
        job = tmp_path / "job.job"
        whole = lsp.Range(lsp.Position(0, 0), lsp.Position(99, 0))
        async with editor() as ed:

            async def actions(text: str) -> Any:
                ed.open(job, text)
                await ed.published(job, bool)
                locations: Any = await ed.client.text_document_code_action_async(
                    lsp.CodeActionParams(ed.named(job), whole, lsp.CodeActionContext([]))
                )
                ed.close(job)
                return locations or []

            for before, title, after in MENDED:
                for bom in ("", "\ufeff"):
                    found = [action for action in await actions(bom + MARK + before) if action.title == title]
                    assert len(found) == 1
                    text = Text(utf8(bom + MARK + before))
                    for edit in found[0].edit.changes[job.as_uri()]:
                        text = text.edited(lsp.TextDocumentContentChangePartial(range=edit.range, text=edit.new_text))
                    assert text.data.decode() == bom + MARK + after
            refused = "LASER POWER 3\nLINE X 1\nLASER ON\n"  # LASER OFF would have nothing to mark.
            assert [action.title for action in await actions(MARK + refused)] == []

    run(session())
