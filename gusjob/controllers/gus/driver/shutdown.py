"""The shutdown after every run: laser off, motion stopped, laser off again.

No function in this module raises: every call is made, refused or not, and what could not be turned off becomes a
diagnostic.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from gusjob.controllers.control import Control, StopKind
from gusjob.controllers.gus.calls import Value
from gusjob.controllers.gus.driver.link import BackendError, Link, meaning
from gusjob.controllers.gus.driver.requirements import Outputs
from gusjob.controllers.gus.ranges import CHANNEL, CRD
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic
from gusjob.i18n.phrases import Phrase

_CHANNELS = tuple(range(int(CHANNEL.low), int(CHANNEL.high) + 1))
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


@dataclass(slots=True)
class Shutdown:
    """Turns a controller off. `patience_s`: how long a link that does not answer is tried."""

    link: Link
    outputs: Outputs
    patience_s: float
    laser_off_s: float = math.inf
    """When the first channel began to be switched off by a call that succeeded (time.perf_counter)."""

    def laser_off(self, *, retry: bool = True) -> list[Diagnostic]:
        """Switch every channel off; set the power of one that refuses to 0, and with `retry` try again."""
        failed = {channel: code for channel in _CHANNELS if (code := self._channel_off(channel))}
        power_failed = {channel: self.try_call("GT_LaserPrfCmd", 0.0, float(channel)) != 0 for channel in failed}
        until, tries = time.perf_counter() + self.patience_s, dict.fromkeys(failed, 1)
        while left := [ch for ch, code in failed.items() if retry and code and (code < 0 or tries[ch] < _TRIES)]:
            if time.perf_counter() > until:
                break
            time.sleep(_SLEEP_S)
            for channel in left:
                failed[channel] = self._channel_off(channel)
                tries[channel] += 1
        return [_laser_diagnostic(channel, code, power_failed[channel]) for channel, code in failed.items() if code]

    def _channel_off(self, channel: int) -> int:
        """Switch a channel off; one that the job does not use may be missing on the controller."""
        began = time.perf_counter()
        code = self.try_call("GT_SetHSIOOpt", 0.0, float(channel))
        if code == 0 and channel in self.outputs.channels:
            self.laser_off_s = min(self.laser_off_s, began)
        return 0 if code > 0 and channel not in self.outputs.channels else code

    def stop(self, control: Control, *, abrupt: bool) -> list[Diagnostic]:
        """Stop the motion, and until it is at rest switch the laser off again and again.

        A smooth stop continues along the path, through calls that may switch the laser on: its power is 0 then.
        """
        code = self._stop(abrupt=abrupt)
        began, abrupt_since = time.perf_counter(), time.perf_counter() if abrupt else 0.0
        while True:
            moving = self.moving()
            now = time.perf_counter()
            if moving is False and code == 0:
                return []
            if not abrupt_since and (control.stop == StopKind.ABRUPT or now - began > _SMOOTH_S or code):
                code, abrupt_since = self._stop(abrupt=True), now
            elif code:
                code = self._stop(abrupt=True)
            patience = _REST_S if moving else self.patience_s
            if abrupt_since and now - abrupt_since > patience:
                return [_motion_diagnostic(code)]
            for channel in _CHANNELS:
                self._channel_off(channel)
            for channel in self.outputs.channels:
                self.try_call("GT_LaserPrfCmd", 0.0, float(channel))
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

    def moving(self) -> bool | None:
        """Return whether anything moves; None if it is not known."""
        states = []
        for crd in _CRDS:
            try:
                code, found = self.link.call("GT_CrdStatus", float(crd), 0.0, 0.0, 0.0)
            except BackendError:
                code, found = -1, [0]
            missing = code > 0 and crd not in self.outputs.crds
            states.append(None if code and not missing else bool(not code and found[0]))
        return True if True in states else None if None in states else False

    def try_call(self, name: str, *values: Value) -> int:
        """Return a call's code; a call that fails in the library counts as no answer."""
        try:
            return self.link.call(name, *values)[0]
        except BackendError:
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
