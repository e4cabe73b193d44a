"""Paths as GitHub and GitLab show them: relative to the top folder of the checkout."""

from __future__ import annotations

import os
from pathlib import Path

from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.diagnostics.model import Diagnostic

Key = tuple[object, ...]


def repository_path(path: Path, diagnostic: Diagnostic, variable: str) -> str:
    """Return the path of a diagnostic's file with `/`: relative to the checkout, absolute if it is outside.

    Args:
        path: The file that was checked.
        diagnostic: A diagnostic of this file, or of one that it includes or depends on.
        variable: Environment variable with the checkout's folder; without it, the current folder counts.
    """
    shown = str(path).encode("utf-8", "backslashreplace").decode()
    file = path if diagnostic.file == shown else Path(diagnostic.file)
    absolute, top = _absolute(file), _absolute(Path(os.environ.get(variable, "")))
    # The checkout's folder may be named over a link; the file itself stays the link that it is.
    names = ((absolute, top), (absolute.parent.resolve() / absolute.name, top.resolve()))
    below = next((name.relative_to(folder) for name, folder in names if name.is_relative_to(folder)), absolute)
    return os.fsencode(below.as_posix()).decode("utf-8", "backslashreplace")


def _absolute(path: Path) -> Path:
    return Path(os.path.abspath(path))  # noqa: PTH100  (resolve() would follow links)


class Seen(Struct, kw_only=True):
    """The diagnostics that were added: one that several jobs share has one position to correct, and is shown once."""

    keys: set[Key] = field(default_factory=set)

    def is_new(self, diagnostic: Diagnostic, file: str) -> bool:
        """Whether no equal diagnostic was added before; adds it."""
        span = replace(diagnostic.span, path="")  # A file may be checked itself, and as a part of a job.
        key = (diagnostic.rule.code, file, span, diagnostic.message)
        new = key not in self.keys
        self.keys.add(key)
        return new
