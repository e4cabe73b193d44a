"""Runs on the virtual controller, which the backend can't tell from a real one: what it received, what it did, and how
every way out leaves it."""

from __future__ import annotations

import ctypes
import re
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.controller import CC, GTS, GTS_MULTI, GUS, Fault, Row, needs_controller
from support.hardware import EVERYTHING, Bench, bench, goes_on, light_off_at
from support.tools import MARK, ROOT, stream_in, stream_of

from gusjob.config.machine import Abi, Interlock, Machine
from gusjob.controllers.control import Control, Phase
from gusjob.controllers.gus.calls import CRD_FIELDS, HOST_CALLS, SIGNATURES, Stream
from gusjob.controllers.gus.driver import fifo
from gusjob.controllers.gus.driver.abi import TCrdPrm, prototypes
from gusjob.controllers.gus.driver.library import load_library
from gusjob.controllers.gus.driver.session import needed_calls
from gusjob.controllers.gus.dry import frame, without_laser
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.journal import Journal
from gusjob.pipeline import examine_file

pytestmark = needs_controller

JOBS = [path for path in sorted((ROOT / "jobs").rglob("*.job")) if "shared" not in path.parts]
CODES = (1, 2, 3, 7, 8, -1, -6, -7, -8)
HOST = {*HOST_CALLS, "GT_CrdStatus"}
POLLS = ("GT_CrdStatus", "GT_CrdSpace", "GT_GetCrdPos")
BEGIN = (
    "GT_SetLaserDisMode(0,0,{0,0,0,0},{1,1,1,1}", "GT_DisFPK(", "GT_SetLevelDelay(0,0,", "GT_SetWaitPulse(0,",
    "GT_SetPreVltg(0,0,",
)  # fmt: skip
"""What makes the lasers as a job takes them for granted."""


@pytest.fixture(scope="module")
def benches(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Bench]:
    folder = tmp_path_factory.mktemp("controllers")
    return {abi: bench(folder, abi) for abi in (GUS, GTS, GTS_MULTI)}


