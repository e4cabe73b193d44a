"""gusjob check."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from glob import glob, has_magic
from pathlib import Path
from typing import Protocol

import click

from gusjob.cli.common import Verdict, machine_option, output_option, show, stop, write
from gusjob.diagnostics import Diagnostic
from gusjob.loading import Loaded, load, look_closer
from gusjob.rules import RULES

_CHECKED = {".job", ".gts"}
"""Endings of the files in a folder that are checked."""


def _prefixes(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    """Codes or the beginnings of codes, 'GJ4' or 'GJ401,GJ402'; each must begin a rule."""
    codes = tuple(code.strip().upper() for text in value for code in text.split(",") if code.strip())
    for code in codes:
        if not any(known.startswith(code) for known in RULES):
            raise click.BadParameter(f"no rule begins with {code}; `gusjob explain` lists them")
    return codes


@click.command(name="check")
@click.argument("paths", metavar="FILE|FOLDER|GLOB...", nargs=-1, required=True, type=click.Path(path_type=Path))
@machine_option
@click.option(
    "--format", "form", type=click.Choice(["text", "json", "sarif", "junit"]), default="text", show_default=True,
    help="text for people, json for programs, sarif for code scanning, junit for CI systems that show tests.",
)  # fmt: skip
@output_option
@click.option("--strict", is_flag=True, help="Warnings fail too.")
@click.option(
    "--select", multiple=True, callback=_prefixes, metavar="CODES", help="Only these rules, such as GJ4,GJ201."
)
@click.option("--ignore", multiple=True, callback=_prefixes, metavar="CODES", help="All but these rules.")
@click.option("--statistics", is_flag=True, help="Count the faults of each rule in place of listing them.")
def command(
    paths: tuple[Path, ...], machine_path: Path | None, form: str, output: Path | None, strict: bool,
    select: tuple[str, ...], ignore: tuple[str, ...], statistics: bool,
) -> None:  # fmt: skip
    """Check jobs and listings: words, ranges, modes, order, light, motion.

    All faults of all files are listed; in a FOLDER all .job and .gts files are checked, and of a GLOB ("**/*.job") that
    the shell has left as it is, what it matches. Exit status: 0 clean, 1 an error (with --strict also a warning), 2 a
    file that can't be read. A fault that is not selected does not count.
    """
    _refuse(form, output, statistics=statistics)
    wanted = _chosen(select, ignore)
    verdict, counts = Verdict(strict=strict), Counter[str]()
    by_rule: Counter[str] = Counter()
    gathered = _gathering(form, strict=strict, by_rule=by_rule if statistics else None)
    read: list[Path] = []
    number = left_out = 0
    for path in _files(paths):
        number += 1
        loaded = judged(path, machine_path)
        chosen = [fault for fault in loaded.faults if loaded.unreadable or wanted(fault)]
        left_out += len(loaded.faults) - len(chosen)
        loaded.faults = chosen
        verdict.add(loaded)
        counts.update(fault.severity.value for fault in loaded.faults)
        by_rule.update(_counted(loaded.faults))
        read += loaded.inputs
        if gathered is not None:
            gathered.add(loaded)
        elif not statistics:
            show(loaded, err=False)
    if gathered is not None:
        write([gathered.written()], output, sources=read)
    elif statistics:
        _print_statistics(by_rule)
    if gathered is None or output is not None:
        said = ", ".join(f"{n} {kind}{'s' if n != 1 else ''}" for kind, n in sorted(counts.items())) or "clean"
        hidden = f" ({left_out} not selected)" if left_out else ""
        click.echo(f"{number} file{'s' if number != 1 else ''}: {said}{hidden}", err=True)
    sys.exit(verdict.exit_code)


def _refuse(form: str, output: Path | None, *, statistics: bool) -> None:
    """What does not go together."""
    if form == "text" and output is not None:
        raise click.UsageError("-o is for --format json, sarif and junit")
    if statistics and form in ("sarif", "junit"):
        raise click.UsageError("--statistics is for text and JSON")


class _Gathering(Protocol):
    """A format for programs: files are added as they are judged, and it is written at the end."""

    def add(self, loaded: Loaded) -> None:
        """One more file."""

    def written(self) -> bytes:
        """All of it."""


def _gathering(form: str, *, strict: bool, by_rule: Counter[str] | None) -> _Gathering | None:
    """What gathers faults for a format; nothing for text, which is shown at once."""
    match form:
        case "json":
            return _Json(by_rule=by_rule)
        case "sarif":
            return _Sarif()
        case "junit":
            return _JUnit(strict)
        case _:
            return None


@dataclass(slots=True, kw_only=True)
class _Json:
    by_rule: Counter[str] | None
    faults: list[Diagnostic] = field(default_factory=list)

    def add(self, loaded: Loaded) -> None:
        self.faults += loaded.faults

    def written(self) -> bytes:
        from gusjob.report.files import check_json

        return check_json(self.faults, None if self.by_rule is None else dict(self.by_rule)) + b"\n"


class _Sarif:
    def __init__(self) -> None:
        from gusjob.report.sarif import SarifLog

        self._log = SarifLog()

    def add(self, loaded: Loaded) -> None:
        self._log.add(loaded.path, loaded.faults, loaded.text_of, readable=not loaded.unreadable)

    def written(self) -> bytes:
        return self._log.written()


class _JUnit:
    def __init__(self, strict: bool) -> None:
        from gusjob.report.junit import JUnitReport

        self._report = JUnitReport(strict=strict)

    def add(self, loaded: Loaded) -> None:
        from gusjob.cli.text import diagnostic_text

        def describe(fault: Diagnostic) -> str:
            return diagnostic_text(fault, loaded.text_of, color=False)

        self._report.add(loaded.path, loaded.faults, describe, readable=not loaded.unreadable)

    def written(self) -> bytes:
        return self._report.written()


def _files(paths: tuple[Path, ...]) -> list[Path]:
    """The files to check, each once, in the order in which they are named."""
    files: dict[str, Path] = {}
    for path in paths:
        for file in _named(path):
            files.setdefault(_identity(file), file)
    return list(files.values())


def _named(path: Path) -> list[Path]:
    """A file as given; of a folder the jobs and listings in it; of a glob what it matches.

    A gate that looks at nothing must not open: a folder or glob without a file ends with 2.
    """
    if path.is_dir():
        return list(_inside(path)) or stop(f"{path}: there is no .job or .gts file in this folder")
    if not has_magic(str(path)) or path.exists():  # part[1].job is a name like any other.
        return [path]
    found = glob(str(path), recursive=True)  # noqa: PTH207  (Path.glob takes no absolute pattern)
    matches = [Path(name) for name in sorted(found)]
    files = [file for match in matches for file in (_inside(match) if match.is_dir() else (match,))]
    return files or stop(f"{path}: no file matches")


def _inside(folder: Path) -> Iterator[Path]:
    """The jobs and listings in a folder, in order, hidden folders left out."""
    inside = (p for p in folder.rglob("*") if p.suffix.lower() in _CHECKED and p.is_file())
    yield from sorted(p for p in inside if not any(part.startswith(".") for part in p.relative_to(folder).parts))


def _identity(path: Path) -> str:
    """The same for two ways to write a name. A link is a name of its own: it may lie beside another profile."""
    try:
        return os.path.normcase(path.parent.resolve() / path.name)
    except (OSError, ValueError, RuntimeError):  # No such name, or a loop of links: it is told when it is read.
        return str(path)


def _chosen(select: tuple[str, ...], ignore: tuple[str, ...]) -> Callable[[Diagnostic], bool]:
    """Whether a fault is wanted; of --select and --ignore the longer beginning wins."""

    def longest(code: str, prefixes: tuple[str, ...]) -> int:
        return max((len(p) for p in prefixes if code.startswith(p)), default=0)

    def wanted(fault: Diagnostic) -> bool:
        code = fault.rule.code
        chosen, left_out = longest(code, select), longest(code, ignore)
        return chosen > left_out if select else not left_out

    return wanted


def _counted(faults: list[Diagnostic]) -> Counter[str]:
    """Faults of each rule, those that are not listed or come in many rounds included."""
    counts: Counter[str] = Counter()
    for fault in faults:
        code = fault.rule.code
        if "count" in fault.fields and fault.fields.get("code") in RULES:
            code, times = str(fault.fields["code"]), int(fault.fields["count"])
            counts[code] += times
        else:
            counts[code] += fault.count
    return counts


def _print_statistics(counts: Counter[str]) -> None:
    for code, times in sorted(counts.items(), key=lambda item: (-item[1], item[0])):
        click.echo(f"{times:>9}  {code}  {RULES[code].severity.value:<7}  {RULES[code].title}")


def judged(path: Path, machine_path: Path | None) -> Loaded:
    """A file with all its diagnostics."""
    loaded = load(path, machine_path)
    look_closer(loaded)
    return loaded
