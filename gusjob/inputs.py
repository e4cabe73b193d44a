"""Open the files that a command reads. A named pipe is refused: opening it blocks until a process writes to it."""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path
from typing import IO

from gusjob.i18n.phrases import Phrase
from gusjob.patterns import lazy_pattern

NAMED_PIPE = Phrase("it is a named pipe, not a file")
_DESCRIPTOR = lazy_pattern(r"/dev/(stdin|fd/\d+)|/proc/(self|\d+)/fd/.+")
"""Names of files that the process has open: /dev/stdin, and what a shell passes for <(command)."""


def open_input(path: Path) -> IO[bytes]:
    """Open a file to read it. Pipes that the process has open already are read, too.

    Raises:
        OSError: it can't be opened, or is a named pipe.
    """
    if not path.is_fifo():
        return path.open("rb")
    if sys.platform == "win32" or not _is_descriptor(path):
        raise OSError(errno.EINVAL, NAMED_PIPE, str(path))
    # Standard input may be a named pipe, whose writer may be gone: without O_NONBLOCK this would wait for another one.
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    os.set_blocking(handle, True)
    return open(handle, "rb")  # noqa: PTH123  (a handle has no path)


def exists(path: str | Path) -> bool:
    """Return whether a file or folder exists; False for a name that is too long, for which Path.exists raises."""
    return os.path.exists(path)  # noqa: PTH110


def _is_descriptor(path: Path) -> bool:
    """Return whether a path, or what it links to, names a file that the process has open."""
    names = os.path.abspath(path), os.path.realpath(path)  # noqa: PTH100  (links stay unresolved in the first one)
    return any(_DESCRIPTOR.fullmatch(name) for name in names)
