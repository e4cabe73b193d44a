"""Pass: sky writing. Every mark gets a run-in and a run-out: it is at mark speed from its first to its last point.

        jump          run-in          mark               run-out         jump
    ............P-->-->-->-->-->S==================E-->-->-->-->-->Q............
                |  v^2/2a  | 10 us * NPREV |       | 10 us * NPOST |  v^2/2a |

RTC5 manual p. 115: run-in and run-out last 10 us * Nprev and Npost at mark speed. The RTC5's set path has no
acceleration; a GUS has one, so the distance for acceleration is added before the run-in, and that for deceleration
after the run-out. Mode 1 moves to P backwards from S, and from Q back to E; modes 2 and 3 jump to P and on from Q.
A line is continued straight, an arc along its circle. Switches that need all velocities are placed by a later pass.
"""

from __future__ import annotations

import numpy as np

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.ir.job import Job
from gusjob.ir.modal import modal_state
from gusjob.kinematics.arrays import Indices
from gusjob.planner.plan import NO_SKY_WRITING, QuantizedPath, StagedPath, rearranged
from gusjob.planner.quantize import quantize


def add_runs(quantized: QuantizedPath) -> QuantizedPath:
    """Add run-ins, run-outs and switches to the marks; without sky writing the path stays as it is."""
    number, settings = quantized.job.sky_writing_by_row()
    if not settings:
        return quantized
    # Most jobs have no sky writing: start-up time is part of the tool.
    from gusjob.planner.skywriting.added_rows import AddedRows
    from gusjob.planner.skywriting.marks import find_marks
    from gusjob.planner.skywriting.run_rows import add_run_rows
    from gusjob.planner.skywriting.switch_rows import add_switch_rows

    marks = find_marks(quantized, number, settings)
    if not marks.is_mark.any():
        return quantized
    # Elsewhere nothing is moved, and a stage must not lose all its rows.
    with_marks = np.isin(stage_of_rows(quantized), quantized.stage_of_timed[marks.is_mark])
    spare = with_marks & np.isin(quantized.origin, redundant_switches(quantized.job))
    if spare.any():
        kept = np.flatnonzero(~spare)
        quantized = quantize(rearranged(quantized, kept, {}), NO_SKY_WRITING)
        marks = find_marks(quantized, number, settings)
    rows = AddedRows(quantized=quantized, marks=marks)
    run_out_ends = add_run_rows(quantized, marks, rows)
    add_switch_rows(quantized, marks, rows, run_out_ends)
    return quantize(*rows.build())


def stage_of_rows(staged: StagedPath) -> Indices:
    """Number of the stage of each row, (n,)."""
    return np.searchsorted([stage.first for stage in staged.stages], np.arange(len(staged.path)), side="right") - 1


def redundant_switches(job: Job) -> Indices:
    """Find the rows of the job's path that switch a laser on that is on, or off that is off, ascending.

    Sky writing moves the switches of its marks along the path. A switch that stays where it is must not come behind a
    LASER OFF that was moved before it, nor before one that was moved behind it: such switches are left out. What comes
    before the first LASER ON stays, since an earlier program may have left the laser on.
    """
    modal, found = modal_state(job), []
    for channel in CHANNELS:
        switches = modal.switches(channel)
        same = np.append(False, switches.on[1:] == switches.on[:-1])[: len(switches)]
        begun = np.maximum.accumulate(switches.on) if len(switches) else switches.on
        found.append(switches.rows[same & begun & switches.is_buffered])
    return np.sort(np.concatenate(found))
