"""Paths and URIs of files."""

from __future__ import annotations

from pathlib import Path

from gusjob.lsp.workspace import path_of, uri_of


def test_uris_of_files(tmp_path: Path) -> None:
    path = tmp_path / "a b%20ü#?.job"
    assert path_of(uri_of(path)) == path
    for none in ("untitled:Untitled-1", "file:///a%00b", "git:/a", "", "file://elsewhere/a.job"):
        assert path_of(none) is None
