"""The entries of the profile: the kind of a value, its range, its key in the file, and a line for the guide.

Each field of the machine and its parts has an Entry in its annotation. The reader (table_reader.py), its checks and the
table in docs/profile.md are driven by these entries.
"""

from __future__ import annotations

from functools import cache
from typing import get_type_hints

from msgspec import Struct

from gusjob.controllers.gus.ranges import Range

Kind = Range | type
"""A number in a range; str, bool, an enumeration of texts, Scanner; or a record with entries of its own: a table."""


class Entry(Struct, frozen=True):
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


@cache
def entries_of(table: type) -> dict[str, tuple[str, Entry]]:
    """Return the field and entry of each (dotted) key of a table."""
    hints = get_type_hints(table, include_extras=True)
    found = ((name, mark) for name, hint in hints.items() for mark in getattr(hint, "__metadata__", ()))
    return {entry.key or name: (name, entry) for name, entry in found}
