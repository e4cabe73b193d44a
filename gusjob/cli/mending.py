"""What `gusjob check --fix` does to files, and what --diff shows of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

from gusjob.cli.common import bom_of, rewrite, write
from gusjob.diagnostics.select import SelectionLayer
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.pipeline import Checked, FileResult, load


@dataclass(slots=True, kw_only=True)
class Mending:
    """What --fix does to files, or --diff shows of it."""

    machine_path: Path | None
    asked: SelectionLayer
    diffs: bool
    count: int = 0
    exit_code: int = 0

    def mended(self, loaded: FileResult) -> FileResult:
        """A file that was judged as it is now, or would be. Listings, journals and profiles stay as they are."""
        if not isinstance(loaded, Checked) or loaded.job is None:
            return loaded
        from gusjob.diagnostics.fixes import mended  # Start-up time is part of the tool.

        path, source, selection = loaded.path, loaded.source, loaded.machine.selection
        done = mended(
            loaded, lambda data: load(path, self.machine_path, data=data), lambda f: selection.wants(f, self.asked)
        )
        if not done.count:
            return loaded
        try:
            bom = bom_of(path) if path.is_file() else b""  # A pipe can't be read twice.
        except OSError:  # It is gone again: it won't be written either.
            bom = b""
        before, after = bom + source.data, bom + done.data
        if self.diffs:
            from gusjob.frontend.format.difference import difference

            write(difference(source.name, before, after), None)
            self.exit_code = max(self.exit_code, 1)
        elif reason := rewrite(path, before, after):
            told = localized(Phrase("{path}: can't write: {reason}", path=source.name, reason=reason))
            click.echo(f"gusjob: {printable(told)}", err=True)
            self.exit_code = 2
            return loaded
        self.count += done.count
        return done.loaded

    @property
    def told(self) -> str:
        """'; 2 mended', in the user's language."""
        count = self.count
        return localized(
            Phrase("; {count} to mend", count=count) if self.diffs else Phrase("; {count} mended", count=count)
        )
