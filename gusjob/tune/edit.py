"""Insert or replace a statement in a job's text without changing other text."""

from __future__ import annotations

from msgspec.structs import replace

from gusjob.diagnostics.model import Span
from gusjob.frontend import Source
from gusjob.i18n.phrases import Phrase, all_of
from gusjob.ir.job import Job
from gusjob.ir.setup import LaserDelay, LaserMode, Setup, SkyWrite


def with_statement(
    source: Source, job: Job, kind: type[LaserDelay | SkyWrite], channel: int, text: str
) -> Source | str:
    """Put a statement in place of the job's only statement of its kind, or after the channel's first LASER MODE.

    Included files are not changed, since other jobs may use them: the statement is inserted after the INCLUDE.

    Returns:
        The new text; the reason if the position is ambiguous.
    """
    name = "SKYWRITE" if kind is SkyWrite else "LASER DELAY"
    found = [s for s in job.setups if isinstance(s.statement, kind) and _applies_to(s, channel)]
    own = [s for s in found if not job.locate(s.line, "").path]
    spans, lines = _statement_spans(job, own), {s.line for s in own}
    if kind is LaserDelay and any(s.channel != channel for s in job.setups if s.line in lines):
        return Phrase(
            "{name} in line {line} sets more than one channel; write one for each", name=name, line=spans[0].line
        )
    if len(spans) > 1:
        return Phrase(
            "the job has more than one {name}, in lines {lines}; keep one of them",
            name=name,
            lines=all_of(str(span.line) for span in spans),
        )
    if own and found[-1] not in own:
        path = job.locate(found[-1].line, "").path
        return Phrase(
            "the included file {path} sets {name} again after line {line}; remove one of them",
            path=path,
            name=name,
            line=spans[0].line,
        )
    if own:
        return replace(source, data=_replaced(source, spans[0], text), written=None)
    modes = [s for s in job.setups if isinstance(s.statement, LaserMode) and s.channel == channel]
    if not modes:
        return Phrase(
            "the job has no LASER MODE for channel {channel}, after which {name} could be written",
            channel=channel,
            name=name,
        )
    data = _inserted(source, _line_of(job, found[-1] if found else modes[0]), text)
    return replace(source, data=data, written=None)


def _line_of(job: Job, setup: Setup) -> int:
    """Return the line of the job's own text with a statement, or with the INCLUDE of its file."""
    if job.locate(setup.line, "").path and job.provenance is not None:
        return job.provenance.steps(setup.provenance)[-1].line
    return setup.line


def _applies_to(setup: Setup, channel: int) -> bool:
    if isinstance(setup.statement, SkyWrite):
        return setup.statement.settings is not None
    return setup.channel == channel


def _statement_spans(job: Job, setups: list[Setup]) -> list[Span]:
    """Return the spans of statements, each once however often a loop repeats it."""
    return [job.locate(line, "") for line in dict.fromkeys(s.line for s in setups)]


def _replaced(source: Source, span: Span, text: str) -> bytes:
    lines = source.lines_as_written()
    line = lines[span.line - 1].decode()
    lines[span.line - 1] = (line[: span.column - 1] + text + line[span.end_column - 1 :]).encode()
    return b"".join(lines)


def _inserted(source: Source, number: int, text: str) -> bytes:
    """Insert a line after another, with the same indentation and line end."""
    lines = source.lines_as_written()
    line = lines[number - 1].decode()
    new = line[: len(line) - len(line.lstrip())] + text
    end = line[len(line.rstrip("\r\n")) :]
    lines.insert(number, (new + end if end else f"\n{new}").encode())
    return b"".join(lines)
