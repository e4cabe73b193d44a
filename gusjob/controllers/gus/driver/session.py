"""A job on a controller, from GT_Open to GT_Close. Everything in here runs in one thread, which owns the link."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, replace

import numpy as np

from gusjob.config.machine import Machine
from gusjob.controllers.control import Control, Phase
from gusjob.controllers.gus.calls import BUFFERED, Buffered, Call, Stream, Value
from gusjob.controllers.gus.driver.fifo import Fifo, Interrupted, FifoStage
from gusjob.controllers.gus.driver.link import BackendError, Link, failure, call_failure
from gusjob.controllers.gus.driver.shutdown import Outputs, Shutdown
from gusjob.controllers.gus.path_position import JOB_START, PathPosition, TimedPath
from gusjob.controllers.gus.ranges import STANDBY_KHZ
from gusjob.controllers.gus.remainder import Remainder, remainder_from
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Span
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.units import MS_PER_S

INITIAL_SETTINGS: tuple[tuple[str, tuple[Value, ...]], ...] = (
    ("GT_SetLaserDisMode", (0.0, 0.0, (0.0,) * 4, (1.0,) * 4)),
    ("GT_DisFPK", ()),
    ("GT_SetLevelDelay", (0.0, 0.0)),
    ("GT_SetWaitPulse", (0.0, STANDBY_KHZ.high, 0.0)),
    ("GT_SetPreVltg", (0.0, 0.0)),
)
"""How each laser stands when a job begins: what is not said in a job is off."""
_GO_ON = Phrase("go on with --resume")
_PAUSE_S = 0.05
"""How often light and interlock are looked after in a pause."""

NEEDED = (
    "GT_Open", "GT_Close", "GT_ClrSts", "GT_AxisOn", "GT_AxisOff", "GT_SetHSIOOpt", "GT_LaserPrfCmd", "GT_SetCrdPrm",
    "GT_CrdClear", "GT_CrdSpace", "GT_CrdStart", "GT_CrdStatus", "GT_GetCrdPos", "GT_Stop", "GT_LnXY",
)  # fmt: skip
"""The calls that every run needs, beside those of its job."""


def needed_calls(stream: Stream, machine: Machine) -> set[str]:
    """Every call that a run of a stream on a machine can make."""
    names = {*NEEDED, *(call.name for call in stream.calls)}
    names |= {BUFFERED[Buffered(kind)].name for kind in np.unique(stream.buffered.kind).tolist()}
    names |= {"GT_BufLaserOn", "GT_BufLaserPrfCmd"} if "GT_BufLaserOn" in names or "GT_LaserPrfCmd" in names else set()
    names |= {"GT_ArcXYC"} if "GT_ArcXYR" in names else set()
    names |= {"GT_LoadConfig"} if machine.controller.configuration else set()
    return names | ({"GT_GetDi"} if machine.controller.interlock else set())


def one_queue(stream: Stream) -> list[Diagnostic]:
    """A stream that fills more than one FIFO is refused: which of them runs when could not be followed."""
    calls = stream.buffered
    queue = calls.crd.astype(np.int64) * 2 + calls.fifo
    if not len(queue) or (queue == queue[0]).all():
        return []
    row = int(np.argmax(queue != queue[0]))
    names = [
        Phrase("GT_ calls of coordinate system {crd}, FIFO {fifo}", crd=int(calls.crd[i]), fifo=int(calls.fifo[i]))
        for i in (row, 0)
    ]
    fields = {"what": names[0], "first": names[1]}
    return [Diagnostic(rule=rules.TWO_SYSTEMS, span=Span(line=int(calls.line[row])), fields=fields)]


def outputs_of(stream: Stream) -> Outputs:
    """What a stream may leave on."""
    calls = stream.buffered
    channels = {int(c) for c in np.unique(calls.channel[calls.kind >= Buffered.ON])}
    for call in stream.calls:
        if call.name not in ("GT_SetCrdPrm", "GT_CrdClear", "GT_CrdStart", "GT_CrdStatus", "GT_SetAxisMode"):
            channels.add(int(_number(call.args[-1])))
    crds = {int(c) for c in np.unique(calls.crd)} or {1}
    axes = {axis for call in stream.calls if call.name == "GT_SetCrdPrm" for axis in _axes(call.args[1])} or {1, 2}
    return Outputs(channels=tuple(sorted(channels)), crds=tuple(sorted(crds)), axes=tuple(sorted(axes)))


def _number(value: Value) -> float:
    assert isinstance(value, float)
    return value


def _axes(parameters: Value) -> list[int]:
    """The axes of a coordinate system: those whose profile names a dimension (sister)."""
    profile = parameters[1] if isinstance(parameters, tuple) else ()
    assert isinstance(profile, tuple)
    return [axis for axis, dimension in enumerate(profile, 1) if dimension]


@dataclass(slots=True)
class Session:
    """One run. `stream` is the whole job; `reached`: where it is in there."""

    link: Link
    machine: Machine
    control: Control
    stream: Stream
    outputs: Outputs
    reached: PathPosition = JOB_START
    ran_on_ms: float = 0.0
    """For how long at most the motion that was found when the controller was opened went on dark."""
    options: str = ""
    """What has to be said again to go on with this run."""
    trusted: bool = False
    """The library has proved to be of its ABI: only then "off" means off."""
    _part: Remainder | None = None
    _fifo: Fifo | None = None

    @property
    def line(self) -> int:
        """The job's line that was reached."""
        lines = self.stream.buffered.line
        return int(lines[min(self.reached.row, len(lines) - 1)]) if len(lines) else 1

    # Open.

    def open(self) -> None:
        """Open the controller and make sure of it: the right library, light off, at rest, interlock closed."""
        controller = self.machine.controller
        self.link.must("GT_Open", float(controller.open_channel), float(controller.open_param))
        self.link.probe()
        self.trusted = True
        self.dark()
        if self.way_out.moving():
            dark_s = time.perf_counter()
            if faults := self.way_out.stop(self.control, abrupt=True):
                raise BackendError(*faults)
            self.ran_on_ms = (time.perf_counter() - dark_s) * MS_PER_S
        self.interlock(Phrase("start again"))

    def position(self, crd: int) -> tuple[float, float]:
        """Where the head is, pulse."""
        (position,) = self.link.must("GT_GetCrdPos", float(crd), 0.0)
        return float(position[0]), float(position[1])

    def head(self) -> tuple[float, float] | None:
        """Where the head is, pulse; None if the controller does not say, as before it has a coordinate system."""
        code, found = self.link.call("GT_GetCrdPos", float(self.outputs.crds[0]), 0.0)
        if code < 0:
            raise call_failure("GT_GetCrdPos", code, 0)
        return None if code else (float(found[0][0]), float(found[0][1]))

    def prepare(self) -> None:
        """Configuration, status, axes; and the lasers as the interpreter has them when a job begins."""
        if self.machine.controller.configuration:
            self.link.must("GT_LoadConfig", os.fsencode(self.machine.controller.configuration))
        for axis in self.outputs.axes:
            self.link.must("GT_ClrSts", float(axis), 1.0)
            self.link.must("GT_AxisOn", float(axis))
        for channel in self.outputs.channels:
            for name, values in INITIAL_SETTINGS:
                self._begin(name, *values, float(channel))

    def _begin(self, name: str, *values: Value) -> None:
        """A setting that an earlier program may have left. What a controller does not have needs no reset."""
        if name in self.link.library.functions:
            code, _ = self.link.call(name, *values)
            if code < 0:
                raise call_failure(name, code, 0)

    # Run.

    def run(self, part: Remainder) -> None:
        """A part and all that is left of the job behind it, with its pauses."""
        while True:
            try:
                self._run(part)
                return
            except Interrupted:
                if self.control.stop:
                    raise
                part = self._pause()

    def _run(self, part: Remainder) -> None:
        self.reached = part.begin
        self.link.journal.mark(part=part.begin.row, run=part.begin.run_pulse, lead=part.lead)
        self._part = part
        self._fifo = Fifo(
            self.link, self.control, part, on_look=self._looked, before_start=lambda: self.interlock(_GO_ON)
        )
        for first, last, call in part.stream.parts():
            self._fifo.send(first, last)
            if call is not None:
                self._step(self._fifo, call)
        self._wait(self._fifo)
        self.reached = PathPosition(row=len(self.stream.buffered))

    def _step(self, fifo: Fifo, call: Call) -> None:
        """A call between the buffered ones."""
        fifo.heed()
        match call.name:
            case "GT_CrdClear":
                self.link.must(call.name, *call.args, line=call.line)
                fifo.begin(int(_number(call.args[0])), int(_number(call.args[1])), call.at, call.line)
            case "GT_CrdStart":
                if fifo.stage is None or not fifo.stage.started:
                    fifo.start(call)
            case "GT_CrdStatus":
                self._wait(fifo)
            case _:
                self.link.must(call.name, *call.args, line=call.line)

    def _wait(self, fifo: Fifo) -> None:
        """Until the stage has ended; at rest the head is where its last motion ends."""
        first = fifo.stage.first if fifo.stage else 0
        look = fifo.wait_for_end()
        if look is None or fifo.stage is None:
            return
        moves = np.flatnonzero(fifo.calls.kind[first : fifo.stage.sent] < Buffered.DELAY)
        if not len(moves):
            return
        row, tolerance = first + int(moves[-1]), self.machine.controller.position_tolerance_pulse
        want_x, want_y = float(fifo.calls.x[row]), float(fifo.calls.y[row])
        if max(abs(look.x - want_x), abs(look.y - want_y)) > tolerance:
            where = {"x": look.x, "y": look.y, "want_x": want_x, "want_y": want_y}
            raise failure(rules.WRONG_END, int(fifo.calls.line[row]), **where)

    def interlock(self, again: str) -> None:
        """The profile's input must read what the profile says."""
        lock = self.machine.controller.interlock
        if lock is None:
            return
        (found,) = self.link.must("GT_GetDi", float(lock.di_type), 0.0)
        bit = int(found) >> lock.input & 1
        if bit != lock.value:
            fields = {"di_type": lock.di_type, "input": lock.input, "found": bit, "value": lock.value, "again": again}
            raise failure(rules.INTERLOCK, self.line, **fields)

    # Watching.

    def _looked(self, stage: FifoStage) -> None:
        """After every look at the controller."""
        assert self._part is not None
        self.reached = replace(self._part.place(PathPosition(row=stage.taken)), sure=False)
        self._show(Phase.RUNNING if stage.started else Phase.FILLING)
        self.interlock(_GO_ON)

    def _show(self, phase: Phase) -> None:
        view, stage = replace(self.control.view, phase=phase, row=self.reached.row), self._fifo and self._fifo.stage
        if stage and self._part:
            view = replace(view, sent=self._part.row(stage.sent), slots=stage.size)
            if look := stage.last:
                view = replace(view, x_pulse=look.x, y_pulse=look.y, queued=stage.size - look.space)
        self.control.view = view

    # Ways out.

    @property
    def way_out(self) -> Shutdown:
        """The way out of this run."""
        return Shutdown(self.link, self.outputs, self.machine.controller.link_patience_s)

    def halt(self, *, abrupt: bool, locate: bool = True) -> list[Diagnostic]:
        """Light off, see where that was, stop, light off; and what could not be made sure of."""
        way = self.way_out
        # Light that can't be switched off at the first try is a reason to stop the motion at once.
        lit = way.light_off(patient=False)
        self._show(Phase.STOPPING)
        try:
            if locate and not lit:
                self._locate(way.off_s)
        finally:
            faults = way.stop(self.control, abrupt=abrupt or bool(lit))
        if locate and lit:
            self._locate(time.perf_counter())
        faults = way.light_off() + faults
        if faults:
            self.reached = replace(self.reached, sure=False)
            way.reset()
            faults += [fault for fault in way.light_off() if fault not in faults]
        return faults

    def _locate(self, off_s: float) -> None:
        """Where on the path the light went off (off_s, time.perf_counter): what is left begins there.

        Space and position are read one behind the other, and the motion goes on between: all rows that may have been
        in progress are looked at.
        """
        fifo, part = self._fifo, self._part
        if fifo is None or part is None or fifo.stage is None or not fifo.stage.started:
            return
        stage = fifo.stage
        before = stage.taken
        try:
            x, y = self.position(stage.crd)
            late_ms = (time.perf_counter() - off_s) * MS_PER_S
            (space,) = self.link.must("GT_CrdSpace", float(stage.crd), 0.0, float(stage.fifo))
        except BackendError:
            return
        taken = max(stage.sent - (stage.size - int(space)), stage.first)
        route = TimedPath.of(fifo.calls, part.start)
        self.reached = part.place(route.back(route.place(min(before, taken), taken, x, y), late_ms))
        if self.reached.sure:
            self.link.journal.mark(broken=self.reached.row, run=self.reached.run_pulse, line=self.line)

    def _pause(self) -> Remainder:
        """Dark and at rest until the user goes on; then what is left from where the light went off."""
        faults, stage = self.halt(abrupt=False), self._fifo.stage if self._fifo else None
        if stage is not None:
            stage.started = False  # It rests: where the light went off is known, and not to be looked for again.
        if faults:
            raise BackendError(*faults)
        while self.control.pause and not self.control.stop:
            self._show(Phase.PAUSED)
            self.control.nap(_PAUSE_S)
            self.interlock(_GO_ON)
            self.dark()
        if self.control.stop:
            raise Interrupted
        return remainder_from(self.stream, self.reached, self.position(stage.crd) if stage else None)

    def finish(self) -> None:
        """Behind the end of a job it is dark and nothing moves."""
        self.dark()
        if self.way_out.moving():
            raise failure(rules.MOTION_UNKNOWN, 0, why=Phrase("something moves behind the end of the job"))

    def dark(self) -> None:
        """The light is off, or it is an error."""
        if faults := self.way_out.light_off():
            raise BackendError(*faults)

    def close(self) -> list[Diagnostic]:
        """Axes as configured, then the controller closed."""
        steps: list[tuple[str, tuple[float, ...]]] = [("GT_Close", ())]
        if self.machine.controller.axes_off_after:
            steps = [*(("GT_AxisOff", (float(axis),)) for axis in self.outputs.axes), *steps]
        made = [(name, self.way_out.code(name, *values)) for name, values in steps]
        return [fault for name, code in made if code for fault in call_failure(name, code, self.line).faults]
