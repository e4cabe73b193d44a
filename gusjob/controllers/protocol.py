"""The interface of a controller: what the program needs to compile for it and to simulate it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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

    @property
    def formats_with_diagnostics(self) -> tuple[str, ...]:
        """Formats that have the diagnostics, too, and so can be written of a job that was not compiled."""

    def compile(self, job: Job, machine: Machine) -> tuple[StreamT, list[Diagnostic]]:
        """Compile a checked job to calls; with them the diagnostics that only the planner can make."""

    def write(
        self,
        stream: StreamT | None,
        form: str,
        overrides: Overrides = NO_OVERRIDES,
        *,
        name: str = "",
        diagnostics: Sequence[Diagnostic] = (),
    ) -> Iterator[bytes]:
        """Write a stream in one of the formats, in pieces that end with a line end.

        Args:
            stream: The calls; None for a job that was not compiled, in one of `formats_with_diagnostics`.
            form: The format.
            overrides: The values of LETs that the job was compiled with; the head names them.
            name: The job's name, for a job that was not compiled.
            diagnostics: Of the job.
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