@pytest.fixture
def gus(benches: dict[int, Bench], monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    """A GUS in virtual time, asked often in real time and seldom in its own, so that tests are short."""
    monkeypatch.setattr(fifo, "POLL_S", 0.0005)
    made = benches[GUS]
    fresh(made)
    yield made
    made.controller.reset()


def fresh(made: Bench, **options: float) -> None:
    """Switched off and on again."""
    made.controller.reset()
    made.controller.options(poll_us=40_000, call_us=5, **options)


def plain(call: str) -> str:
    """A call with its numbers in one form, -0 as 0."""
    return re.sub(r"(?<![A-Za-z_])-?\d[\d.]*(e[+-]?\d+)?", lambda m: repr(float(m[0]) + 0.0), call)


def job_calls(calls: list[tuple[int, str]]) -> list[str]:
    """The calls of the job among those that were made and taken; but for those that only turn the light off."""
    # Before the axes are on the controller is set up, and behind that the lasers are as a job takes them for granted.
    began = max((i for i, (_, call) in enumerate(calls) if call.startswith("GT_AxisOn")), default=0)
    began += 1 + sum(call.startswith(BEGIN) for _, call in calls[began : began + 11])
    mine = [call for code, call in calls[began:] if code == 0 and call.partition("(")[0] not in HOST]
    return [plain(call) for call in mine if not call.startswith(("GT_SetHSIOOpt(0", "GT_CrdStart"))]


def of_file(path: Path) -> tuple[Stream, Machine]:
    loaded = examine_file(path, None)
    stream = stream_in(loaded)
    assert stream is not None, loaded.diagnostics
    return stream, loaded.machine


# What is sent, and what comes of it.


@pytest.mark.parametrize("path", JOBS, ids=lambda p: p.stem)
def test_a_job_is_received_and_done_as_compiled_and_interpreted(gus: Bench, path: Path) -> None:
    stream, machine = of_file(path)
    ran = gus.run(stream, gus.machine(machine))
    assert ran.faults == []
    wanted = [plain(line) for line in "".join(listing(stream)).splitlines()]
    wanted = [c for c in wanted if not c.startswith(("GT_CrdStart", "GT_CrdStatus", "GT_SetHSIOOpt(0"))]
    assert job_calls(gus.controller.calls()) == wanted
    trace, _ = simulate_stream(stream, machine)
    assert trace is not None
    rows, period_ms = gus.controller.rows(), machine.period_us / 1000
    assert len(rows) == len(trace)
    if not len(rows):
        return
    assert np.abs(rows[:, Row.START_MS] - trace.schedule.times_ms[:-1]).max() < period_ms / 1000
    assert np.abs(rows[:, Row.DURATION_MS] - trace.schedule.duration_ms).max() < period_ms / 1000
    assert np.abs(rows[:, Row.X1] - trace.segments.x1).max() < 1e-6
    assert np.abs(rows[:, Row.Y1] - trace.segments.y1).max() < 1e-6
    for channel in trace.channels:
        lit_ms = rows[:, Row.EMISSION0_MS + channel.channel]
        energy = rows[:, Row.POWER0_MS + channel.channel]
        assert np.abs(lit_ms - channel.emitted.emission_ms).max() < period_ms / 1000
        assert energy == pytest.approx(channel.emitted.power_ms, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("abi", [GUS, GTS, GTS_MULTI])
@pytest.mark.parametrize(("slots", "counts_all", "freed_early"), [(4096, 1, 0), (7, 1, 0), (7, 0, 1), (4096, 0, 1)])
def test_every_abi_and_fifo(
    benches: dict[int, Bench], monkeypatch: pytest.MonkeyPatch, abi: int, slots: int, counts_all: int, freed_early: int
) -> None:
    monkeypatch.setattr(fifo, "POLL_S", 0.0005)
    made, stream = benches[abi], stream_of(EVERYTHING)
    fresh(made, slots=slots, segment_counts_all=counts_all, slot_freed_at_start=freed_early)
    made.controller.option("poll_us", 5_000)
    assert made.run(stream, made.machine(Machine())).faults == []
    received = job_calls(made.controller.calls())
    wanted = [plain(line) for line in "".join(listing(stream)).splitlines()]
    if abi != GUS:  # Their own spelling of the manual's calls.
        wanted = [c.replace("GT_BufLaserPrfFollow", "GT_BufLaserFollowRatio") for c in wanted]
        wanted = [re.sub(r"^(GT_LaserPowerMode\(.*)\)$", r"\1,0.0)", c) for c in wanted]
    assert received == [c for c in wanted if not c.startswith(("GT_CrdSta", "GT_SetHSIOOpt(0"))]
    state = made.controller.state()
    assert (state.x, state.y, state.queued, state.open) == (1000, 2000, 0, False)


def test_buffered_calls_are_sent_once_and_in_order_over_a_full_fifo(gus: Bench) -> None:
    stream = stream_of(MARK + "LASER POWER 30\nLASER ON\nREPEAT 600 AS i\nLINE X (i % 7) Y (i % 2)\nEND\nLASER OFF\n")
    fresh(gus, slots=64)
    gus.controller.option("poll_us", 8_000)
    assert gus.run(stream, gus.machine(Machine())).faults == []
    refused = [call for code, call in gus.controller.calls() if code == 1]
    assert refused == []  # GT_CrdSpace tells how many are taken.
    wanted = [plain(c) for c in "".join(listing(stream)).splitlines() if c.startswith("GT_LnXY")]
    assert [c for c in job_calls(gus.controller.calls()) if c.startswith("GT_LnXY")] == wanted


@pytest.mark.parametrize("code", [1])
def test_a_call_refused_as_if_the_fifo_were_full_is_sent_again(gus: Bench, code: int) -> None:
    stream = stream_of(EVERYTHING)
    buffered = [name for name in SIGNATURES if SIGNATURES[name].buffered is not None]
    for name in buffered:
        for nth in (1, 2, 3):
            fresh(gus)
            gus.controller.fault(Fault.RETURN, name, nth, 2, code)
            assert gus.run(stream, gus.machine(Machine())).faults == []
            wanted = [plain(c) for c in "".join(listing(stream)).splitlines()]
            wanted = [c for c in wanted if not c.startswith(("GT_CrdSta", "GT_SetHSIOOpt(0"))]
            assert job_calls(gus.controller.calls()) == wanted, (name, nth)


# The fault matrix.


def is_safe(made: Bench) -> bool:
    """Dark and at rest, as the controller has it."""
    state = made.controller.state()
    return not any(state.emitting) and not any(state.switched_on) and state.moving == 0


def test_fault_matrix_each_call_and_each_code(gus: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    """Each call of a job fails once with each code; then the run is gone on with, and the path is whole."""
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine())
    assert gus.run(stream, machine).faults == []
    whole, names = gus.controller.rows(), gus.controller.names()
    cases = failed = 0
    for nth, name in enumerate(names, 1):
        # One poll is like another: the first few with every code, the others with two.
        for code in CODES if name not in POLLS or names[:nth].count(name) <= 4 else (1, -7):
            for what in (Fault.RETURN, Fault.AFTER) if code == -7 else (Fault.RETURN,):
                fresh(gus)
                gus.controller.fault(what, nth=nth, value=code)
                ran, case = gus.run(stream, machine), f"{what.name} {code} at call {nth}, {name}"
                cases += 1
                assert is_safe(gus), case
                if not ran.faults:
                    rows = gus.controller.rows()
                    assert rows[:, : Row.POWER1_MS] == pytest.approx(whole[:, : Row.POWER1_MS]), case
                    continue
                failed += 1
                assert {fault.rule.code for fault in ran.faults} <= {"GJ903", "GJ904"}, case
                # Looks come by time: the call may be another one than in the run without faults.
                really = gus.controller.names()[nth - 1]
                assert any(really in fault.message for fault in ran.faults), (case, really)
                assert all(1 <= fault.span.line <= len(EVERYTHING.splitlines()) for fault in ran.faults), case
                done = gus.controller.rows()
                broken = light_off_at(done, gus.controller.edges())
                again, place = gus.resumed(stream, machine, ran.journal)
                assert again.faults == [], (case, again.faults)
                assert is_safe(gus), case
                assert place is not None
                if place.row < len(stream.buffered):
                    assert not isinstance(goes_on(whole, gus.controller.rows()[len(done) :], broken), str), case
    with capsys.disabled():
        print(
            f"\nfault matrix: {cases} cases, {failed} failed safely and were gone on with, {cases - failed} did no harm"
        )
    assert cases > 800


def test_fault_matrix_link_lost(gus: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    """The link dies at each point: for a while, then the light goes off as soon as it is back; or for ever."""
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine(), link_patience_s=0.08)
    assert gus.run(stream, machine).faults == []
    names, cases = gus.controller.names(), 0
    for nth in range(3, len(names) + 1):
        for count in (3, -1) if nth % 8 == 0 else (3,):
            fresh(gus)
            gus.controller.fault(Fault.RETURN, nth=nth, count=count, value=-7)
            cases += 1
            ran, case = gus.run(stream, machine), f"{count} calls from {nth}, {names[nth - 1]}"
            said, made = " ".join(fault.message for fault in ran.faults), gus.controller.names()
            if count > 0:
                assert is_safe(gus), case
                assert "MAY BE ON" not in said, case
            elif len(made) < nth or made[nth - 1] == "GT_Close":
                assert is_safe(gus), case  # Looks come by time: this run was done with fewer, or with its last call.
            else:
                # Nothing can be switched any more: that is said, first of all.
                assert ran.codes[0] == "GJ912", case
                assert "THE LIGHT OF CHANNEL 0 MAY BE ON" in said, case
                assert "emergency stop" in said, case
            assert "cable" in said or not ran.faults, case
    with capsys.disabled():
        print(f"\nlink lost: {cases} cases")


def test_fault_matrix_hang(gus: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    """Each call hangs: another thread turns the light off, and the hung one makes no call any more."""
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine(), call_timeout_s=0.03)
    assert gus.run(stream, machine).faults == []
    names = gus.controller.names()
    for nth in range(1, len(names) + 1):
        if names[nth - 1] in ("GT_Open", "GT_Close"):
            continue  # Ten times as long.
        fresh(gus)
        gus.controller.fault(Fault.HANG, nth=nth)
        ran = gus.run(stream, machine)
        case = f"call {nth}, {names[nth - 1]}"
        if not ran.faults and len(gus.controller.calls()) < nth:
            continue  # Looks come by time: this run was done with fewer.
        assert "GJ905" in ran.codes, case
        assert re.search(r"(GT_\w+|a buffered call) has not returned", " ".join(f.message for f in ran.faults)), case
        if nth > 2:  # Before, nobody knows what the library is, and nothing was switched on.
            assert is_safe(gus), case
        made = len(gus.controller.calls())
        gus.controller.release()
        time.sleep(0.002)
        assert len(gus.controller.calls()) <= made + 1, case
    with capsys.disabled():
        print(f"\nhang: {len(names) - 2} cases")


@pytest.mark.parametrize(("what", "codes"), [(Fault.HALT, {"GJ907"}), (Fault.DRY, {"GJ906", "GJ907"})])
def test_fault_matrix_motion_stopped_by_something_else(gus: Bench, what: Fault, codes: set[str]) -> None:
    """An emergency stop at each point, and a FIFO that ran dry: noticed, dark, and gone on with."""
    text = MARK + "LASER POWER 40\nLASER ON\nREPEAT 40 AS i\nLINE X (i % 2) Y (i / 10)\nEND\nLASER OFF\n"
    stream, machine = stream_of(text), gus.machine(Machine())
    fresh(gus, slots=16)
    gus.controller.option("poll_us", 5_000)
    assert gus.run(stream, machine).faults == []
    whole, calls, noticed = gus.controller.rows(), len(gus.controller.calls()), 0
    for nth in range(1, calls + 1, 11):
        fresh(gus, slots=16)
        gus.controller.option("poll_us", 5_000)
        gus.controller.fault(what, nth=nth)
        ran = gus.run(stream, machine)
        assert is_safe(gus), nth
        if not ran.faults:
            continue
        assert set(ran.codes) <= codes, (nth, ran.faults)
        noticed += 1
        done = gus.controller.rows()
        broken = light_off_at(done, gus.controller.edges()[:0])
        again, _ = gus.resumed(stream, machine, ran.journal)
        assert again.faults == [], nth
        found = goes_on(whole, gus.controller.rows()[len(done) :], broken)
        assert not isinstance(found, str), (nth, found)
    assert noticed > 20


def test_light_that_can_not_be_switched_off_is_said(gus: Bench) -> None:
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine())
    gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 3, -1, 7)
    gus.controller.fault(Fault.RETURN, "GT_BufDelay", 1, -1, 7)
    ran = gus.run(stream, machine)
    assert ran.codes[0] == "GJ912"
    names = gus.controller.names()
    # Without power, and in the end reset: then it is dark all the same.
    assert names.index("GT_LaserPrfCmd", names.index("GT_BufDelay")) < names.index("GT_Reset")
    assert not any(gus.controller.state().emitting)


