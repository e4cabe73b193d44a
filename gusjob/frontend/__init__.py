"""Text to Job or Stream, with diagnostics. The only importer of lark."""

from __future__ import annotations

from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from gusjob.config.machine import Machine
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, has_errors
from gusjob.frontend.files import SourceMap
from gusjob.frontend.parse.job_reader import JobText, more_diagnostics, plain, read_job_text
from gusjob.frontend.parse.spelling import small_note
from gusjob.frontend.resolve.elaborate import Told, elaborate
from gusjob.frontend.source import Source, check_text, read_source
from gusjob.i18n.phrases import Phrase
from gusjob.ir.job import Job

if TYPE_CHECKING:
    from gusjob.controllers.gus.calls import Stream

__all__ = ["Source", "check_text", "is_listing", "locate_calls", "read_job", "read_listing", "read_source"]

_JOB_ENDINGS = {".job"}
_LISTING_ENDINGS = {".gts", ".c", ".cc", ".cpp", ".h"}


def is_listing(source: Source) -> bool:
    """Whether a text is a listing of calls: by its file's ending, else by what it holds."""
    ending = PurePath(source.name).suffix.lower()
    if ending in _JOB_ENDINGS | _LISTING_ENDINGS:
        return ending in _LISTING_ENDINGS
    from gusjob.frontend.listing.reader import looks_like_listing

    return looks_like_listing(source.data)


def read_job(source: Source, machine: Machine) -> tuple[Job, list[Diagnostic]]:
    """A job text on a machine; all diagnostics of the text in one go."""
    text = read_job_text(source)
    found = list(text.diagnostics)
    if plain(text):
        sources = SourceMap()
        sources.add(source)
        nothing = np.zeros(1, dtype=np.int64)
        told = Told(
            name=source.name, rows=text.rows, setups=text.setups, sources=sources, frame_parent=nothing,
            whole=not text.diagnostics,
        )  # fmt: skip
    else:
        told, more = _carried_out(text, machine)
        found += more
    job, diagnostics = elaborate(told, machine)
    found += diagnostics
    if text.diagnostics_not_listed:
        found.append(more_diagnostics(text))
    if text.small_words and (note := small_note(source.data, source.name)) is not None:
        found.append(note)
    if not len(told.rows.op) and not found:
        found.append(Diagnostic(rule=rules.EMPTY, span=d.NOWHERE, fields={"what": Phrase("statements")}))
    return job, [_named(f, source.name) for f in found]


def _carried_out(text: JobText, machine: Machine) -> tuple[Told, list[Diagnostic]]:
    """A text with loops, names, routines, frames or includes, carried out."""
    from gusjob.frontend.expand.expand import expand  # Start-up time is part of the tool.
    from gusjob.frontend.expand.program import read_program

    program, diagnostics = read_program(text, machine)
    done = expand(program, machine)
    told = Told(
        name=text.source.name,
        rows=done.rows,
        setups=done.setups,
        sources=program.sources,
        frame_parent=done.frame_parent,
        trails=done.trails,
        lets=program.lets,
        whole=not has_errors([*text.diagnostics, *diagnostics, *done.diagnostics]),
    )
    return told, [*diagnostics, *done.diagnostics]


def read_listing(source: Source) -> tuple[Stream, list[Diagnostic]]:
    """A listing's calls; all diagnostics of the text in one go."""
    from gusjob.frontend.listing import reader as listing_reader

    stream, found = listing_reader.read_listing(source)
    if not len(stream.buffered) and not stream.calls and not found:
        found = [Diagnostic(rule=rules.EMPTY, span=d.NOWHERE, fields={"what": Phrase("GT_ calls")})]
    return stream, [_named(f, source.name) for f in found]


def locate_calls(diagnostics: list[Diagnostic], source: Source) -> list[Diagnostic]:
    """Diagnostics that know only their line get the span of the line's text."""
    placed = []
    for diagnostic in diagnostics:
        if diagnostic.span.end_column or diagnostic.rule is rules.MORE:
            placed.append(diagnostic)
            continue
        text = source.line(diagnostic.span.line).split("//")[0]
        start = len(text) - len(text.lstrip()) + 1
        line = diagnostic.span.line
        span = d.Span(line=line, column=start, end_line=line, end_column=max(len(text.rstrip()) + 1, start + 1))
        placed.append(replace(diagnostic, span=span))
    return placed


def _named(diagnostic: Diagnostic, name: str) -> Diagnostic:
    return diagnostic if diagnostic.path else replace(diagnostic, path=name)
