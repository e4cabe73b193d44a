"""Run a compiled job on a controller: prepare, confirm, run, report how it ended. No terminal is involved."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path

from gusjob.config.machine import Abi
from gusjob.controllers.control import Control
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.doubling import before_laser_on, doubling_mm
from gusjob.controllers.gus.driver.library import Library, load_library
from gusjob.controllers.gus.driver.link import Link
from gusjob.controllers.gus.driver.requirements import check_single_fifo, needed_calls, outputs_of
from gusjob.controllers.gus.driver.resume import find_range
from gusjob.controllers.gus.driver.session import Session
from gusjob.controllers.gus.dry_run import frame, without_laser
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.gus.path_position import JOB_START, PathPosition, PositionRange
from gusjob.controllers.gus.remainder import Remainder, remainder_from, whole_job
from gusjob.controllers.journal.writer import Journal, mark_resumed
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic, has_errors
from gusjob.hardware.begin import begin_range, fingerprint, range_is_in_job, rest_is_in_job
from gusjob.hardware.forecast import Forecast, forecast
from gusjob.hardware.guard.start import Guard, guarded
from gusjob.hardware.locks import controller_lock, recorded_again, run_locks
from gusjob.hardware.progress import ProgressMeter, Watch
from gusjob.hardware.request import Refusal, RunMode, RunRequest
from gusjob.hardware.signals import stop_on_signals
from gusjob.hardware.supervisor import SessionOutcome, Supervisor
from gusjob.i18n.phrases import Phrase, reason_of
from gusjob.inputs import exists
from gusjob.version import __version__

_UNSAFE = (rules.LASER_STATE_UNKNOWN, rules.MOTION_STATE_UNKNOWN, rules.WRONG_ABI)
"""Rules after which the laser may be on or the axes may move."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunPlan:
    """What a run will do, to be confirmed.

    `remaining_ms`: planned time from `begin` on; `doubling_mm`: length of the marks that a resumed run may make twice,
    at most; `is_torn`: the last line of the journal that is continued is incomplete; `begin_location`: file:line where
    it begins, '' at the job's start; `abi_title`: a phrase that describes the ABI.
    """

    job: Path
    mode: RunMode
    library: str
    abi: Abi
    abi_title: str
    forecast: Forecast
    begin: PathPosition
    begin_location: str
    remaining_ms: float
    journal: Path
    doubling_mm: float = 0.0
    is_torn: bool = False


Confirm = bool | Callable[[RunPlan], bool]
"""Whether a run is confirmed: True, or a function that shows the plan and asks."""


class Ending(StrEnum):
    """How a run ended."""

    UNCONFIRMED = "unconfirmed"
    """Nothing was done: the request is not confirmed."""
    REFUSED = "refused"
    """Nothing was done: the request can't be run; `refusal` says why."""
    BUSY = "busy"
    """Nothing was done: another run uses the controller or continues the journal; `diagnostics` says which."""
    INVALID = "invalid"
    """Nothing was done: the job or the library has errors; `diagnostics` has them."""
    DECLINED = "declined"
    """The plan was not confirmed."""
    NOTHING_LEFT = "nothing-left"
    """The run that was to be continued had been done to its end."""
    FAILED = "failed"
    """The run was stopped or failed; `diagnostics` says why."""
    DONE = "done"


