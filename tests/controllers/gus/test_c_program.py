"""gusjob compile --format c: the program is compiled, linked with a stand-in for the vendor's library, and run."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.tools import MARK, ROOT, recorded_stream, stream_in, stream_of

from gusjob.controllers.gus.c_program import c_program
from gusjob.controllers.gus.calls import BUFFERED, SIGNATURES, Stream
from gusjob.controllers.gus.listing import listing
from gusjob.frontend import check_text, read_listing
from gusjob.pipeline import examine_file

VENDOR = ROOT / "tests" / "vendor"
FILES = [*sorted((ROOT / "jobs").rglob("*.job")), *sorted((ROOT / "tests" / "manual").glob("*.c"))]
STRICT = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-I", str(VENDOR))
CC = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_cc = pytest.mark.skipif(CC is None, reason="no C compiler (cc, gcc, clang) on this machine")
needs_posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")

WAYS_OUT = ("GT_SetHSIOOpt(0,", "GT_Stop(", "GT_CrdStatus(", "GT_Close(")

JOB = (
    MARK
    + """LASER POWER 40
JUMP X -5 Y 0
LASER ON
LINE X 5
LASER OFF
LASER POWER 25 NOW
LASER ON
ARC CCW I 5 J 0
DWELL 3
LASER FOLLOW MIN 5 MAX 60 AT 100
ARC CW X 8 Y 3 R 4
LASER OFF
LASER MODE ANALOG MAX 8 CHANNEL 1
LASER POWER 2.5 CHANNEL 1
LASER ON CHANNEL 1
LINE X 1 Y 2
LASER OFF CHANNEL 1
"""
)
"""Every buffered call that a job can make, three stages, two channels."""

OTHERS = """GT_Reset()
GT_SetCrdStopDec(1,2.5,100)
GT_LnXYG0(1,1000,-2000,50.5,2,0)
GT_ArcXYC(1,3469,-2000,1234.5,6e-13,0,50.5,2,0,0)
GT_BufLaserFollowMode(1,0,0,0,0.5)
GT_BufLaserFollowRatio(1,0.1,2.5,97.5,0,0)
GT_BufLaserFollowOff(1,0,0)
GT_CrdStart(1,0)
GT_CrdStatus(1,run,segment,0)
GT_Stop(256,256)
"""
"""Calls of listings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ran:
    """What a program did: its exit status, its messages, and the stand-in's log as (return code, call)."""

    status: int
    told: str
    log: tuple[tuple[int, str], ...]

    def names(self) -> list[str]:
        return [call.partition("(")[0] for _, call in self.log]

    def behind(self, index: int) -> list[str]:
        """The calls behind one of the log."""
        return [call for _, call in self.log[index + 1 :]]


Build = Callable[..., Path]


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stand-in as an object file."""
    assert CC is not None
    made = tmp_path_factory.mktemp("vendor") / "gts.o"
    subprocess.run([CC, "-std=c99", "-c", *STRICT, str(VENDOR / "gts.c"), "-o", str(made)], check=True)
    return made


@pytest.fixture
def build(library: Path, tmp_path: Path) -> Build:
    """A program of a stream, compiled as C99 without a warning."""

    def made(stream: Stream, *flags: str) -> Path:
        source, program = tmp_path / "job.c", tmp_path / "job"
        source.write_text("".join(c_program(stream)), encoding="ascii")
        command = [str(CC), "-std=c99", *STRICT, *flags, str(source), str(library), "-o", str(program)]
        subprocess.run(command, check=True)
        return program

    return made


def run(program: Path, *arguments: str, **stub: str | int) -> Ran:
    """Run a program; `stub` is what the stand-in is told (gts.c)."""
    told = {f"STUB_{name.upper()}": str(value) for name, value in stub.items()}
    done = subprocess.run(
        [str(program), *arguments], env=os.environ | told, capture_output=True, text=True, timeout=60, check=False
    )
    return Ran(status=done.returncode, told=done.stderr, log=read_log(done.stdout))


def read_log(text: str) -> tuple[tuple[int, str], ...]:
    lines = (line.split(" ", 1) for line in text.splitlines())
    return tuple((int(code), call) for code, call in lines)


def stream_of_file(path: Path) -> Stream:
    stream = stream_in(examine_file(path, None))
    assert stream is not None
    return stream


def calls_in(text: str) -> Stream:
    source, _ = check_text(text.encode(), "test.gts")
    assert source is not None
    stream, diagnostics = read_listing(source)
    assert diagnostics == []
    return stream


def plain(call: str) -> str:
    """A call with its numbers in one form."""
    return re.sub(r"(?<![A-Za-z_])-?\d[\d.]*(e[+-]?\d+)?", lambda m: repr(float(m[0]) + 0.0), call)


def wanted(stream: Stream, channels: str) -> list[str]:
    """The listing's calls; the end of the last stage is waited for, then the laser is switched off."""
    calls = "".join(listing(stream)).splitlines()
    calls = ["at rest" if c.startswith("GT_CrdStatus") else plain(c) for c in calls]
    moves = [c.name for c in stream.calls if c.name in ("GT_CrdStart", "GT_CrdStatus")]
    rest = ["at rest"] if moves[-1:] == ["GT_CrdStart"] else []
    return [*calls, *rest, *(plain(f"GT_SetHSIOOpt(0,{channel})") for channel in channels)]


