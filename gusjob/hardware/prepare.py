"""Prepare a run: make the calls that are run and their forecast, and load the library. No call is made."""

from __future__ import annotations

from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.driver.library import Library, abi_titles, load_library
from gusjob.controllers.gus.driver.requirements import check_stream, needed_calls
from gusjob.controllers.gus.dry_run import frame, without_laser
from gusjob.controllers.gus.model import simulate_stream
from gusjob.diagnostics.model import Diagnostic, has_errors
from gusjob.hardware.forecast import Forecast, forecast
from gusjob.hardware.outcome import Ending, RunOutcome
from gusjob.hardware.request import Refusal, RunMode, RunRequest
from gusjob.i18n.phrases import Phrase, any_of
from gusjob.inputs import exists


class PreparedRun(Struct, frozen=True, kw_only=True):
    """All that a run needs before the controller is opened. `request` has the calls that are run."""

    request: RunRequest
    forecast: Forecast
    library: Library


def prepare(request: RunRequest) -> PreparedRun | RunOutcome:
    """Make the calls that are run, their forecast, and load the library."""
    machine, controller, options = request.machine, request.machine.controller, request.options
    library_path = _existing_file(options.library) or controller.library
    abi = options.abi or controller.abi
    if not library_path or abi is None:
        return RunOutcome.refused(Refusal(reason=_missing_option(library_path)))
    found: list[Diagnostic] = []
    if options.mode is not RunMode.JOB:
        stream = _dry_stream(request)
        if stream is None:
            return RunOutcome.refused(Refusal(reason=Phrase("nothing moves in this job")))
        trace, simulated = simulate_stream(stream, machine)
        found += request.report(simulated)
        if trace is None or has_errors(simulated):
            return RunOutcome(ending=Ending.INVALID, diagnostics=tuple(found))
        request = replace(request, stream=stream, trace=trace)
    if faults := check_stream(request.stream):
        return RunOutcome(ending=Ending.INVALID, diagnostics=(*found, *request.located(faults)))
    library, faults = load_library(library_path, abi, controller.card, needed_calls(request.stream, machine))
    if library is None:
        return RunOutcome(ending=Ending.INVALID, diagnostics=(*found, *request.located(faults)))
    expected = forecast(request.stream, request.trace, machine)
    return PreparedRun(request=request, forecast=expected, library=library)


def _missing_option(library_path: str) -> Phrase:
    """Say what a run needs, if there is no library or no ABI, and how to find it out."""
    if not library_path:
        return Phrase(
            "a run on hardware needs the vendor's library: --library PATH, or library under [controller] in the "
            "machine profile; `gusjob devices` finds it"
        )
    abis = [Phrase("{abi} ({title})", abi=abi, title=title) for abi, title in abi_titles().items()]
    return Phrase(
        "the ABI of {library} is not given. It says which functions the library has, and their arguments: "
        "--abi {abis}, or abi under [controller] in the machine profile; `gusjob devices --library {library}` shows "
        "which one fits",
        library=library_path,
        abis=any_of(abis),
    )


def _dry_stream(request: RunRequest) -> Stream | None:
    """Return the calls of a dry run; None if nothing moves."""
    if request.options.mode is RunMode.FRAME:
        return frame(request.stream, request.trace)
    return without_laser(request.stream)


def _existing_file(library: str) -> str:
    """Return the whole path of a file that is there; other names are for the system's search."""
    return str(Path(library).resolve()) if exists(library) else library