def test_a_wrong_end_is_seen(gus: Bench) -> None:
    gus.controller.option("pos_error", 50)
    ran = gus.run(stream_of(MARK + "LINE X 5\n"), gus.machine(Machine()))
    assert ran.codes == ["GJ909"]
    assert "X 5050" in ran.faults[0].message


@pytest.mark.parametrize(("option", "code"), [("deaf", "GJ908"), ("stuck", "GJ908")])
def test_motion_that_does_not_go_on(gus: Bench, monkeypatch: pytest.MonkeyPatch, option: str, code: str) -> None:
    monkeypatch.setattr(fifo, "START_S", 0.05)
    monkeypatch.setattr(fifo, "STILL_S", 0.05)
    gus.controller.option(option, 1)
    ran = gus.run(stream_of(MARK + "LASER POWER 20\nLASER ON\nLINE X 5\nLASER OFF\n"), gus.machine(Machine()))
    assert code in ran.codes
    assert not any(gus.controller.state().emitting)


# The library.


def test_prototypes_are_those_of_the_vendors_header() -> None:
    header = (ROOT / "tests" / "vendor" / "gts.h").read_text(encoding="ascii")
    found = dict(re.findall(r"^short (GT_\w+)\(([^;]*)\);", re.sub(r"\s+", " ", header).replace("; ", ";\n"), re.M))

    def types(arguments: str) -> list[str]:
        return (
            []
            if arguments == "void"
            else [re.sub(r"(\*?)\s*\w+$", r"\1", a.strip()).replace(" ", "") for a in arguments.split(",")]
        )

    for name, arguments in found.items():
        signature = (SIGNATURES | HOST_CALLS)[name]
        ours = signature.prototype.partition("(")[2][:-1]
        assert types(ours) == types(arguments), name
    assert found.keys() >= SIGNATURES.keys()


