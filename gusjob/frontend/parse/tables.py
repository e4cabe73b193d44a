"""Precomputed parser tables: computing them would take most of the start-up time.

Tables fit one grammar and one version of lark. Those of this package's own grammar were made with one version; for any
other they are worked out once and kept in the user's cache directory. Whatever is wrong with a cached file, the parser
is made from the grammar: a cache never causes an error.
"""

from __future__ import annotations

import os
import re
import stat
import sys
import tempfile
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

import lark
from lark import Lark
from lark.grammar import Rule
from lark.lexer import TerminalDef
from msgspec.json import decode

_FORMAT = 2
"""Of the files of this module. Part of the key: a change makes all older files unfit."""


def parser_from_tables(name: str, text: str) -> Lark:
    """The parser of a grammar: from the package's tables, from cached ones, or worked out and cached.

    Args:
        name: File name of the grammar.
        text: The grammar.
    """
    key = tables_key(text)
    for path in (packaged_tables(name), cached_tables(name, key)):
        if path is not None and (found := _load(path, key)) is not None:
            return found
    made = new_parser(text)
    if (path := cached_tables(name, key)) is not None:
        _write_to_cache(path, tables_of(made, key))
    return made


def new_parser(text: str) -> Lark:
    """The parser of a grammar, its tables worked out."""
    # Keywords take either case of A-Z only: without re.ASCII, a long s is an s, and the sign of the kelvin a k.
    return Lark(text, parser="lalr", lexer="contextual", maybe_placeholders=False, g_regex_flags=int(re.ASCII))


def tables_key(text: str) -> str:
    """Key of the tables: the file's format, lark's version and the grammar."""
    return f"{_FORMAT} {lark.__version__} {zlib.crc32(text.encode()):08x}"


def tables_of(parser: Lark, key: str) -> bytes:
    """The tables of a parser as a file: a line with the key and a checksum, then JSON.

    JSON, not lark's own pickle: reading it can't run code, and it fits every version of Python.
    """
    import json  # Of msgspec, only the decoder knows whole numbers of any size.

    data, memo = parser.memo_serialize([TerminalDef, Rule])
    tables = json.dumps({"data": data, "memo": memo}, separators=(",", ":")).encode()
    return _head(key, tables) + b"\n" + tables + b"\n"


def _head(key: str, tables: bytes) -> bytes:
    return f"{key} {zlib.crc32(tables.strip()):08x}".encode()


def packaged_tables(name: str) -> Path:
    """The tables of a grammar that belong to this package."""
    return Path(__file__).with_name(name).with_suffix(".tables")


def cached_tables(name: str, key: str) -> Path | None:
    """The file in the user's cache directory for some tables; None if there is no such directory."""
    folder = cache_directory()
    return None if folder is None else folder / f"{Path(name).stem}-{'-'.join(key.split())}.tables"


def cache_directory() -> Path | None:
    """The user's cache directory of this program, as the platform has it; None if there is no home directory."""
    try:
        if sys.platform == "win32":
            folder = os.environ.get("LOCALAPPDATA")
            base = Path(folder) if folder else Path.home() / "AppData" / "Local"
        elif sys.platform == "darwin":
            base = Path.home() / "Library" / "Caches"
        else:
            folder = os.environ.get("XDG_CACHE_HOME", "")
            # The specification of XDG: a relative path is invalid and is ignored.
            base = Path(folder) if Path(folder).is_absolute() else Path.home() / ".cache"
    except RuntimeError:  # No home directory.
        return None
    return base / "gusjob" if base.is_absolute() else None  # HOME may be relative.


def _load(path: Path, key: str) -> Lark | None:
    """The parser from a file of tables; None if the file does not fit, is damaged or is not trusted."""
    try:
        if not _is_trusted(path):
            return None
        head, _, tables = path.read_bytes().partition(b"\n")
        if head.strip() != _head(key, tables):
            return None
        return Lark.load(_with_numbers(decode(tables)))
    except OSError:
        return None
    except Exception:  # noqa: BLE001  (whatever lark raises for tables that it has not written)
        return None


def _is_trusted(path: Path) -> bool:
    """Whether a file is one that nobody but the user (of the package's own files: the administrator) can write.

    Tables decide what a job means, so those that another user can write are not read.
    """
    if sys.platform == "win32" or path.parent == Path(__file__).parent:
        return True  # Windows: LOCALAPPDATA is the user's alone.
    file, folder = path.stat(), path.parent.stat()
    return stat.S_ISREG(file.st_mode) and all(
        found.st_uid == os.geteuid() and not found.st_mode & 0o022 for found in (file, folder)
    )


def _with_numbers(tables: dict[str, Any]) -> dict[str, Any]:
    """The tables with the numbers of rules, tokens and states, which are keys: JSON has them as texts."""
    parser = tables["data"]["parser"]["parser"]
    states = {state: _numbered(actions) for state, actions in parser["states"].items()}
    parser |= {"tokens": _numbered(parser["tokens"]), "states": _numbered(states)}
    return tables | {"memo": _numbered(tables["memo"])}


def _numbered(table: dict[str, Any]) -> dict[int, Any]:
    return {int(key): value for key, value in table.items()}


def _write_to_cache(path: Path, content: bytes) -> None:
    """Write a file in one step, so that no other process reads half of it; what can't be written is left out."""
    with suppress(OSError):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=path.name, dir=path.parent)
        temporary = Path(name)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            temporary.replace(path)
        except OSError:
            temporary.unlink(missing_ok=True)
            raise
