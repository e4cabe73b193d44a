"""The shutdown after every run: laser off, motion stopped, laser off again.

No function in this module raises: every call is made, refused or not, and what could not be turned off becomes a
diagnostic.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from msgspec import Struct, field

from gusjob.controllers.control import Control, StopKind
from gusjob.controllers.gus.calls import Value
from gusjob.controllers.gus.driver.link import BackendError, Link, meaning
from gusjob.controllers.gus.driver.requirements import Outputs
from gusjob.controllers.gus.ranges import CHANNELS, CRD
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic
from gusjob.i18n.phrases import Phrase

_CRDS = tuple(range(int(CRD.low), int(CRD.high) + 1))

_TRIES = 3
"""Number of attempts at a call that the controller refuses."""
_SLEEP_S = 0.02
_SMOOTH_S = 2.0
"""A smooth stop that takes longer becomes an abrupt one."""
_REST_S = 2.0
"""Longest time after an abrupt stop until the motion is at rest."""
_WATCH_S = 0.05
"""Time after an abrupt stop for which the laser is switched off repeatedly without a pause."""

MISSING = (7, 8)
"""Codes with which a controller answers to a channel or a coordinate system that it does not have."""
_NOT_OPEN = -6
"""The code of a call that did not reach the controller."""


class Shutdown(Struct):
    """Turns a controller off. `patience_s`: how long a link that does not answer is tried.

    `off_since_s`: when the first call was made that may have switched the laser off; `rest_s`: when the motion was
    confirmed to be at rest (time.perf_counter); inf: not yet. Both since the last part of the run began.
    """

    link: Link
    outputs: Outputs
    patience_s: float
    off_since_s: float = math.inf
    rest_s: float = math.inf
    _is_marked: bool = False
    _present: set[tuple[str, int]] = field(default_factory=set)
    """What has answered once: (call, channel or coordinate system). It is not missing if it refuses later."""

    def begin_part(self) -> None:
        """Forget when the laser was switched off: a part begins."""
        self.off_since_s = self.rest_s = math.inf
        self._is_marked = False

    def laser_off(self, *, retry: bool = True) -> list[Diagnostic]:
        """Switch every channel off; set the power of one that refuses to 0, and with `retry` try again."""
        if not self._is_marked:
            # Before the call: a process that is killed in it leaves no other trace.
            self._is_marked = True
            self.link.journal.mark(off=True)
        failed = {channel: code for channel in CHANNELS if (code := self._channel_off(channel))}
        power_failed = {channel: self._power_off(channel) != 0 for channel in failed}
        until, tries = time.perf_counter() + self.patience_s, dict.fromkeys(failed, 1)
        while left := [ch for ch, code in failed.items() if retry and code and (code < 0 or tries[ch] < _TRIES)]:
            if time.perf_counter() > until:
                break
            time.sleep(_SLEEP_S)
            for channel in left:
                failed[channel] = self._channel_off(channel)
                tries[channel] += 1
        if math.isinf(self.off_since_s):
            self._is_marked = False
            self.link.journal.mark(off=False)
        return [_laser_diagnostic(channel, code, power_failed[channel]) for channel, code in failed.items() if code]

    def _channel_off(self, channel: int) -> int:
        """Switch a channel off; one that the job does not use may be missing on the controller."""
        is_used = channel in self.outputs.channels
        return self._answer("GT_SetHSIOOpt", channel, is_used, lambda: self._off_call("GT_SetHSIOOpt", channel))

    def _power_off(self, channel: int) -> int:
        return self._off_call("GT_LaserPrfCmd", channel)

    def _off_call(self, name: str, channel: int) -> int:
        """Make a call with the value 0, and note when the first one was made that may have had an effect."""
        began = time.perf_counter()
        code = self.try_call(name, 0.0, float(channel))
        if code <= 0 and code != _NOT_OPEN:
            self.off_since_s = min(self.off_since_s, began)
        return code

    def _answer(self, name: str, number: int, is_used: bool, make: Callable[[], int]) -> int:
        """Make a call about a channel or coordinate system; return 0 also if the controller has none of that number.

        It is missing if the job does not use it and it has never answered anything else.
        """
        for _ in range(_TRIES):
            code = make()
            if code == 0:
                self._present.add((name, number))
            if is_used or code not in MISSING or (name, number) in self._present:
                return code
        return 0

    def stop(self, control: Control, *, abrupt: bool) -> list[Diagnostic]:
        """Stop the motion, and until it is at rest switch the laser off again and again.

        A smooth stop continues along the path, through calls that may switch the laser on: its power is 0 then.
        """
        self.rest_s = math.inf
        code = self._stop(abrupt=abrupt)
        began, abrupt_since = time.perf_counter(), time.perf_counter() if abrupt else 0.0
        while True:
            moving = self.moving()
            now = time.perf_counter()
            if moving is False and code == 0:
                self._note_rest(now)
                return []
            if not abrupt_since and (control.stop == StopKind.ABRUPT or now - began > _SMOOTH_S or code):
                code, abrupt_since = self._stop(abrupt=True), now
            elif code:
                code = self._stop(abrupt=True)
            patience = _REST_S if moving else self.patience_s
            if abrupt_since and now - abrupt_since > patience:
                return [_motion_diagnostic(code)]
            for channel in CHANNELS:
                self._channel_off(channel)
            for channel in self.outputs.channels:
                self._power_off(channel)
            if abrupt_since and now - abrupt_since > _WATCH_S:
                time.sleep(_SLEEP_S)

    def reset(self) -> bool:
        """Make GT_Reset, if the library has it: the last resort where laser or motion could not be turned off."""
        return "GT_Reset" in self.link.library.functions and self.try_call("GT_Reset") == 0

    def _stop(self, *, abrupt: bool) -> int:
        """GT_Stop: bit 8 is coordinate system 1, bit 9 the other; bit 0 axis 1 (sister)."""
        systems = sum(1 << (7 + crd) for crd in _CRDS)
        axes = sum(1 << (axis - 1) for axis in self.outputs.axes)
        return self.try_call("GT_Stop", float(systems), float(systems | axes if abrupt else 0))

    def _note_rest(self, now_s: float) -> None:
        if math.isinf(self.rest_s):
            self.rest_s = now_s
            self.link.journal.mark(rest=True)

    def moving(self) -> bool | None:
        """Return whether anything moves; None if it is not known."""
        states = [self._moves(crd) for crd in _CRDS]
        moving = True if True in states else None if None in states else False
        if moving is False:
            self._note_rest(time.perf_counter())
        elif moving:
            self.rest_s = math.inf
        return moving

    def _moves(self, crd: int) -> bool | None:
        found: list[int] = [0]

        def ask() -> int:
            try:
                code, found[:] = self.link.call("GT_CrdStatus", float(crd), 0.0, 0.0, 0.0)
            except BackendError:
                return -1
            return code

        code = self._answer("GT_CrdStatus", crd, crd in self.outputs.crds, ask)
        # The answer of a missing system does not count.
        return None if code else ("GT_CrdStatus", crd) in self._present and bool(found[0])

    def confirm_rest(self) -> list[Diagnostic]:
        """Check that nothing moves: after the end of a job."""
        until = time.perf_counter() + self.patience_s
        while (moving := self.moving()) is None and time.perf_counter() < until:
            time.sleep(_SLEEP_S)
        if moving is False:
            return []
        what = Phrase("something moves after the end of the job")
        why = what if moving else Phrase("GT_CrdStatus does not answer after the end of the job")
        return [Diagnostic(rule=rules.MOTION_STATE_UNKNOWN, span=NOWHERE, fields={"why": why})]

    def try_call(self, name: str, *values: Value) -> int:
        """Return a call's code; a call that fails in the library counts as no answer."""
        try:
            return self.link.call(name, *values)[0]
        except (BackendError, ValueError):  # __stdcall in 32 bits: a library of another ABI.
            return -1