def test_the_parameters_are_laid_out_as_the_compiler_does(tmp_path: Path) -> None:
    """offsetof and sizeof by the C compiler, through a library of its own."""
    import subprocess

    fields = [name for name, *_ in CRD_FIELDS]
    source = tmp_path / "layout.c"
    exprs = ",".join(f"offsetof(TCrdPrm,{name})" for name in fields)
    source.write_text(
        f'#include <stddef.h>\n#include "gts.h"\nconst unsigned long layout[] = {{sizeof(TCrdPrm),{exprs}}};\n',
        encoding="ascii",
    )
    library = tmp_path / "layout.so"
    assert CC is not None
    include = str(ROOT / "tests" / "vendor")
    subprocess.run([CC, "-shared", "-fPIC", "-I", include, str(source), "-o", str(library)], check=True)
    found = list((ctypes.c_ulong * (len(fields) + 1)).in_dll(ctypes.CDLL(str(library)), "layout"))
    assert found == [ctypes.sizeof(TCrdPrm), *(getattr(TCrdPrm, name).offset for name in fields)]


def test_what_the_abis_differ_in() -> None:
    gus, gts, multi = (prototypes(abi, 3) for abi in (Abi.GUS, Abi.GTS, Abi.GTS_MULTI))
    counts = [
        [len(p[name].argtypes) for p in (gus, gts, multi)] for name in ("GT_LaserPowerMode", "GT_Close", "GT_LnXY")
    ]
    assert counts == [[4, 5, 6], [0, 0, 1], [7, 7, 8]]
    assert [p["GT_SetPulseWidth"].argtypes[-2] for p in (gus, gts)] == [ctypes.c_ushort, ctypes.c_ulong]
    assert [p["GT_BufLaserPrfFollow"].symbol for p in (gus, gts)] == ["GT_BufLaserPrfFollow", "GT_BufLaserFollowRatio"]
    assert multi["GT_LnXY"].before == (3,)


