"""A journal is read as far as it was written."""

from __future__ import annotations

from pathlib import Path

from support.journals import with_checksums

from gusjob.controllers.journal.reader import RecordedRun, read_journal

HEAD = [
    b'{"schema":"gusjob-journal/2","job":"a.job","calls":"","rows":12,"options":"","begin":[0,0.0],"resumes":null}',
    b'{"t":0.1,"part":0,"run":0.0,"lead":0,"to":[0,0.0]}',
]
ROWS = [
    b'{"t":0.2,"code":0,"row":%d,"line":%d,"call":"GT_LnXY","args":[1,0,0,1,1,0,0]}' % (row, row + 3)
    for row in range(4)
]
END = [b'{"t":0.3,"end":"done","x":0.0,"y":0.0}']


def test_an_empty_journal_is_that_of_a_run_that_never_began(tmp_path: Path) -> None:
    (tmp_path / "a.journal").write_bytes(b"")
    found = read_journal(tmp_path / "a.journal")
    assert isinstance(found, str)
    assert "start the job again" in found


def test_a_line_that_was_cut_does_not_count(tmp_path: Path) -> None:
    """Cut after any byte, as by a kill or a power failure: the run is that of the whole lines."""
    path, whole, head = tmp_path / "a.journal", with_checksums([*HEAD, *ROWS, *END]), len(with_checksums(HEAD))
    for count in range(head, len(whole) + 1):
        written = whole[:count]
        lines = written[head:].count(b"\n")
        path.write_bytes(written)
        found = read_journal(path)
        assert isinstance(found, RecordedRun), written
        assert found.part is not None
        assert found.part.sent == min(lines, 4), written
        assert found.done == (lines == 5), written
        assert found.torn == (not written.endswith(b"\n")), written