def job_calls(ran: Ran) -> list[str]:
    """The job's calls of a log that were carried out, and where the motion was seen at rest."""
    found = list[str]()
    for code, call in ran.log:
        name = call.partition("(")[0]
        if name == "GT_CrdStatus":
            if call.split(",")[1] == "0" and found[-1] != "at rest":
                found.append("at rest")
        elif code == 0 and name in SIGNATURES:
            found.append(plain(call))
    return found


def safely_left(calls: list[str], channels: str) -> None:
    """These calls, the last ones of a program, are a safe way out: off, stop, off, close, and nothing else."""
    off = [f"GT_SetHSIOOpt(0,{channel})" for channel in channels]
    assert calls[: len(off)] == off
    assert calls[len(off)] == "GT_Stop(256,259)"
    assert calls[-len(off) - 1 :] == [*off, "GT_Close()"]
    assert [call for call in calls if not call.startswith(WAYS_OUT)] == []


@needs_cc
@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_makes_the_calls_of_the_listing(path: Path, build: Build) -> None:
    stream = stream_of_file(path)
    ran = run(build(stream))
    assert (ran.status, ran.told) == (0, "")
    assert job_calls(ran) == wanted(stream, "01" if path.stem == "two_channels" else "0")
    assert ran.names()[0] == "GT_Open"
    assert ran.names()[-1] == "GT_Close"


@needs_cc
def test_makes_every_call_there_is(build: Build) -> None:
    job, others = stream_of(JOB), calls_in(OTHERS)
    assert {*job.buffered.kind.tolist(), *others.buffered.kind.tolist()} == set(BUFFERED)
    for stream, channels in ((job, "01"), (others, "0")):
        ran = run(build(stream))
        assert (ran.status, ran.told) == (0, "")
        assert job_calls(ran) == wanted(stream, channels)


@needs_cc
def test_pointers_arrays_and_structs_of_a_listing(build: Build) -> None:
    text = """long pos[4] = {1,-2,3,4};
GT_GetHSIOOpt(&value,0)
GT_SetLaserDisMode(1,0,pos,{1000,0.1,1e-7,33.333333333333336},0)
GT_SetCrdPrm(2,{2,{0,0,1,2,0,0,0,0},500,1.5,50,1,{0,0,7,-8,0,0,0,0}})
GT_CrdClear(2,1)
GT_LnXY(2,5,6,1,2,0,1)
GT_CrdStart(2,2)
"""
    stream = calls_in(text)
    ran = run(build(stream))
    assert (ran.status, ran.told) == (0, "")
    assert job_calls(ran) == wanted(stream, "0")
    axes = [c for _, c in ran.log if c.startswith(("GT_ClrSts", "GT_AxisOn"))]
    assert axes == ["GT_ClrSts(3,1)", "GT_AxisOn(3)", "GT_ClrSts(4,1)", "GT_AxisOn(4)"]


