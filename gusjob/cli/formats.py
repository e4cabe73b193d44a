"""Formats of output: the one for people is called text by some commands and table by others; all take both names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    _Choice = click.Choice[str]
else:
    _Choice = click.Choice

_OTHER_NAME = {"text": "table", "table": "text"}


class FormatChoice(_Choice):
    """The names of a command's formats; text and table mean the one that it has."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the format, under the command's own name."""
        other = _OTHER_NAME.get(value)
        known = tuple(self.choices)
        return super().convert(other if value not in known and other in known else value, param, ctx)
