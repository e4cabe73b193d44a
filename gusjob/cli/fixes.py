"""`gusjob check --fix` and `--diff`: apply fixes to files, or show them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from msgspec import Struct

from gusjob.cli.color import colored_difference
from gusjob.cli.common import BOM, bom_of, rewrite, write
from gusjob.diagnostics.rules.fixable import FIX_OF_RULE
from gusjob.diagnostics.select import SelectionLayer
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.pipeline import Checked, FileResult, load

if TYPE_CHECKING:
    from gusjob.diagnostics.fixes import FixResult


_MAX_COUNTED_BYTES = 200_000
"""Fixes of a larger file are not counted: each is proved by another check of the file."""


def has_candidates(loaded: FileResult, asked: SelectionLayer) -> bool:
    """Whether some diagnostic of an examined file is of a rule with a fix."""
    if not isinstance(loaded, Checked) or loaded.job is None:
        return False
    return any(d.rule.code in FIX_OF_RULE and loaded.selection.selects(d, asked) for d in loaded.diagnostics)


def count_fixes(loaded: FileResult, machine_path: Path | None, asked: SelectionLayer) -> int | None:
    """Count the problems of an examined file that --fix would correct, by trying it; None if the file is too large."""
    if not isinstance(loaded, Checked) or not has_candidates(loaded, asked):
        return 0
    if len(loaded.source.data) > _MAX_COUNTED_BYTES:
        return None
    return _fixed(loaded, machine_path, asked).count


def _fixed(loaded: Checked, machine_path: Path | None, asked: SelectionLayer) -> FixResult:
    from gusjob.diagnostics.fixes import apply_fixes  # Start-up time is part of the tool.

    path, selection = loaded.path, loaded.selection
    return apply_fixes(loaded, lambda data: load(path, machine_path, data=data), lambda d: selection.selects(d, asked))


class FileFixer(Struct, kw_only=True):
    """Fixes files, or only shows what would change (`diffs`). `asked`: the rules selected on the command line."""

    machine_path: Path | None
    asked: SelectionLayer
    diffs: bool
    count: int = 0
    exit_code: int = 0

    def fix(self, loaded: FileResult, data: bytes | None = None) -> FileResult:
        """Fix an examined file and return the new result; listings, journals and profiles stay as they are.

        `data`: the content of standard input, which is written to standard output, also if nothing is fixed.
        """
        fixed = self._fixed(loaded, data)
        if data is not None and not self.diffs and not loaded.is_unreadable:
            if fixed is not loaded and isinstance(fixed, Checked):
                data = BOM * data.startswith(BOM) + fixed.source.as_written
            write([data], None)
        return fixed

    def _fixed(self, loaded: FileResult, data: bytes | None) -> FileResult:
        if not isinstance(loaded, Checked) or loaded.job is None:
            return loaded
        path, source = loaded.path, loaded.source
        result = _fixed(loaded, self.machine_path, self.asked)
        if not result.count:
            return loaded
        bom = _bom_of(path) if data is None else BOM * data.startswith(BOM)
        before, after = bom + source.as_written, bom + result.data
        if self.diffs:
            from gusjob.frontend.format.unified_diff import unified_diff

            write(colored_difference(unified_diff(source.name, before, after)), None)
            self.exit_code = max(self.exit_code, 1)
        elif data is None and (reason := rewrite(path, before, after)):
            text = localized(Phrase("{path}: can't write: {reason}", path=source.name, reason=reason))
            click.echo(f"gusjob: {printable(text)}", err=True)
            self.exit_code = 2
            return loaded
        self.count += result.count
        return result.loaded

    @property
    def summary(self) -> str:
        """'; 2 fixed', in the user's language."""
        count = self.count
        return localized(
            Phrase("; {count} can be fixed", count=count) if self.diffs else Phrase("; {count} fixed", count=count)
        )


def _bom_of(path: Path) -> bytes:
    """The BOM of a file that can be read again."""
    try:
        return bom_of(path) if path.is_file() else b""  # A pipe can't be read twice.
    except OSError:  # The file has been removed: it won't be written either.
        return b""