@needs_cc
def test_before_the_job_the_controller_is_set_up(build: Build) -> None:
    program = build(stream_of(JOB))
    ran = run(program, "my.cfg")
    head = ["GT_Open(0,1)", "GT_LoadConfig(my.cfg)", "GT_ClrSts(1,1)", "GT_AxisOn(1)", "GT_ClrSts(2,1)", "GT_AxisOn(2)"]
    assert [call for _, call in ran.log[:6]] == head
    assert run(program, "a", "b").status == 1


@needs_cc
def test_a_stage_longer_than_the_fifo(build: Build) -> None:
    text = MARK + "LASER POWER 10\nLASER ON\n" + "LINE X 1\nLINE X 0\n" * 3000 + "LASER OFF\nWAIT\nLINE X 0 Y 1\n"
    stream = stream_of(text)
    ran = run(build(stream))
    assert (ran.status, ran.told) == (0, "")
    full = [i for i, (code, _) in enumerate(ran.log) if code == 1]
    assert len(full) > 2
    for i in full:  # The same call comes again, behind polls only.
        again = next(j for j in range(i + 1, len(ran.log)) if ran.log[j][1].startswith("GT_LnXY"))
        assert ran.log[again] == (0, ran.log[i][1])
        assert set(ran.names()[i + 1 : again]) <= {"GT_CrdSpace", "GT_CrdStatus", "GT_GetCrdPos", "GT_CrdStart"}
    found, want = job_calls(ran), wanted(stream, "0")
    started, listed = found.index(plain("GT_CrdStart(1,0)")), want.index(plain("GT_CrdStart(1,0)"))
    cleared = found.index(plain("GT_CrdClear(1,0)"))
    assert started == cleared + 1 + 4096 + 1  # One status poll saw the system at rest before the start.
    assert found[started - 1] == "at rest"
    del found[started - 1 : started + 1], want[listed]
    assert found == want


@needs_cc
def test_a_fifo_that_runs_dry_is_noticed(build: Build) -> None:
    text = MARK + "LASER POWER 10\nLASER ON\n" + "LINE X 1\nLINE X 0\n" * 5000 + "LASER OFF\n"
    ran = run(build(stream_of(text)), dry=1)
    assert ran.status == 1
    assert "the motion stopped with calls in the FIFO" in ran.told
    last = max(i for i, name in enumerate(ran.names()) if name == "GT_GetCrdPos")
    safely_left(ran.behind(last), "0")
    # It is noticed long before the 10003 calls are through.
    assert sum(name == "GT_LnXY" for name in ran.names()) < 4096 + 200


@needs_cc
@pytest.mark.parametrize(
    ("stub", "told"), [({"stuck": 1}, "no progress for 1 s"), ({"deaf": 1}, "the motion did not start within 1 s")]
)
def test_waiting_has_an_end(build: Build, stub: dict[str, int], told: str) -> None:
    ran = run(build(stream_of(JOB), "-DGUSJOB_PATIENCE_S=1"), **stub)
    assert (ran.status, ran.told) == (1, f"line 9: {told}\n")
    last = max(i for i, name in enumerate(ran.names()) if name == "GT_GetCrdPos")
    safely_left(ran.behind(last), "01")


@needs_cc
def test_slow_progress_is_progress(build: Build) -> None:
    text = MARK + "LASER POWER 10\nLASER ON\n" + "LINE X 1\nLINE X 0\n" * 250 + "LASER OFF\n"
    program = build(stream_of(text), "-DGUSJOB_PATIENCE_S=1")
    begin = time.monotonic()
    ran = run(program, drain=1, every=3)
    assert (ran.status, ran.told) == (0, "")
    assert time.monotonic() - begin > 1.2


