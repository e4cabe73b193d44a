"""Run a session in its own thread and supervise it: requests, errors, calls that never return."""

from __future__ import annotations

import errno
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.controllers.control import Phase, StopKind
from gusjob.controllers.gus.driver.fifo import Interrupted
from gusjob.controllers.gus.driver.link import BackendError, TakenOver
from gusjob.controllers.gus.driver.session import Session
from gusjob.controllers.gus.driver.shutdown import hung_diagnostics
from gusjob.controllers.gus.remainder import Remainder
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic, Span
from gusjob.i18n.phrases import Phrase

TICK_S = 0.02
_CUT_OUTSIDE = (rules.INTERLOCK, rules.STOPPED_FROM_OUTSIDE, rules.NO_PROGRESS)
"""Faults whose cause may have cut the laser before the program noticed it."""
_GRACE_S = 1.0
"""How much longer than a call and the patience with the link an emergency shutdown may take."""


class SessionOutcome(Struct):
    """How a session ended. Without faults the whole job was done.

    `is_off`: calls confirmed that every laser is off and nothing moves; `is_untouched`: no call was made that could
    switch anything on or off, but perhaps an off call without confirmation, whose result is `off_tried`.
    """

    faults: list[Diagnostic] = field(default_factory=list)
    bug: BaseException | None = None
    is_off: bool = False
    is_untouched: bool = False
    off_tried: str = ""