@pytest.mark.parametrize(("library", "profile"), [(a, b) for a in range(3) for b in range(3) if a != b])
def test_a_wrong_profile_is_noticed_before_light(benches: dict[int, Bench], library: int, profile: int) -> None:
    stream = stream_of(EVERYTHING)
    made, abi = benches[library], (Abi.GUS, Abi.GTS, Abi.GTS_MULTI)[profile]
    made.controller.reset()
    machine = made.machine(Machine(), abi=abi)
    loaded, faults = load_library(str(made.path), abi, 0, needed_calls(stream, machine))
    if loaded is None:
        codes = [fault.rule.code for fault in faults]
        assert f"--abi {abi}" in faults[0].message
    else:
        codes = made.run(stream, machine).codes
    assert codes == ["GJ903"]
    names = set(made.controller.names())
    assert names <= {"GT_Open", "GT_ClrSts"}
    assert not any(made.controller.state().switched_on)


def test_missing_symbols_are_one_clear_error(tmp_path: Path) -> None:
    made = bench(tmp_path, GUS, "-DVC_NO_FOLLOW")
    stream, machine = stream_of(EVERYTHING), made.machine(Machine())
    library, (fault,) = load_library(str(made.path), Abi.GUS, 0, needed_calls(stream, machine))
    assert library is None
    assert fault.rule.code == "GJ902"
    assert all(part in fault.message for part in (str(made.path), "--abi gus", "GT_BufLaserPrfFollow"))
    assert made.controller.calls() == []
    # A job that does not follow does without.
    plainer = stream_of(MARK + "LASER POWER 3\nLASER ON\nLINE X 1\nLASER OFF\n")
    assert load_library(str(made.path), Abi.GUS, 0, needed_calls(plainer, machine))[1] == []


