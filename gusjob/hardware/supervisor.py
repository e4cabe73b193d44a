"""Runs a session in a thread of its own and watches over it: wishes, signals, calls that never return."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from types import FrameType
from typing import Any

from gusjob.controllers.control import Control, Phase
from gusjob.controllers.gus.driver.fifo import Interrupted
from gusjob.controllers.gus.driver.link import BackendError, TakenOver
from gusjob.controllers.gus.driver.session import Session
from gusjob.controllers.gus.remainder import Remainder
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic, Span
from gusjob.i18n.phrases import Phrase

TICK_S = 0.02
_SLOW = ("GT_Open", "GT_Close", "GT_LoadConfig", "GT_Reset")
_SLOW_FACTOR = 10
"""These take so many times longer."""
_DEADLY = (
    "SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK", "SIGQUIT", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGVTALRM", "SIGPROF",
    "SIGXCPU", "SIGIO", "SIGPWR",
)  # fmt: skip
"""Signals that would end the process, with the light as it is."""
_GRACE_S = 1.0
"""What a rescue may take beyond the patience with the link."""


@dataclass(slots=True)
class SessionOutcome:
    """How a run ended. No faults: all of it was done."""

    faults: list[Diagnostic] = field(default_factory=list)
    bug: BaseException | None = None


@dataclass(slots=True)
class Supervisor:
    """Runs steps of a session. `tick` is called in the caller's thread all the while."""

    session: Session
    tick: Callable[[], None] = lambda: None
    outcome: SessionOutcome = field(default_factory=SessionOutcome)

    def run(self, part: Callable[[Session], Remainder | None]) -> SessionOutcome:
        """Open, find out what to run (`part`; None: nothing), run it, and leave; whatever happens, dark and at rest."""
        self._supervise(lambda: self._work(part))
        session = self.session
        faults = [self._placed(fault) for fault in self.outcome.faults]
        self.outcome.faults = sorted(faults, key=lambda f: f.rule not in (rules.LIGHT_UNKNOWN, rules.MOTION_UNKNOWN))
        end = "failed" if self.outcome.faults or self.outcome.bug else "done"
        codes = [fault.rule.code for fault in self.outcome.faults]
        place = session.reached
        session.link.journal.mark(
            end=end, row=place.row, run=place.along_pulse, sure=place.sure, line=session.line, faults=codes
        )
        if self.outcome.bug is not None:
            raise self.outcome.bug
        return self.outcome

    def _work(self, part: Callable[[Session], Remainder | None]) -> None:
        """The whole run. Whatever ends it: light off, motion stopped, closed."""
        session, control, faults = self.session, self.session.control, self.outcome.faults
        abrupt = True
        try:
            session.open()
            if (made := part(session)) is not None:
                session.prepare()
                session.run(made)
            session.finish()
            faults += session.close()
            control.status = replace(control.status, phase=Phase.DONE)
            return
        except BackendError as error:
            faults += error.faults
        except Interrupted:
            abrupt = control.stop > 1
            fields = {"who": control.stopped_by, "journal": str(session.link.journal.path), "options": session.options}
            faults.append(Diagnostic(rule=rules.STOPPED, span=NOWHERE, fields=fields))
        except TakenOver:
            raise
        except BaseException as bug:  # noqa: BLE001  (the light goes off whatever it is; it is raised again then)
            self.outcome.bug = bug
        # A library of another ABI would take "off" for something else.
        if session.abi_confirmed:
            try:
                faults += [fault for fault in session.halt(abrupt=abrupt) if fault not in faults]
            except Exception as bug:  # noqa: BLE001  (light and motion are off by then)
                self.outcome.bug = bug
            faults += session.close()
        control.status = replace(control.status, phase=Phase.STOPPED)

    def _supervise(self, work: Callable[[], None]) -> None:
        """Run in a thread until it is done or hangs; a second one watches it, since a tick may be blocked."""
        thread = _started(self.session.link.take_over, work)
        watchdog = _started(lambda: None, lambda: self._watch_over(thread))
        while watchdog.is_alive():
            watchdog.join(TICK_S)
            self._tick()

    def _watch_over(self, thread: threading.Thread) -> None:
        """Until the thread is done; if a call of it hangs, turn everything off without it."""
        link = self.session.link
        while thread.is_alive():
            thread.join(TICK_S)
            limit_s = self.session.machine.controller.call_timeout_s * (_SLOW_FACTOR if link.calling in _SLOW else 1)
            if (hung_s := link.hung_s()) > limit_s:
                self._rescue(link.calling, hung_s)
                return

    def _tick(self) -> None:
        """A panel that fails, or whose terminal is gone, must not leave the light on: it ends the run."""
        try:
            self.tick()
        except OSError:
            self.tick = lambda: None
            self.session.control.request_stop(Phrase("a closed terminal or pipe"))
        except BaseException as bug:  # noqa: BLE001  (raised again at the end)
            self.tick = lambda: None
            self.outcome.bug = bug
            self.session.control.request_stop(Phrase("an internal error"))

    def _rescue(self, call: str, hung_s: float) -> None:
        """A call hangs: another thread turns everything off, as far as the library lets it."""
        session, controller = self.session, self.session.machine.controller
        session.control.requested = True  # Should the call return after all, no other one follows it.
        fields = {"call": call, "seconds": round(hung_s, 1)}
        faults = [Diagnostic(rule=rules.NO_ANSWER, span=NOWHERE, fields=fields)]
        turned_off: list[list[Diagnostic]] = []

        def off() -> None:
            # A library that has not proved to be of its ABI would take "off" for something else; it did nothing yet.
            turned_off.append(session.halt(abrupt=True, locate=False) + session.close() if session.abi_confirmed else [])

        session.link.release()
        thread = _started(session.link.take_over, off)
        until = time.perf_counter() + controller.link_patience_s + controller.call_timeout_s + _GRACE_S
        while thread.is_alive() and time.perf_counter() < until and session.link.hung_s() < controller.call_timeout_s:
            thread.join(TICK_S)
        session.link.release()  # Nobody makes calls any more.
        if turned_off:
            faults += turned_off[0]
        else:
            why = Phrase("hangs behind {call}", call=call)
            for channel in session.outputs.channels:
                light = {"channel": channel, "call": f"GT_SetHSIOOpt(0,{channel})", "why": why}
                faults.append(Diagnostic(rule=rules.LIGHT_UNKNOWN, span=NOWHERE, fields=light))
            why = Phrase("GT_Stop hangs behind {call}", call=call)
            faults.append(Diagnostic(rule=rules.MOTION_UNKNOWN, span=NOWHERE, fields={"why": why}))
        self.outcome.faults = faults

    def _placed(self, fault: Diagnostic) -> Diagnostic:
        """A fault that names no line is about the line that was reached."""
        line = self.session.line if fault.span is NOWHERE else fault.span.line or self.session.line
        return replace(fault, span=Span(line=line), path=self.session.stream.name)


