"""Where calls go. A backend takes a stream and a machine and tells what was done; `sim` is the default."""

from __future__ import annotations

from typing import Protocol

from gusjob.diagnostics import Diagnostic
from gusjob.interpreter import Trace
from gusjob.machine import Machine
from gusjob.stream import Stream


class Backend(Protocol):
    """Runs the calls of a stream."""

    def run(self, stream: Stream, machine: Machine, *, foreign: bool) -> tuple[Trace | None, list[Diagnostic]]:
        """Run all of it. `foreign`: the calls come from somebody else's program."""
        ...
