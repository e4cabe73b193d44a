"""What every driver must do, whatever its controller: checks that take a driver with a device of the tests.

A driver is tested through Driver: it makes its device new, runs a job, has trouble planted in the middle of a run, and
says what the device did and in which state it is. The checks know no call and no packet of any controller.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Protocol

import numpy as np
from oracles.coverage import Floats
from support.promises import Attempt, is_stuck, judged

from gusjob.config.machine import Machine
from gusjob.controllers.control import Control, Phase
from gusjob.hardware.outcome import Ending
from gusjob.simulate import Trace

JOB = """LASER MODE DUTY CARRIER 10
LASER DELAY ON 50us OFF 60us
VEL 300
ACC 100000
LASER POWER 40
JUMP X -3 Y -3
LASER ON
LINE X 4 Y -3
LINE X 4 Y -1
LASER POWER 65
REPEAT 24 AS i
LINE X (4 - i % 2 - i / 8) Y (i / 8 - 0.9)
END
DWELL 3
LINE X 0.5 Y 2.4
LASER OFF
JUMP X -4 Y 3
LASER POWER 30
LASER ON
ARC CCW X -2 Y 4 R 1.5
LASER FOLLOW MIN 5 MAX 60 AT 250
LINE X 3 Y 4.5
LINE X 3.5 Y 0
LASER OFF
JUMP X 0 Y 0
"""
"""One laser, 0.2 s. No two calls of a kind have the same target, and the path turns where the laser is switched."""


class Trouble(StrEnum):
    """What goes wrong in the middle of a run."""

    REFUSED_ONCE = "refused once"
    """The device refuses one motion, with an error that is not about its buffer."""
    REFUSED = "refused"
    """It refuses every motion from then on."""
    LINK_LOST = "link lost"
    """The link does not answer for a moment."""
    LINK_GONE = "link gone"
    """The link does not answer from then on."""
    HANG = "hang"
    """A call or transfer does not return for longer than the machine's patience."""
    STOPPED = "stopped from outside"
    """All motion stops, as by an emergency stop."""
    DRY = "buffer dry"
    """The buffer runs empty while there is more to send."""
    INTERLOCK = "interlock"
    """The machine's interlock opens."""


class Request(StrEnum):
    """What the user requests in the middle of a run."""

    STOP = "stop"
    STOP_ABRUPTLY = "stop abruptly"
    PAUSE = "pause"


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceState:
    """The state of light and motion."""

    emits: bool
    is_switched_on: bool
    moves: bool

    @property
    def is_off(self) -> bool:
        return not (self.emits or self.is_switched_on or self.moves)


@dataclass(frozen=True, slots=True, kw_only=True)
class Execution:
    """What the device executed since it was new, one entry for each motion or dwell.

    `end_mm` (n, 2): where it ended; `length_mm`, `duration_ms`, `emission_ms`, `power_min`, `power_max` (n,): its light
    with the laser's delays, and its power in the unit of the mode, NaN without light.
    """

    end_mm: Floats
    length_mm: Floats
    duration_ms: Floats
    emission_ms: Floats
    power_min: Floats
    power_max: Floats


class Driver(Protocol):
    """A driver with a device of the tests."""

    def renew(self) -> None:
        """Make the device new: at rest, dark, at the origin, without trouble; its logs are empty.

        It runs in real time.
        """

    @property
    def machine(self) -> Machine:
        """The machine profile, with short patience and an interlock."""

    def simulate(self, job: str) -> Trace:
        """Compile a job for the controller and simulate it."""

    def run(
        self,
        job: str,
        *,
        resume: Path | None = None,
        control: Control | None = None,
        tick: Callable[[], None] | None = None,
    ) -> Attempt:
        """Run a job, or continue the run of a journal. `tick` is called often, in this thread."""

    def plant(self, trouble: Trouble) -> None:
        """Let it come in the middle of the next run of JOB."""

    def repair(self) -> None:
        """End all trouble."""

    def state(self) -> DeviceState:
        """Return the present state."""

    def execution(self) -> Execution:
        """Return what was executed."""

    def lits(self) -> Floats:
        """Return the lit stretches; columns are support.device_log.Lit."""


# The simulator and the device, side by side.


def check_same_as_simulated(driver: Driver, job: str = JOB) -> None:
    """The device executes what the simulator computes: segments, times, light and power of each."""
    driver.renew()
    trace = driver.simulate(job)
    ran = driver.run(job)
    assert ran.ending is Ending.DONE, ran
    assert driver.state().is_off
    found, period_ms = driver.execution(), trace.period_ms
    segments, (per_x, per_y) = trace.segments, driver.machine.pulses_per_mm
    assert len(found.end_mm) == len(trace)
    ends = np.column_stack([segments.x1 / per_x, segments.y1 / per_y])
    _assert_near(found.end_mm, ends, 1.0 / min(per_x, per_y), "ends, mm")
    if per_x == per_y:
        _assert_near(found.length_mm, segments.length / per_x, 1.0 / per_x, "lengths, mm")
    _assert_near(found.duration_ms, trace.schedule.duration_ms, period_ms / 10, "durations, ms")
    (laser,) = (channel for channel in trace.channels if channel.emitted.emission_ms.any())
    _assert_near(found.emission_ms, laser.emitted.emission_ms, period_ms / 10, "emission, ms")
    for name, own, wanted in (
        ("lowest power", found.power_min, laser.emitted.power_min),
        ("highest power", found.power_max, laser.emitted.power_max),
    ):
        assert np.isnan(own).tolist() == np.isnan(wanted).tolist(), name
        _assert_near(np.nan_to_num(own), np.nan_to_num(wanted), 0.01 * float(np.nanmax(wanted)), name)