def _started(first: Callable[[], None], work: Callable[[], None]) -> threading.Thread:
    """A thread that owns the link."""

    def run() -> None:
        first()
        with suppress(TakenOver):
            work()

    thread = threading.Thread(target=run, daemon=True)  # One that hangs in C must not keep the process.
    thread.start()
    return thread


@contextmanager
def stop_on_signals(control: Control) -> Iterator[None]:
    """Ctrl+C, the end of the session, the closed terminal: wishes to stop, as long as a run goes on."""

    def heard(number: int, _frame: FrameType | None) -> None:
        # SIGINT comes twice if the user insists; the others mean that time is short.
        name = signal.Signals(number).name
        control.request_stop("Ctrl+C" if number == signal.SIGINT else name, abrupt=number != signal.SIGINT)

    def suspended(_number: int, _frame: FrameType | None) -> None:
        # A suspended process could not watch over its laser: Ctrl+Z pauses the run instead, and goes on.
        control.toggle_pause()

    wanted: dict[str, Any] = dict.fromkeys(_DEADLY, heard)
    wanted |= {"SIGTSTP": suspended, "SIGTTOU": signal.SIG_IGN, "SIGTTIN": signal.SIG_IGN}
    numbers = {getattr(signal, name): handler for name, handler in wanted.items() if hasattr(signal, name)}
    before = {number: signal.signal(number, handler) for number, handler in numbers.items()}
    try:
        with _console_closed(control):
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _console_closed(control: Control) -> Iterator[None]:
    """On Windows a closed console ends the process as soon as the handler returns: it waits for the way out."""
    if sys.platform != "win32":
        yield
        return
    import ctypes

    over = threading.Event()

    @ctypes.WINFUNCTYPE(ctypes.c_int, ctypes.c_ulong)
    def handler(event: int) -> int:
        if event < 2:  # Ctrl+C and Ctrl+Break come as signals.
            return 0
        control.request_stop(Phrase("the closed console"), abrupt=True)
        over.wait(10)
        return 1

    ctypes.windll.kernel32.SetConsoleCtrlHandler(handler, 1)
    try:
        yield
    finally:
        over.set()
        ctypes.windll.kernel32.SetConsoleCtrlHandler(handler, 0)