@needs_cc
def test_a_call_refused_with_room_is_an_error_and_not_repeated_for_ever(build: Build) -> None:
    ran = run(build(stream_of(JOB)), fail="GT_BufLaserOn:1")
    assert ran.status == 1
    assert ran.told == (
        "line 6: GT_BufLaserOn(1,0,0) returned 1: can't be done now (FIFO full, coordinate system moving)\n"
    )
    assert ran.names().count("GT_BufLaserOn") == 2


@needs_cc
@pytest.mark.parametrize(
    ("code", "meaning"),
    [
        (1, "can't be done now (FIFO full, coordinate system moving)"),
        (2, "no licence"),
        (3, "wrong version"),
        (7, "parameter error"),
        (8, "not supported by the firmware"),
        (-1, "fault of the link to the controller"),
        (-5, "fault of the link to the controller"),
        (-6, "the controller can't be opened"),
        (-7, "no response"),
        (-8, "lock time-out"),
        (99, "not documented"),
    ],
)
def test_messages_give_line_call_code_and_meaning(build: Build, code: int, meaning: str) -> None:
    program = build(stream_of(JOB))
    for call in ("GT_LaserOutFrq(10,0)", "GT_CrdClear(1,0)", "GT_CrdStart(1,0)", "GT_BufDelay(1,3,0)"):
        name = call.partition("(")[0]
        line = {"GT_LaserOutFrq": 1, "GT_CrdClear": 4, "GT_CrdStart": 8, "GT_BufDelay": 12}[name]
        told = run(program, fail=f"{name}:{code}").told
        assert told == f"line {line}: {call} returned {code}: {meaning}\n"


@needs_cc
def test_after_a_refused_call_the_laser_is_off_wherever_it_was(build: Build) -> None:
    program = build(stream_of(JOB))
    clean = run(program)
    last = len(clean.log) - 3  # GT_SetHSIOOpt(0,0), GT_SetHSIOOpt(0,1), GT_Close.
    assert clean.names()[last:] == ["GT_SetHSIOOpt", "GT_SetHSIOOpt", "GT_Close"]
    for k in range(2, last + 1):
        ran = run(program, fail_at=f"{k}:7")
        assert (k, ran.status) == (k, 1)
        assert "returned 7: parameter error" in ran.told
        assert ran.log[:k] == (*clean.log[: k - 1], (7, clean.log[k - 1][1]))
        safely_left(ran.behind(k - 1), "01")
    assert run(program, fail_at="1:-6").log == ((-6, "GT_Open(0,1)"),)
    assert run(program, fail_at="1:-6").status == 1
    assert run(program, fail_at=f"{last + 3}:7").status == 1


@needs_cc
def test_a_failed_laser_off_is_retried_and_reported(build: Build) -> None:
    program = build(stream_of(JOB))
    clean = run(program)
    once = run(program, fail_at=f"{len(clean.log) - 2}:-7")
    assert (once.status, once.told) == (0, "")
    assert once.names()[-4:] == ["GT_SetHSIOOpt", "GT_SetHSIOOpt", "GT_SetHSIOOpt", "GT_Close"]
    never = run(program, fail="GT_SetHSIOOpt:-7")
    assert never.status == 1
    assert "THE LASER OF CHANNEL 1 MAY BE ON" in never.told
    assert never.names()[-1] == "GT_Close"
    assert "GT_Stop" in never.names()


@needs_cc
@needs_posix
def test_a_signal_stops_it_wherever_it_is(build: Build) -> None:
    program = build(stream_of(JOB))
    clean = run(program)
    # Up to the last look at the motion: behind it are two more polls, two switches and GT_Close.
    for k in range(1, len(clean.log) - 5):
        ran = run(program, signal_at=k)
        assert (k, ran.status) == (k, 2)
        assert ran.told.endswith("stopped on request\n")
        # What was begun with its two polls may end; no call of the job comes any more.
        after = [c for c in ran.behind(k - 1) if not c.startswith(("GT_CrdSpace", "GT_GetCrdPos", "GT_CrdStatus"))]
        safely_left(after, "01")


