"""Diagnostics that only the planner sees, told at the lines of the job."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gusjob.diagnostics.model import Collector, Rule
from gusjob.kinematics.arrays import Indices
from gusjob.planner.plan import Plan


def report_rows(
    state: Plan,
    collector: Collector,
    rule: Rule,
    rows: Indices,
    fields: Callable[[int], dict[str, Any]],
    word: str = "",
) -> None:
    """One diagnostic a line, at its first of some rows of the path, with how often it comes; `fields` of the i-th
    row."""
    path = state.path
    _, first, counts = np.unique(path.line[rows], return_index=True, return_counts=True)
    listed = collector.room(rule)
    for i, count in zip(first[:listed].tolist(), counts[:listed].tolist(), strict=True):
        row = int(rows[i])
        span = state.job.locate(int(path.line[row]), word)
        remarks = state.job.provenance_remarks(int(path.provenance[row]))
        collector.add(rule, span, fields(i), count, remarks)
    collector.uncounted(rule, max(len(first) - listed, 0))