class Supervisor(Struct):
    """Runs a session. `tick` is called repeatedly in the caller's thread during the run."""

    session: Session
    tick: Callable[[], None] = lambda: None
    ends_run: bool = True
    """The journal's run ends with this session."""
    outcome: SessionOutcome = field(default_factory=SessionOutcome)

    def run(self, part: Callable[[Session], Remainder | None]) -> SessionOutcome:
        """Open the controller, run, and close it, with a shutdown however the run ends.

        Args:
            part: finds out, with the controller open, what to run; None for nothing.

        Raises:
            BaseException: a bug, or an exception of `part` or `tick`, after the shutdown.
        """
        self._supervise(lambda: self._work(part))
        session = self.session
        faults = [self._with_line(fault) for fault in self.outcome.faults]
        self.outcome.faults = sorted(
            faults, key=lambda f: f.rule not in (rules.LASER_STATE_UNKNOWN, rules.MOTION_STATE_UNKNOWN)
        )
        self.outcome.is_off = session.is_off
        self.outcome.is_untouched, self.outcome.off_tried = not session.abi_confirmed, session.harmless_off
        if self.ends_run or self.outcome.faults or self.outcome.bug:
            end = "failed" if self.outcome.faults or self.outcome.bug else "done"
            codes, at = [fault.rule.code for fault in self.outcome.faults], session.reached
            session.link.journal.mark(end=end, row=at.row, run=at.along_pulse, line=session.line, faults=codes)
        if self.outcome.bug is not None:
            raise self.outcome.bug
        return self.outcome

    def _work(self, part: Callable[[Session], Remainder | None]) -> None:
        """Do the whole run. Whatever ends it: laser off, motion stopped, controller closed."""
        session, control, faults = self.session, self.session.control, self.outcome.faults
        abrupt = True
        try:
            session.open()
            if (made := part(session)) is not None:
                session.prepare()
                session.run(made)
            session.finish()
            faults += session.close()
            if faults:
                session.note_end()
            control.status = replace(control.status, phase=Phase.DONE)
            return
        except BackendError as error:
            faults += error.faults
        except Interrupted:
            abrupt = control.stop == StopKind.ABRUPT
            fields = {"who": control.stopped_by, "journal": str(session.link.journal.path), "options": session.options}
            faults.append(Diagnostic(rule=rules.STOPPED_ON_REQUEST, span=NOWHERE, fields=fields))
        except TakenOver:
            raise
        except BaseException as bug:  # noqa: BLE001  (the laser goes off whatever it is; it is raised again then)
            self.outcome.bug = bug
        cut_outside = any(fault.rule in _CUT_OUTSIDE for fault in faults)
        try:
            # In another ABI "off" means something else.
            if not session.abi_confirmed:
                session.switch_off_unconfirmed()
            if session.abi_confirmed:
                halted = session.halt(abrupt=abrupt, cut_outside=cut_outside)
                faults += [fault for fault in halted if fault not in faults]
        except Exception as bug:  # noqa: BLE001  (laser and motion are off by then)
            self.outcome.bug = bug
        if session.abi_confirmed:
            faults += session.close()
        control.status = replace(control.status, phase=Phase.STOPPED)

    def _supervise(self, work: Callable[[], None]) -> None:
        """Run in a thread until it is done or hangs; a second one watches it, since a tick may block."""
        thread = _started(self.session.link.take_over, work)
        watchdog = _started(lambda: None, lambda: self._watch(thread))
        while watchdog.is_alive():
            watchdog.join(TICK_S)
            self._tick()

    def _watch(self, thread: threading.Thread) -> None:
        """Watch the thread until it is done; if a call of it hangs, shut down without it."""
        link, timeout_s = self.session.link, self.session.machine.controller.call_timeout_s
        while thread.is_alive():
            thread.join(TICK_S)
            if (hung_s := link.journal.hung_s()) > timeout_s:
                reason = Phrase("a line has not been written for {seconds} s", seconds=round(hung_s, 1))
                link.journal.give_up(OSError(errno.EIO, reason))
                fault = Diagnostic(rule=rules.NO_JOURNAL, span=NOWHERE, fields={"reason": reason})
                self._emergency_shutdown(thread, Phrase("the journal"), fault)
                return
            if (hung_s := link.hung_s()) > link.allowed_s(timeout_s):
                fields = {"call": link.calling, "seconds": round(hung_s, 1)}
                fault = Diagnostic(rule=rules.NO_ANSWER, span=NOWHERE, fields=fields)
                self._emergency_shutdown(thread, link.calling, fault)
                return

    def _tick(self) -> None:
        """Call `tick`. If it fails, for example because its terminal is closed, the run is stopped."""
        try:
            self.tick()
        except OSError:
            self.tick = lambda: None
            self.session.control.request_stop(Phrase("a closed terminal or pipe"))
        except BaseException as bug:  # noqa: BLE001  (raised again at the end)
            self.tick = lambda: None
            self.outcome.bug = bug
            self.session.control.request_stop(Phrase("an internal error"))

    def _emergency_shutdown(self, hung: threading.Thread, call: str, fault: Diagnostic) -> None:
        """Shut down in another thread while a call, or writing the journal, hangs, as far as the library allows."""
        session, controller = self.session, self.session.machine.controller
        session.control.requested = True  # Should the call return after all, no other one follows it.
        faults = [fault]
        turned_off: list[list[Diagnostic]] = []

        def turn_off() -> None:
            if not session.abi_confirmed:
                session.switch_off_unconfirmed()
            if session.abi_confirmed:
                off = session.halt(abrupt=True, locate=False)
                # The call that hangs may return late, and have its effect only then.
                if _ends_within(hung, controller.call_timeout_s):
                    off = session.halt(abrupt=True, locate=False)
                turned_off.append(off + session.close())

        session.link.release()
        thread = _started(session.link.take_over, turn_off)
        until = time.perf_counter() + controller.link_patience_s + 2 * controller.call_timeout_s + _GRACE_S
        while thread.is_alive() and time.perf_counter() < until and session.link.hung_s() < controller.call_timeout_s:
            thread.join(TICK_S)
        session.link.release()  # No thread makes calls any more.
        if session.abi_confirmed or thread.is_alive():
            session.is_off = session.is_off and bool(turned_off)
            faults += turned_off[0] if turned_off else hung_diagnostics(session.outputs, call)
        self.outcome.faults = faults

    def _with_line(self, fault: Diagnostic) -> Diagnostic:
        """Give a fault without a line the line that was reached."""
        line = self.session.line if fault.span is NOWHERE else fault.span.line or self.session.line
        return replace(fault, span=Span(line=line), path=self.session.stream.name)


def _ends_within(thread: threading.Thread, seconds: float) -> bool:
    """Wait for a thread; return whether it ended."""
    thread.join(seconds)
    return not thread.is_alive()


def _started(first: Callable[[], None], work: Callable[[], None]) -> threading.Thread:
    """Start a thread that owns the link."""

    def run() -> None:
        first()
        with suppress(TakenOver):
            work()

    thread = threading.Thread(target=run, daemon=True)  # One that hangs in C must not keep the process.
    thread.start()
    return thread
