"""A statement put into a job's text; all other text stays as the user wrote it."""

from __future__ import annotations

from dataclasses import replace

from gusjob.diagnostics import Span
from gusjob.job import Job, LaserDelay, LaserMode, Setup, SkyWrite
from gusjob.syntax import Source


def with_statement(
    source: Source, job: Job, kind: type[LaserDelay | SkyWrite], channel: int, text: str
) -> Source | str:
    """The text with `text` in place of its one statement of a kind, or behind the channel's first LASER MODE.

    Where that is not to be done without guessing, the reason.
    """
    name = "SKYWRITE" if kind is SkyWrite else "LASER DELAY"
    found = [s for s in job.setups if isinstance(s.what, kind) and _speaks_of(s, channel)]
    spans = _spans(job, found)
    lines = {s.line for s in found}
    if kind is LaserDelay and any(s.channel != channel for s in job.setups if s.line in lines):
        return f"{name} in line {spans[0].line} speaks of more than one channel: write one for each"
    if len(spans) > 1:
        where = ", ".join(str(span.line) for span in spans)
        return f"the job has more than one {name}, in lines {where}: which of them is meant is yours to say"
    modes = _spans(job, [s for s in job.setups if isinstance(s.what, LaserMode) and s.channel == channel])
    if not spans and not modes:
        return f"the job has no LASER MODE for channel {channel} behind which {name} could stand"
    span = spans[0] if spans else modes[0]
    if span.path:
        return f"{name} belongs into {span.path}, an included file that other jobs may use: write it there by hand"
    return replace(source, data=_replaced(source, span, text) if spans else _inserted(source, span, text), _ends=None)


def _speaks_of(setup: Setup, channel: int) -> bool:
    if isinstance(setup.what, SkyWrite):
        return setup.what.settings is not None
    return setup.channel == channel


def _spans(job: Job, setups: list[Setup]) -> list[Span]:
    """Where statements stand, each once however often a loop comes by."""
    return [job.locate(line, "") for line in dict.fromkeys(s.line for s in setups)]


def _replaced(source: Source, span: Span, text: str) -> bytes:
    lines = source.data.split(b"\n")
    line = lines[span.line - 1].decode()
    lines[span.line - 1] = (line[: span.column - 1] + text + line[span.end_column - 1 :]).encode()
    return b"\n".join(lines)


def _inserted(source: Source, span: Span, text: str) -> bytes:
    """A line of its own behind that of a span, as far in as that, with the same line end."""
    lines = source.data.split(b"\n")
    line = lines[span.line - 1].decode()
    indent = line[: len(line) - len(line.lstrip())]
    lines.insert(span.line, (indent + text).encode() + b"\r" * line.endswith("\r"))
    return b"\n".join(lines)
