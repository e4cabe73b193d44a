"""Model of the GUS controller: a stream of calls to events, and the simulation of a stream."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import FOLLOW_KINDS, POWER_KINDS, Buffered, BufferedCalls, Stream
from gusjob.controllers.gus.checks import carrier_diagnostics, limit_diagnostics, listing_diagnostics
from gusjob.controllers.gus.execution import Execution
from gusjob.controllers.gus.executor import execute
from gusjob.controllers.gus.motions import limited_motions
from gusjob.diagnostics.model import Diagnostic
from gusjob.kinematics.arrays import Bools, Indices
from gusjob.simulate import Trace, simulate
from gusjob.simulate.events import ChannelEvents, Events, LaserSwitchEvents, MotionEvents, PowerEvents, StageEvents


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
    events, diagnostics = events_of(stream, execution)
    trace, found = simulate(events, machine, is_listing=is_listing, coarse=coarse)
    diagnostics += found
    if trace is not None:
        if is_listing:
            from gusjob.controllers.gus.listing_checks import rule_diagnostics  # Start-up time is part of the tool.

            diagnostics += listing_diagnostics(execution, events, trace)
            diagnostics += rule_diagnostics(stream, execution, events, trace, machine)
        diagnostics += carrier_diagnostics(trace)
    return trace, diagnostics


def find_diagnostics(stream: Stream, machine: Machine) -> list[Diagnostic]:
    """Find everything that the controller would report for a listing."""
    return simulate_stream(stream, machine, is_listing=True, coarse=True)[1]


def events_of(stream: Stream, execution: Execution) -> tuple[Events, list[Diagnostic]]:
    """Turn an executed stream into events.

    Returns:
        The events, and diagnostics of the calls that the controller refuses or treats in an unexpected way.
    """
    calls, stages = execution.run.calls, execution.stages
    per_stage = [stage.rows for stage in stages]
    rows = np.concatenate(per_stage) if per_stage else np.empty(0, dtype=np.intp)
    stage_of_row = np.repeat(np.arange(len(stages)), [len(r) for r in per_stage])
    takes_time = calls.kind[rows] <= Buffered.DELAY
    timed = np.flatnonzero(takes_time)
    stage_first = np.searchsorted(stage_of_row[timed], np.arange(len(stages) + 1))
    # For each row, how many motions and dwells run before it.
    segment_of_row: Indices = np.cumsum(takes_time) - takes_time
    motion, diagnostics = _motion(stream, execution, rows[timed], stage_of_row[timed])
    channels = tuple(
        ChannelEvents(
            channel=channel,
            switch=_switch(stream, calls, rows, stage_of_row, segment_of_row, channel),
            power=_power(calls, rows, stage_of_row, segment_of_row, channel),
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
        stage_first=stage_first,
        motion=motion,
        channels=channels,
        at_end=execution.at_end,
    )
    return events, [*execution.diagnostics, *diagnostics]


def _motion(
    stream: Stream, execution: Execution, row: Indices, stage: Indices
) -> tuple[MotionEvents, list[Diagnostic]]:
    """Make the motions and dwells that run, from their rows and stages, (m,)."""
    made = limited_motions(execution.run, row, stage, [s.settings for s in execution.stages])
    motion = made.events
    if stream.intent is not None:
        motion = replace(motion, run_kind=stream.intent.run[row])
    return motion, limit_diagnostics(stream.name, motion, made.too_fast, made.too_strong)


def _switch(
    stream: Stream,
    calls: BufferedCalls,
    rows: Indices,
    stage_of_row: Indices,
    segment_of_row: Indices,
    channel: int,
) -> LaserSwitchEvents:
    kind = calls.kind[rows]
    mine = np.flatnonzero(((kind == Buffered.ON) | (kind == Buffered.OFF)) & (calls.channel[rows] == channel))
    segment, on = segment_of_row[mine], kind[mine] == Buffered.ON
    mark_segment = segment
    if stream.intent is not None:
        # The planner names the motion that starts at the mark's start, or the one that ends at its end.
        number = np.zeros(len(calls), dtype=np.intp)
        number[rows] = segment_of_row
        named = stream.intent.mark_end[rows[mine]]
        mark_segment = np.where(named >= 0, number[named] + ~on, segment)
    return LaserSwitchEvents(stage=stage_of_row[mine], segment=segment, on=on, mark_segment=mark_segment)


def _power(
    calls: BufferedCalls, rows: Indices, stage_of_row: Indices, segment_of_row: Indices, channel: int
) -> PowerEvents:
    mine = np.flatnonzero(np.isin(calls.kind[rows], POWER_KINDS) & (calls.channel[rows] == channel))
    mine = mine[_changes_power(calls.kind[rows[mine]])]
    row = rows[mine]
    kind = calls.kind[row]
    follow = np.isin(kind, FOLLOW_KINDS)
    # What power is in force after the end of a follow is not documented: none that a call has set.
    direct = np.where(kind == Buffered.FOLLOW_OFF, np.nan, calls.p[row])
    return PowerEvents(
        stage=stage_of_row[mine],
        segment=segment_of_row[mine],
        low=np.where(follow, calls.q[row], direct),
        ratio=np.where(follow, calls.p[row], 0.0),
        high=np.where(follow, calls.r[row], np.inf),
    )


def _changes_power(kind: npt.NDArray[np.uint8]) -> Bools:
    """Find the power calls of a channel that change its power, (e,): a follow ends only after one has begun."""
    ends = kind == Buffered.FOLLOW_OFF
    last = np.maximum.accumulate(np.where(ends, -1, np.arange(len(kind))))
    return np.asarray(~ends | ((last >= 0) & np.isin(kind[last], FOLLOW_KINDS)))
