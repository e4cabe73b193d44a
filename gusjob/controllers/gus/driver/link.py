"""The line to the controller: one call at a time, each into the journal, with a mark on what has not returned yet."""

from __future__ import annotations

import ctypes
import threading
import time
from typing import Any

from gusjob.config.machine import Abi
from gusjob.controllers.gus.calls import ArgKind, Value
from gusjob.controllers.gus.driver.abi import PROBE, PROBE_ARGUMENTS, PROBE_GUARD, c_value
from gusjob.controllers.gus.driver.library import Library
from gusjob.controllers.journal import Journal
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule, Span
from gusjob.i18n.phrases import Phrase

FULL = 1
"""What a buffered call returns when the FIFO is full."""

_CABLE = Phrase("check cable and power, and that no other program uses the controller")
MEANINGS: dict[int, tuple[str, str]] = {
    1: (
        Phrase("execution error, a condition is not met"),
        Phrase("look whether the axes are on and without alarm, at rest, and the coordinate system is built"),
    ),
    2: (
        Phrase("no licence for it"),
        Phrase("ask the vendor for a licence, or leave out the statement that needs it"),
    ),
    3: (Phrase("library and firmware do not fit"), Phrase("install the library of the controller's firmware")),
    7: (
        Phrase("parameter error"),
        Phrase("the controller does not take one of the arguments; is --abi the right one?"),
    ),
    8: (
        Phrase("not supported by this firmware"),
        Phrase("leave out the statement that needs it, or update the firmware"),
    ),
    -6: (
        Phrase("the controller can't be opened"),
        Phrase("is it on, its driver installed? {cable}; gusjob devices says more", cable=_CABLE),
    ),
    -7: (Phrase("no response"), _CABLE),
    -8: (Phrase("lock time-out"), _CABLE),
}
"""Return codes (sister): what each means and what to do."""
_NO_LINK = (Phrase("the link to the controller failed"), _CABLE)
_UNKNOWN = (Phrase("an unknown return code"), Phrase("look it up in the library's manual"))


def meaning(code: int) -> tuple[str, str]:
    """What a return code means and what to do."""
    return MEANINGS.get(code) or (_NO_LINK if code < 0 else _UNKNOWN)


class BackendError(Exception):
    """The one exception of the house: the controller did not do what the job needs. It carries its diagnostics."""

    def __init__(self, *faults: Diagnostic) -> None:
        self.faults = list(faults)
        super().__init__(*(fault.message for fault in faults))


def failure(rule: Rule, line: int, **fields: Any) -> BackendError:
    """A failure at a line of the job; line 0: wherever the run is."""
    return BackendError(Diagnostic(rule=rule, span=Span(line=line), fields=fields))


def call_failure(call: str, code: int, line: int) -> BackendError:
    """The fault of a call that did not return 0."""
    what, advice = meaning(code)
    return failure(rules.CALL_FAILED, line, call=call, code=code, meaning=what, advice=advice)


class TakenOver(BaseException):
    """Raised in a thread whose call hung so long that another one has taken over. It must make no more calls."""


class Link:
    """Makes calls. Only the thread that owns the link may."""

    def __init__(self, library: Library, journal: Journal) -> None:
        self.library = library
        self.journal = journal
        self.owner = threading.get_ident()
        self.calling = ""
        self.since_s = 0.0
        """When the call that has not returned yet was made (time.perf_counter), 0 if there is none."""
        self.made = 0
        """How many calls returned."""

    def take_over(self) -> None:
        """This thread owns the link from now on."""
        self.since_s = 0.0
        self.owner = threading.get_ident()

    def release(self) -> None:
        """Nobody owns the link, until a thread takes it over: what hangs is not waited for any more."""
        self.owner, self.since_s = 0, 0.0

    def hung_s(self) -> float:
        """For how long the present call has not returned."""
        since = self.since_s
        return time.perf_counter() - since if since else 0.0

    def call(self, name: str, *values: Value | bytes, line: int = 0) -> tuple[int, list[Any]]:
        """One call by the manual's name: what it returned, and what it found for each pointer, in order.

        A journal that can't be written ends the run (see must), but not the way out of it.
        """
        prototype = self.library.prototypes[name]
        given = [c_value(arg, value) for arg, value in zip(prototype.args, values, strict=True)]
        code = self._make(name, self.library.functions[name], (*prototype.before, *given, *prototype.behind))
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

    def no_journal(self, line: int = 0) -> BackendError:
        """The journal can't be written any more."""
        return failure(rules.NO_JOURNAL, line, reason=self.journal.lost)

    def must(self, name: str, *values: Value | bytes, line: int = 0) -> list[Any]:
        """The same; anything but 0 is an error."""
        code, found = self.call(name, *values, line=line)
        if code:
            raise call_failure(name, code, line)
        if self.journal.lost:
            raise self.no_journal(line)
        return found

    def probe(self) -> None:
        """A call that only a library of this ABI answers with 0: it has no pointers, so a wrong one can't crash."""
        prototype = self.library.prototypes[PROBE]
        # A function of its own without argument types: it gets more arguments than the prototype has.
        guarded: Any = self.library.handle[prototype.symbol]
        guarded.restype = ctypes.c_short
        guard: tuple[int, ...] = PROBE_GUARD
        try:
            code = self._make(PROBE, guarded, (*prototype.before, *PROBE_ARGUMENTS, *guard))
        except ValueError:
            # __stdcall in 32 bits counts the arguments.
            guard = ()
            code = self._make(PROBE, self.library.functions[PROBE], (*prototype.before, *PROBE_ARGUMENTS))
        self.journal.call(code, 0, PROBE, [*PROBE_ARGUMENTS])
        if code == 0:
            return
        if code < 0:
            raise call_failure(PROBE, code, 0)
        other = {Abi.GTS: Abi.GTS_MULTI, Abi.GTS_MULTI: Abi.GTS}.get(self.library.abi)
        raise failure(
            rules.WRONG_ABI, 0, library=self.library.path, abi=self.library.abi,
            reason=Phrase("{call}, which every controller takes, returned {code}", call=PROBE, code=code),
            hint=Phrase("; try --abi {abi}", abi=other) if other else Phrase("; is it a library for several cards?"),
        )  # fmt: skip

    def crashed(self, name: str, error: OSError) -> BackendError:
        """On Windows an access violation within the library is an OSError."""
        reason = Phrase("{call} failed within the library ({error})", call=name, error=str(error))
        return failure(rules.WRONG_ABI, 0, library=self.library.path, abi=self.library.abi, hint="", reason=reason)

    def _make(self, name: str, function: Any, args: tuple[Any, ...]) -> int:
        if threading.get_ident() != self.owner:
            raise TakenOver
        self.calling, self.since_s = name, time.perf_counter()
        try:
            code: int = function(*args)
        except OSError as error:
            raise self.crashed(name, error) from error
        finally:
            if threading.get_ident() != self.owner:
                raise TakenOver
            self.since_s = 0.0
        self.made += 1
        return code
