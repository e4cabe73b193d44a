"""Which file an INCLUDE may read, and which files other jobs include."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path, PureWindowsPath

from msgspec import Struct

from gusjob.frontend.source import Source, read_source
from gusjob.i18n.phrases import Phrase
from gusjob.patterns import lazy_pattern

_INCLUDES = lazy_pattern(rb'include[ \t]*"([^"\n]*)"', re.IGNORECASE)
_MAX_JOBS, _MAX_BYTES = 5000, 10_000_000
"""How many jobs near a file are searched, and how much of each."""


class FoundInclude(Struct, frozen=True, kw_only=True):
    """What an INCLUDE names. `path`: the file, None if it may not be read; `reason`: why there is no `source`."""

    path: Path | None = None
    source: Source | None = None
    reason: str = ""


def find_include(name: str, source: Source, top: Source) -> FoundInclude:
    """Read the file that an INCLUDE names. Nothing outside the job's folder is ever read.

    Args:
        name: The name in the INCLUDE.
        source: The text with the INCLUDE.
        top: The job's own text.
    """
    if source.path is None or top.path is None:
        reason = Phrase("this text does not come from a file, so there is no folder to look in")
        return FoundInclude(reason=reason)
    if not name or "\0" in name or not name.isprintable():
        return FoundInclude(reason=Phrase("this is not a file name"))
    relative = name.replace("\\", "/")
    if relative.startswith("/") or PureWindowsPath(name).drive or PureWindowsPath(name).is_absolute():
        return FoundInclude(reason=Phrase("write it relative to the file that includes it"))
    try:
        folder = top.path.resolve().parent
        path = (source.path.resolve().parent / relative).resolve()
        if not path.is_relative_to(folder):
            return FoundInclude(reason=Phrase("it is outside the job's folder"))
        if not path.is_file():
            reason = Phrase("it is not a file") if path.exists() else Phrase("there is no such file")
            return FoundInclude(path=path, reason=reason)
    except (OSError, ValueError, RuntimeError) as error:  # RuntimeError: a cycle of links.
        text = getattr(error, "strerror", None)
        return FoundInclude(reason=text.lower() if text else Phrase("it can't be found"))
    shown = top.name.replace("\\", "/").rpartition("/")[0]
    inside = path.relative_to(folder).as_posix()
    found, diagnostics = read_source(path, f"{shown}/{inside}" if shown else inside)
    return FoundInclude(path=path, source=found, reason=diagnostics[0].phrase if diagnostics else "")


def may_be_included(path: Path) -> bool:
    """Whether a job in a file's folder, or in one of the two folders above, includes it, directly or not.

    True also where there are too many jobs to search.
    """
    here = Path(path).resolve()  # Editors give unresolved paths; resolving one reads no other file.
    to_search = [job for folder in here.parents[:3] for job in folder.glob("*.job")]
    seen = set(to_search)
    while to_search:
        if len(seen) > _MAX_JOBS:
            return True
        found = _included_by(to_search.pop())
        if here in found:
            return True
        to_search += found - seen
        seen |= found
    return False


def _included_by(job: Path) -> set[Path]:
    """The files that a job names in its INCLUDEs, whether or not they run."""
    try:
        if not job.is_file():  # Opening a pipe would block.
            return set()
        return {(job.parent / name).resolve() for name in _names_in(job, job.stat().st_mtime_ns)}
    except (OSError, RuntimeError):
        return set()


@lru_cache(maxsize=_MAX_JOBS)
def _names_in(job: Path, _changed_ns: int) -> frozenset[str]:
    """The names in the INCLUDE lines of a job; kept until it changes, since an editor calls this at every keystroke."""
    with job.open("rb") as file:
        data = file.read(_MAX_BYTES)
    names = (found[1].decode("utf-8", "replace").replace("\\", "/") for found in _INCLUDES.finditer(data))
    return frozenset(name for name in names if "\0" not in name)
