"""Switch a controller off after its run ended without a shutdown, through a link of the guard's own.

It is not known what GT_Open of a second process does to a controller that moves: the profile must allow it. What is
reported is what the calls confirmed, never more.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from msgspec import Struct, field

from gusjob.config.machine import Abi
from gusjob.controllers.control import Control
from gusjob.controllers.gus.driver.library import load_library
from gusjob.controllers.gus.driver.link import SLOW_FACTOR, BackendError, Link, TakenOver
from gusjob.controllers.gus.driver.requirements import RUN_CALLS, Outputs
from gusjob.controllers.gus.driver.shutdown import Shutdown, hung_diagnostics
from gusjob.controllers.journal.lines import is_continued
from gusjob.controllers.journal.writer import Journal
from gusjob.diagnostics.model import Diagnostic
from gusjob.hardware.locks import HeldLock, RunLock
from gusjob.i18n.language import set_language
from gusjob.i18n.phrases import Phrase, localized, printable, reason_of

_TICK_S = 0.02
_LOCK_S = 3.0
"""Longest time until the system has released the lock of a process that has ended."""
_LOADING = "LoadLibrary"
_UNRECORDED = Phrase("the journal does not have these calls: continue with --from-line N, not with --resume")
_CONFIRMED = Phrase("the guard switched the controller off: it confirmed that every laser is off and nothing moves")


class SwitchOffOrders(Struct, frozen=True, kw_only=True):
    """What to switch off, in plain values: they come through a pipe.

    `lock`: the name of the controller's lock; `start_s`: the start of the journal, as time.perf_counter, which is the
    same in all processes.
    """

    library: str
    abi: str
    card: int
    open_channel: int
    open_param: int
    call_timeout_s: float
    link_patience_s: float
    channels: tuple[int, ...]
    crds: tuple[int, ...]
    axes: tuple[int, ...]
    journal: str
    start_s: float
    job: str
    lock: str

    @property
    def outputs(self) -> Outputs:
        """What the job may have left on."""
        return Outputs(channels=tuple(self.channels), crds=tuple(self.crds), axes=tuple(self.axes))


def switched_off(orders: Mapping[str, Any], language: str) -> list[str]:
    """Switch the controller off, and return the messages for the user.

    The time is limited: a thread whose call hangs is abandoned.

    Args:
        orders: the fields of SwitchOffOrders.
        language: the user's language.
    """
    set_language(language)
    given = SwitchOffOrders(**orders)
    lock = RunLock(name=given.lock, what="")
    try:
        held = _locked(lock, given.job)
    except OSError as error:
        return _lines([_nothing_done(reason_of(error))])
    if held is None:
        return _lines([_nothing_done(Phrase("it is in use by {holder}", holder=lock.holder()))])
    try:
        if is_continued(Path(given.journal)):
            # It had the controller before this process got the lock, and has switched it off.
            return _lines([_nothing_done(Phrase("another run has continued the journal"))])
        return _lines(_supervised(_Switching(given)))
    finally:
        held.release()


def _locked(lock: RunLock, job: str) -> HeldLock | None:
    """Take the lock of the controller; None if another run has it: nothing of that one may be switched off."""
    until = time.perf_counter() + _LOCK_S
    while (held := lock.acquire(job)) is None and time.perf_counter() < until:
        time.sleep(_TICK_S)
    return held


def _supervised(switching: _Switching) -> list[str]:
    """Switch off in a thread, and wait as long as no call hangs."""
    thread = threading.Thread(target=switching.work, daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(_TICK_S)
        if (call := switching.hanging_call()) and thread.is_alive():
            return switching.give_up(call)
    return switching.report


class _Switching(Struct):
    """Switches a controller off in a thread."""

    orders: SwitchOffOrders
    link: Link | None = None
    began_s: float = field(default_factory=time.perf_counter)
    report: list[str] = field(default_factory=list)

    def work(self) -> None:
        """Do everything. Whatever prevents it is in the report."""
        try:
            self._switch_off()
        except TakenOver:
            return
        except BackendError as error:
            self.report = [_nothing_done(error.faults[0].phrase)]
        except Exception as error:  # noqa: BLE001  (a bug must not end the process without a report)
            self.report = [_nothing_done(repr(error))]

    def _switch_off(self) -> None:
        orders = self.orders
        library, faults = load_library(orders.library, Abi(orders.abi), orders.card, RUN_CALLS)
        if library is None:
            self.report = [_nothing_done(faults[0].phrase)]
            return
        journal = _journal_of(orders)
        try:
            self.link = Link(library, journal)
            self.link.call("GT_Open", float(orders.open_channel), float(orders.open_param))
            self._shut_down(self.link)
        finally:
            journal.close()

    def _shut_down(self, link: Link) -> None:
        """Make the calls of a shutdown, if the library's ABI is confirmed: in another ABI "off" means something else.

        GT_Open may refuse a controller that the other process left open: only the probe decides.
        """
        link.probe()
        shutdown = Shutdown(link, self.orders.outputs, self.orders.link_patience_s)
        shutdown.laser_off(retry=False)
        faults = shutdown.stop(Control(), abrupt=True)
        faults = shutdown.laser_off() + faults
        if faults:
            shutdown.reset()
            faults += [fault for fault in shutdown.laser_off() if fault not in faults]
        self.report = _texts(faults) if faults else [_CONFIRMED]
        if link.journal.lost:
            self.report.append(_UNRECORDED)
        shutdown.try_call("GT_Close")

    def hanging_call(self) -> str:
        """Return the call that hangs, '' if none does."""
        link, limit_s = self.link, self.orders.call_timeout_s
        if link is None:
            return _LOADING if time.perf_counter() - self.began_s > limit_s * SLOW_FACTOR else ""
        return link.calling if link.hung_s() > link.allowed_s(limit_s) else ""

    def give_up(self, call: str) -> list[str]:
        """Make no more calls; report that nothing is certain, unless GT_Close is what hangs."""
        if self.link is None:
            return [_nothing_done(Phrase("loading the library takes too long"))]
        self.link.release()
        return self.report or _texts(hung_diagnostics(self.orders.outputs, call))


def _journal_of(orders: SwitchOffOrders) -> Journal:
    """Open the journal of the run, to record there where the laser went off: a resume needs that."""
    try:
        journal = Journal.reopen(Path(orders.journal))
    except OSError as error:  # A full disk must not keep the laser from being switched off.
        return Journal.unwritten(error)
    journal.start_s = orders.start_s
    return journal


def _nothing_done(why: str) -> Phrase:
    return Phrase("the guard could not switch the controller off: {why}", why=why)


def _texts(faults: list[Diagnostic]) -> list[str]:
    return [fault.phrase for fault in faults]


def _lines(texts: list[str]) -> list[str]:
    return [f"gusjob: {printable(localized(text))}" for text in texts]
