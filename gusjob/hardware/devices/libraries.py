"""Find the vendor's libraries on this computer."""

from __future__ import annotations

import ctypes.util
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from msgspec import Struct

from gusjob.controllers.gus.driver.inspection import VendorLibrary, inspect_library
from gusjob.inputs import exists

LIBRARY_NAMES: Mapping[str, tuple[str, ...]] = {
    "win32": ("gus.dll", "gts.dll"),  # Windows ignores case: GUS.dll is the same.
    "darwin": ("libgus.dylib", "libgts.dylib"),  # As far as is known the vendor has none.
    "linux": ("libgus.so", "libgts.so"),
}
"""Names of the vendor's libraries by sys.platform; other systems are treated as Linux."""

_PATH_VARIABLE = {"win32": "PATH", "darwin": "DYLD_LIBRARY_PATH"}
_SYSTEM_FOLDERS = ("/usr/lib", "/usr/local/lib", "/usr/lib64")


class SearchPaths(Struct, frozen=True, kw_only=True):
    """Where libraries are searched for. `system`: also where the system's loader searches."""

    names: tuple[str, ...]
    folders: tuple[str, ...]
    system: bool = False


def search_paths(platform: str = sys.platform, environ: Mapping[str, str] = os.environ) -> SearchPaths:
    """Return where to search on this computer.

    Never in the current folder, nor in an entry of PATH that means it: loading a library runs its code, and a job could
    come with a library beside it.
    """
    entries = environ.get(_PATH_VARIABLE.get(platform, "LD_LIBRARY_PATH"), "").split(os.pathsep)
    entries = [entry.strip('"') for entry in entries] if platform == "win32" else entries
    folders = [entry for entry in entries if Path(entry).is_absolute()]
    # The loader uses the same list: if an entry means the current folder, the loader is not used.
    system = platform != "win32" and (entries == [""] or len(folders) == len(entries))
    if platform != "win32":
        folders += [*_SYSTEM_FOLDERS, *sorted(str(path) for path in Path("/usr/lib").glob("*-linux-gnu*"))]
    names = LIBRARY_NAMES.get(platform, LIBRARY_NAMES["linux"])
    return SearchPaths(names=names, folders=tuple(dict.fromkeys(folders)), system=system)


def find_libraries(named: Sequence[str], search: SearchPaths) -> tuple[VendorLibrary, ...]:
    """Inspect the libraries that the user names, existing or not, and those that are found elsewhere; each once."""
    paths = [*map(whole_path, named), *_in_folders(search), *_by_loader(search)]
    once = {_identity(path): path for path in reversed(paths)}
    return tuple(inspect_library(path) for path in paths if once.get(_identity(path)) is path)


def whole_path(path: str) -> str:
    """Return the whole path of an existing file, which may be in the current folder if the user names it."""
    return str(Path(path).absolute()) if exists(path) else path


def _in_folders(search: SearchPaths) -> list[str]:
    paths = (str(Path(folder) / name) for folder in search.folders for name in search.names)
    return [path for path in paths if exists(path) and not Path(path).is_dir()]


def _by_loader(search: SearchPaths) -> list[str]:
    """Return bare names under which the system's loader knows a library that is in none of the folders."""
    if not search.system:
        return []
    known = {name for path in _in_folders(search) for name in (Path(path).name, Path(path).resolve().name)}
    stems = (name.removeprefix("lib").partition(".")[0] for name in search.names)
    found = (ctypes.util.find_library(stem) for stem in stems)
    return [name for name in found if name and Path(name).name not in known]


def _identity(path: str) -> str:
    return os.path.normcase(os.path.realpath(path)) if exists(path) else path