@pytest.mark.parametrize(
    ("name", "said"), [("no/such.so", "no such file"), ("libnosuch.so", "such file"), ("text.so", "")]
)
def test_a_library_that_can_not_be_loaded(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / "text.so").write_text("no library", encoding="ascii")
    path = name if name == "libnosuch.so" else str(tmp_path / name)
    library, (fault,) = load_library(path, Abi.GUS, 0, [])
    assert library is None
    assert fault.rule.code == "GJ901"
    assert said in fault.message


def test_a_library_without_the_calls_is_of_no_use() -> None:
    from ctypes.util import find_library

    if not (name := find_library("m")):
        pytest.skip("no library to be found")
    _, (fault,) = load_library(name, Abi.GUS, 0, ["GT_Open", "GT_Close", "GT_LnXY", "GT_CrdClear"])
    assert fault.rule.code == "GJ902"
    assert "no Googol library" in fault.message


# Wishes.

LONG = (
    MARK
    + "VEL 50\nLASER POWER 40\nLASER ON\nREPEAT 60 AS i\nLINE X (i % 2 * 3) Y (i / 10)\nEND\n"
    + "DWELL 400\nLINE X 9\nLASER OFF\n"
)


class Asking:
    """Asks for something once a run has come to a row."""

    def __init__(self, row: int, ask: str, again: float = 0.0) -> None:
        self.row, self.ask, self.again, self.asked_s, self.paused = row, ask, again, 0.0, 0

    def __call__(self, control: Control) -> None:
        if not self.asked_s and control.view.phase is Phase.RUNNING and control.view.row >= self.row:
            self.asked_s = time.perf_counter()
            control.ask_pause() if self.ask == "pause" else control.ask_stop("test", abrupt=self.ask == "abrupt")
        if self.ask == "pause" and control.view.phase is Phase.PAUSED and not self.paused:
            self.paused = control.view.row
            control.ask_pause()


@pytest.mark.parametrize("ask", ["smooth", "abrupt"])
@pytest.mark.parametrize("row", [5, 25, 50, 62])
def test_stopped_and_gone_on_with(gus: Bench, ask: str, row: int) -> None:
    stream, machine = stream_of(LONG), gus.machine(Machine())
    gus.controller.option("poll_us", 3_000)
    assert gus.run(stream, machine).faults == []
    whole = gus.controller.rows()
    fresh(gus)
    gus.controller.option("poll_us", 3_000)
    ran = gus.run(stream, machine, tick=Asking(row, ask))
    assert ran.codes == ["GJ911"]
    assert "test" in ran.faults[0].message
    assert is_safe(gus)
    assert ran.session.reached.sure
    done = gus.controller.rows()
    again, place = gus.resumed(stream, machine, ran.journal)
    assert again.faults == []
    assert place is not None
    assert place.row >= row - 1
    rest_of = gus.controller.rows()[len(done) :]
    if ask == "abrupt":
        assert not isinstance(goes_on(whole, rest_of, light_off_at(done, gus.controller.edges()[:0])), str)
    # All that was to be marked was marked, and next to nothing twice.
    lit = sum(float(r[r[:, Row.EMISSION0_MS] > 0, Row.POWER0_MS].sum()) for r in (done, rest_of))
    assert lit >= float(whole[:, Row.POWER0_MS].sum()) * 0.999


