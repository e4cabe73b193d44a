"""The files that the arguments of a command name: files, folders, and globs that the shell did not expand."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import click

from gusjob.cli.common import stop
from gusjob.cli.standard_input import STANDARD_INPUT, named_path
from gusjob.i18n.phrases import Phrase, any_of, localized
from gusjob.inputs import exists

CURRENT_FOLDER = Path()
"""What a command that only reads takes if no file is named."""


def refuse_writing_unnamed(paths: tuple[Path, ...], why: Phrase) -> None:
    """Refuse to rewrite files that nobody named."""
    if not paths:
        raise click.UsageError(localized(why))


def files_named(paths: tuple[Path, ...], endings: tuple[str, ...]) -> list[Path]:
    """List the files that are named, each once, in their order; of folders those with one of the endings."""
    files: dict[str, Path] = {}
    for path in paths:
        for file in _named(path, endings):
            files.setdefault(_identity(file), file)
    return list(files.values())


def _named(path: Path, endings: tuple[str, ...]) -> list[Path]:
    """List a file, the files of a folder, or what a glob matches.

    A check of no files must not pass: a folder or glob without a file ends with exit status 2.
    """
    if path == STANDARD_INPUT:
        return [path]
    if exists(path) and path.is_dir():
        kinds = any_of(endings)
        return list(_inside(path, endings)) or stop(
            Phrase("{path}: there is no {kinds} file in this folder", path=path, kinds=kinds)
        )
    if exists(path):  # part[1].job is a name like any other.
        return [path]
    from glob import glob, has_magic  # Start-up time is part of the tool.

    if not has_magic(str(path)):
        return [path]
    found = glob(str(path), recursive=True)  # noqa: PTH207  (Path.glob takes no absolute pattern)
    matches = [named_path(os.path.join(os.curdir, name)) for name in sorted(found)]  # noqa: PTH118  (no file is -)
    files = [file for match in matches for file in (_inside(match, endings) if match.is_dir() else (match,))]
    return files or stop(Phrase("{path}: no file matches", path=path))


def _inside(folder: Path, endings: tuple[str, ...]) -> Iterator[Path]:
    """List the files in a folder and its subfolders, in order, without hidden folders."""
    inside = (p for p in folder.rglob("*") if p.suffix.lower() in endings and p.is_file())
    yield from sorted(p for p in inside if not any(part.startswith(".") for part in p.relative_to(folder).parts))


def _identity(path: Path) -> str:
    """A key that is equal for two spellings of a path. A link counts as a file: it may lie beside another profile."""
    if path == STANDARD_INPUT:
        return str(path)
    try:
        return os.path.normcase(path.parent.resolve() / path.name)
    except (OSError, ValueError, RuntimeError):  # No such name, or a loop of links: reported when it is read.
        return str(path)
