"""From text to Job or Stream, with all diagnostics of the text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec.structs import replace

from gusjob.config.machine import Abi, Machine
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.characters import without_consequences
from gusjob.diagnostics.model import Diagnostic, has_errors
from gusjob.frontend.expand.expanded_job import ExpandedJob
from gusjob.frontend.parse.job_reader import JobText, more_diagnostics, read_job_text
from gusjob.frontend.resolve.resolver import resolve
from gusjob.frontend.source import Source, is_listing_text
from gusjob.i18n.phrases import Phrase
from gusjob.ir.job import Job
from gusjob.ir.overrides import NO_OVERRIDES, Overrides

if TYPE_CHECKING:
    from gusjob.controllers.gus.calls import Stream


def is_listing(source: Source) -> bool:
    """Whether a text is a listing of calls: by its file's suffix, else by its content."""
    return is_listing_text(source.name, source.data)


def read_job(source: Source, machine: Machine, overrides: Overrides = NO_OVERRIDES) -> tuple[Job, list[Diagnostic]]:
    """Read a job text for a machine.

    Args:
        source: The text; its path says where files to include are.
        machine: Gives pulses per mm, chord tolerance and limits of the expansion.
        overrides: Values in place of those of the text's LETs.

    Returns:
        The job, and all diagnostics of the text. With errors the job has only what could be read.
    """
    text = read_job_text(source)
    found = list(text.diagnostics)
    if text.is_plain:
        expanded = ExpandedJob.of_plain(text)
        found += _unknown_names(text, overrides)
    else:
        expanded, diagnostics = _expand(text, machine, overrides)
        found += diagnostics
    job, diagnostics = resolve(expanded, machine)
    found += diagnostics
    if text.diagnostics_not_listed:
        found.append(more_diagnostics(text))
    if text.has_lower_case:
        from gusjob.frontend.parse.keyword_case import lower_case_note  # Start-up time is part of the tool.

        note = lower_case_note(source.data, source.name)
        found += [] if note is None else [note]
    if not len(expanded.rows.op) and not found:
        found.append(Diagnostic(rule=rules.EMPTY, span=d.NOWHERE, fields={"what": Phrase("statements")}))
    return job, [_with_path(diagnostic, source.name) for diagnostic in without_consequences(found)]


def _unknown_names(text: JobText, overrides: Overrides) -> list[Diagnostic]:
    """Report all overrides of a text without LETs; a LET that can't be parsed is reported already."""
    names = [name for name in overrides if name not in text.unread_names]
    if not names:
        return []
    from gusjob.frontend.expand.let_overrides import unknown_name  # Start-up time is part of the tool.

    return [unknown_name(name, ()) for name in names]


def _expand(text: JobText, machine: Machine, overrides: Overrides) -> tuple[ExpandedJob, list[Diagnostic]]:
    """Expand a text with loops, names, routines, frames or includes."""
    from gusjob.frontend.expand.expander import expand  # Start-up time is part of the tool.
    from gusjob.frontend.expand.program_builder import build_program

    program, of_program = build_program(text, machine, overrides)
    expanded, of_expansion = expand(program, text.source.name, machine)
    diagnostics = [*of_program, *of_expansion]
    return replace(expanded, complete=not has_errors([*text.diagnostics, *diagnostics])), diagnostics


def read_listing(source: Source, abi: Abi | None = None) -> tuple[Stream, list[Diagnostic]]:
    """Read the calls of a listing.

    Args:
        source: The text.
        abi: ABI of the library that the calls are for; None if it is not known.

    Returns:
        The calls, and all diagnostics of the text. With errors the stream has only what could be read.
    """
    from gusjob.frontend.listing import listing_reader

    stream, found = listing_reader.read_listing(source, abi)
    if not len(stream.buffered) and not stream.calls and not found:
        found = [Diagnostic(rule=rules.EMPTY, span=d.NOWHERE, fields={"what": Phrase("GT_ calls")})]
    if source.encoding:
        fields = {"encoding": source.encoding}
        found = [Diagnostic(rule=rules.RECODED, span=d.NOWHERE, fields=fields), *found]
    return stream, [_with_path(diagnostic, source.name) for diagnostic in found]


def locate_calls(diagnostics: list[Diagnostic], source: Source) -> list[Diagnostic]:
    """Give diagnostics that know only their line the span of the line's code."""
    located = []
    for diagnostic in diagnostics:
        if diagnostic.span.end_column or diagnostic.rule is rules.NOT_LISTED:
            located.append(diagnostic)
            continue
        line = diagnostic.span.line
        code = source.line(line).split("//")[0]
        start = len(code) - len(code.lstrip()) + 1
        span = d.Span(line=line, column=start, end_line=line, end_column=max(len(code.rstrip()) + 1, start + 1))
        located.append(replace(diagnostic, span=span))
    return located


def _with_path(diagnostic: Diagnostic, name: str) -> Diagnostic:
    return diagnostic if diagnostic.path else replace(diagnostic, path=name)
