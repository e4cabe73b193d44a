"""Diagnostics that only the planner can make, at the lines of the job."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gusjob.diagnostics.model import Collector, Rule
from gusjob.kinematics.arrays import Indices
from gusjob.planner.plan import StagedPath


def report_rows(
    staged: StagedPath,
    collector: Collector,
    rule: Rule,
    rows: Indices,
    fields: Callable[[int], dict[str, Any]],
    word: str = "",
) -> None:
    """Report some rows of the path: one diagnostic a line, with a count.

    Args:
        rows: Rows of the path, (k,).
        fields: Fields of the diagnostic for the i-th of the rows; a line takes those of its first row.
        word: Word of the line at which the diagnostic is reported.
    """
    path = staged.path
    _, first, counts = np.unique(path.line[rows], return_index=True, return_counts=True)
    listed = collector.remaining(rule)
    for i, count in zip(first[:listed].tolist(), counts[:listed].tolist(), strict=True):
        row = int(rows[i])
        span = staged.job.locate(int(path.line[row]), word)
        remarks = staged.job.provenance_remarks(int(path.provenance[row]))
        collector.add(rule, span, fields(i), count, remarks)
    collector.count_unlisted(rule, max(len(first) - listed, 0))
