"""The journal: a file of JSON lines with every call that was really sent.

The first line describes the run (gusjob-journal/1). Each further line is a call: `t` in s since the start, the `code`
that it returned, for a buffered call the job's `row` (-1: a call that rebuilds the state of a resumed run), the job's
`line`, the `call` and its `args` (of what it points to, the values found there). A `part` line marks where a run begins
or continues, a `broken` line where the laser went off to pause or end, the `end` line how the run ended.

writer.py writes a journal, reader.py finds out where its run ended. This module imports nothing, since every command
needs to recognize a journal.
"""

JOURNAL_SCHEMA = "gusjob-journal/1"
JOURNAL_START = b'{"schema":"' + JOURNAL_SCHEMA.encode()
"""The first bytes of a journal."""
