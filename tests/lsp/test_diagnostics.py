"""Diagnostics for the editor are those of `gusjob check`."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from lsprotocol import types as lsp
from support.editor import utf16_units
from support.tools import MARK, ROOT

from gusjob.lsp.diagnostics import SourceLocations, diagnose, lsp_diagnostics
from gusjob.lsp.text import Text, utf8
from gusjob.lsp.workspace import Workspace, uri_of
from gusjob.pipeline import examine_file

FILES = [
    p for kind in ("job", "gts") for p in sorted(ROOT.glob(f"tests/*/*.{kind}")) + sorted(ROOT.glob(f"jobs/*.{kind}"))
]


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_diagnostics_are_those_of_check(path: Path) -> None:
    data = path.read_bytes()
    workspace = Workspace({str(path.resolve()): data})
    mine = diagnose(str(path), path, data, workspace)
    text = Text(data)
    found = lsp_diagnostics(SourceLocations(diagnosis=mine, uri=uri_of(path), text=text, uris={}, unit="utf-16"))
    wanted = examine_file(path, None).diagnostics
    lines = data.decode().split("\n")
    own = [f for f in wanted if not f.span.path][:500]
    assert [(d.code, d.range.start) for d in found[uri_of(path)]] == [
        (
            f.rule.code,
            lsp.Position(
                f.span.line - 1,
                utf16_units(lines[f.span.line - 1][: f.span.column - 1])
                if f.span.end_column
                else utf16_units(re.match(r"\s*", lines[f.span.line - 1])[0]),  # type: ignore[index]  # it always matches
            ),
        )
        for f in own
    ]
    elsewhere = {uri: got for uri, got in found.items() if uri != uri_of(path) and got}
    assert sum(map(len, elsewhere.values())) == sum(bool(f.span.path) for f in wanted)


def test_what_is_not_read_is_faded(tmp_path: Path) -> None:
    text = MARK + "LET a = 1\nDEF f()\nEND\nWAIT\n"
    path = tmp_path / "job.job"
    mine = diagnose(str(path), path, utf8(text), Workspace({str(path.resolve()): utf8(text)}))
    found = lsp_diagnostics(SourceLocations(diagnosis=mine, uri="u", text=Text(utf8(text)), uris={}, unit="utf-16"))[
        "u"
    ]
    assert [(d.code, d.tags) for d in found] == [(c, [lsp.DiagnosticTag.Unnecessary]) for c in ("GJ142", "GJ141")]