class MachineState(StrEnum):
    """What is known of laser and motion after a run."""

    OFF = "off"
    """Calls confirmed that every laser is off and nothing moves."""
    UNTOUCHED = "untouched"
    """Nothing was switched: laser and motion are as they were before."""
    UNKNOWN = "unknown"
    """The laser may be on, or the axes may move."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOutcome:
    """How a run ended.

    `diagnostics`: at the job's spans; `location`: file:line that was reached by a run that failed, '' if it did not
    begin; `elapsed_s`: since the journal was opened; `state`: of laser and motion; `off_tried`: what an off call did
    that was made without a confirmed library; `is_journal_needed`: the journal has the position of a run that was
    declined.
    """

    ending: Ending
    refusal: Refusal | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    journal: Path | None = None
    location: str = ""
    elapsed_s: float = 0.0
    state: MachineState = MachineState.UNTOUCHED
    off_tried: str = ""
    is_journal_needed: bool = False

    @property
    def is_safe(self) -> bool:
        """Whether calls confirmed that every laser is off and the motion stopped, or no call was made."""
        reached = self.ending in (Ending.FAILED, Ending.DONE)
        return self.state is MachineState.OFF if reached else True


@dataclass(frozen=True, slots=True, kw_only=True)
class _PreparedRun:
    """All that a run needs before the controller is opened. `request` has the calls that are run."""

    request: RunRequest
    forecast: Forecast
    library: Library


def run_on(
    request: RunRequest, *, confirm: Confirm, control: Control | None = None, watch: Watch | None = None
) -> RunOutcome:
    """Run a job on a controller through the vendor's library.

    However the run ends, the laser is switched off, the motion is stopped, the laser is switched off again, and the
    controller is closed. Call it in the main thread: only there signals (Ctrl+C, SIGTERM) can stop the run.

    Args:
        request: the job, with its options.
        confirm: the user's confirmation. Without it nothing is done and no laser is switched on.
        control: stops or pauses the run from a callback or another thread.
        watch: opens a display of the progress; see progress.report_to.

    Returns:
        How the run ended. User errors and faults of the hardware are in it, not exceptions.
    """
    prepared = _prepare(request)
    if isinstance(prepared, RunOutcome):
        return prepared
    if confirm is not True and not callable(confirm):
        refusal = Refusal(reason=Phrase("a run on hardware must be confirmed"))
        return RunOutcome(ending=Ending.UNCONFIRMED, refusal=refusal)
    with run_locks(prepared.request, prepared.library) as obstacle:
        if isinstance(obstacle, Diagnostic):
            return RunOutcome(ending=Ending.BUSY, diagnostics=prepared.request.located([obstacle]))
        if isinstance(obstacle, Refusal):
            return RunOutcome(ending=Ending.REFUSED, refusal=obstacle)
        return _run_locked(prepared, confirm, control or Control(), watch)


def _run_locked(prepared: _PreparedRun, confirm: Confirm, control: Control, watch: Watch | None) -> RunOutcome:
    """Run with the controller, and the journal that is continued, locked."""
    request = recorded_again(prepared.request)
    if isinstance(request, Refusal):
        return RunOutcome(ending=Ending.REFUSED, refusal=request)
    prepared, begin = replace(prepared, request=request), begin_range(request)
    if isinstance(begin, Refusal):
        return RunOutcome(ending=Ending.REFUSED, refusal=begin)
    journal = _open_journal(prepared, begin)
    if isinstance(journal, Refusal):
        return RunOutcome(ending=Ending.REFUSED, refusal=journal)
    try:
        with guarded(request, prepared.library, journal.path, journal.start_s) as guard:
            if isinstance(guard, Refusal):
                return RunOutcome(ending=Ending.REFUSED, refusal=guard, journal=journal.path)
            return _run(prepared, begin, journal, guard, confirm, control, watch)
    finally:
        journal.close()


def _run(
    prepared: _PreparedRun,
    begin: PositionRange | None,
    journal: Journal,
    guard: Guard,
    confirm: Confirm,
    control: Control,
    watch: Watch | None,
) -> RunOutcome:
    request, link = prepared.request, Link(prepared.library, journal)
    if is_searched := begin is None:
        if refusal := _used_since(prepared) or _take_over(prepared, journal):
            return RunOutcome(ending=Ending.REFUSED, refusal=refusal)
        begin, searched = _find_range(prepared, link, guard)
        if begin is None:
            return _outcome(prepared, searched, journal, None)
    if _is_complete(request, begin):
        return RunOutcome(ending=Ending.NOTHING_LEFT, journal=journal.path)
    if request.options.resume is not None and not rest_is_in_job(request, _begin(request, begin)):
        reason = Phrase("the rest of the job from there would not mark as the job does: continue with --from-line N")
        refusal = Refusal(reason=reason, subject=str(request.options.resume.path))
        return RunOutcome(ending=Ending.REFUSED, refusal=refusal)
    if callable(confirm) and not confirm(_plan(prepared, begin, journal)):
        return RunOutcome(ending=Ending.DECLINED, journal=journal.path, is_journal_needed=is_searched)
    if not is_searched and (refusal := _take_over(prepared, journal)):
        return RunOutcome(ending=Ending.REFUSED, refusal=refusal)
    session = _session(prepared, link, control)
    session.marked_to = begin.latest
    meter = ProgressMeter.of(control, prepared.forecast, request.stream, request.machine, request.location_of_row)
    with stop_on_signals(control), guard.watching(), watch(meter) if watch else nullcontext() as display:
        supervisor = Supervisor(session, display.tick) if display else Supervisor(session)
        outcome = supervisor.run(_part(request, _begin(request, begin)))
    return _outcome(prepared, outcome, journal, session)


def _is_complete(request: RunRequest, begin: PositionRange) -> bool:
    """Return whether nothing of the job is left behind a position."""
    is_start = begin == PositionRange.exactly(JOB_START)
    return not is_start and begin.earliest.row >= len(request.stream.buffered)


def _begin(request: RunRequest, begin: PositionRange) -> PathPosition:
    """Return where the run begins: a resumed one so far back that its light is on where it went off."""
    return begin.earliest if request.options.resume is None else before_laser_on(request.stream, begin.earliest)


# Before the controller is opened.


def _prepare(request: RunRequest) -> _PreparedRun | RunOutcome:
    """Make the calls that are run, their forecast, and load the library."""
    machine, controller, options = request.machine, request.machine.controller, request.options
    library_path = _existing_file(options.library) or controller.library
    abi = options.abi or controller.abi
    if not library_path or abi is None:
        reason = Phrase(
            "a run on hardware needs the vendor's library: --library PATH and --abi {abis}, "
            "or library and abi under [controller] in the machine profile; see gusjob devices",
            abis="|".join(Abi),
        )
        return RunOutcome(ending=Ending.REFUSED, refusal=Refusal(reason=reason))
    found: list[Diagnostic] = []
    if options.mode is not RunMode.JOB:
        stream = _dry_stream(request)
        if stream is None:
            return RunOutcome(ending=Ending.REFUSED, refusal=Refusal(reason=Phrase("nothing moves in this job")))
        trace, simulated = simulate_stream(stream, machine)
        found += request.report(simulated)
        if trace is None or has_errors(simulated):
            return RunOutcome(ending=Ending.INVALID, diagnostics=tuple(found))
        request = replace(request, stream=stream, trace=trace)
    if faults := check_single_fifo(request.stream):
        return RunOutcome(ending=Ending.INVALID, diagnostics=(*found, *request.located(faults)))
    library, faults = load_library(library_path, abi, controller.card, needed_calls(request.stream, machine))
    if library is None:
        return RunOutcome(ending=Ending.INVALID, diagnostics=(*found, *request.located(faults)))
    expected = forecast(request.stream, request.trace, machine)
    return _PreparedRun(request=request, forecast=expected, library=library)


def _dry_stream(request: RunRequest) -> Stream | None:
    """Return the calls of a dry run; None if nothing moves."""
    if request.options.mode is RunMode.FRAME:
        return frame(request.stream, request.trace)
    return without_laser(request.stream)


def _existing_file(library: str) -> str:
    """Return the whole path of a file that is there; other names are for the system's search."""
    return str(Path(library).resolve()) if exists(library) else library


