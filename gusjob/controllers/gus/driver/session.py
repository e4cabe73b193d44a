"""A job on a controller, from GT_Open to GT_Close. All of this module runs in one thread, which owns the link."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, replace

import numpy as np

from gusjob.config.machine import Machine
from gusjob.controllers.control import Control, Phase
from gusjob.controllers.gus.calls import Buffered, Call, Stream, Value
from gusjob.controllers.gus.driver.fifo import Fifo, FifoStage, Interrupted
from gusjob.controllers.gus.driver.link import BackendError, Link, call_failure, failure
from gusjob.controllers.gus.driver.requirements import Outputs, number
from gusjob.controllers.gus.driver.shutdown import Shutdown
from gusjob.controllers.gus.path_position import JOB_START, PathPosition, TimedPath
from gusjob.controllers.gus.ranges import STANDBY_KHZ
from gusjob.controllers.gus.remainder import Remainder, remainder_from
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.units import MS_PER_S

INITIAL_SETTINGS: tuple[tuple[str, tuple[Value, ...]], ...] = (
    ("GT_SetLaserDisMode", (0.0, 0.0, (0.0,) * 4, (1.0,) * 4)),
    ("GT_DisFPK", ()),
    ("GT_SetLevelDelay", (0.0, 0.0)),
    ("GT_SetWaitPulse", (0.0, STANDBY_KHZ.high, 0.0)),
    ("GT_SetPreVltg", (0.0, 0.0)),
)
"""The state of each laser when a job begins: what the job does not set is off."""
_RESUME = Phrase("continue with --resume")
_PAUSE_S = 0.05
"""Interval between checks of laser and interlock during a pause."""


@dataclass(slots=True)
class Session:
    """One run. `stream` is the whole job; `reached`: the run's position in it."""

    link: Link
    machine: Machine
    control: Control
    stream: Stream
    outputs: Outputs
    reached: PathPosition = JOB_START
    overrun_ms: float = 0.0
    """Longest time for which a motion that was in progress at GT_Open continued without laser."""
    options: str = ""
    """The options that must be given again to resume this run."""
    abi_confirmed: bool = False
    """The library has proved to be of its ABI: only then "off" means off."""
    _part: Remainder | None = None
    _fifo: Fifo | None = None

    @property
    def line(self) -> int:
        """The job's line that was reached."""
        lines = self.stream.buffered.line
        return int(lines[min(self.reached.row, len(lines) - 1)]) if len(lines) else 1

    # Open and close.

    def open(self) -> None:
        """Open the controller and check it: the right library, laser off, at rest, interlock closed."""
        controller = self.machine.controller
        self.link.checked("GT_Open", float(controller.open_channel), float(controller.open_param))
        self.link.probe()
        self.abi_confirmed = True
        self.ensure_laser_off()
        if self.shutdown.moving():
            off_s = time.perf_counter()
            if faults := self.shutdown.stop(self.control, abrupt=True):
                raise BackendError(*faults)
            self.overrun_ms = (time.perf_counter() - off_s) * MS_PER_S
        self.check_interlock(Phrase("start again"))

    def prepare(self) -> None:
        """Load the configuration, clear the axes' status, enable the axes, set the lasers to their initial state."""
        if self.machine.controller.configuration:
            self.link.checked("GT_LoadConfig", os.fsencode(self.machine.controller.configuration))
        for axis in self.outputs.axes:
            self.link.checked("GT_ClrSts", float(axis), 1.0)
            self.link.checked("GT_AxisOn", float(axis))
        for channel in self.outputs.channels:
            for name, values in INITIAL_SETTINGS:
                self._reset_setting(name, *values, float(channel))

    def _reset_setting(self, name: str, *values: Value) -> None:
        """Reset what an earlier program may have set. What a controller does not have needs no reset."""
        if name in self.link.library.functions:
            code, _ = self.link.call(name, *values)
            if code < 0:
                raise call_failure(name, code, 0)

    def finish(self) -> None:
        """Check that after the end of a job the laser is off and nothing moves."""
        self.ensure_laser_off()
        if self.shutdown.moving():
            raise failure(rules.MOTION_STATE_UNKNOWN, 0, why=Phrase("something moves after the end of the job"))

    def close(self) -> list[Diagnostic]:
        """Disable the axes if the profile says so, then close the controller."""
        steps: list[tuple[str, tuple[float, ...]]] = [("GT_Close", ())]
        if self.machine.controller.axes_off_after:
            steps = [*(("GT_AxisOff", (float(axis),)) for axis in self.outputs.axes), *steps]
        made = [(name, self.shutdown.try_call(name, *values)) for name, values in steps]
        return [fault for name, code in made if code for fault in call_failure(name, code, self.line).faults]

    # State of the machine.

    def position(self, crd: int) -> tuple[float, float]:
        """Return where the head is, pulse."""
        (position,) = self.link.checked("GT_GetCrdPos", float(crd), 0.0)
        return float(position[0]), float(position[1])

    def position_or_none(self) -> tuple[float, float] | None:
        """Return where the head is, pulse; None if the controller does not know, as without a coordinate system."""
        code, found = self.link.call("GT_GetCrdPos", float(self.outputs.crds[0]), 0.0)
        if code < 0:
            raise call_failure("GT_GetCrdPos", code, 0)
        return None if code else (float(found[0][0]), float(found[0][1]))

    def ensure_laser_off(self) -> None:
        """Switch the laser off, or raise."""
        if faults := self.shutdown.laser_off():
            raise BackendError(*faults)

    def check_interlock(self, again: str) -> None:
        """Raise if the profile's interlock input does not read the profile's value. `again`: what to do then."""
        interlock = self.machine.controller.interlock
        if interlock is None:
            return
        (found,) = self.link.checked("GT_GetDi", float(interlock.di_type), 0.0)
        bit = int(found) >> interlock.input & 1
        if bit != interlock.value:
            fields = {
                "di_type": interlock.di_type,
                "input": interlock.input,
                "found": bit,
                "value": interlock.value,
                "again": again,
            }
            raise failure(rules.INTERLOCK, self.line, **fields)

    # Run.

    def run(self, part: Remainder) -> None:
        """Run a remainder of the job to its end, with its pauses."""
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
        self.link.journal.mark(part=part.begin.row, run=part.begin.along_pulse, lead=part.lead_rows)
        self._part = part
        self._fifo = Fifo(
            self.link,
            self.control,
            part,
            on_status=self._on_status,
            before_start=lambda: self.check_interlock(_RESUME),
        )
        for first, last, call in part.stream.parts():
            self._fifo.send(first, last)
            if call is not None:
                self._immediate(self._fifo, call)
        self._wait(self._fifo)
        self.reached = PathPosition(row=len(self.stream.buffered))

    def _immediate(self, fifo: Fifo, call: Call) -> None:
        """Make a call between the buffered ones."""
        fifo.check_requests()
        match call.name:
            case "GT_CrdClear":
                self.link.checked(call.name, *call.args, line=call.line)
                fifo.begin(int(number(call.args[0])), int(number(call.args[1])), call.at, call.line)
            case "GT_CrdStart":
                if fifo.stage is None or not fifo.stage.started:
                    fifo.start(call)
            case "GT_CrdStatus":
                self._wait(fifo)
            case _:
                self.link.checked(call.name, *call.args, line=call.line)

    def _wait(self, fifo: Fifo) -> None:
        """Wait until the stage has ended, and check that the head is where its last motion ends."""
        first = fifo.stage.first if fifo.stage else 0
        status = fifo.wait_for_end()
        if status is None or fifo.stage is None:
            return
        moves = np.flatnonzero(fifo.calls.kind[first : fifo.stage.sent] < Buffered.DELAY)
        if not len(moves):
            return
        row, tolerance = first + int(moves[-1]), self.machine.controller.position_tolerance_pulse
        end_x, end_y = float(fifo.calls.x[row]), float(fifo.calls.y[row])
        if max(abs(status.x - end_x), abs(status.y - end_y)) > tolerance:
            fields = {"x": status.x, "y": status.y, "want_x": end_x, "want_y": end_y}
            raise failure(rules.WRONG_END_POSITION, int(fifo.calls.line[row]), **fields)

    def _on_status(self, stage: FifoStage) -> None:
        """Publish the status after every poll, and check the interlock."""
        assert self._part is not None
        self.reached = replace(self._part.job_position(PathPosition(row=stage.taken)), sure=False)
        self._publish(Phase.RUNNING if stage.started else Phase.FILLING)
        self.check_interlock(_RESUME)

    def _publish(self, phase: Phase) -> None:
        status = replace(self.control.status, phase=phase, row=self.reached.row)
        stage = self._fifo and self._fifo.stage
        if stage and self._part:
            status = replace(status, sent=self._part.job_row(stage.sent), slots=stage.size)
            if last := stage.last:
                status = replace(status, x_pulse=last.x, y_pulse=last.y, queued=stage.size - last.space)
        self.control.status = status

    # Interruptions.

    @property
    def shutdown(self) -> Shutdown:
        """The shutdown of this run."""
        return Shutdown(self.link, self.outputs, self.machine.controller.link_patience_s)

    def halt(self, *, abrupt: bool, locate: bool = True) -> list[Diagnostic]:
        """Switch the laser off, find out where that was, stop, switch the laser off.

        Args:
            abrupt: stop abruptly.
            locate: find out where the laser went off.

        Returns:
            What could not be turned off.
        """
        shutdown = self.shutdown
        # If the laser can't be switched off at the first try, the motion must stop at once.
        still_on = shutdown.laser_off(retry=False)
        self._publish(Phase.STOPPING)
        try:
            if locate and not still_on:
                self._locate(shutdown.laser_off_s)
        finally:
            faults = shutdown.stop(self.control, abrupt=abrupt or bool(still_on))
        if locate and still_on:
            self._locate(time.perf_counter())
        faults = shutdown.laser_off() + faults
        if faults:
            self.reached = replace(self.reached, sure=False)
            shutdown.reset()
            faults += [fault for fault in shutdown.laser_off() if fault not in faults]
        return faults

    def _locate(self, off_s: float) -> None:
        """Find the position on the path at which the laser went off (off_s, time.perf_counter): the rest begins there.

        Free slots and position are read one after the other, and the motion continues in between: all rows that may
        have been in progress are considered.
        """
        fifo, part = self._fifo, self._part
        if fifo is None or part is None or fifo.stage is None or not fifo.stage.started:
            return
        stage = fifo.stage
        before = stage.taken
        try:
            x, y = self.position(stage.crd)
            late_ms = (time.perf_counter() - off_s) * MS_PER_S
            (space,) = self.link.checked("GT_CrdSpace", float(stage.crd), 0.0, float(stage.fifo))
        except BackendError:
            return
        taken = max(stage.sent - (stage.size - int(space)), stage.first)
        path = TimedPath.of(fifo.calls, part.start_pulse)
        self.reached = part.job_position(path.rewind(path.locate(min(before, taken), taken, x, y), late_ms))
        if self.reached.sure:
            self.link.journal.mark(broken=self.reached.row, run=self.reached.along_pulse, line=self.line)

    def _pause(self) -> Remainder:
        """Wait, laser off and at rest, until the user continues; return the rest from where the laser went off."""
        faults, stage = self.halt(abrupt=False), self._fifo.stage if self._fifo else None
        if stage is not None:
            stage.started = False  # At rest: a stop during the pause must not locate the laser-off position again.
        if faults:
            raise BackendError(*faults)
        while self.control.pause and not self.control.stop:
            self._publish(Phase.PAUSED)
            self.control.sleep(_PAUSE_S)
            self.check_interlock(_RESUME)
            self.ensure_laser_off()
        if self.control.stop:
            raise Interrupted
        return remainder_from(self.stream, self.reached, self.position(stage.crd) if stage else None)