def _assert_near(found: Floats, wanted: Floats, tolerance: float, what: str) -> None:
    off = np.abs(found - wanted)
    assert off.max(initial=0.0) <= tolerance, f"{what}: {found[off > tolerance]} instead of {wanted[off > tolerance]}"


# Trouble and requests.


def check_trouble(driver: Driver, trouble: Trouble, job: str = JOB) -> None:
    """Whatever happens, the laser goes off and the motion stops, and no message says so if it is not so.

    When the trouble is over the run is resumed: nothing is left out, and no more is marked twice than was announced.
    """
    expected = _expected(driver, job)
    driver.renew()
    driver.plant(trouble)
    first = driver.run(job)
    _check_claims(driver, first)
    if trouble is Trouble.LINK_GONE:
        assert not first.claims_off, f"nothing could be switched, but: {first}"
    elif trouble is Trouble.REFUSED_ONCE and first.is_done:  # It sent the motion again.
        pass
    else:
        assert first.ending is Ending.FAILED, first
        assert first.claims_off, first
        assert first.reasons, first
    driver.repair()
    _resume_until_whole(driver, job, expected, [first])


def check_request(driver: Driver, request: Request, job: str = JOB) -> None:
    """A stopped run is off and can be resumed; a paused one is off until it continues."""
    expected = _expected(driver, job)
    driver.renew()
    control, middle = Control(), len(driver.simulate(job)) // 2
    rows, is_requested, seen_paused, announced_mm = [0], [False], list[DeviceState](), [0.0]

    def tick() -> None:
        status = control.status
        rows[0] = max(rows[0], status.row)
        if not is_requested[0] and status.phase is Phase.RUNNING and status.row >= middle:
            is_requested[0] = True
            if request is Request.PAUSE:
                control.toggle_pause()
            else:
                control.request_stop("the test", abrupt=request is Request.STOP_ABRUPTLY)
        elif request is Request.PAUSE and status.phase is Phase.PAUSED:
            seen_paused.append(driver.state())
            announced_mm.append(status.doubling_mm)
            if len(seen_paused) == 3:
                control.toggle_pause()

    first = driver.run(job, control=control, tick=tick)
    assert is_requested[0], f"the run was over before row {middle}, it was seen at {rows[0]}"
    _check_claims(driver, first)
    if request is Request.PAUSE:
        assert first.is_done, first
        assert len(seen_paused) >= 3
        assert all(state.is_off for state in seen_paused), seen_paused
        # What continuing doubles is announced during the pause.
        assert judged(expected, driver.lits(), [replace(first, announced_mm=announced_mm[-1])]).wrong == ()
    else:
        assert first.ending is Ending.FAILED, first
        assert first.claims_off, first
        _resume_until_whole(driver, job, expected, [first])


def check_it_begins_dark(driver: Driver, job: str = JOB) -> None:
    """A job that is done leaves nothing on, and a second run of it does the same as the first."""
    expected = _expected(driver, job)
    driver.renew()
    first = driver.run(job)
    mark = len(driver.lits())
    second = driver.run(job)
    assert (first.ending, second.ending) == (Ending.DONE, Ending.DONE)
    assert driver.state().is_off
    assert judged(expected, driver.lits()[:mark], [first]).wrong == ()
    assert judged(expected, driver.lits()[mark:], [second]).wrong == ()


def _expected(driver: Driver, job: str) -> Floats:
    """Return the lit stretches of a run without trouble."""
    driver.renew()
    ran = driver.run(job)
    assert ran.is_done, ran
    return driver.lits()


def _check_claims(driver: Driver, ran: Attempt) -> None:
    assert not ran.error, ran.error
    assert not ran.false_claim, ran.false_claim
    assert not ran.claims_off or driver.state().is_off, f"{ran}, but {driver.state()}"


def _resume_until_whole(driver: Driver, job: str, expected: Floats, attempts: list[Attempt]) -> None:
    while not attempts[-1].is_done and not is_stuck(attempts):
        journal = next(one.journal for one in reversed(attempts) if one.journal is not None)
        attempts.append(driver.run(job, resume=journal))
        _check_claims(driver, attempts[-1])
    verdict = judged(expected, driver.lits(), attempts)
    assert (verdict.wrong, verdict.over) == ((), ()), [str(one) for one in attempts]
    assert driver.state().is_off
