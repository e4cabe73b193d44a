"""A job after expansion: its statements in the order in which they run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct, field

from gusjob.frontend.parse.job_reader import JobText
from gusjob.frontend.parse.statement import Statement
from gusjob.frontend.scan.rows import Rows
from gusjob.frontend.source_map import SourceMap
from gusjob.ir.provenance import Provenance
from gusjob.kinematics.arrays import Ints

if TYPE_CHECKING:  # Start-up time is part of the tool: a plain job has none.
    from gusjob.frontend.expand.override_notes import OverrideNotes


class ExpandedJob(Struct, frozen=True, kw_only=True, eq=False):
    """All statements of a job in the order in which they run.

    Attributes:
        name: Name of the job.
        rows: The statements; SETUP rows point into `setups`.
        setups: Setup statements.
        sources: The texts.
        frame_parent: For each frame (from 1) the frame around it, 0 for none.
        provenance: None where every statement is outside of all loops and routines.
        lets: Lines that set each name.
        complete: Whether every line could be parsed and expanded.
        override_notes: Finds the overrides that a diagnostic depends on; None without overrides.
    """

    name: str
    rows: Rows
    setups: tuple[Statement, ...]
    sources: SourceMap
    frame_parent: Ints
    provenance: Provenance | None = None
    lets: dict[str, list[int]] = field(default_factory=dict)
    complete: bool = True
    override_notes: OverrideNotes | None = None

    @classmethod
    def of_plain(cls, text: JobText) -> ExpandedJob:
        """The job of a text that has nothing to expand."""
        sources = SourceMap()
        sources.add(text.source)
        return cls(
            name=text.source.name,
            rows=text.rows,
            setups=text.setups,
            sources=sources,
            frame_parent=np.zeros(1, dtype=np.int64),
            complete=not text.diagnostics,
        )