@pytest.mark.parametrize("row", [5, 25, 62])
def test_paused_and_gone_on(gus: Bench, row: int) -> None:
    stream, machine = stream_of(LONG), gus.machine(Machine())
    gus.controller.option("poll_us", 3_000)
    assert gus.run(stream, machine).faults == []
    whole = gus.controller.rows()
    fresh(gus)
    gus.controller.option("poll_us", 3_000)
    asking = Asking(row, "pause")
    ran = gus.run(stream, machine, tick=asking)
    assert ran.faults == []
    assert asking.paused >= row - 1
    rows = gus.controller.rows()
    assert rows[-1, [Row.X1, Row.Y1]].tolist() == whole[-1, [Row.X1, Row.Y1]].tolist()
    assert len(rows) > len(whole)
    lit_ms, wanted_ms = rows[:, Row.EMISSION0_MS].sum(), whole[:, Row.EMISSION0_MS].sum()
    assert wanted_ms * 0.99 < lit_ms < wanted_ms * 1.2
    if row > 60:  # In the dwell, which is run again.
        assert (rows[:, Row.KIND] == 3).sum() == 2


def test_stopped_while_it_was_paused(gus: Bench) -> None:
    """What goes on is what was left when the light went off, not where the smooth stop came to rest."""
    text = MARK + "VEL 50\nACC 500\nLASER POWER 40\nLASER ON\nLINE X 100\nLASER OFF\n"
    stream, machine = stream_of(text), gus.machine(Machine())
    gus.controller.option("poll_us", 3_000)

    def tick(control: Control) -> None:
        if control.view.phase is Phase.PAUSED:
            control.ask_stop("test")
        elif control.view.x_pulse > 40_000 and not control.pause:
            control.ask_pause()

    ran = gus.run(stream, machine, tick=tick)
    assert ran.codes == ["GJ911"]
    done, place = gus.controller.rows(), ran.session.reached
    assert place.sure
    # v^2 / 2a = 50^2 / (2 * 0.5) pulse from where the light went off.
    assert done[0, Row.LENGTH] - place.run_pulse == pytest.approx(2500, abs=100)
    assert gus.resumed(stream, machine, ran.journal)[0].faults == []
    way, left = gus.controller.rows()[1:]
    assert way[Row.EMISSION0_MS] == 0
    assert left[Row.LENGTH] == pytest.approx(100_000 - place.run_pulse, abs=1)
    assert left[Row.EMISSION0_MS] > 0


@pytest.mark.parametrize("when", ["before", "while"])
def test_the_interlock(gus: Bench, when: str) -> None:
    machine = gus.machine(Machine(), interlock=Interlock(di_type=4, input=2, value=1))
    gus.controller.option("di", 0 if when == "before" else 0b111)
    if when == "while":
        gus.controller.fault(Fault.DI, "GT_CrdStatus", 8, 1, 0b011)
    ran = gus.run(stream_of(LONG), machine)
    assert ran.codes == ["GJ910"]
    assert "input 2" in ran.faults[0].message
    assert is_safe(gus)
    assert ("GT_LnXY" in gus.controller.names()) == (when == "while")


def test_axes_are_left_as_configured(gus: Bench) -> None:
    for off in (False, True):
        fresh(gus)
        assert gus.run(stream_of(MARK + "LINE X 1\n"), gus.machine(Machine(), axes_off_after=off)).faults == []
        assert gus.controller.state().axes == (0 if off else 0b11)


def test_a_bug_in_what_watches_leaves_no_light(gus: Bench) -> None:
    def tick(control: Control) -> None:
        if control.view.row > 10:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        gus.run(stream_of(LONG), gus.machine(Machine()), tick=tick)
    assert is_safe(gus)


def test_a_closed_terminal_ends_the_run(gus: Bench) -> None:
    def tick(control: Control) -> None:
        if control.view.row > 10:
            raise BrokenPipeError

    ran = gus.run(stream_of(LONG), gus.machine(Machine()), tick=tick)
    assert ran.codes == ["GJ911"]
    assert is_safe(gus)


