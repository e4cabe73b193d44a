"""The job: setup statements as records, the path as columns. Positions in pulse, not yet rounded."""

from __future__ import annotations

import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from gusjob.diagnostics.model import Diagnostic, Remark, Span
from gusjob.ir.path import Path, Speeds
from gusjob.ir.provenance import Locate, Provenance
from gusjob.ir.setup import Setup, SkyWrite, SkyWriting
from gusjob.kinematics.arrays import Indices


class Job(Struct, frozen=True, kw_only=True):
    """A whole job.

    Lines are numbered through all files of a job. `locate` finds the span of a line and a word in it, `text_of` the
    source line of a span, `name_remarks` the statements that set the names in a word of a line. `setups` are in job
    order.
    """

    name: str
    path: Path
    speeds: Speeds
    setups: tuple[Setup, ...]
    locate: Locate
    text_of: Callable[[Span], str]
    name_remarks: Callable[[int, str], tuple[Remark, ...]]
    files: tuple[tuple[str, int], ...] = ()
    """For a job that includes files: name of each file, its own first, and the offset of its line numbers."""
    included_paths: tuple[pathlib.Path, ...] = ()
    """The files that INCLUDEs name, whether or not they could be read. `files` has their names for messages."""
    included: tuple[tuple[str, bytes], ...] = ()
    """Name and text of every included file."""
    in_pulses: bool = False
    """The job is written in the controller's units (UNITS PULSE)."""
    complete: bool = True
    """Every line of the text is in the job. If not, what seems to be missing may be in a line with a diagnostic."""
    unknown_at_end: int = 0
    """The state at the end, bits of ir.effects."""
    provenance: Provenance | None = None
    """None for a job without loops, routines and includes."""
    with_override_notes: Callable[[Diagnostic], Diagnostic] | None = None
    """Adds to a diagnostic the overrides of LETs that it depends on; None for a job without overrides."""

    def without_path(self) -> Job:
        """Return what is left to tell of a job when it is compiled: all but its path, which takes the most memory."""
        return replace(self, path=self.path.without_rows())

    def provenance_remarks(self, node: int) -> tuple[Remark, ...]:
        """Describe where a statement came from."""
        return self.provenance.remarks(node, self.locate) if self.provenance is not None and node else ()

    def is_own(self, line: Any) -> Any:
        """Whether a line, or each of an array of lines, is in the job's own file, not in one that it includes."""
        return line <= (self.files[1][1] if len(self.files) > 1 else np.inf)

    @property
    def has_forced_ends(self) -> bool:
        """Whether the job has an END: only the planner can find out whether it can be met."""
        return not bool(np.isnan(self.path.end).all())

    @property
    def has_sky_writing(self) -> bool:
        """Whether sky writing is on somewhere: only the planner can find out where its run-ins lie."""
        return any(isinstance(s.statement, SkyWrite) and s.statement.is_on for s in self.setups)

    def sky_writing_by_row(self) -> tuple[Indices, tuple[SkyWriting, ...]]:
        """For each row of the path the number of the settings in force, -1 where sky writing is off; the settings."""
        found: list[SkyWriting] = []
        rows, numbers = [0], [-1]
        for setup in self.setups:
            if isinstance(setup.statement, SkyWrite):
                settings = setup.statement.settings
                on = settings is not None and settings.is_on
                rows.append(setup.row)
                numbers.append(len(found) if on else -1)
                found += [settings] if settings is not None and on else []
        return np.repeat(np.array(numbers, dtype=np.intp), np.diff([*rows, len(self.path)])), tuple(found)
