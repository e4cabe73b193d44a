"""The way out, whatever happened: light off first, then the motion stopped, then the light off again.

Nothing in here raises: every call is made, refused or not, and what could not be made sure becomes a diagnostic.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from gusjob.controllers.control import Control
from gusjob.controllers.gus.calls import Value
from gusjob.controllers.gus.driver.link import BackendError, Link, meaning
from gusjob.controllers.gus.ranges import CHANNEL, CRD
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic
from gusjob.i18n.phrases import Phrase

_CHANNELS = tuple(range(int(CHANNEL.low), int(CHANNEL.high) + 1))
_CRDS = tuple(range(int(CRD.low), int(CRD.high) + 1))

_TRIES = 3
"""So often a call is repeated that the controller itself refuses."""
_NAP_S = 0.02
_SMOOTH_S = 2.0
"""A smooth stop that takes longer becomes an abrupt one."""
_REST_S = 2.0
"""So long after an abrupt stop the motion may take to rest."""
_WATCH_S = 0.05
"""So long after an abrupt stop the light is switched off without a pause between."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outputs:
    """Which laser channels, coordinate systems and axes a job uses.

    All channels and systems are turned off, since an earlier program may have left any of them on; of those that a job
    does not use the controller may say that it has none.
    """

    channels: tuple[int, ...]
    crds: tuple[int, ...]
    axes: tuple[int, ...]


@dataclass(slots=True)
class Shutdown:
    """Turns a controller off. `patience_s`: for so long a link that does not answer is tried."""

    link: Link
    outputs: Outputs
    patience_s: float
    off_s: float = math.inf
    """When the first channel began to be switched off by a call that did it (time.perf_counter)."""

    def light_off(self, *, patient: bool = True) -> list[Diagnostic]:
        """Every channel dark. One that refuses gets no power instead; `patient`: and is tried again."""
        failed = {channel: code for channel in _CHANNELS if (code := self._off(channel))}
        powered = {channel: self.code("GT_LaserPrfCmd", 0.0, float(channel)) != 0 for channel in failed}
        until, tries = time.perf_counter() + self.patience_s, dict.fromkeys(failed, 1)
        while left := [ch for ch, code in failed.items() if patient and code and (code < 0 or tries[ch] < _TRIES)]:
            if time.perf_counter() > until:
                break
            time.sleep(_NAP_S)
            for channel in left:
                failed[channel] = self._off(channel)
                tries[channel] += 1
        return [_laser_diagnostic(channel, code, powered[channel]) for channel, code in failed.items() if code]

    def _off(self, channel: int) -> int:
        """Switch a channel off. A controller that has none other than the job's may say so."""
        began = time.perf_counter()
        code = self.code("GT_SetHSIOOpt", 0.0, float(channel))
        if code == 0 and channel in self.outputs.channels:
            self.off_s = min(self.off_s, began)
        return 0 if code > 0 and channel not in self.outputs.channels else code

    def stop(self, control: Control, *, abrupt: bool) -> list[Diagnostic]:
        """The motion at rest. Until then the light is switched off again and again.

        A smooth stop goes on along the path, through calls that may switch the light on: it finds no power then.
        """
        code = self._stop(abrupt=abrupt)
        began, abrupt_since = time.perf_counter(), time.perf_counter() if abrupt else 0.0
        while True:
            moving = self.moving()
            now = time.perf_counter()
            if moving is False and code == 0:
                return []
            if not abrupt_since and (control.stop > 1 or now - began > _SMOOTH_S or code):
                code, abrupt_since = self._stop(abrupt=True), now
            elif code:
                code = self._stop(abrupt=True)
            patience = _REST_S if moving else self.patience_s
            if abrupt_since and now - abrupt_since > patience:
                return [_motion_diagnostic(code)]
            for channel in _CHANNELS:
                self._off(channel)
            for channel in self.outputs.channels:
                self.code("GT_LaserPrfCmd", 0.0, float(channel))
            if abrupt_since and now - abrupt_since > _WATCH_S:
                time.sleep(_NAP_S)

    def reset(self) -> bool:
        """The last resort where light or motion could not be turned off: GT_Reset, if the library has it."""
        return "GT_Reset" in self.link.library.functions and self.code("GT_Reset") == 0

    def _stop(self, *, abrupt: bool) -> int:
        """GT_Stop: bit 8 is coordinate system 1, bit 9 the other; bit 0 axis 1 (sister)."""
        systems = sum(1 << (7 + crd) for crd in _CRDS)
        axes = sum(1 << (axis - 1) for axis in self.outputs.axes)
        return self.code("GT_Stop", float(systems), float(systems | axes if abrupt else 0))

    def moving(self) -> bool | None:
        """Whether anything moves; None if nobody knows."""
        states = []
        for crd in _CRDS:
            try:
                code, found = self.link.call("GT_CrdStatus", float(crd), 0.0, 0.0, 0.0)
            except BackendError:
                code, found = -1, [0]
            not_there = code > 0 and crd not in self.outputs.crds
            states.append(None if code and not not_there else bool(not code and found[0]))
        return True if True in states else None if None in states else False

    def code(self, name: str, *values: Value) -> int:
        """A call's return code; a call that fails in the library counts as no answer."""
        try:
            return self.link.call(name, *values)[0]
        except BackendError:
            return -1


def _motion_diagnostic(code: int) -> Diagnostic:
    if code:
        why = Phrase("GT_Stop returned {code} ({meaning})", code=code, meaning=meaning(code)[0])
    else:
        why = Phrase("GT_CrdStatus still says so")
    return Diagnostic(rule=rules.MOTION_UNKNOWN, span=NOWHERE, fields={"why": why})


def _laser_diagnostic(channel: int, code: int, powered: bool) -> Diagnostic:
    what = meaning(code)[0]
    if powered:
        why = Phrase("returned {code} ({meaning})", code=code, meaning=what)
    else:
        why = Phrase("returned {code} ({meaning}); its power was set to 0", code=code, meaning=what)
    fields = {"channel": channel, "call": f"GT_SetHSIOOpt(0,{channel})", "why": why}
    return Diagnostic(rule=rules.LIGHT_UNKNOWN, span=NOWHERE, fields=fields)
