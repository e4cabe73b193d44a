"""The entries of the profile: the kind of a value, its range, its key in the file, and a line for the guide.

Each field of the machine and its parts has an Entry in its metadata. The reader (table_reader.py), its checks and the
table in docs/profile.md are driven by these entries.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from typing import Any

from gusjob.controllers.gus.ranges import Range

_METADATA = "entry"

Kind = Range | type
"""A number in a range; str, bool, an enumeration of texts, Scanner; or a dataclass with entries of its own: a table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """An entry of the profile.

    `help`: its meaning, for the guide. `key`: its dotted key in the file, if that is not the field's name. `example`: a
    value in TOML for the guide, if the default can't be written.
    """

    kind: Kind
    help: str = ""
    key: str = ""
    example: str = ""
    pair: bool = False
    """It is a list of two numbers."""
    single: bool = False
    """One number may stand for both of a pair."""
    ascending: bool = False
    """The first of a pair is below the second."""
    repeated: bool = False
    """It is an array of tables."""
    unique: bool = False
    """No two tables of the array have the same value."""


def entry(kind: Kind, help: str = "", **options: Any) -> dict[str, Entry]:  # noqa: A002  (as click names it)
    """Return the metadata of a field; the options are the other fields of Entry."""
    return {_METADATA: Entry(kind=kind, help=help, **options)}


@cache
def entries_of(table: type) -> dict[str, tuple[str, Entry]]:
    """Return the field and entry of each (dotted) key of a dataclass."""
    found = ((part.name, part.metadata[_METADATA]) for part in fields(table) if _METADATA in part.metadata)
    return {entry.key or name: (name, entry) for name, entry in found}