# Without light.


def test_without_laser_there_is_no_call_to_a_laser(gus: Bench) -> None:
    stream = stream_of(EVERYTHING)
    assert gus.run(stream, gus.machine(Machine())).faults == []
    whole = gus.controller.rows()
    fresh(gus)
    assert gus.run(without_laser(stream), gus.machine(Machine())).faults == []
    rows = gus.controller.rows()
    moved = [Row.KIND, Row.DURATION_MS, Row.X1, Row.Y1]
    assert rows[:, moved] == pytest.approx(whole[:, moved])
    assert rows[:, [Row.EMISSION0_MS, Row.EMISSION1_MS]].sum() == 0
    laser = {c for _, c in gus.controller.calls() if re.search("Laser|HSIO|FPK|Pulse|Vltg|Level|AxisMode", c)}
    assert laser == {"GT_SetHSIOOpt(0,0)", "GT_SetHSIOOpt(0,1)"}  # Off is always allowed.


def test_the_frame_is_the_box_of_the_marks(gus: Bench) -> None:
    text = MARK + "LASER POWER 3\nJUMP X 50 Y 50\nJUMP X 0 Y 0\nLASER ON\nARC CCW I 5 J 0\nLINE X -2 Y 3\nLASER OFF\n"
    stream = stream_of(text)
    trace, _ = simulate_stream(stream, Machine())
    assert trace is not None
    framed = frame(stream, trace)
    assert framed is not None
    assert gus.run(framed, gus.machine(Machine())).faults == []
    corners = {(x, y) for x, y in gus.controller.rows()[:, [Row.X1, Row.Y1]].tolist()}
    assert corners == {(-2000, -5000), (10000, -5000), (10000, 5000), (-2000, 5000)}
    assert gus.controller.edges().size == 0


def test_a_full_disk_ends_the_run_dark(gus: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The journal can't be written any more, at each of its lines: no light is left on for want of a journal."""
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine())
    lines = gus.run(stream, machine).journal.read_bytes().count(b"\n")
    whole = gus.controller.rows()
    for full_at in range(2, lines, 3):
        fresh(gus)
        journals: list[_Full] = []

        def full_journal(path: Path, head: dict[str, object], at: int = full_at, made: list[_Full] = journals) -> _Full:
            made.append(_Full(path, head, at))
            return made[0]

        monkeypatch.setattr("support.hardware.Journal", full_journal)
        ran = gus.run(stream, machine)
        assert is_safe(gus), full_at
        if ran.codes:
            assert ran.codes == ["GJ915"], full_at
        else:  # Full behind the last look at the motion: what is left is the way out.
            assert journals[0].missed <= 7, full_at
            assert gus.controller.rows().shape == whole.shape, full_at


class _Full(Journal):
    """On a disk that is full after so many lines; `missed` counts those that found no room."""

    def __init__(self, path: Path, head: dict[str, object], lines: int) -> None:
        super().__init__(path, head)
        self.missed = 0
        written, real = [0], self.write

        def write(line: bytes) -> int | None:
            written[0] += 1
            if written[0] > lines:
                self.missed += 1
                raise OSError(28, "No space left on device")
            return real(line)

        self.write = write

    def give_up(self, error: OSError) -> None:
        super().give_up(error)
        self.write = self._miss

    def _miss(self, _line: bytes) -> None:
        self.missed += 1


def test_a_fifo_that_runs_dry_before_all_is_sent_is_seen_at_once(gus: Bench) -> None:
    """Not when the next call finds its way into a FIFO that stands still."""
    fresh(gus, slots=16)
    gus.controller.options(poll_us=5_000)
    gus.controller.fault(Fault.DRY, "GT_CrdStatus", 12)
    ran = gus.run(stream_of(LONG), gus.machine(Machine()))
    assert ran.codes == ["GJ906"]
    names = gus.controller.names()
    dry = [i for i, name in enumerate(names) if name == "GT_CrdStatus"][11]
    assert "GT_LnXY" not in names[dry:]
