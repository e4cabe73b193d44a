"""The files of a job as the editor has them: open texts come from the editor, all others from the disk."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any
from urllib.parse import unquote, urlsplit

from msgspec import Struct, field

from gusjob.config.profile import PROFILE_NAME
from gusjob.frontend.source import read_limited
from gusjob.inputs import open_input

if sys.platform == "win32":
    from pathlib import WindowsPath as _Native
else:
    from pathlib import PosixPath as _Native

Stamp = tuple[int, int] | None
"""Modification time of a file, ns, and its size, bytes; None if there is no file."""


def path_of(uri: str) -> Path | None:
    """Return the path of a file URI; None for other URIs (untitled:, git: ...)."""
    try:
        parts = urlsplit(uri)
    except ValueError:
        return None
    if parts.scheme != "file" or parts.netloc not in ("", "localhost"):
        return None
    name = unquote(parts.path, errors="surrogateescape")
    if sys.platform == "win32":
        name = name.lstrip("/")
    return Path(name) if name and "\0" not in name else None


def uri_of(path: Path) -> str:
    """Return the URI of a file."""
    return Path(os.path.abspath(path)).as_uri()  # noqa: PTH100  (links stay unresolved)


def file_stamp(path: Path) -> Stamp:
    """Return the stamp of a file."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size


class Workspace(Struct):
    """The files that one analysis of a job reads. `open_texts`: the editor's open texts by resolved path."""

    open_texts: Mapping[str, bytes]
    read: dict[str, bytes] = field(default_factory=dict)
    """Every file that was read, by resolved path."""
    stamps: dict[Path, Stamp] = field(default_factory=dict)
    """Stamps of all files on which the result depends."""

    def path(self, path: Path) -> Path:
        """Return a path whose `open` reads the editor's text. Paths derived from it (resolve, /) do the same."""
        workspace = self

        class WorkspacePath(_Native):
            """A path that opens the editor's text in place of the file's content."""

            def open(self, mode: str = "r", *_args: Any, **_options: Any) -> IO[Any]:  # type: ignore[override]  # only one of its overloads is used
                assert mode == "rb"
                return io.BytesIO(workspace.bytes_of(Path(self)))

            def is_file(self, **_options: Any) -> bool:
                return workspace.has(Path(self))

        return WorkspacePath(path)

    def has(self, path: Path) -> bool:
        """Return whether a file exists in the editor or on the disk."""
        self.stamps.setdefault(path, file_stamp(path))
        return str(path.resolve()) in self.open_texts or path.is_file()

    def bytes_of(self, path: Path) -> bytes:
        """Return a file's content.

        Raises:
            OSError: The file can't be read.
        """
        self.stamps.setdefault(path, file_stamp(path))
        name = str(path.resolve())
        if name not in self.read:
            self.read[name] = self.open_texts[name] if name in self.open_texts else _read_file(path)
        return self.read[name]

    def watch_for_profile(self, job: Path) -> None:
        """Also watch the places where a machine profile nearer to the job could appear."""
        folder = job.resolve().parent
        for above in (folder, *folder.parents):
            near = above / PROFILE_NAME
            self.stamps.setdefault(near, file_stamp(near))
            if near.is_file():
                break

    @property
    def changed(self) -> bool:
        """Whether a file has changed since it was read."""
        return any(file_stamp(path) != stamp for path, stamp in self.stamps.items())


def _read_file(path: Path) -> bytes:
    with open_input(path) as file:
        return read_limited(file)
