"""Run a compiled job on a controller: prepare, confirm, run, report how it ended. No terminal is involved."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from datetime import UTC, datetime
from pathlib import Path

from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.config.machine import Abi
from gusjob.controllers.control import Control
from gusjob.controllers.gus.doubling import before_laser_on, doubling_mm
from gusjob.controllers.gus.driver.link import Link
from gusjob.controllers.gus.driver.requirements import outputs_of
from gusjob.controllers.gus.driver.resume import find_range
from gusjob.controllers.gus.driver.session import Session
from gusjob.controllers.gus.path_position import JOB_START, PathPosition, PositionRange
from gusjob.controllers.gus.remainder import Remainder, remainder_from, whole_job
from gusjob.controllers.journal.lines import path_text
from gusjob.controllers.journal.writer import Journal, mark_resumed
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic
from gusjob.hardware.begin import begin_range, fingerprint, range_is_in_job, rest_is_in_job
from gusjob.hardware.forecast import Forecast
from gusjob.hardware.guard.start import Guard, guarded
from gusjob.hardware.locks import controller_lock, recorded_again, run_locks
from gusjob.hardware.outcome import Ending, RunOutcome, outcome_of_session
from gusjob.hardware.prepare import PreparedRun, prepare
from gusjob.hardware.progress import ProgressMeter, Watch
from gusjob.hardware.request import Refusal, RunMode, RunRequest
from gusjob.hardware.signals import stop_on_signals
from gusjob.hardware.supervisor import SessionOutcome, Supervisor
from gusjob.i18n.phrases import Phrase, reason_of
from gusjob.ir.overrides import NO_OVERRIDES, Overrides
from gusjob.version import __version__


class RunPlan(Struct, frozen=True, kw_only=True):
    """What a run will do, to be confirmed.

    `remaining_ms`: planned time from `begin` on; `doubling_mm`: length of the marks that a resumed run makes twice
    at most; `is_torn`: the last line of the journal that is continued is incomplete; `begin_location`: file:line where
    it begins, '' at the job's start; `abi_title`: a phrase that describes the ABI; `overrides`: the values of LETs that
    the job was compiled with.
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
    overrides: Overrides = field(default_factory=lambda: NO_OVERRIDES)


Confirm = bool | Callable[[RunPlan], bool]
"""Whether a run is confirmed: True, or a function that shows the plan and returns the answer."""


def run_on(
    request: RunRequest, *, confirm: Confirm, control: Control | None = None, watch: Watch | None = None
) -> RunOutcome:
    """Run a job on a controller through the vendor's library.

    However the run ends, the laser is switched off, the motion is stopped, the laser is switched off again, and the
    controller is closed. Call it in the main thread: only there signals (Ctrl+C, SIGTERM) can stop the run.

    Args:
        request: the job, with its options.
        confirm: the user's confirmation. Without it no laser is switched on. To find where a killed run was
            interrupted, the controller is opened and its motion stopped before a function is called.
        control: stops or pauses the run from a callback or another thread.
        watch: opens a display of the progress; see progress.report_to.

    Returns:
        How the run ended. User errors and faults of the hardware are in it, not exceptions.
    """
    prepared = prepare(request)
    if isinstance(prepared, RunOutcome):
        return prepared
    if confirm is not True and not callable(confirm):
        refusal = Refusal(reason=Phrase("a run on hardware must be confirmed"))
        return RunOutcome(ending=Ending.UNCONFIRMED, refusal=refusal)
    with run_locks(prepared.request, prepared.library) as obstacle:
        if isinstance(obstacle, Diagnostic):
            return RunOutcome(ending=Ending.BUSY, diagnostics=prepared.request.located([obstacle]))
        if isinstance(obstacle, Refusal):
            return RunOutcome.refused(obstacle)
        return _run_locked(prepared, confirm, control or Control(), watch)


def _run_locked(prepared: PreparedRun, confirm: Confirm, control: Control, watch: Watch | None) -> RunOutcome:
    """Run with the controller, and the journal that is continued, locked."""
    request = recorded_again(prepared.request)
    if isinstance(request, Refusal):
        return RunOutcome.refused(request)
    prepared, begin = replace(prepared, request=request), begin_range(request)
    if isinstance(begin, Refusal):
        return RunOutcome.refused(begin)
    journal = _open_journal(prepared, begin)
    if isinstance(journal, Refusal):
        return RunOutcome.refused(journal)
    try:
        with guarded(request, prepared.library, journal.path, journal.start_s) as guard:
            if isinstance(guard, Refusal):
                return RunOutcome.refused(guard, journal.path)
            return _run(prepared, begin, journal, guard, confirm, control, watch)
    finally:
        journal.close()