def _open_journal(prepared: _PreparedRun, begin: PositionRange | None) -> Journal | Refusal:
    """Create the journal, before anything else is done."""
    request, options, now = prepared.request, prepared.request.options, datetime.now(UTC)
    path = request.path
    journal = options.journal or path.with_name(f"{path.stem}.{now:%Y%m%d-%H%M%S-%f}.journal")
    head = {
        "gusjob": __version__,
        "job": str(path.resolve()),
        "calls": fingerprint(request.stream),
        "rows": len(request.stream.buffered),
        "library": prepared.library.path,
        "abi": prepared.library.abi,
        "started": now.isoformat(),
        "options": options.mode.option,
        "begin": None if begin is None else [*begin.earliest.key, *begin.latest.key],
        "resumes": str(options.resume.path.resolve()) if options.resume else None,
    }
    try:
        return Journal(journal, head)
    except FileExistsError:
        reason = Phrase("this file exists already; name another one with --journal")
    except OSError as error:
        reason = Phrase("can't write the journal: {reason}; name another file with --journal", reason=reason_of(error))
    return Refusal(reason=reason, subject=str(journal))


def _used_since(prepared: _PreparedRun) -> Refusal | None:
    """Refuse to search where a run was interrupted if another one has used the controller since."""
    recorded = prepared.request.options.resume
    assert recorded is not None
    started, journal = controller_lock(prepared.library, prepared.request.machine.controller).last_run()
    if not started or started == recorded.head.get("started"):
        return None
    reason = Phrase(
        "another run has used the controller since ({journal}), and the position is lost: check the part, then "
        "continue with --from-line N",
        journal=journal,
    )
    return Refusal(reason=reason, subject=str(recorded.path))


