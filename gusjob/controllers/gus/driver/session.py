"""A job on a controller, from GT_Open to GT_Close. All of this module runs in one thread, which owns the link."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.config.machine import Abi, Machine
from gusjob.controllers.control import Control, Phase
from gusjob.controllers.gus.calls import Buffered, BufferedCalls, Call, Stream, Value
from gusjob.controllers.gus.doubling import before_laser_on, doubling_mm
from gusjob.controllers.gus.driver.fifo import Fifo, FifoStage, Interrupted
from gusjob.controllers.gus.driver.link import BackendError, Link, call_failure, failure, meaning
from gusjob.controllers.gus.driver.requirements import Outputs, number
from gusjob.controllers.gus.driver.shutdown import Shutdown
from gusjob.controllers.gus.path_position import JOB_START, PathPosition, PositionRange, TimedPath
from gusjob.controllers.gus.ranges import STANDBY_KHZ
from gusjob.controllers.gus.remainder import Remainder, remainder_from
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.units import MS_PER_S

NOT_SUPPORTED = 8
"""The code of a call that the firmware does not have."""


class InitialSetting(Struct, frozen=True, kw_only=True):
    """A call that resets a setting; the channel is its last argument. `others`: further calls of the same setting."""

    call: str
    values: tuple[Value, ...] = ()
    others: tuple[str, ...] = ()


INITIAL_SETTINGS = (
    InitialSetting(
        call="GT_SetLaserDisMode", values=(0.0, 0.0, (0.0,) * 4, (1.0,) * 4), others=("GT_SetLaserDisRatio",)
    ),
    InitialSetting(call="GT_DisFPK", others=("GT_EnaFPK",)),
    InitialSetting(call="GT_SetLevelDelay", values=(0.0, 0.0)),
    InitialSetting(call="GT_SetWaitPulse", values=(0.0, STANDBY_KHZ.high, 0.0)),
    InitialSetting(call="GT_SetPreVltg", values=(0.0, 0.0)),
)
"""The state of each laser when a job begins: what the job does not set is off."""
_RESUME = Phrase("continue with --resume")
_RESET_TRIES = 2
"""Number of attempts at a reset that the controller does not support."""
_PAUSE_S = 0.05
"""Interval between checks of laser and interlock during a pause."""


class Session(Struct, dict=True):
    """One run. `stream` is the whole job; `reached`: the run's position in it."""

    link: Link
    machine: Machine
    control: Control
    stream: Stream
    outputs: Outputs
    reached: PathPosition = JOB_START
    options: str = ""
    """The options that must be given again to resume this run."""
    abi_confirmed: bool = False
    """Whether the ABI of the library is confirmed: only then "off" means off."""
    was_moving: bool = False
    """The motion was in progress when the controller was opened."""
    is_off: bool = False
    """At the end: calls confirmed that every laser is off and nothing moves."""
    harmless_off: str = ""
    """What the off call did that was made before the ABI was confirmed; '' if none was made."""
    warnings: list[Diagnostic] = field(default_factory=list)
    supported: set[str] = field(default_factory=set)
    """The calls that reset a setting and were accepted."""
    marked_to: PathPosition = JOB_START
    """What earlier parts of the job's run may have marked ends here."""
    broken: PositionRange | None = None
    """Where the laser went off, in the whole job; None if that is not known, or it has not."""
    _part: Remainder | None = None
    _fifo: Fifo | None = None

    @cached_property
    def shutdown(self) -> Shutdown:
        """What switches everything off."""
        return Shutdown(self.link, self.outputs, self.machine.controller.link_patience_s)

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
        if self.shutdown.moving() is not False:
            self.was_moving = True
            self.link.journal.mark(moving=True)
            if faults := self.shutdown.stop(self.control, abrupt=True):
                raise BackendError(*faults)
        try:
            self.check_interlock(Phrase("start again"))
        except BackendError:
            self.link.journal.mark(cut=True)
            raise

    @property
    def off_ms(self) -> float:
        """Longest time for which the motion continued after the laser was switched off, until it was at rest."""
        return (self.shutdown.rest_s - self.shutdown.off_since_s) * MS_PER_S

    def prepare(self) -> None:
        """Load the configuration, clear the axes' status, enable the axes, set the lasers to their initial state."""
        if self.machine.controller.configuration:
            self.link.checked("GT_LoadConfig", os.fsencode(self.machine.controller.configuration))
        for axis in self.outputs.axes:
            self.link.checked("GT_ClrSts", float(axis), 1.0)
            self.link.checked("GT_AxisOn", float(axis))
        for channel in self.outputs.channels:
            for setting in INITIAL_SETTINGS:
                self._reset_setting(setting, channel)

    def _reset_setting(self, setting: InitialSetting, channel: int) -> None:
        """Reset what an earlier program may have set.

        A controller that does not support a setting has nothing to reset. If it says so, that is a warning, unless the
        job itself needs the setting; any other refusal leaves an unknown state in force.
        """
        name = setting.call
        is_there = name in self.link.library.functions
        code = NOT_SUPPORTED
        for _ in range(_RESET_TRIES if is_there else 0):
            code, _ = self.link.call(name, *setting.values, float(channel))
            if code != NOT_SUPPORTED:
                break
        if code == 0:
            self.supported.add(name)
        # A controller that supports it for one channel does so for the other.
        if code not in (0, NOT_SUPPORTED) or (code and (name in self.supported or self._uses(setting, channel))):
            raise call_failure(name, code, 0)
        if code:
            fields = {"call": name, "channel": channel}
            self.warnings.append(Diagnostic(rule=rules.NOT_RESET, span=NOWHERE, fields=fields))

    def _uses(self, setting: InitialSetting, channel: int) -> bool:
        """Return whether the job makes a call of a setting for a channel."""
        names = {setting.call, *setting.others}
        return any(call.name in names and call.args[-1] == channel for call in self.stream.calls)

    def finish(self) -> None:
        """Check that after the end of a job the laser is off and nothing moves."""
        self.ensure_laser_off()
        if faults := self.shutdown.confirm_rest():
            raise BackendError(*faults)
        self.is_off = True

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

    def switch_off_unconfirmed(self) -> None:
        """Try to confirm the ABI after all; if it can't be, make the off call that means "off" in every ABI.

        GT_SetHSIOOpt(0, 0) with a leading 0 or without is the same in all of them: it switches channel 0 off. For
        another card or channel a library of another ABI could take it for "on".
        """
        until = time.perf_counter() + self.machine.controller.link_patience_s
        while not self.abi_confirmed:
            try:
                self.link.probe()
                self.abi_confirmed = True
            except BackendError as error:
                if error.faults[0].rule is not rules.CALL_FAILED:
                    return  # It is of another ABI.
                if time.perf_counter() > until:
                    break
                time.sleep(_PAUSE_S)
        controller = self.machine.controller
        if not self.abi_confirmed and (self.link.library.abi is not Abi.GTS_MULTI or controller.card == 0):
            self.link.journal.mark(off=True)
            code = self.shutdown.try_call("GT_SetHSIOOpt", 0.0, 0.0)
            self.harmless_off = Phrase(
                "GT_SetHSIOOpt(0,0) returned {code} ({meaning})", code=code, meaning=meaning(code)[0]
            )

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
        self.reached, self.broken = part.begin, None
        self.shutdown.begin_part()
        to = max(part.begin, self.marked_to, key=lambda position: position.key)
        self.link.journal.mark(part=part.begin.row, run=part.begin.along_pulse, lead=part.lead_rows, to=[*to.key])
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
                if call.waits:
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
            # Calls may have been lost anywhere in the stage.
            lost = PositionRange(earliest=PathPosition(row=first), latest=PathPosition(row=fifo.stage.sent))
            self.note_broken(fifo.part.job_range(lost))
            fields = {"x": status.x, "y": status.y, "want_x": end_x, "want_y": end_y}
            raise failure(rules.WRONG_END_POSITION, int(fifo.calls.line[row]), **fields)

    def _on_status(self, stage: FifoStage) -> None:
        """Publish the status after every poll, and check the interlock."""
        assert self._part is not None
        self.reached = self._part.job_position(PathPosition(row=stage.taken))
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

    def halt(self, *, abrupt: bool, locate: bool = True, cut_outside: bool = False) -> list[Diagnostic]:
        """Switch the laser off, find out where that was, stop, switch the laser off.

        Args:
            abrupt: stop abruptly.
            locate: find out where the laser went off.
            cut_outside: something else may have cut laser and motion since the last poll that found no fault.

        Returns:
            What could not be turned off.
        """
        shutdown, self.is_off = self.shutdown, False
        if cut_outside:
            self.link.journal.mark(cut=True)
        # If the laser can't be switched off at the first try, the motion must stop at once.
        still_on = shutdown.laser_off(retry=False)
        self._publish(Phase.STOPPING)
        self._note_unstarted()
        try:
            if locate and not still_on:
                self._locate(time.perf_counter, cut_outside=cut_outside)
        finally:
            faults = shutdown.stop(self.control, abrupt=abrupt or bool(still_on))
        if locate and not faults:
            self._locate(lambda: shutdown.rest_s, cut_outside=cut_outside)
        if locate:
            self._extend_to_rest(is_at_rest=not faults)
        faults = shutdown.laser_off() + faults
        if faults:
            shutdown.reset()
            faults += [fault for fault in shutdown.laser_off() if fault not in faults]
        self.is_off = not faults
        return faults

    def _locate(self, until_s: Callable[[], float], *, cut_outside: bool) -> None:
        """Find where on the path the laser went off, if that is not known yet: the rest begins there.

        Args:
            until_s: gives the time (time.perf_counter) until which the motion may have continued to the position that
                is read.
            cut_outside: see halt.
        """
        fifo, part = self._fifo, self._part
        if self.broken is not None or part is None or fifo is None or fifo.stage is None:
            return
        try:
            found = self._located(fifo.stage, fifo.calls, part, until_s, cut_outside=cut_outside)
        except BackendError:
            return
        if found is not None:
            self.note_broken(part.job_range(found))

    def _note_unstarted(self) -> None:
        """Record where the laser went off if the present stage was not started, which needs no call."""
        fifo, part = self._fifo, self._part
        if self.broken is not None or part is None:
            return
        stage = fifo.stage if fifo else None
        if stage is None or not stage.may_run:
            self.note_broken(part.job_range(PositionRange.exactly(PathPosition(row=stage.first if stage else 0))))

    def _located(
        self,
        stage: FifoStage,
        calls: BufferedCalls,
        part: Remainder,
        until_s: Callable[[], float],
        *,
        cut_outside: bool,
    ) -> PositionRange | None:
        """Return where the laser went off in the stream that is run; None if the head is not on its path.

        Free slots and position are read one after the other, and the motion continues in between: all rows that may
        have been in progress are considered.

        Raises:
            BackendError: the controller does not answer.
        """
        path = TimedPath.of(calls, part.start_pulse)
        before, good = stage.taken, stage.good
        off_s = self.shutdown.off_since_s
        if cut_outside:
            before, off_s = (good.taken, good.began_s) if good else (stage.first, stage.start_s)
        x, y = self.position(stage.crd)
        late_ms = (until_s() - off_s) * MS_PER_S
        (space,) = self.link.checked("GT_CrdSpace", float(stage.crd), 0.0, float(stage.fifo))
        # A buffered call that was not answered may have been taken.
        taken = max(stage.sent - (stage.size - int(space)), stage.first)
        found = path.locate(min(before, taken), min(taken + 1, len(calls)), x, y, sent=stage.sent + 1)
        if found is None:
            return None
        polled = path.earliest_at(good.taken, good.x, good.y) if good else JOB_START
        begin = PathPosition(row=stage.first)
        rewound = path.rewind(found.earliest, late_ms, stage.first)
        return PositionRange(earliest=rewound, latest=found.latest).not_before(polled).not_before(begin)

    def note_end(self) -> None:
        """Record that the whole job was done, although the run failed after it."""
        if self._part is not None:
            self.note_broken(PositionRange.exactly(PathPosition(row=len(self.stream.buffered))))

    def _extend_to_rest(self, *, is_at_rest: bool) -> None:
        """Extend where the laser went off to the rest position, if a call before it switches the laser on.

        The shutdown switches the laser off again, but it may emit for a short time. Without a rest position, the end of
        what was sent is the limit.
        """
        fifo, part, broken = self._fifo, self._part, self.broken
        if fifo is None or fifo.stage is None or part is None or broken is None or not fifo.stage.may_run:
            return
        found = None
        if is_at_rest:
            with suppress(BackendError):
                off_since_s = self.shutdown.off_since_s
                found = self._located(fifo.stage, fifo.calls, part, lambda: off_since_s, cut_outside=False)
        sent = part.job_position(PathPosition(row=fifo.stage.sent))
        rest = sent if found is None else part.job_range(found).latest
        kinds = self.stream.buffered.kind[broken.earliest.row : rest.row + 1]
        if rest.key > broken.latest.key and (kinds == Buffered.ON).any():
            self.note_broken(replace(broken, latest=rest))

    def note_broken(self, found: PositionRange) -> None:
        """Record where the laser went off."""
        found = found.until(self.marked_to)
        self.broken, self.reached, self.marked_to = found, found.earliest, found.latest
        (row, along), (to_row, to_along) = found.earliest.key, found.latest.key
        self.link.journal.mark(broken=row, run=along, to=[to_row, to_along], line=self.line)

    def _pause(self) -> Remainder:
        """Wait, laser off and at rest, until the user continues; return the rest from where the laser went off."""
        faults, stage = self.halt(abrupt=False), self._fifo.stage if self._fifo else None
        if faults:
            raise BackendError(*faults)
        if self.broken is None:
            raise failure(rules.POSITION_UNKNOWN, 0, why=Phrase("the head is not on the path"), calls=0)
        twice_mm = doubling_mm(self.stream, self.broken, self.machine)
        self.control.status = replace(self.control.status, doubling_mm=twice_mm)
        while self.control.pause and not self.control.stop:
            self._publish(Phase.PAUSED)
            self.control.sleep(_PAUSE_S)
            self.check_interlock(_RESUME)
            self.ensure_laser_off()
        self.control.status = replace(self.control.status, doubling_mm=0.0)
        if self.control.stop:
            raise Interrupted
        begin = before_laser_on(self.stream, self.broken.earliest)
        return remainder_from(self.stream, begin, self.position(stage.crd) if stage else None)
