"""Diagnostics as text in a file, as the terminal shows them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from msgspec import Struct, field

from gusjob.diagnostics.formats.text import TextOf, diagnostic_text
from gusjob.diagnostics.model import Diagnostic


class PlainText(Struct, kw_only=True):
    """The diagnostics of all files, without colour."""

    lines: list[str] = field(default_factory=list)

    def add(self, path: Path, diagnostics: Iterable[Diagnostic], text_of: TextOf, *, readable: bool) -> None:
        """Add the diagnostics of a file."""
        self.lines += [diagnostic_text(diagnostic, text_of, color=False) for diagnostic in diagnostics]

    def to_bytes(self) -> bytes:
        """Return the text."""
        return "".join(f"{line}\n" for line in self.lines).encode("utf-8", "backslashreplace")
