"""The interface of a controller: what the program needs to compile for it and to simulate it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol, TypeVar

from gusjob.ir.overrides import NO_OVERRIDES, Overrides

if TYPE_CHECKING:  # The implementations import what they need when they are called: start-up stays short.
    from gusjob.config.machine import Machine
    from gusjob.diagnostics.model import Diagnostic
    from gusjob.ir.job import Job
    from gusjob.simulate import Trace

StreamT = TypeVar("StreamT")


class Controller(Protocol[StreamT]):
    """A controller and its command set. `StreamT` is its sequence of calls as data."""

    @property
    def name(self) -> str:
        """Name for people."""

    @property
    def formats(self) -> tuple[str, ...]:
        """Formats in which a stream can be written; the first one can be read again."""

    def compile(self, job: Job, machine: Machine) -> tuple[StreamT, list[Diagnostic]]:
        """Compile a checked job to calls; with them the diagnostics that only the planner can make."""

    def write(self, stream: StreamT, form: str, overrides: Overrides = NO_OVERRIDES) -> Iterator[bytes]:
        """Write a stream in one of the formats, in pieces that end with a line end.

        Args:
            stream: The calls.
            form: One of `formats`.
            overrides: The values of LETs that the job was compiled with; the head names them.
        """

    def simulate(
        self, stream: StreamT, machine: Machine, *, is_listing: bool = False, coarse: bool = False
    ) -> tuple[Trace | None, list[Diagnostic]]:
        """Simulate a stream on a machine.

        Args:
            stream: The calls.
            machine: Period, scanner, field and look-ahead.
            is_listing: The calls do not come from the planner: check what the planner would not make, too.
            coarse: Only the diagnostics are of interest: sample power at fewer ticks.

        Returns:
            The trace, or None if the run is too long to be simulated; and the diagnostics.
        """
