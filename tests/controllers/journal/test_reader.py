"""A journal is read as far as it was written."""

from __future__ import annotations

from pathlib import Path

from gusjob.controllers.journal.reader import RecordedRun, read_journal

HEAD = b'{"schema":"gusjob-journal/1","job":"a.job","begin":[0,0.0]}\n{"t":0.1,"part":0,"run":0.0,"lead":0}\n'
ROWS = b"".join(
    b'{"t":0.2,"code":0,"row":%d,"line":%d,"call":"GT_LnXY","args":[1,0,0,1,1,0,0]}\n' % (row, row + 3)
    for row in range(8, 12)
)
END = b'{"t":0.3,"end":"done","x":0.0,"y":0.0}\n'


def test_a_line_that_was_cut_does_not_count(tmp_path: Path) -> None:
    """Cut after any byte, as by a kill or a power failure: the run is that of the whole lines."""
    path = tmp_path / "a.journal"
    for count in range(len(ROWS + END) + 1):
        written = (ROWS + END)[:count]
        lines = written.count(b"\n")
        path.write_bytes(HEAD + written)
        found = read_journal(path)
        assert isinstance(found, RecordedRun), written
        assert found.sent == (8 + min(lines, 4) if lines else 0), written
        assert (found.end is not None) == (lines == 5), written
