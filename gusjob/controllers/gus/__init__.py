"""The Googol GUS controller: ranges, calls, lowering, listing, C program, model, library and driver."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from gusjob.ir.overrides import NO_OVERRIDES, Overrides

if TYPE_CHECKING:
    from gusjob.config.machine import Machine
    from gusjob.controllers.gus.calls import Stream
    from gusjob.controllers.protocol import Controller
    from gusjob.diagnostics.model import Diagnostic
    from gusjob.ir.job import Job
    from gusjob.simulate import Trace


class GusController:
    """The GUS as a `Controller`."""

    name = "GUS"
    formats = ("gts", "json", "c")
    formats_with_diagnostics = ("json",)

    def compile(self, job: Job, machine: Machine) -> tuple[Stream, list[Diagnostic]]:
        """Compile a checked job: see gusjob.controllers.gus.lower.compile_job."""
        from gusjob.controllers.gus.lower import compile_job

        return compile_job(job, machine)

    def write(
        self,
        stream: Stream | None,
        form: str,
        overrides: Overrides = NO_OVERRIDES,
        *,
        name: str = "",
        diagnostics: Sequence[Diagnostic] = (),
    ) -> Iterator[bytes]:
        """Write a stream as a listing (gts), as columns (json) or as a C program (c). `overrides`: for its head."""
        from gusjob.controllers.gus.listing import listing, listing_json

        match form:
            case "json":
                return listing_json(stream, stream.name if stream is not None else name, diagnostics, overrides)
            case "gts" if stream is not None:
                return (text.encode() for text in listing(stream, overrides))
            case "c" if stream is not None:
                from gusjob.controllers.gus.c_program import c_program

                return (text.encode() for text in c_program(stream, overrides))
            case _:
                raise ValueError(f"{form!r} is none of {', '.join(self.formats)}")

    def simulate(
        self, stream: Stream, machine: Machine, *, is_listing: bool = False, coarse: bool = False
    ) -> tuple[Trace | None, list[Diagnostic]]:
        """Simulate a stream: see gusjob.controllers.gus.model.simulate_stream."""
        from gusjob.controllers.gus.model import simulate_stream

        return simulate_stream(stream, machine, is_listing=is_listing, coarse=coarse)


GUS: Controller[Stream] = GusController()
