"""Fingerprints, by which code scanning recognizes a diagnostic that it has seen before."""

from __future__ import annotations

from collections import Counter
from hashlib import sha256

from msgspec import Struct, field

from gusjob.diagnostics.formats.text import TextOf
from gusjob.diagnostics.model import Diagnostic


class Fingerprints(Struct, kw_only=True):
    """Makes the fingerprints of a report; no two are equal."""

    equal: Counter[tuple[str, str, str]] = field(default_factory=Counter)

    def of(self, diagnostic: Diagnostic, file: str, text_of: TextOf) -> str:
        """Return a hash that stays the same while the line reads the same, wherever it moves in its file.

        Equal lines are numbered from the top.
        """
        span = diagnostic.span
        whole_file = span.line == 1 and span.column == 1 and not span.end_column
        text = "" if whole_file else " ".join(text_of(span, diagnostic.path).split())
        key = (diagnostic.rule.code, file, text)
        self.equal[key] += 1
        return sha256("\0".join([*key, str(self.equal[key])]).encode()).hexdigest()