def _take_over(prepared: _PreparedRun, journal: Journal) -> Refusal | None:
    """Record, before the first call, which run uses the controller and which one it continues.

    Without that, two runs could continue one journal one after the other.
    """
    request, lock = prepared.request, controller_lock(prepared.library, prepared.request.machine.controller)
    try:
        lock.note_run(journal.head["started"], journal.path)
    except OSError as error:
        reason = Phrase("can't write to the folder of the locks: {reason}", reason=reason_of(error))
        return Refusal(reason=reason, subject=str(lock.last_path))
    if request.options.resume is None:
        return None
    path = request.options.resume.path
    try:
        mark_resumed(path, journal.path)
    except OSError as error:
        reason = Phrase("can't write to the journal that is continued: {reason}", reason=reason_of(error))
        return Refusal(reason=reason, subject=str(path))
    return None


def _plan(prepared: _PreparedRun, found: PositionRange, journal: Journal) -> RunPlan:
    request, expected, abi = prepared.request, prepared.forecast, prepared.library.abi
    begin, recorded = _begin(request, found), request.options.resume
    return RunPlan(
        job=request.path,
        mode=request.options.mode,
        library=prepared.library.path,
        abi=abi,
        abi_title=prepared.library.abi_title,
        forecast=expected,
        begin=begin,
        doubling_mm=0.0 if recorded is None else doubling_mm(request.stream, found, request.machine),
        is_torn=recorded is not None and recorded.torn,
        begin_location="" if begin == JOB_START else request.location_of_row(begin.row),
        remaining_ms=expected.duration_ms - expected.done_ms(begin.row),
        journal=journal.path,
    )


# With the controller.


def _session(prepared: _PreparedRun, link: Link, control: Control) -> Session:
    request = prepared.request
    return Session(
        link=link,
        machine=request.machine,
        control=control,
        stream=request.stream,
        options=" --no-laser" if request.options.mode is RunMode.NO_LASER else "",
        outputs=outputs_of(request.stream),
    )


def _find_range(prepared: _PreparedRun, link: Link, guard: Guard) -> tuple[PositionRange | None, SessionOutcome]:
    """Open the controller to find where a recorded run was interrupted."""
    found: list[PositionRange] = []
    recorded = prepared.request.options.resume
    assert recorded is not None

    def search(session: Session) -> None:
        found.append(find_range(session, recorded))

    session = _session(prepared, link, Control())
    with stop_on_signals(session.control), guard.watching():
        outcome = Supervisor(session, ends_run=False).run(search)
    if found and not range_is_in_job(prepared.request, found[0]):
        why = Phrase("it is not on the path of the job")
        fields = {"why": why, "calls": recorded.part.queued if recorded.part else 0}
        outcome.faults.append(Diagnostic(rule=rules.POSITION_UNKNOWN, span=NOWHERE, fields=fields))
    return (found[0] if found and not outcome.faults else None), outcome


def _part(request: RunRequest, begin: PathPosition) -> Callable[[Session], Remainder]:
    """Return the function that makes the remainder to run, once it is known where the head is."""
    stream = request.stream

    def part(session: Session) -> Remainder:
        head_pulse = session.position_or_none()
        if begin == JOB_START:
            return whole_job(stream, head_pulse)
        return remainder_from(stream, begin, head_pulse)

    return part


def _outcome(prepared: _PreparedRun, outcome: SessionOutcome, journal: Journal, session: Session | None) -> RunOutcome:
    request = prepared.request
    return RunOutcome(
        ending=Ending.FAILED if outcome.faults else Ending.DONE,
        diagnostics=request.located([*outcome.faults, *(session.warnings if session else ())]),
        state=_state(outcome),
        off_tried=outcome.off_tried,
        journal=journal.path,
        location=request.location(session.line) if session else "",
        elapsed_s=journal.now_s(),
    )


def _state(outcome: SessionOutcome) -> MachineState:
    """Return what is known of laser and motion after a session. Only what calls confirmed is known."""
    if any(fault.rule in _UNSAFE for fault in outcome.faults):
        return MachineState.UNKNOWN
    if outcome.is_off:
        return MachineState.OFF
    return MachineState.UNTOUCHED if outcome.is_untouched else MachineState.UNKNOWN
