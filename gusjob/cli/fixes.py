"""`gusjob check --fix` and `--diff`: apply fixes to files, or show them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

from gusjob.cli.color import colored_difference
from gusjob.cli.common import BOM, bom_of, rewrite, write
from gusjob.diagnostics.select import SelectionLayer
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.pipeline import Checked, FileResult, load


@dataclass(slots=True, kw_only=True)
class FileFixer:
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
                data = BOM * data.startswith(BOM) + fixed.source.data
            write([data], None)
        return fixed

    def _fixed(self, loaded: FileResult, data: bytes | None) -> FileResult:
        if not isinstance(loaded, Checked) or loaded.job is None:
            return loaded
        from gusjob.diagnostics.fixes import apply_fixes  # Start-up time is part of the tool.

        path, source, selection = loaded.path, loaded.source, loaded.selection
        result = apply_fixes(
            loaded, lambda data: load(path, self.machine_path, data=data), lambda d: selection.selects(d, self.asked)
        )
        if not result.count:
            return loaded
        bom = _bom_of(path) if data is None else BOM * data.startswith(BOM)
        before, after = bom + source.data, bom + result.data
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
