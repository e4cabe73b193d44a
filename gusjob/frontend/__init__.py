"""Frontend: text to Job or Stream, with diagnostics.

    text ─► scan, parse ─► rows ─► expand ─► rows ─► resolve ─► Job
    listing text ─► scan, listing ─► Stream of calls

`scan` turns lines into columns, `parse` one line into a statement (the only user of lark), `expand` runs loops,
routines, frames and includes, `resolve` makes units and positions absolute, `listing` reads calls, `format` writes a
job's text in its canonical layout.
"""

from __future__ import annotations

from gusjob.frontend.reader import is_listing, locate_calls, read_job, read_listing
from gusjob.frontend.source import Source, check_text, read_source

__all__ = ["Source", "check_text", "is_listing", "locate_calls", "read_job", "read_listing", "read_source"]
