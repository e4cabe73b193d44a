"""A job with a note, a warning and a note, and the diagnostics that are reported of a file."""

from __future__ import annotations

from pathlib import Path

from gusjob.diagnostics.select import EMPTY_LAYER, SelectionLayer
from gusjob.pipeline import FileResult, examine_file, selected

# 4: GJ142 (note), 7: GJ404 (warning), 9: GJ141 (note)
JOB = """LASER MODE DUTY CARRIER 10kHz
VEL 100
ACC 5000
LET p = 3
LASER POWER 30
LASER ON
LINE X 10
DWELL 3
LINE X 20
LASER OFF
DEF f()
DWELL 3
END
"""
DIAGNOSTICS = {(4, "GJ142", "note"), (8, "GJ404", "warning"), (11, "GJ141", "note")}


def checked(path: Path, layer: SelectionLayer = EMPTY_LAYER) -> FileResult:
    return selected(examine_file(path), layer)


def found(path: Path, layer: SelectionLayer = EMPTY_LAYER) -> set[tuple[int, str, str]]:
    """(line, code, severity) of the reported diagnostics of a file."""
    return {(f.span.line, f.rule.code, f.severity.value) for f in checked(path, layer).diagnostics}
