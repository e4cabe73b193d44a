"""The built-in interpreter as a backend: no hardware, no light."""

from __future__ import annotations

from gusjob.diagnostics import Diagnostic
from gusjob.interpreter import Trace, interpret
from gusjob.machine import Machine
from gusjob.stream import Stream


class SimBackend:
    """Interprets the calls tick by tick."""

    def run(self, stream: Stream, machine: Machine, *, foreign: bool) -> tuple[Trace | None, list[Diagnostic]]:
        """What the controller would do, and what it would say."""
        return interpret(stream, machine, foreign=foreign)
