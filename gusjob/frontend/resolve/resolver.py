"""Assemble the Job from expanded statements, and report problems that only the whole job shows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gusjob.config.machine import Machine
from gusjob.controllers.gus.ranges import CHANNEL, Membership
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule
from gusjob.frontend.expand.expanded_job import ExpandedJob
from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.statement import RowOp
from gusjob.frontend.resolve.columns import ResolvedColumns, settled_rows
from gusjob.frontend.resolve.path import ResolvedPath, resolve_path
from gusjob.frontend.resolve.setups import resolve_setups
from gusjob.frontend.resolve.speeds import written_speeds
from gusjob.i18n.phrases import Phrase
from gusjob.ir.effects import POSITION, is_known
from gusjob.ir.job import Job

if TYPE_CHECKING:  # Start-up time: most jobs have no FRAME.
    from gusjob.frontend.resolve.frames import Frames


def resolve(expanded: ExpandedJob, machine: Machine) -> tuple[Job, list[Diagnostic]]:
    """The job of expanded statements on a machine."""
    columns = ResolvedColumns(settled_rows(expanded.rows), machine)
    frames = None
    if columns.has(Column.FRAME):
        from gusjob.frontend.resolve.frames import frames_of

        frames = frames_of(columns, expanded.frame_parent)
    path = resolve_path(columns, frames, expanded.setups)
    sources, lets = expanded.sources, expanded.lets
    job = Job(
        name=expanded.name,
        path=path.path,
        speeds=written_speeds(columns, path.path_row),
        setups=resolve_setups(columns, expanded.setups, path),
        locate=sources.locate,
        text_of=sources.text_of,
        name_remarks=lambda line, word: sources.name_remarks(line, word, lets),
        files=sources.files,
        included_paths=tuple(dict.fromkeys(sources.included_paths)),
        included=tuple((source.name, source.data) for source in sources.sources[1:]),
        in_pulses=bool((columns.op == RowOp.UNITS_PULSE).any()),
        complete=expanded.complete,
        unknown_at_end=int(path.unknown[-1]) if len(path.unknown) else 0,
        provenance=expanded.provenance,
        with_override_notes=None if expanded.override_notes is None else expanded.override_notes.add_to,
    )
    return job, _diagnostics(job, columns, frames, path)


def _diagnostics(job: Job, columns: ResolvedColumns, frames: Frames | None, path: ResolvedPath) -> list[Diagnostic]:
    """Channels that do not exist, frames without a usable size, arcs in frames that are none."""
    provenance = columns.provenance()
    found = []

    def report(rule: Rule, row: int, word: str, count: int, **fields: Any) -> None:
        span, remarks = job.locate(int(columns.rows.line[row]), word), job.provenance_remarks(int(provenance[row]))
        found.append(Diagnostic(rule=rule, span=span, fields=fields, count=count, remarks=remarks))

    op, channel = columns.op, columns.channel()
    written = op == RowOp.CHANNEL
    if columns.has(Column.CHANNEL):
        written = written | (~np.isnan(columns.raw(Column.CHANNEL)) & (op != RowOp.UNREAD))
    bad = np.flatnonzero(written)
    bad = bad[(CHANNEL.classify(channel[bad]) > 0) | ~CHANNEL.carries(channel[bad])]
    for row, count in columns.first_of_lines(bad):
        word, value = "value" if op[row] == RowOp.CHANNEL else "CHANNEL", float(channel[row])
        fields = {"what": "CHANNEL", "value": value, "unit": "", "range": str(CHANNEL), "hint": ""}
        report(rules.OUT_OF_RANGE, row, word, count, **fields)
    if frames is not None:
        from gusjob.frontend.resolve.frames import SCALE_RANGE

        begins, scale = op == RowOp.FRAME, columns.raw(Column.RATIO)
        for row, count in columns.first_of_lines(np.flatnonzero(begins & ~(scale > 0) & ~np.isnan(scale))):
            report(rules.FRAME_SCALE, row, "SCALE", count, value=float(scale[row]))
        size = frames.written_scale[columns.frame()]
        outside = begins & (SCALE_RANGE.classify(size) == Membership.OUTSIDE)
        for row, count in columns.first_of_lines(np.flatnonzero(outside)):
            allowed = Phrase("in {range}", range=str(SCALE_RANGE))
            report(rules.FRAME_SCALE_RANGE, row, "SCALE", count, value=float(size[row]), range=allowed)
    if not columns.machine.equal_axes and columns.is_arc.any():
        in_mm, in_pulse = columns.arc_units()
        i_pulse = columns.in_pulse(Column.I)
        for row, count in columns.first_of_lines(np.flatnonzero(columns.is_arc & in_mm & in_pulse)):
            units = ("mm", "pulse") if i_pulse is None or not i_pulse[row] else ("pulse", "mm")
            report(rules.ARC_IN_TWO_UNITS, row, "J", count, first=units[0], second=units[1])
    for arc in path.bad_arcs:
        if is_known(int(path.unknown_before[arc.row] | path.unknown[arc.row]), POSITION):
            report(arc.rule, arc.row, arc.word, 1, **arc.fields)
    return found
