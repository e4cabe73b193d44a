"""The files of a job as the editor has them: texts that are open are read from there, all others from the disk."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any
from urllib.parse import unquote, urlsplit

from gusjob.config.profile import PROFILE_NAME
from gusjob.frontend.source import MAX_FILE_MB

if sys.platform == "win32":
    from pathlib import WindowsPath as _Native
else:
    from pathlib import PosixPath as _Native

Stamp = tuple[int, int] | None
"""When a file was changed, ns, and its size in bytes; None where there is none."""


def path_of(uri: str) -> Path | None:
    """The file that a URI names; None for one that is no file's (untitled:, git: ...)."""
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
    """The URI of a file."""
    return Path(os.path.abspath(path)).as_uri()  # noqa: PTH100  (links stay as the user wrote them)


def stamp_of(path: Path) -> Stamp:
    """How a file looks from outside."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size


@dataclass(slots=True)
class Desk:
    """What one look at a job reads. `open_texts`: by resolved path, as the editor has them."""

    open_texts: Mapping[str, bytes]
    read: dict[str, bytes] = field(default_factory=dict)
    """Every file that was read, by resolved path."""
    stamps: dict[Path, Stamp] = field(default_factory=dict)
    """Files that the answer hangs on, as they were on the disk."""

    def path(self, path: Path) -> Path:
        """A path from which the syntax room reads what the editor has: what it resolves to and joins is one, too."""
        desk = self

        class DeskPath(_Native):
            """Opens the editor's text in place of the file's."""

            def open(self, mode: str = "r", *_args: Any, **_options: Any) -> IO[Any]:  # type: ignore[override]  # one of its many forms is used
                assert mode == "rb"
                return io.BytesIO(desk.bytes_of(Path(self)))

            def is_file(self, **_options: Any) -> bool:
                return desk.has(Path(self))

        return DeskPath(path)

    def has(self, path: Path) -> bool:
        """Whether there is such a file, in the editor or on the disk."""
        self.stamps.setdefault(path, stamp_of(path))
        return str(path.resolve()) in self.open_texts or path.is_file()

    def bytes_of(self, path: Path) -> bytes:
        """A file's content. Raises OSError."""
        self.stamps.setdefault(path, stamp_of(path))
        name = str(path.resolve())
        if name not in self.read:
            self.read[name] = self.open_texts[name] if name in self.open_texts else _content(path)
        return self.read[name]

    def watch_for_profile(self, job: Path) -> None:
        """A machine profile that appears nearer to the job than the one that was found counts from then on."""
        folder = job.resolve().parent
        for above in (folder, *folder.parents):
            near = above / PROFILE_NAME
            self.stamps.setdefault(near, stamp_of(near))
            if near.is_file():
                break

    @property
    def changed(self) -> bool:
        """Whether a file is another than when it was read."""
        return any(stamp_of(path) != stamp for path, stamp in self.stamps.items())


def _content(path: Path) -> bytes:
    """What is on the disk, as far as gusjob reads a file: a byte more says that it is too large."""
    with path.open("rb") as file:
        return file.read(int(MAX_FILE_MB * 1_000_000) + 1)