def _run(
    prepared: PreparedRun,
    found: PositionRange | None,
    journal: Journal,
    guard: Guard,
    confirm: Confirm,
    control: Control,
    watch: Watch | None,
) -> RunOutcome:
    """Run with a journal and a guard. `found`: where the laser went off; None if only the controller has it."""
    request, link = prepared.request, Link(prepared.library, journal)
    if is_searched := found is None:
        if refusal := _used_since(prepared) or _take_over(prepared, journal):
            return RunOutcome.refused(refusal)
        found, searched = _find_range(prepared, link, guard)
        if found is None:
            return outcome_of_session(request, searched, journal, None)
    if _is_complete(request, found):
        return RunOutcome(ending=Ending.NOTHING_LEFT, journal=journal.path)
    begin = _begin(request, found)
    if request.options.resume is not None and not rest_is_in_job(request, begin):
        reason = Phrase(
            "the rest of the job from this position would not mark what the job marks: continue with --from-line N"
        )
        return RunOutcome.refused(Refusal(reason=reason, subject=str(request.options.resume.path)))
    if callable(confirm) and not confirm(_plan(prepared, found, begin, journal)):
        return RunOutcome(ending=Ending.DECLINED, journal=journal.path, is_journal_needed=is_searched)
    if not is_searched and (refusal := _take_over(prepared, journal)):
        return RunOutcome.refused(refusal)
    session = _session(prepared, link, control)
    session.marked_to = found.latest
    meter = ProgressMeter.of(control, prepared.forecast, request.stream, request.machine, request.location_of_row)
    with stop_on_signals(control), guard.watching(), watch(meter) if watch else nullcontext() as display:
        supervisor = Supervisor(session, display.tick) if display else Supervisor(session)
        outcome = supervisor.run(_part(request, begin))
    return outcome_of_session(request, outcome, journal, session)


def _is_complete(request: RunRequest, found: PositionRange) -> bool:
    """Return whether nothing of the job is left after a position."""
    is_start = found == PositionRange.exactly(JOB_START)
    return not is_start and found.earliest.row >= len(request.stream.buffered)


def _begin(request: RunRequest, found: PositionRange) -> PathPosition:
    """Return where the run begins: a resumed one far enough back that it emits again where the laser went off."""
    return found.earliest if request.options.resume is None else before_laser_on(request.stream, found.earliest)


def _open_journal(prepared: PreparedRun, begin: PositionRange | None) -> Journal | Refusal:
    """Create the journal, before anything else is done."""
    request, options, now = prepared.request, prepared.request.options, datetime.now(UTC)
    path = request.path
    journal = options.journal or path.with_name(f"{path.stem}.{now:%Y%m%d-%H%M%S-%f}.journal")
    head = {
        "gusjob": __version__,
        "job": path_text(path.resolve()),
        "calls": fingerprint(request.stream),
        "rows": len(request.stream.buffered),
        "library": path_text(Path(prepared.library.path)),
        "abi": prepared.library.abi,
        "started": now.isoformat(),
        "options": options.mode.option,
        **({"overrides": dict(request.overrides)} if request.overrides else {}),
        "begin": None if begin is None else [*begin.earliest.key, *begin.latest.key],
        "resumes": path_text(options.resume.path.resolve()) if options.resume else None,
        "resumes_started": options.resume.head.get("started", "") if options.resume else "",
    }
    try:
        return Journal(journal, head)
    except FileExistsError:
        reason = Phrase("this file exists already; name another one with --journal")
    except OSError as error:
        reason = Phrase("can't write the journal: {reason}; name another file with --journal", reason=reason_of(error))
    return Refusal(reason=reason, subject=str(journal))


def _used_since(prepared: PreparedRun) -> Refusal | None:
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


def _take_over(prepared: PreparedRun, journal: Journal) -> Refusal | None:
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
        mark_resumed(path, journal.path, journal.head["started"])
    except OSError as error:
        reason = Phrase("can't write to the journal that is continued: {reason}", reason=reason_of(error))
        return Refusal(reason=reason, subject=str(path))
    return None


def _plan(prepared: PreparedRun, found: PositionRange, begin: PathPosition, journal: Journal) -> RunPlan:
    request, expected, recorded = prepared.request, prepared.forecast, prepared.request.options.resume
    return RunPlan(
        job=request.path,
        mode=request.options.mode,
        library=prepared.library.path,
        abi=prepared.library.abi,
        abi_title=prepared.library.abi_title,
        forecast=expected,
        begin=begin,
        doubling_mm=0.0 if recorded is None else doubling_mm(request.stream, found, request.machine),
        is_torn=recorded is not None and recorded.torn,
        begin_location="" if begin == JOB_START else request.location_of_row(begin.row),
        remaining_ms=expected.duration_ms - expected.done_ms(begin.row),
        journal=journal.path,
        overrides=request.overrides,
    )


# With the controller.


def _session(prepared: PreparedRun, link: Link, control: Control) -> Session:
    request = prepared.request
    return Session(
        link=link,
        machine=request.machine,
        control=control,
        stream=request.stream,
        options=" --no-laser" if request.options.mode is RunMode.NO_LASER else "",
        outputs=outputs_of(request.stream),
    )


def _find_range(prepared: PreparedRun, link: Link, guard: Guard) -> tuple[PositionRange | None, SessionOutcome]:
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
