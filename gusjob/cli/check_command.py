"""gusjob check."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import click

from gusjob.cli.common import Verdict, machine_option, show, stop, write
from gusjob.diagnostics import Diagnostic
from gusjob.loading import Loaded, compiled, interpreted, interpreted_faults, load
from gusjob.machine import Budget
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
@click.argument("paths", metavar="FILE|FOLDER...", nargs=-1, required=True, type=click.Path(path_type=Path))
@machine_option
@click.option("--format", "form", type=click.Choice(["text", "json"]), default="text", show_default=True)
@click.option("--strict", is_flag=True, help="Warnings fail too.")
@click.option(
    "--select", multiple=True, callback=_prefixes, metavar="CODES", help="Only these rules, such as GJ4,GJ201."
)
@click.option("--ignore", multiple=True, callback=_prefixes, metavar="CODES", help="All but these rules.")
@click.option("--statistics", is_flag=True, help="Count the faults of each rule in place of listing them.")
def command(
    paths: tuple[Path, ...], machine_path: Path | None, form: str, strict: bool, select: tuple[str, ...],
    ignore: tuple[str, ...], statistics: bool,
) -> None:  # fmt: skip
    """Check jobs and listings: words, ranges, modes, order, light, motion.

    All faults of all files are listed; in a FOLDER all .job and .gts files are checked. Exit status: 0 clean, 1 an
    error (with --strict also a warning), 2 a file that can't be read. A fault that is not selected does not count.
    """
    wanted = _chosen(select, ignore)
    verdict, counts, faults = Verdict(strict=strict), Counter[str](), list[Diagnostic]()
    by_rule: Counter[str] = Counter()
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
        if form == "json":
            faults += loaded.faults
        elif not statistics:
            show(loaded, err=False)
    if form == "json":
        from gusjob.report.files import check_json

        write([check_json(faults, dict(by_rule) if statistics else None), b"\n"], None)
    else:
        if statistics:
            _print_statistics(by_rule)
        said = ", ".join(f"{n} {kind}{'s' if n != 1 else ''}" for kind, n in sorted(counts.items())) or "clean"
        hidden = f" ({left_out} not selected)" if left_out else ""
        click.echo(f"{number} file{'s' if number != 1 else ''}: {said}{hidden}", err=True)
    sys.exit(verdict.exit_code)


def _files(paths: tuple[Path, ...]) -> Iterator[Path]:
    """Files as given; of folders the jobs and listings in them, in order, hidden folders left out."""
    for path in paths:
        if not path.is_dir():
            yield path
            continue
        inside = (p for p in path.rglob("*") if p.suffix.lower() in _CHECKED and p.is_file())
        found = sorted(p for p in inside if not any(part.startswith(".") for part in p.relative_to(path).parts))
        if not found:  # A gate that looks at nothing must not open.
            stop(f"{path}: there is no .job or .gts file in this folder")
        yield from found


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
    """A file with all its diagnostics: for a listing, what the controller would say too."""
    loaded = load(path, machine_path)
    if loaded.machine.budget != Budget():
        interpreted(loaded)
    elif loaded.stream is not None:
        from gusjob.interpreter import find_faults

        interpreted_faults(loaded, find_faults(loaded.stream, loaded.machine))
    elif loaded.job is not None and (loaded.job.has_forced_ends or loaded.job.sky_writes):
        compiled(loaded)
    return loaded
