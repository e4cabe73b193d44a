"""The driver of the vendor's library conforms, with each of its ABIs."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from oracles.coverage import Floats
from support import conformance
from support.conformance import DeviceState, Driver, Execution, Request, Trouble
from support.controller import GTS, GTS_MULTI, GUS, Fault, Row, needs_controller
from support.hardware import ABIS, Bench
from support.promises import Attempt
from support.resuming import attempt, recorded_of
from support.tools import stream_of

from gusjob.config.machine import Interlock, Machine
from gusjob.controllers.control import Control
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.driver import fifo
from gusjob.controllers.gus.model import simulate_stream
from gusjob.hardware.guard import start as guard_start
from gusjob.hardware.progress import report_to
from gusjob.hardware.request import RunOptions, RunRequest
from gusjob.simulate import Trace

pytestmark = [needs_controller, pytest.mark.slow]

MACHINE = Machine()
HANG_S = 0.6
FAULTS: dict[Trouble, dict[str, object]] = {
    Trouble.REFUSED_ONCE: {"what": Fault.RETURN, "name": "GT_LnXY", "nth": 20, "value": 7},
    Trouble.REFUSED: {"what": Fault.RETURN, "name": "GT_LnXY", "nth": 20, "count": -1, "value": 7},
    Trouble.LINK_LOST: {"what": Fault.RETURN, "nth": 80, "count": 3, "value": -7},
    Trouble.LINK_GONE: {"what": Fault.RETURN, "nth": 80, "count": -1, "value": -7},
    Trouble.HANG: {"what": Fault.HANG, "name": "GT_CrdStatus", "nth": 10, "value": HANG_S},
    Trouble.STOPPED: {"what": Fault.HALT, "name": "GT_CrdSpace", "nth": 10},
    Trouble.DRY: {"what": Fault.DRY, "name": "GT_CrdSpace", "nth": 4},
    Trouble.INTERLOCK: {"what": Fault.DI, "name": "GT_GetDi", "nth": 10, "value": 0},
}
_numbers = itertools.count()


@cache
def compiled(job: str) -> tuple[Stream, Trace]:
    """The calls of a job, and their simulation."""
    stream = stream_of(job, MACHINE)
    trace, _ = simulate_stream(stream, MACHINE)
    assert trace is not None
    return stream, trace


@dataclass(frozen=True, slots=True)
class GusDriver:
    """The driver under test on a virtual controller."""

    bench: Bench
    folder: Path

    @property
    def machine(self) -> Machine:
        settings = {"call_timeout_s": 0.25, "link_patience_s": 0.1, "interlock": Interlock(di_type=4, input=0, value=1)}
        return self.bench.machine(MACHINE, **settings)

    def renew(self) -> None:
        self.bench.controller.reset()
        self.bench.controller.options(speed=1, slots=16, di=1)

    def simulate(self, job: str) -> Trace:
        return compiled(job)[1]

    def run(
        self,
        job: str,
        *,
        resume: Path | None = None,
        control: Control | None = None,
        tick: Callable[[], None] | None = None,
    ) -> Attempt:
        stream, trace = compiled(job)
        recorded = None if resume is None else recorded_of(resume)
        assert not isinstance(recorded, str), recorded
        journal = self.folder / f"{next(_numbers)}.journal"
        options = RunOptions(
            library=str(self.bench.path), abi=ABIS[self.bench.abi], journal=journal, resume=recorded
        )  # fmt: skip
        request = RunRequest(
            path=self.folder / "conformance.job", stream=stream, trace=trace, machine=self.machine, options=options
        )
        watch = None if tick is None else report_to(lambda _: tick(), every_s=0.0)
        return attempt(request, self.bench.controller, control=control, watch=watch)[0]

    def plant(self, trouble: Trouble) -> None:
        fault = FAULTS[trouble]
        self.bench.controller.fault(**fault)  # type: ignore[arg-type]

    def repair(self) -> None:
        self.bench.controller.clear_faults()
        self.bench.controller.options(di=1)

    def state(self) -> DeviceState:
        state = self.bench.controller.state()
        return DeviceState(emits=any(state.emitting), is_switched_on=any(state.switched_on), moves=state.moving != 0)

    def execution(self) -> Execution:
        rows, per_mm = self.bench.controller.rows(), np.array(MACHINE.pulses_per_mm)
        return Execution(
            end_mm=rows[:, [Row.X1, Row.Y1]] / per_mm,
            length_mm=rows[:, Row.LENGTH] / per_mm[0],
            duration_ms=rows[:, Row.DURATION_MS],
            emission_ms=rows[:, Row.EMISSION0_MS],
            power_min=rows[:, Row.POWER0_MIN],
            power_max=rows[:, Row.POWER0_MAX],
        )

    def lits(self) -> Floats:
        return self.bench.controller.lits()


@pytest.fixture(params=[GUS, GTS, GTS_MULTI], ids=["gus", "gts", "gts-multi"])
def driver(
    request: pytest.FixtureRequest, benches: dict[int, Bench], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Driver]:
    """The driver with each ABI, polling often."""
    monkeypatch.setattr(fifo, "POLL_S", 0.004)
    monkeypatch.setattr(guard_start, "_can_start", lambda: False)
    bench = benches[request.param]
    yield GusDriver(bench, tmp_path)
    bench.controller.release()
    bench.controller.reset()


def test_it_runs_what_is_simulated(driver: Driver) -> None:
    conformance.check_same_as_simulated(driver)


def test_it_begins_and_ends_dark(driver: Driver) -> None:
    conformance.check_it_begins_dark(driver)


@pytest.mark.parametrize("trouble", Trouble)
def test_it_survives_trouble(driver: Driver, trouble: Trouble) -> None:
    conformance.check_trouble(driver, trouble)


@pytest.mark.parametrize("requested", Request)
def test_it_stops_and_pauses(driver: Driver, requested: Request) -> None:
    conformance.check_request(driver, requested)