@needs_cc
@needs_posix
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_from_outside_while_it_waits(build: Build, number: str) -> None:
    if signal.getsignal(getattr(signal, number)) is signal.SIG_IGN:
        pytest.skip(f"{number} is ignored here, as under nohup, and children inherit that")
    program = build(stream_of(JOB))
    endless, pipe = os.environ | {"STUB_ENDLESS": "1"}, subprocess.PIPE
    with subprocess.Popen([str(program)], env=endless, stdout=pipe, stderr=pipe, text=True) as running:
        assert running.stdout is not None
        try:
            head = list(lines_up_to(running.stdout, "GT_CrdStart"))
            running.send_signal(getattr(signal, number))
            rest, told = running.communicate(timeout=30)
        finally:
            running.kill()
    assert (running.returncode, told) == (2, "line 9: stopped on request\n")
    log = read_log("".join(head) + rest)
    stop = next(i for i, (_, call) in enumerate(log) if call.startswith("GT_Stop"))
    safely_left([call for _, call in log[stop - 2 :]], "01")


def lines_up_to(stream: Iterator[str], name: str) -> Iterator[str]:
    for line in stream:
        yield line
        if name in line:
            return


@needs_cc
@needs_posix
def test_a_message_that_nobody_reads_does_not_block_the_shutdown(build: Build, tmp_path: Path) -> None:
    program = build(stream_of(JOB))
    reader, writer = os.pipe()
    os.close(reader)
    with (tmp_path / "log").open("w") as log:
        done = subprocess.run(
            [str(program)], env=os.environ | {"STUB_FAIL": "GT_LnXY:7"}, stdout=log, stderr=writer, check=False
        )
    os.close(writer)
    assert done.returncode == 1
    assert (tmp_path / "log").read_text().splitlines()[-1] == "0 GT_Close()"


@needs_cc
def test_in_another_program(build: Build, tmp_path: Path) -> None:
    ran = run(build(stream_of(JOB), *host(tmp_path)))
    assert ran.status == 40
    assert ran.names()[0] == "GT_SetAxisMode"
    assert "GT_Open" not in ran.names()
    half = len(ran.log) // 2
    assert ran.log[:half] == ran.log[half:]


@needs_cc
def test_a_run_that_failed_leaves_nothing_to_the_next(build: Build, tmp_path: Path) -> None:
    program = build(calls_in("GT_LnXY(1,5,6,1,2,0,0)\n" * 100 + "GT_CrdStart(1,0)\n"), *host(tmp_path))
    polls = [i for i, name in enumerate(run(program).names(), start=1) if name == "GT_CrdStatus"]
    ran = run(program, fail_at=f"{polls[1]}:-7")
    assert (ran.status, ran.told) == (41, "line 101: GT_CrdStatus(1,run,segment,0) returned -7: no response\n")
    assert run(program, fail="GT_CrdStart:7").told == "line 101: GT_CrdStart(1,0) returned 7: parameter error\n" * 2


def host(folder: Path) -> tuple[str, str]:
    """A program that runs the job twice; its status is 40 and theirs."""
    source = folder / "host.c"
    source.write_text("int gusjob_run(void);\nint main(void)\n{\n    return gusjob_run() + gusjob_run() + 40;\n}\n")
    return "-DGUSJOB_NO_MAIN", str(source)


@needs_cc
@pytest.mark.parametrize("compiler", ["cc", "gcc", "clang"])
def test_other_compilers_take_it_as_c_and_as_cpp(compiler: str, tmp_path: Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} on this machine")
    source = tmp_path / "job.c"
    source.write_text("".join(c_program(stream_of(JOB))), encoding="ascii")
    languages = [("c", "c99"), *([("c++", "c++11")] if shutil.which(compiler.replace("cc", "++")) else [])]
    for language, standard in languages:
        for flags in ((), ("-DGUSJOB_NO_MAIN",), ("-O2",)):
            command = [compiler, "-x", language, f"-std={standard}", *STRICT, *flags, "-fsyntax-only", str(source)]
            subprocess.run(command, check=True)


@needs_cc
def test_an_empty_job_is_a_program_too(build: Build) -> None:
    ran = run(build(stream_of("VEL 100\n")))
    assert (ran.status, ran.names()) == (0, ["GT_Open", "GT_Close"])


