"""The link to the controller: one call at a time, each recorded in the journal, with the time of a call in progress."""

from __future__ import annotations

import ctypes
import threading
import time
from typing import Any

from gusjob.config.machine import Abi
from gusjob.controllers.gus.calls import ArgKind, Value
from gusjob.controllers.gus.driver.abi import PROBE, PROBE_ARGUMENTS, PROBE_GUARD, c_value
from gusjob.controllers.gus.driver.library import Library
from gusjob.controllers.journal.writer import Journal
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule, Span
from gusjob.i18n.phrases import Phrase

FULL = 1
"""Return code of a buffered call when the FIFO is full."""
SLOW_CALLS = ("GT_Open", "GT_Close", "GT_LoadConfig", "GT_Reset")
"""Calls that take much longer than others."""
SLOW_FACTOR = 10
"""How much longer than others a slow call, and loading the library, may take."""

_CABLE = Phrase("check cable and power, and that no other program uses the controller")
MEANINGS: dict[int, tuple[str, str]] = {
    1: (
        Phrase("execution error, a condition is not met"),
        Phrase("check that the axes are on, without alarm and at rest, and that the coordinate system is set up"),
    ),
    2: (
        Phrase("no licence for it"),
        Phrase("ask the vendor for a licence, or remove the statement that needs it"),
    ),
    3: (
        Phrase("library and firmware do not match"),
        Phrase("install the library that belongs to the controller's firmware"),
    ),
    7: (
        Phrase("parameter error"),
        Phrase("the controller refuses one of the arguments; check that --abi is right"),
    ),
    8: (
        Phrase("not supported by this firmware"),
        Phrase("remove the statement that needs it, or update the firmware"),
    ),
    -6: (
        Phrase("the controller can't be opened"),
        Phrase("check that it is on and its driver installed; {cable}; gusjob devices shows more", cable=_CABLE),
    ),
    -7: (Phrase("no response"), _CABLE),
    -8: (Phrase("lock time-out"), _CABLE),
}
"""Return codes (sister): what each means and what to do."""
_NO_LINK = (Phrase("the link to the controller failed"), _CABLE)
_UNKNOWN = (Phrase("an unknown return code"), Phrase("look it up in the library's manual"))


def meaning(code: int) -> tuple[str, str]:
    """Return what a return code means and what to do."""
    return MEANINGS.get(code) or (_NO_LINK if code < 0 else _UNKNOWN)


class BackendError(Exception):
    """The only exception of a run: the controller did not do what the job needs. It carries its diagnostics."""

    def __init__(self, *faults: Diagnostic) -> None:
        self.faults = list(faults)
        super().__init__(*(fault.message for fault in faults))


class TakenOver(BaseException):
    """Raised in a thread whose call hung so long that another one took over. It must make no more calls."""


def failure(rule: Rule, line: int, **fields: Any) -> BackendError:
    """Make the error of a failure at a line of the job; line 0: the line that the run has reached."""
    return BackendError(Diagnostic(rule=rule, span=Span(line=line), fields=fields))


def call_failure(call: str, code: int, line: int) -> BackendError:
    """Make the error of a call that did not return 0."""
    what, advice = meaning(code)
    return failure(rules.CALL_FAILED, line, call=call, code=code, meaning=what, advice=advice)


