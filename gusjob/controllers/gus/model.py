"""Model of the GUS controller: a stream of calls to events, and the simulation of a stream."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import FOLLOW_KINDS, POWER_KINDS, Buffered, BufferedCalls, Stream
from gusjob.controllers.gus.checks import carrier_diagnostics, limit_diagnostics, listing_diagnostics
from gusjob.controllers.gus.execution import Execution
from gusjob.controllers.gus.executor import execute
from gusjob.controllers.gus.motions import limited_motions
from gusjob.diagnostics.model import Diagnostic
from gusjob.kinematics.arrays import Bools, Indices
from gusjob.kinematics.freed_arrays import return_free_memory
from gusjob.kinematics.schedule import stage_numbers
from gusjob.simulate import Trace, simulate
from gusjob.simulate.events import ChannelEvents, Events, LaserSwitchEvents, MotionEvents, PowerEvents, StageEvents

_MANY_CALLS = 100_000
"""From so many buffered calls on memory matters."""


def simulate_stream(
    stream: Stream, machine: Machine, *, is_listing: bool = False, coarse: bool = False
) -> tuple[Trace | None, list[Diagnostic]]:
    """Simulate a stream on a machine.

    Args:
        stream: The calls.
        machine: Period, scanner, field and look-ahead.
        is_listing: The calls do not come from the planner: check corners, arcs, field and FIFO, too.
        coarse: Only the diagnostics are of interest: sample power at fewer ticks.

    Returns:
        The trace, or None if the run is too long to be simulated or not known; and the diagnostics.
    """
    execution = execute(stream, has_scanner=machine.scanner is not None)
    if not execution.is_known:
        return None, list(execution.diagnostics)
    linted = None
    if is_listing:
        from gusjob.controllers.gus.listing_checks import lint_calls  # Start-up time is part of the tool.

        linted = lint_calls(stream, execution, machine)
        if len(stream.buffered) > _MANY_CALLS:
            return_free_memory()
    events, diagnostics = events_of(stream, execution)
    trace, found = simulate(events, machine, is_listing=is_listing, coarse=coarse)
    diagnostics += found
    if trace is not None:
        if linted is not None:
            diagnostics += listing_diagnostics(execution, events, trace)
            diagnostics += linted.diagnostics(events, trace)
        diagnostics += carrier_diagnostics(trace)
    return trace, diagnostics


def events_of(stream: Stream, execution: Execution) -> tuple[Events, list[Diagnostic]]:
    """Turn an executed stream into events.

    Returns:
        The events, and diagnostics of the calls that the controller refuses or treats in an unexpected way.
    """
    stages, run = execution.stages, _RunRows.of(execution)
    motion, diagnostics = _motion(stream, execution, run)
    channels = tuple(
        ChannelEvents(
            channel=channel,
            switch=_switch(stream, run, channel),
            power=_power(run, channel),
            laser_at_end=execution.lasers[channel],
        )
        for channel in execution.channels
    )
    events = Events(
        name=stream.name,
        stages=tuple(
            StageEvents(
                line=stage.line,
                lasers=stage.lasers,
                at_rest=tuple(stage.at_rest),
                moving=tuple(stage.moving),
                axes=stage.settings.axes,
                start_ms=stage.start_ms,
                rest_ms=stage.rest_ms,
            )
            for stage in stages
        ),
        stage_first=run.stage_first,
        motion=motion,
        channels=channels,
        at_end=execution.at_end,
    )
    return events, [*execution.diagnostics, *diagnostics]


class _RunRows(Struct, frozen=True, kw_only=True, eq=False):
    """The rows of the buffered calls that run, in order, (n,): those of all stages.

    `untimed` (k,): numbers of those that take no time. `row_first`, `stage_first` (s+1,): number of each stage's first
    row, and of its first motion or dwell; the count of all.
    """

    calls: BufferedCalls
    rows: Indices
    untimed: Indices
    row_first: Indices
    stage_first: Indices

    @classmethod
    def of(cls, execution: Execution) -> _RunRows:
        """Put the rows of all stages behind each other."""
        calls, per_stage = execution.run.calls, [stage.rows for stage in execution.stages]
        rows = per_stage[0] if len(per_stage) == 1 else np.concatenate([np.empty(0, dtype=np.intp), *per_stage])
        untimed = np.flatnonzero(calls.kind[rows] > Buffered.DELAY)
        row_first = np.cumsum([0, *map(len, per_stage)])
        stage_first = row_first - np.searchsorted(untimed, row_first)
        return cls(calls=calls, rows=rows, untimed=untimed, row_first=row_first, stage_first=stage_first)

    def timed(self) -> Indices:
        """The rows that are motions and dwells, (m,)."""
        return np.delete(self.rows, self.untimed) if len(self.untimed) else self.rows

    def of_kinds(self, kinds: Iterable[Buffered], channel: int) -> Indices:
        """Numbers of the rows of a channel that are of some kinds, none of which takes time."""
        row = self.rows[self.untimed]
        found: Indices = self.untimed[np.isin(self.calls.kind[row], [*kinds]) & (self.calls.channel[row] == channel)]
        return found

    def stage_of(self, numbers: Indices) -> Indices:
        """Stage of some rows."""
        return np.searchsorted(self.row_first, numbers, side="right") - 1

    def segment_of(self, numbers: Indices) -> Indices:
        """Number of motions and dwells that run before some rows."""
        return numbers - np.searchsorted(self.untimed, numbers)


def _motion(stream: Stream, execution: Execution, run: _RunRows) -> tuple[MotionEvents, list[Diagnostic]]:
    """Make the motions and dwells that run, (m,)."""
    row, settings = run.timed(), [stage.settings for stage in execution.stages]
    made = limited_motions(execution.run, row, stage_numbers(run.stage_first), settings)
    motion = made.events
    if stream.intent is not None:
        motion = replace(motion, run_kind=stream.intent.run[row])
    return motion, limit_diagnostics(stream.name, motion, made.too_fast, made.too_strong)


def _switch(stream: Stream, run: _RunRows, channel: int) -> LaserSwitchEvents:
    calls, mine = run.calls, run.of_kinds((Buffered.ON, Buffered.OFF), channel)
    segment, on = run.segment_of(mine), calls.kind[run.rows[mine]] == Buffered.ON
    mark_segment = segment
    if stream.intent is not None:
        # The planner names the motion that starts at the mark's start, or the one that ends at its end.
        number = np.zeros(len(calls), dtype=np.intp)
        number[run.rows] = run.segment_of(np.arange(len(run.rows)))
        named = stream.intent.mark_end[run.rows[mine]]
        mark_segment = np.where(named >= 0, number[named] + ~on, segment)
    return LaserSwitchEvents(stage=run.stage_of(mine), segment=segment, on=on, mark_segment=mark_segment)


def _power(run: _RunRows, channel: int) -> PowerEvents:
    calls, mine = run.calls, run.of_kinds(POWER_KINDS, channel)
    mine = mine[_changes_power(calls.kind[run.rows[mine]])]
    row = run.rows[mine]
    kind = calls.kind[row]
    follow = np.isin(kind, FOLLOW_KINDS)
    # What power is in force after the end of a follow is not documented: none that a call has set.
    direct = np.where(kind == Buffered.FOLLOW_OFF, np.nan, calls.p[row])
    return PowerEvents(
        stage=run.stage_of(mine),
        segment=run.segment_of(mine),
        low=np.where(follow, calls.q[row], direct),
        ratio=np.where(follow, calls.p[row], 0.0),
        high=np.where(follow, calls.r[row], np.inf),
    )


def _changes_power(kind: npt.NDArray[np.uint8]) -> Bools:
    """Find the power calls of a channel that change its power, (e,): a follow ends only after one has begun."""
    ends = kind == Buffered.FOLLOW_OFF
    last = np.maximum.accumulate(np.where(ends, -1, np.arange(len(kind))))
    return np.asarray(~ends | ((last >= 0) & np.isin(kind[last], FOLLOW_KINDS)))