@needs_cc
def test_many_stages_are_cut_into_functions(build: Build) -> None:
    stream = stream_of(MARK + "LASER POWER 10\nLINE X 1\nWAIT\nLINE X 0\nWAIT\n" * 150)
    text = "".join(c_program(stream))
    parts = re.findall(r"static int part_\d+\(void\)\n{\n(.*?)\n}", text, re.DOTALL)
    assert len(parts) > 1
    assert max(len(part.splitlines()) for part in parts) < 250
    ran = run(build(stream))
    assert ran.status == 0
    assert job_calls(ran) == wanted(stream, "0")


@pytest.mark.parametrize(
    ("calls", "message"),
    [
        ("GT_LnXY(1,2.5,0,1,1,0,0)", "line 1: GT_LnXY: x is 2.5, it must be whole and in "),
        ("GT_LnXY(3,2,0,1,1,0,0)", "line 1: GT_LnXY: crd is 3, it must be whole and in [1, 2]"),
        ("GT_SetLevelDelay(70000,0,0)", "line 1: GT_SetLevelDelay: highLevelDelay is 70000, it must be whole and in "),
        ("GT_SetLaserDisMode(1,0,{0,0.5,0,0},{1,1,1,1},0)", "line 1: GT_SetLaserDisMode: pPos is 0.5, it must be "),
        ("GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0.5},1,1,0,1,{0,0,0,0,0,0,0,0}})", "line 1: GT_SetCrdPrm: profile is 0.5, "),
    ],
)
def test_an_argument_that_its_c_type_cannot_hold_is_an_error(calls: str, message: str) -> None:
    errors = [line for line in "".join(c_program(calls_in(calls))).splitlines() if line.startswith("#error")]
    assert len(errors) == 1
    assert errors[0].startswith(f"#error {message}")


def test_what_can_be_written_has_no_fault() -> None:
    for path in FILES:
        assert "#error" not in "".join(c_program(stream_of_file(path)))


@pytest.mark.parametrize("name", ["a*/b.job", "a\\", "a??/", "line\nend", "刀.job", "/a/folder/x.job", "C:\\a\\x.job"])
def test_any_name_is_safe_in_the_comment(name: str) -> None:
    stream = stream_of(JOB)
    text = "".join(c_program(Stream(name=name, buffered=stream.buffered, calls=stream.calls)))
    assert text.isascii()
    head = text.splitlines()[:4]
    assert (head[0], head[3]) == ("/*", " */")
    assert re.fullmatch(r" \* Job: [A-Za-z0-9 ._+()\[\],:=@#-]*", head[1])
    assert "folder" not in head[1]


def test_numbers_are_written_as_in_the_listing() -> None:
    for path in FILES:
        stream = stream_of_file(path)
        text = "".join(c_program(stream))
        rows = re.findall(r"^\{\d+,(\w+),\{(.*)\}\},$", text, re.M)
        names = tuple(s.name for s in BUFFERED.values())
        buffered = [c for c in "".join(listing(stream)).splitlines() if c.startswith(names)]
        assert [f"GT_{name}({numbers})" for name, numbers in rows] == buffered


@needs_cc
def test_long_paths_are_cut_into_tables(build: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gusjob.controllers.gus.c_program._CHUNK", 3)
    stream = stream_of(JOB)
    assert "calls_4" in "".join(c_program(stream))
    assert job_calls(run(build(stream))) == wanted(stream, "01")


def test_pieces_end_with_a_line_end() -> None:
    assert all(piece.endswith("\n") for piece in c_program(stream_of(JOB)))


def test_a_status_that_was_recorded_with_what_it_read_is_left_out() -> None:
    text = "GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\nGT_CrdStatus(1,1,0,0)\nGT_LaserPrfCmd(20,0)\n"
    program = "".join(c_program(recorded_stream(text + "AT_REST(1)\nGT_LaserPrfCmd(10,0)\n")))
    assert re.findall(r"RUN\(crd_wait\((\d+), 1", program) == ["5"]
