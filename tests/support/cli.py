"""The commands as a user calls them, and files for them."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner, Result
from support.tools import MARK

from gusjob.cli import cli

GOOD = MARK + "LASER POWER 50\nJUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\n"
"""A job without diagnostics."""


def gusjob(*args: object, given: bytes = b"") -> Result:
    """Run a command in this process. `given`: its standard input."""
    return CliRunner().invoke(cli, [str(a) for a in args], input=given, catch_exceptions=False)


def write(tmp_path: Path, text: str | bytes, name: str = "x.job") -> Path:
    """Write a file and return its path."""
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path