class Link:
    """Makes calls. Only the thread that owns the link may."""

    def __init__(self, library: Library, journal: Journal) -> None:
        self.library = library
        self.journal = journal
        self.owner = threading.get_ident()
        self.calling = ""
        self.since_s = 0.0
        """When the call in progress was made (time.perf_counter), 0 if there is none."""
        self.call_count = 0
        """Number of calls that returned."""

    def take_over(self) -> None:
        """Let this thread own the link from now on."""
        self.since_s = 0.0
        self.owner = threading.get_ident()

    def release(self) -> None:
        """Release the link until a thread takes it over: a call that hangs is no longer waited for."""
        self.owner, self.since_s = 0, 0.0

    def hung_s(self) -> float:
        """Return for how long the call in progress has not returned."""
        since = self.since_s
        return time.perf_counter() - since if since else 0.0

    def allowed_s(self, timeout_s: float) -> float:
        """Return how long the call in progress may take, by the time that is allowed for most calls."""
        return timeout_s * SLOW_FACTOR if self.calling in SLOW_CALLS else timeout_s

    def call(self, name: str, *values: Value | bytes, line: int = 0) -> tuple[int, list[Any]]:
        """Make one call by the manual's name.

        A journal that can't be written ends the run (see checked), but not its shutdown.

        Returns:
            The return code, and the value at each pointer, in order.
        """
        prototype = self.library.prototypes[name]
        given = [c_value(arg, value) for arg, value in zip(prototype.args, values, strict=True)]
        code = self._make(name, self.library.functions[name], (*prototype.leading, *given, *prototype.trailing))
        pointers = [(i, arg) for i, arg in enumerate(prototype.args) if arg.kind is ArgKind.POINTER]
        found = [list(given[i]) if arg.count > 1 else given[i][0] for i, arg in pointers]
        plain = (ArgKind.WHOLE, ArgKind.REAL)
        shown = [g if arg.kind in plain else v for arg, g, v in zip(prototype.args, given, values, strict=True)]
        for (i, _), value in zip(pointers, found, strict=True):
            shown[i] = value
        self.journal.call(
            code, line, name, [v.decode("utf-8", "replace") if isinstance(v, bytes) else v for v in shown]
        )
        return code, found

    def checked(self, name: str, *values: Value | bytes, line: int = 0) -> list[Any]:
        """Make one call that must return 0.

        Returns:
            What it found for each pointer, in order.

        Raises:
            BackendError: it returned something else, or the journal can't be written.
        """
        code, found = self.call(name, *values, line=line)
        if code:
            raise call_failure(name, code, line)
        if self.journal.lost:
            raise self.journal_failure(line)
        return found

    def probe(self) -> None:
        """Make a call that only a library of this ABI answers with 0: without pointers, so a wrong one can't crash."""
        prototype = self.library.prototypes[PROBE]
        # A function object of its own without argument types: it gets more arguments than the prototype has.
        guarded: Any = self.library.handle[prototype.symbol]
        guarded.restype = ctypes.c_short
        try:
            code = self._make(PROBE, guarded, (*prototype.leading, *PROBE_ARGUMENTS, *PROBE_GUARD))
        except ValueError:
            # __stdcall in 32 bits counts the arguments.
            code = self._make(PROBE, self.library.functions[PROBE], (*prototype.leading, *PROBE_ARGUMENTS))
        self.journal.call(code, 0, PROBE, [*PROBE_ARGUMENTS])
        if code == 0:
            return
        if code < 0:
            raise call_failure(PROBE, code, 0)
        other = {Abi.GTS: Abi.GTS_MULTI, Abi.GTS_MULTI: Abi.GTS}.get(self.library.abi)
        raise failure(
            rules.WRONG_ABI,
            0,
            library=self.library.path,
            abi=self.library.abi,
            reason=Phrase("{call}, which every controller accepts, returned {code}", call=PROBE, code=code),
            hint=Phrase("; try --abi {abi}", abi=other) if other else Phrase("; is it a library for several cards?"),
        )

    def journal_failure(self, line: int = 0) -> BackendError:
        """Make the error of a journal that can't be written any more."""
        return failure(rules.NO_JOURNAL, line, reason=self.journal.lost)

    def library_failure(self, name: str, error: OSError) -> BackendError:
        """Make the error of a call that failed within the library: on Windows an access violation is an OSError."""
        reason = Phrase("{call} failed within the library ({error})", call=name, error=str(error))
        return failure(rules.WRONG_ABI, 0, library=self.library.path, abi=self.library.abi, hint="", reason=reason)

    def _make(self, name: str, function: Any, args: tuple[Any, ...]) -> int:
        if threading.get_ident() != self.owner:
            raise TakenOver
        self.calling, self.since_s = name, time.perf_counter()
        try:
            code: int = function(*args)
        except OSError as error:
            raise self.library_failure(name, error) from error
        finally:
            if threading.get_ident() != self.owner:
                raise TakenOver
            self.since_s = 0.0
        self.call_count += 1
        return code
