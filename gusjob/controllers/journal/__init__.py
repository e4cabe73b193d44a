"""The journal: a file of JSON lines with every call that was really sent.

The first line describes the run (gusjob-journal/2). Each further line is a call: `t` in s since the start, the `code`
that it returned, for a buffered call the job's `row` (-1: a call that rebuilds the state of a resumed run), the job's
`line`, the `call` and its `args` (of what it points to, the values found there). Other lines mark an event:

- `part`: a run begins or continues at this row, `run` pulse along it, after `lead` rows of its own; what was marked
  before it ends at `to` (row, pulse) at the latest.
- `starting`: GT_CrdStart is called next.
- `off`: true before the first call that switches the laser off; false if none of these calls had an effect.
- `cut`: something else may have cut the laser since the last poll that found no fault.
- `moving`: the motion was in progress when the controller was opened; `rest`: it was confirmed to be at rest.
- `broken`: the laser went off at this row, `run` pulse along it, or later, but not after `to` (row, pulse).
- `end`: how the run ended; `resumed`: the journal of the run that continues this one.

Each line ends with `crc`, the CRC-32 of the text before it, continued from the line before: so changed, removed and
added lines are detected.

writer.py writes a journal, lines.py reads its lines, reader.py finds out where its run was interrupted. This module
imports nothing, since every command needs to recognize a journal.
"""

JOURNAL_SCHEMA = "gusjob-journal/2"
JOURNAL_START = b'{"schema":"gusjob-journal/'
"""The first bytes of a journal of any version."""


def is_current(data: bytes) -> bool:
    """Return whether a journal is of this version."""
    return data.startswith(b'{"schema":"%b"' % JOURNAL_SCHEMA.encode())
