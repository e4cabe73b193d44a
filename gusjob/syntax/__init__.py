"""Text to Job or Stream, with diagnostics. The only importer of lark."""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING

from gusjob import diagnostics as d
from gusjob.diagnostics import Diagnostic
from gusjob.job import Job
from gusjob.machine import Machine
from gusjob.syntax.elaborate import elaborate
from gusjob.syntax.job_reader import read_job_text
from gusjob.syntax.source import Source, check_text, read_source

if TYPE_CHECKING:
    from gusjob.stream import Stream

__all__ = ["Source", "check_text", "is_listing", "locate_calls", "read_job", "read_listing", "read_source"]

_JOB_ENDINGS = {".job"}
_LISTING_ENDINGS = {".gts", ".c", ".cc", ".cpp", ".h"}


def is_listing(source: Source) -> bool:
    """Whether a text is a listing of calls: by its file's ending, else by what it holds."""
    ending = PurePath(source.name).suffix.lower()
    if ending in _JOB_ENDINGS | _LISTING_ENDINGS:
        return ending in _LISTING_ENDINGS
    from gusjob.syntax.listing_reader import looks_like_listing

    return looks_like_listing(source.data)


def read_job(source: Source, machine: Machine) -> tuple[Job, list[Diagnostic]]:
    """A job text on a machine; all faults of the text in one go."""
    text = read_job_text(source)
    job, faults = elaborate(text, machine)
    found = [*text.diagnostics, *faults]
    if text.faults_not_listed:
        fields = {"count": text.faults_not_listed, "code": "the lines", "shown": len(text.diagnostics)}
        found.append(Diagnostic(rule=d.MORE, span=d.NOWHERE, fields=fields))
    if not len(text.rows.op) and not found:
        found.append(Diagnostic(rule=d.EMPTY, span=d.NOWHERE, fields={"what": "statements"}))
    return job, [_named(f, source.name) for f in found]


def read_listing(source: Source) -> tuple[Stream, list[Diagnostic]]:
    """A listing's calls; all faults of the text in one go."""
    from gusjob.syntax import listing_reader

    stream, found = listing_reader.read_listing(source)
    if not len(stream.buffered) and not stream.calls and not found:
        found = [Diagnostic(rule=d.EMPTY, span=d.NOWHERE, fields={"what": "GT_ calls"})]
    return stream, [_named(f, source.name) for f in found]


def locate_calls(faults: list[Diagnostic], source: Source) -> list[Diagnostic]:
    """Faults that know only their line get the span of the line's text."""
    placed = []
    for fault in faults:
        if fault.span.end_column or fault.rule is d.MORE:
            placed.append(fault)
            continue
        text = source.line(fault.span.line).split("//")[0]
        start = len(text) - len(text.lstrip()) + 1
        line = fault.span.line
        span = d.Span(line=line, column=start, end_line=line, end_column=max(len(text.rstrip()) + 1, start + 1))
        placed.append(Diagnostic(rule=fault.rule, span=span, fields=fault.fields, path=fault.path))
    return placed


def _named(fault: Diagnostic, name: str) -> Diagnostic:
    return fault if fault.path else Diagnostic(rule=fault.rule, span=fault.span, fields=fault.fields, path=name)