def hung_diagnostics(outputs: Outputs, call: str) -> list[Diagnostic]:
    """Report laser and motion as unknown, because a call hangs and no other one could be made."""
    why = Phrase("can't be called while {call} hangs", call=call)
    laser = [
        Diagnostic(
            rule=rules.LASER_STATE_UNKNOWN,
            span=NOWHERE,
            fields={"channel": channel, "call": f"GT_SetHSIOOpt(0,{channel})", "why": why},
        )
        for channel in outputs.channels
    ]
    why = Phrase("GT_Stop can't be called while {call} hangs", call=call)
    return [*laser, Diagnostic(rule=rules.MOTION_STATE_UNKNOWN, span=NOWHERE, fields={"why": why})]


def _motion_diagnostic(code: int) -> Diagnostic:
    if code:
        why = Phrase("GT_Stop returned {code} ({meaning})", code=code, meaning=meaning(code)[0])
    else:
        why = Phrase("GT_CrdStatus still reports motion")
    return Diagnostic(rule=rules.MOTION_STATE_UNKNOWN, span=NOWHERE, fields={"why": why})


def _laser_diagnostic(channel: int, code: int, power_failed: bool) -> Diagnostic:
    what = meaning(code)[0]
    if power_failed:
        why = Phrase("returned {code} ({meaning})", code=code, meaning=what)
    else:
        why = Phrase("returned {code} ({meaning}); its power was set to 0", code=code, meaning=what)
    fields = {"channel": channel, "call": f"GT_SetHSIOOpt(0,{channel})", "why": why}
    return Diagnostic(rule=rules.LASER_STATE_UNKNOWN, span=NOWHERE, fields=fields)
