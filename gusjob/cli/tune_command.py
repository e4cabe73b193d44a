"""`gusjob tune`: laser delays and sky writing for a scanner."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click
from msgspec.structs import replace

from gusjob.cli.common import bom_of, machine_option, rewrite, scanner_option, show, stop, write
from gusjob.cli.formats import FormatChoice
from gusjob.cli.language import Command
from gusjob.cli.quiet import is_quiet, quiet_option
from gusjob.cli.standard_input import file_path
from gusjob.config.machine import Machine, Scanner
from gusjob.diagnostics.model import has_errors
from gusjob.i18n.phrases import Phrase, all_of, figure, localized, reason_of
from gusjob.i18n.width import padded, width
from gusjob.pipeline import Checked, in_order, load

if TYPE_CHECKING:
    from gusjob.frontend import Source
    from gusjob.tune import TuneResult, TuneRun, Verdict


@click.command(name="tune", cls=Command)
@click.argument("path", metavar="FILE", type=click.Path(), callback=file_path)
@machine_option
@scanner_option
@click.option("--skywrite", is_flag=True, help="Tune SKYWRITE instead of LASER DELAY.")
@click.option("--mode", type=click.IntRange(1, 3), help="Mode of SKYWRITE. Default: the job's own, else 3.")
@click.option("--channel", type=click.IntRange(0, 1), default=0, show_default=True, help="Laser channel.")
@click.option("--write", "writes", is_flag=True, help="Write the statement into the job; its other text is unchanged.")
@click.option("--format", "form", type=FormatChoice(["text", "json"]), default="text", show_default=True)
@quiet_option
def command(
    path: Path,
    machine_path: Path | None,
    scanner: Scanner | None,
    skywrite: bool,
    mode: int | None,
    channel: int,
    writes: bool,
    form: str,
) -> None:
    """Find the laser delays, or the sky writing, that bring the ends of marks to their intended positions.

    Uses the scanner of the machine profile (or --scanner) and the velocities of this job. Shows what is optimized, the
    statement found and how it was found, mark quality before and after, and a verdict: what is better, and what is
    worse. If the job's own values are as good, the job stays as it is. Exit status: 0, also if there is nothing to
    gain; 1 if the job has errors, 2 if it can't be tuned. -q shows the statement only.
    """
    if mode is not None and not skywrite:
        raise click.UsageError(localized(Phrase("--mode needs --skywrite")))
    loaded = load(path, machine_path, scanner=scanner)
    if not isinstance(loaded, Checked) or has_errors(loaded.diagnostics):
        show(loaded)
        sys.exit(2 if loaded.is_unreadable else 1)
    if loaded.job is None:
        why = Phrase("this is a listing; only a job can be tuned")
        stop(f"{path}: {localized(why)}")
    if loaded.machine.scanner is None:
        stop(localized(Phrase("no scanner is set: use --scanner, or scanner in the machine profile")))
    from gusjob.tune import delay_objective, judge, run_job, sky_writing_objective, tune_delays, tune_sky_writing

    before = run_job(loaded.source, loaded.job, list(loaded.diagnostics), loaded.machine)
    if before.trace is None:
        show(replace(loaded, diagnostics=in_order(before.diagnostics)))
        sys.exit(1)
    if skywrite:
        tuned = tune_sky_writing(before, loaded.machine, channel, mode)
        objective = sky_writing_objective(before, loaded.machine, mode)
    else:
        tuned = tune_delays(before, loaded.machine, channel)
        objective = delay_objective(loaded.machine, channel)
    if isinstance(tuned, str):
        stop(f"{path}: {localized(tuned)}")
    if tuned.run.trace is None:
        click.echo(f"{tuned.statement}\n{_how(tuned, loaded.machine)}\n")
        sources = {tuned.run.source.name: tuned.run.source}
        show(replace(loaded, content=tuned.run.job, sources=sources, diagnostics=in_order(tuned.run.diagnostics)))
        why = Phrase("with this statement the job has errors; nothing is written")
        click.echo(f"gusjob: {localized(why)}", err=True)
        sys.exit(1)
    verdict = judge(before, tuned, objective)
    writes = writes and verdict.is_gain
    if writes:  # Before any output: the reader of a pipe may stop reading.
        _write_job(path, loaded.source, tuned.run.source)
    if form == "json":
        from gusjob.tune.verdict import tune_json

        write([tune_json(before, tuned, verdict, loaded.machine, written=writes)], None)
        return
    if is_quiet():
        click.echo(tuned.statement)
        return
    click.echo("\n".join(_text(before, tuned, verdict, loaded.machine)))
    if writes:
        click.echo(localized(Phrase("written to {path}", path=path)))


def _text(before: TuneRun, tuned: TuneResult, verdict: Verdict, machine: Machine) -> Iterator[str]:
    """Yield the lines: the objective, what was found, mark quality before and after, the verdict."""
    from gusjob.tune import paired_totals

    yield from (localized(line) for line in verdict.objective.lines(verdict.after.marks))
    yield tuned.statement
    yield _how(tuned, machine)
    for channel in verdict.objective.channels:
        for one, other in paired_totals(before.marking, tuned.run.marking, channel):
            yield ""
            if len(verdict.objective.channels) > 1:
                yield localized(Phrase("channel {channel}", channel=channel))
            yield from _compared(one, other)
    yield ""
    found = Phrase("better: {text}", text=verdict.text)
    yield localized(found if verdict.is_gain else Phrase("nothing to gain: unchanged; {text}", text=verdict.text))
    if not verdict.is_gain:
        return
    yield from (localized(line) for line in verdict.worse_lines())
    if verdict.new_warnings:
        yield localized(
            Phrase("worse: with this statement the job has more warnings: {codes}", codes=all_of(verdict.new_warnings))
        )


def _how(tuned: TuneResult, machine: Machine) -> str:
    how = Phrase("found by {how}, for the scanner {scanner}", how=tuned.how, scanner=machine.scanner)
    return localized(Phrase("{how}: {range}", how=how, range=tuned.searched) if tuned.searched else how)


def _compared(one: dict[str, Any] | None, other: dict[str, Any] | None) -> Iterator[str]:
    """Yield the lines of a table: worst and typical mark quality of a channel in one unit, before and after."""
    from gusjob.simulate.quality.marks import MARKING_WORDS, marking_unit

    unit = (one or other or {"unit": "%"})["unit"]
    past, now = localized(Phrase("before")), localized(Phrase("after"))
    rows = [["", "", localized(Phrase("worst")), "", localized(Phrase("typical")), ""], ["", "", past, now, past, now]]
    for name, word in MARKING_WORDS.items():
        figures = [
            figure(entry[which][name] if entry else None, 4) for which in ("worst", "typical") for entry in (one, other)
        ]
        rows.append([localized(word), marking_unit(name, unit), *figures])
    rows.insert(2, [localized(Phrase("marks")), "", *[str(e["marks"]) if e else "0" for e in (one, other)], "", ""])
    widths = [max(width(row[i]) for row in rows) for i in range(6)]
    for row in rows:
        yield "  ".join(
            padded(cell, w) if i < 2 else " " * (w - width(cell)) + cell
            for i, (cell, w) in enumerate(zip(row, widths, strict=True))
        ).rstrip()


def _write_job(path: Path, before: Source, source: Source) -> None:
    """Replace the job file, unless it has changed since it was read."""
    try:
        bom = bom_of(path)
    except OSError as error:
        _not_written(path, reason_of(error))
    reason = rewrite(path, bom + before.as_written, bom + source.as_written)
    if reason:
        _not_written(path, reason)


def _not_written(path: Path, reason: str) -> NoReturn:
    why = Phrase("can't write: {reason}", reason=reason)
    stop(f"{path}: {localized(why)}")
