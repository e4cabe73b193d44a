"""Programs of several languages, recorded: what is in the listing, and when."""

from __future__ import annotations

import itertools
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.cli import gusjob
from support.recorded import CC, LINE, calls, compiled, library_folder, lines, needs_compiler, needs_cxx, times

from gusjob.config.machine import Abi
from gusjob.record.build import BuildError, Target
from gusjob.record.recording import Fault, Recording, RecordOptions, record, vendor_library

pytestmark = needs_compiler

BEGIN = """
#include <stdio.h>
#include <stdlib.h>
#include "gts.h"
static TCrdPrm prm = {2, {1, 2}, 500, 20, 0, 1, {0}};
static void begin(void) { GT_Open(0, 1); GT_SetCrdPrm(1, &prm); GT_CrdClear(1, 0); }
"""
OPENED = [
    "GT_Open(0,1) = 0",
    "GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},500,20,0,1,{0,0,0,0,0,0,0,0}}) = 0",
    "GT_CrdClear(1,0) = 0",
]


def recorded(tmp_path: Path, *command: object, **options: object) -> Recording:
    """Record a program into calls.gts."""
    chosen = RecordOptions(command=tuple(map(str, command)), output=tmp_path / "calls.gts", **options)  # type: ignore[arg-type]
    recording = record(chosen)
    assert isinstance(recording, Recording), recording
    return recording


def of_c(tmp_path: Path, body: str, *, abi: Abi = Abi.GUS, **options: object) -> Recording:
    """Record a C program with this main()."""
    program = compiled(tmp_path, f"{BEGIN}\nint main(void)\n{{\n{body}\nreturn 0;\n}}\n", abi)
    return recorded(tmp_path, program, abi=abi, **options)


def test_loops_functions_conditions(tmp_path: Path) -> None:
    """The program writes its own log of what it sends; the listing is the same."""
    source = (
        BEGIN
        + """
static FILE *own;
static int line(long x, long y, double vel)
{
    short code = GT_LnXY(1, x, y, vel, 2, 0, 0);
    fprintf(own, "GT_LnXY(1,%ld,%ld,%.17g,2,0,0) = %d\\n", x, y, vel, code);
    return code;
}
static void power(double p)
{
    fprintf(own, "GT_BufLaserPrfCmd(1,%.17g,0,0) = %d\\n", p, GT_BufLaserPrfCmd(1, p, 0, 0));
}
static int hatch(int lines, long width, double vel)
{
    int failed = 0;
    for (int i = 0; i < lines; i++) {
        if (i % 3 == 2)
            continue;
        power(i % 2 ? 12.5 : i);
        failed |= line(i % 2 ? width : -width, 100L * i, vel);
    }
    return failed;
}
int main(int count, char **args)
{
    own = fopen(args[1], "w");
    begin();
    while (--count > 1)
        hatch(atoi(args[count]), 4000, count == 2 ? 50 : 62.5);
    line(1, 2, 0);             /* Refused: velocity 0. */
    line(2000000000, 2, 50);   /* Refused: too far. */
    return 0;
}
"""
    )
    program = compiled(tmp_path, source)
    recording = recorded(tmp_path, program, tmp_path / "own.txt", 5, 7)
    own = (tmp_path / "own.txt").read_text(encoding="ascii").splitlines()
    assert calls(tmp_path / "calls.gts") == OPENED + own
    assert own[-2:] == ["GT_LnXY(1,1,2,0,2,0,0) = 7", "GT_LnXY(1,2000000000,2,50,2,0,0) = 7"]
    assert len(own) == 2 * (4 + 5) + 2
    assert (recording.exit_code, recording.calls) == (0, len(own) + 3)


@needs_cxx
def test_default_arguments_of_cpp(tmp_path: Path) -> None:
    source = """
extern "C" {
short GT_Open(short channel = 0, short param = 1);
short GT_BufLaserOn(short crd, short fifo = 0, short channel = 0);
short GT_LaserPowerMode(short mode, double maxValue, double minValue, short channel = 0, short delaymode = 0);
short GT_LnXY(short crd, long x, long y, double synVel, double synAcc, double velEnd = 0, short fifo = 0);
short GT_GetSts(short axis, long *pSts, short count = 1, unsigned long *pClock = nullptr);
}
struct Head {
    ~Head() { GT_BufLaserOn(1); }
    void to(long x, long y) { GT_LnXY(1, x, y, 50, 2); }
};
int main()
{
    GT_Open();
    GT_LaserPowerMode(0, 100, 0);
    { Head head; head.to(1, 2); }
    long status[2];
    GT_GetSts(1, status, 2);
    return status[0] == 0xa00 && status[1] == 0xa00 ? 0 : 1;
}
"""
    program = compiled(tmp_path, source, Abi.GTS, language="cpp")
    assert recorded(tmp_path, program, abi=Abi.GTS).exit_code == 0
    assert calls(tmp_path / "calls.gts") == [
        "GT_Open(0,1) = 0",
        "GT_LaserPowerMode(0,100,0,0,0) = 0",
        "GT_LnXY(1,1,2,50,2,0,0) = 1",  # There is no coordinate system.
        "GT_BufLaserOn(1,0,0) = 1",
        "GT_GetSts(1,{2560,2560},2,clock) = 0",
    ]


def test_python(tmp_path: Path) -> None:
    """The loader finds the library by its name alone."""
    program = tmp_path / "program.py"
    program.write_text(
        """
import ctypes, sys, time
gts = ctypes.CDLL("libgts.dylib" if sys.platform == "darwin" else "libgts.so")
gts.GT_Open(0, 1)
pos, scale = (ctypes.c_long * 4)(1, -2, 3), (ctypes.c_double * 4)(1000, 1000, 1, 0.1)
gts.GT_SetLaserDisMode(1, 0, pos, scale, 1)
time.sleep(0.25)
gts.GT_LaserPrfCmd(ctypes.c_double(1 / 3), 1)
sys.exit(3)
""",
        encoding="ascii",
    )
    recording = recorded(tmp_path, sys.executable, program)
    assert recording.exit_code == 3
    assert calls(tmp_path / "calls.gts") == [
        "GT_Open(0,1) = 0",
        "GT_SetLaserDisMode(1,0,{1,-2,3,0},{1000,1000,1,0.1},1) = 0",
        "GT_LaserPrfCmd(0.3333333333333333,1) = 0",
    ]
    slept = times(tmp_path / "calls.gts")[2] - times(tmp_path / "calls.gts")[1]
    assert 250 <= slept < 2000
    assert (tmp_path / "calls.gts").read_text(encoding="ascii").splitlines()[0] == (
        "// recorded by gusjob record, ABI gus, time fast"
    )
    assert (tmp_path / "calls.gts").read_text(encoding="ascii").splitlines()[-1] == "// ended with exit code 3"


REPEATED = re.compile(r"\[(?P<first>[0-9.]+)\] .* = 1 // (?P<count>\d+) times, the last at (?P<last>[0-9.]+)")
POLLING = """
short run; long segment; double pos[2]; long polls = 0;
begin();
GT_BufLaserOn(1, 0, 0);
GT_LnXY(1, 10000, 0, 50, 2, 0, 0);
GT_BufLaserOff(1, 0, 0);
GT_CrdStart(1, 0);
do {
    GT_CrdStatus(1, &run, &segment, 0);
    GT_GetCrdPos(1, pos);
    polls++;
} while (run == 1);
printf("%ld %g %ld\\n", segment, pos[0], polls);
"""
MOTION_MS = 225.0
"""10000 pulse at 50 pulse/ms with 2 pulse/ms^2: 200 ms of path, and 25 ms for both ramps."""


def test_polls_in_fast_time(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Each reading takes 2.02 ms; those that follow each other are two lines. The motion ends on its own time."""
    of_c(tmp_path, POLLING)
    segment, position, polls = map(float, capfd.readouterr().out.split())
    assert (segment, position) == (3, 10000)
    assert polls == pytest.approx(MOTION_MS / 4.04, abs=2)
    start = next(
        t
        for t, line in zip(times(tmp_path / "calls.gts"), lines(tmp_path / "calls.gts"), strict=True)
        if "Start" in line
    )
    status, place, rest, *last = lines(tmp_path / "calls.gts")[7:]
    assert status.startswith(f"[{start + 2.02:g}] GT_CrdStatus(1,1,1,0) = 0 // {polls - 1:.0f} times, the last at ")
    assert place.startswith(f"[{start + 4.04:g}] GT_GetCrdPos(1,{{") and place.count(" times, ") == 1
    assert rest.endswith("] AT_REST(1)")
    assert float(rest[1 : rest.index("]")]) == pytest.approx(start + MOTION_MS, abs=1e-3)
    assert {line.partition("] ")[2].partition(" //")[0] for line in last} == {
        "GT_CrdStatus(1,0,3,0) = 0",
        "GT_GetCrdPos(1,{10000,0}) = 0",
    }


def test_polls_in_real_time(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    began = time.monotonic()
    of_c(tmp_path, POLLING, is_real_time=True)
    assert time.monotonic() - began >= MOTION_MS / 1000
    assert float(capfd.readouterr().out.split()[2]) > 100
    rest = next(line for line in lines(tmp_path / "calls.gts") if "AT_REST" in line)
    started = next(line for line in lines(tmp_path / "calls.gts") if "GT_CrdStart" in line)
    took = float(rest[1 : rest.index("]")]) - float(started[1 : started.index("]")])
    assert took == pytest.approx(MOTION_MS, abs=1e-3)
    assert len(lines(tmp_path / "calls.gts")) <= 12  # GT_CrdStatus and GT_GetCrdPos once or twice each.


@pytest.mark.parametrize("is_real", [False, True])
@pytest.mark.parametrize(
    "wait",
    [
        "do GT_GetSts(1, &status, 1, 0); while (status & 0x400);",
        "do GT_GetPrfPos(1, &x, 1, 0); while (x < 1000);",
        "do GT_CrdSpace(1, &left, 0); while (left < 4096);",
        "do GT_GetRemainderSegNum(1, &left, 0); while (left);",
        "do GT_GetCrdVel(1, &x); while (x > 0);",
    ],
)
def test_every_way_to_wait_ends(tmp_path: Path, wait: str, is_real: bool) -> None:
    extra = """
short GT_GetSts(short, long *, short, unsigned long *);
short GT_GetPrfPos(short, double *, short, unsigned long *);
short GT_GetRemainderSegNum(short, long *, short);
short GT_GetCrdVel(short, double *);
long status, left; double x;
begin(); GT_LnXY(1, 1000, 0, 50, 20, 0, 0); GT_CrdStart(1, 0);
"""
    of_c(tmp_path, extra + wait + "GT_Close();", is_real_time=is_real)
    assert len(lines(tmp_path / "calls.gts")) <= 9
    assert "AT_REST(1)" in lines(tmp_path / "calls.gts")[-2] + lines(tmp_path / "calls.gts")[-3]


def test_a_full_fifo_is_tried_again(tmp_path: Path) -> None:
    """Refused calls that follow each other are one line; in the end all have been taken, in order."""
    body = """
begin();
for (int i = 1; i <= 6000; i++) {
    while (GT_LnXY(1, 200L * i, 0, 50, 20, 20, 0) != 0)
        ;
    if (i == 4000)
        GT_CrdStart(1, 0);
}
"""
    of_c(tmp_path, body)
    found = calls(tmp_path / "calls.gts")
    assert [c for c in found if c.startswith("GT_LnXY") and c.endswith("= 0")] == [
        f"GT_LnXY(1,{200 * i},0,50,20,20,0) = 0" for i in range(1, 6001)
    ]
    refused = [match for line in lines(tmp_path / "calls.gts") if (match := REPEATED.fullmatch(line))]
    assert refused
    for match in refused:  # The program needs 2 ms to try again.
        first, count, last = float(match["first"]), int(match["count"]), float(match["last"])
        assert last - first == pytest.approx((count - 1) * 2.02, abs=1e-3)


def test_a_pause_of_the_program_takes_time(tmp_path: Path) -> None:
    """While it sleeps for 60 ms the motion of 30 ms ends."""
    body = """
begin(); GT_LnXY(1, 1000, 0, 50, 5, 0, 0); GT_CrdStart(1, 0);
{ struct timespec nap = {0, 60000000}; nanosleep(&nap, 0); }
GT_Close();
"""
    program = compiled(
        tmp_path, f"#define _GNU_SOURCE\n#include <time.h>\n{BEGIN}\nint main(void)\n{{{body}\nreturn 0;\n}}\n"
    )
    recorded(tmp_path, program)
    *_, start, rest, close = times(tmp_path / "calls.gts")
    assert rest == pytest.approx(start + 30, abs=1e-3)
    assert close >= start + 60


def test_short_pauses_take_time(tmp_path: Path) -> None:
    """A program that switches the laser for 3 ms, twenty times."""
    body = """
begin();
for (int i = 0; i < 40; i++) { struct timespec nap = {0, 3000000}; GT_SetHSIOOpt(i % 2, 0); nanosleep(&nap, 0); }
"""
    head = f"#define _GNU_SOURCE\n#include <time.h>\n{BEGIN}\nint main(void)\n{{{body}\nreturn 0;\n}}\n"
    recorded(tmp_path, compiled(tmp_path, head))
    found = times(tmp_path / "calls.gts")[3:]
    assert all(after - before >= 3 for before, after in itertools.pairwise(found))


@pytest.mark.parametrize("end", ["abort();", "*(volatile int *)8 = 1;", "kill(getpid(), 9);", "_exit(7);"])
def test_a_program_that_breaks_off(tmp_path: Path, end: str) -> None:
    """No call is lost: each is in the file before it returns."""
    source = f"""#define _GNU_SOURCE
#include <signal.h>
#include <unistd.h>
{BEGIN}
int main(void)
{{
    begin();
    for (int i = 0; i < 100; i++)
        GT_LnXY(1, i, 0, 50, 2, 0, 0);
    {end}
}}
"""
    recording = recorded(tmp_path, compiled(tmp_path, source))
    assert calls(tmp_path / "calls.gts") == OPENED + [f"GT_LnXY(1,{i},0,50,2,0,0) = 0" for i in range(100)]
    assert recording.exit_code == {"a": -signal.SIGABRT, "*": -signal.SIGSEGV, "k": -9, "_": 7}[end[0]]
    ending = "with exit code 7" if end[0] == "_" else f"by signal {-recording.exit_code}"
    assert (tmp_path / "calls.gts").read_text(encoding="ascii").endswith(f"\n// ended {ending}\n")


def test_the_recorder_and_its_program_are_killed(tmp_path: Path) -> None:
    """What the program had sent is there, up to a call that was not yet over."""
    source = f"""#define _GNU_SOURCE
#include <unistd.h>
{BEGIN}
int main(void)
{{
    begin();
    for (int i = 0; ; i++) {{
        GT_LaserPrfCmd(i % 100, 0);
        if (write(1, "x", 1) < 0)
            return 1;
    }}
}}
"""
    program = compiled(tmp_path, source)
    command = [sys.executable, "-m", "gusjob", "record", "-o", str(tmp_path / "calls.gts"), "--", str(program)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=True) as process:
        assert process.stdout is not None
        sent = len(process.stdout.read(2000))
        os.killpg(process.pid, signal.SIGKILL)
        sent += len(process.stdout.read())
    found = calls(tmp_path / "calls.gts")
    assert found[: 3 + sent] == OPENED + [f"GT_LaserPrfCmd({i % 100},0) = 0" for i in range(sent)]
    assert len(found) <= 3 + sent + 1
    assert (tmp_path / "calls.gts").read_bytes().endswith(b"\n")


def test_several_cards(tmp_path: Path) -> None:
    """Each card is a machine of its own, with a listing of its own; their clocks are the same."""
    source = """
#include "multi.h"
int main(void)
{
    TCrdPrm prm = {2, {1, 2}, 500, 20, 0, 1, {0}};
    short run; long segment, bad;
    for (short card = 0; card < 3; card += 2) {
        GT_Open(card, 0, 1);
        GT_SetCrdPrm(card, 1, &prm);
        GT_LnXY(card, 1, 1000 + card, 0, 50, 5, 0, 0);
    }
    GT_CrdStart(2, 1, 0);
    do GT_CrdStatus(2, 1, &run, &segment, 0); while (run);
    GT_CrdStatus(0, 1, &run, &segment, 0);
    bad = GT_Open(99, 0, 1);
    return segment == 0 && bad == 7 ? 0 : 1;
}
"""
    text = (Path(__file__).parents[1] / "vendor" / "gts.h").read_text(encoding="ascii")
    (tmp_path / "multi.h").write_text(text.replace("(short ", "(short card, short "), encoding="ascii")
    program = compiled(tmp_path, source, Abi.GTS_MULTI, f"-I{tmp_path}")
    recording = recorded(tmp_path, program, abi=Abi.GTS_MULTI)
    assert [path.name for path in recording.listings] == ["calls.gts", "calls.card2.gts"]
    assert recording.exit_code == 0
    prm = "GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},500,20,0,1,{0,0,0,0,0,0,0,0}}) = 0"
    first, second = recording.listings
    assert calls(first) == ["GT_Open(0,1) = 0", prm, "GT_LnXY(1,1000,0,50,5,0,0) = 0", "GT_CrdStatus(1,0,0,0) = 0"]
    assert [c for c in calls(second) if "Status" not in c] == [
        "GT_Open(0,1) = 0",
        prm,
        "GT_LnXY(1,1002,0,50,5,0,0) = 0",
        "GT_CrdStart(1,0) = 0",
    ]
    assert times(second)[0] == pytest.approx(0.06)
    assert times(first)[-1] > times(second)[-1] > 30
    assert second.read_text(encoding="ascii").startswith(
        "// recorded by gusjob record, ABI gts-multi, card 2, time fast, of calls.gts\n"
    )


def test_a_program_that_selects_its_card(tmp_path: Path) -> None:
    """GT_SetCardNo of the library without card numbers (sister)."""
    body = """
short GT_SetCardNo(short); short GT_GetCardNo(short *); short card = 9;
GT_Open(0, 1); GT_SetCardNo(1); GT_Open(0, 1); GT_GetCardNo(&card); GT_SetCardNo(0); GT_Close();
if (card != 1) return 1;
"""
    recording = of_c(tmp_path, body, abi=Abi.GTS)
    assert recording.exit_code == 0
    assert calls(tmp_path / "calls.gts") == ["GT_Open(0,1) = 0", "GT_SetCardNo(1) = 0", "GT_Close() = 0"]
    assert calls(tmp_path / "calls.card1.gts") == ["GT_Open(0,1) = 0", "GT_GetCardNo(1) = 0", "GT_SetCardNo(0) = 0"]


def test_texts_and_functions_without_a_model(tmp_path: Path) -> None:
    """They return 0 and are recorded; a text is a string of C, whatever is in it."""
    body = r"""
short GT_PrfTrap(short); short GT_SetTrapPrm(short, void *); short GT_GetPrfVel(short, double *, short, void *);
short GT_LnXYZ(short, long, long, long, double, double, double, short);
short GT_BufIO(short, unsigned short, unsigned short, unsigned short, short);
double vel = 7;
GT_PrfTrap(1);
begin();
GT_LoadConfig("C:\\a \"b\".cfg\nGT_LaserPrfCmd(1,0)\303\244");
if (GT_PrfTrap(1) || GT_SetTrapPrm(1, &prm) || GT_GetPrfVel(1, &vel, 1, 0) || vel != 0) return 1;
if (GT_LnXYZ(1, 10, 20, 30, 50, 2, 0, 0) || GT_BufIO(1, 12, 1, 65535, 0)) return 2;
{ long left; GT_CrdSpace(1, &left, 0); if (left != 4094) return 3; }
"""
    assert of_c(tmp_path, body).exit_code == 0
    assert calls(tmp_path / "calls.gts") == [
        "GT_PrfTrap(1) = -6",
        *OPENED,
        r'GT_LoadConfig("C:\\a \"b\".cfg\012GT_LaserPrfCmd(1,0)\303\244") = 0',
        "GT_PrfTrap(1) = 0",
        "GT_SetTrapPrm(1,pointer) = 0",
        "GT_GetPrfVel(1,pointer,1,pointer) = 0",
        "GT_LnXYZ(1,10,20,30,50,2,0,0) = 0",
        "GT_BufIO(1,12,1,65535,0) = 0",
        "GT_CrdSpace(1,4094,0) = 0",
    ]


def test_faults(tmp_path: Path) -> None:
    """A call that fails has no effect: 2 lines are queued."""
    body = """
long left; begin();
for (int i = 0; i < 5; i++) GT_LnXY(1, i, 0, 50, 2, 0, 0);
GT_CrdStart(1, 0); GT_CrdStart(1, 0);
GT_CrdSpace(1, &left, 0);
return left == 4094 ? 0 : 1;
"""
    faults = (
        Fault(name="GT_LnXY", nth=2, code=-7),
        Fault(name="GT_LnXY", nth=4, code=1, lasts=True),
        Fault(name="GT_CrdStart", nth=1, code=8, lasts=True),
    )
    assert of_c(tmp_path, body, faults=faults).exit_code == 0
    assert [c.rpartition(" ")[2] for c in calls(tmp_path / "calls.gts")[3:]] == ["0", "-7", "0", "1", "1", "8", "0"]


def test_a_listing_with_a_limit(tmp_path: Path) -> None:
    """The program goes on; the listing ends with a whole line and says so."""
    body = "GT_Open(0, 1); for (int i = 0; i < 5000; i++) GT_LaserPrfCmd(i % 100, 0);"
    recording = of_c(tmp_path, body, limit_bytes=2000)
    text = (tmp_path / "calls.gts").read_text(encoding="ascii")
    assert recording.is_cut and recording.exit_code == 0
    assert 2000 < len(text) < 2300
    assert text.splitlines()[-2] == (
        "// stopped: the listing has reached its limit of 2000 bytes, later calls are missing"
    )
    assert len(calls(tmp_path / "calls.gts")) == recording.calls == len(lines(tmp_path / "calls.gts"))


def test_a_second_process_has_a_listing_of_its_own(tmp_path: Path) -> None:
    """A program that is forked after its first calls."""
    source = f"""#define _GNU_SOURCE
#include <sys/wait.h>
#include <unistd.h>
{BEGIN}
int main(void)
{{
    begin();
    if (fork() == 0) {{ GT_LaserPrfCmd(1, 0); _exit(0); }}
    wait(0);
    GT_LaserPrfCmd(2, 0);
    return 0;
}}
"""
    recording = recorded(tmp_path, compiled(tmp_path, source))
    assert [path.name for path in recording.listings] == ["calls.gts", "calls.2.gts"]
    assert calls(tmp_path / "calls.gts") == [*OPENED, "GT_LaserPrfCmd(2,0) = 0"]
    assert calls(tmp_path / "calls.2.gts") == ["GT_LaserPrfCmd(1,0) = 0"]


@pytest.mark.parametrize("name", ["a b.gts", "\u6807\u523b.gts", 200 * "n" + ".gts", "a.2.gts", "plain", ".gts"])
def test_names_of_the_listing(tmp_path: Path, name: str) -> None:
    """The second process's listing belongs to it, the first time and the second time."""
    source = f"""#define _GNU_SOURCE
#include <sys/wait.h>
#include <unistd.h>
{BEGIN}
int main(void) {{ begin(); if (fork() == 0) {{ GT_Close(); _exit(0); }} wait(0); return 0; }}
"""
    program = compiled(tmp_path, source)
    (tmp_path / "out").mkdir()
    for replaced in (0, 2):
        made = record(RecordOptions(command=(str(program),), output=tmp_path / "out" / name))
        assert isinstance(made, Recording)
        assert (len(made.listings), len(made.replaced)) == (2, replaced)
        assert len(list((tmp_path / "out").iterdir())) == 2


def test_files_of_an_earlier_recording_are_replaced(tmp_path: Path) -> None:
    """All of them, but no file of somebody else."""
    for name in ("calls.gts", "calls.card1.gts", "calls.2.gts", "calls.3.card4.gts"):
        (tmp_path / name).write_text("// recorded by gusjob record, ABI gus, of calls.gts\n", encoding="ascii")
    for name in ("calls.card3.gts", "calls.txt", "mycalls.gts", "calls.card.gts"):
        (tmp_path / name).write_text("GT_Close()\n", encoding="ascii")
    for name in ("calls.4.gts", "calls.5.gts"):  # Another recording's, and one that was renamed.
        of = ", of job.gts" if "4" in name else ""
        (tmp_path / name).write_text(f"// recorded by gusjob record, ABI gus{of}\n", encoding="ascii")
    recording = of_c(tmp_path, "GT_Open(0, 1);")
    assert calls(tmp_path / "calls.gts") == ["GT_Open(0,1) = 0"]
    assert recording.listings == (tmp_path / "calls.gts",)
    assert [path.name for path in recording.replaced] == [
        "calls.gts",
        "calls.card1.gts",
        "calls.2.gts",
        "calls.3.card4.gts",
    ]
    kept = {"calls.card3.gts", "calls.txt", "mycalls.gts", "calls.card.gts", "calls.4.gts", "calls.5.gts"}
    assert {path.name for path in tmp_path.glob("*calls*")} == {"calls.gts", *kept}


def test_the_library_alone(tmp_path: Path) -> None:
    """Without gusjob: calls.gts in the current folder, and an older one is kept."""
    program = compiled(tmp_path, f"{BEGIN}int main(void) {{ return GT_Open(0, 1); }}")
    variable = "DYLD_LIBRARY_PATH" if sys.platform == "darwin" else "LD_LIBRARY_PATH"
    environ = {variable: str(library_folder(tmp_path / "link", Abi.GUS)), "GUSJOB_RECORD_FAULTS": "GT_Open:2:5"}
    for _ in range(2):
        subprocess.run([program], cwd=tmp_path, env=environ, check=True)
    for name in ("calls.gts", "calls.2.gts"):
        assert calls(tmp_path / name) == ["GT_Open(0,1) = 0"]
    environ["GUSJOB_RECORD"] = str(tmp_path / "none" / "x.gts")
    done = subprocess.run([program], cwd=tmp_path, env=environ, check=True, capture_output=True, text=True)
    assert done.stderr == f"gusjob record: {tmp_path}/none/x.gts: can't be written, no call is recorded\n"


def test_two_names_of_the_library_are_one_machine(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        "import ctypes\nctypes.CDLL('libgts.so').GT_Open(0, 1)\nctypes.CDLL('libgus.so').GT_Close()\n", encoding="ascii"
    )
    assert recorded(tmp_path, sys.executable, program).exit_code == 0
    assert calls(tmp_path / "calls.gts") == ["GT_Open(0,1) = 0", "GT_Close() = 0"]


@pytest.mark.skipif(sys.platform != "linux", reason="binds processes to one processor as on Linux")
def test_a_busy_computer_takes_no_time(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The program computes for 60 ms, which take much longer, since six others use its processor: it has not waited."""
    source = f"""#define _GNU_SOURCE
#include <sched.h>
#include <signal.h>
#include <time.h>
#include <unistd.h>
{BEGIN}
static double now(clockid_t clock)
{{
    struct timespec t;
    clock_gettime(clock, &t);
    return t.tv_sec * 1e3 + t.tv_nsec / 1e6;
}}
int main(void)
{{
    pid_t others[6];
    cpu_set_t one;
    double began, end;
    CPU_ZERO(&one);
    CPU_SET(sched_getcpu(), &one);
    sched_setaffinity(0, sizeof one, &one);
    for (int i = 0; i < 6; i++)
        if ((others[i] = fork()) == 0)
            for (;;)
                ;
    GT_Open(0, 1);
    began = now(CLOCK_MONOTONIC);
    end = now(CLOCK_PROCESS_CPUTIME_ID) + 60;
    while (now(CLOCK_PROCESS_CPUTIME_ID) < end)
        ;
    printf("%g\\n", now(CLOCK_MONOTONIC) - began);
    GT_Close();
    for (int i = 0; i < 6; i++)
        kill(others[i], SIGKILL);
    return 0;
}}
"""
    recorded(tmp_path, compiled(tmp_path, source))
    assert float(capfd.readouterr().out) > 200
    first, last = times(tmp_path / "calls.gts")
    assert 50 < last - first < 100


@pytest.mark.skipif(sys.platform != "linux", reason="the loader of Linux")
@pytest.mark.parametrize("way", ["rpath", "path"])
def test_the_vendors_library_is_not_loaded(tmp_path: Path, way: str) -> None:
    """A program that was linked with the path to it, and one that names its path."""
    folder = tmp_path / "vendor"
    folder.mkdir()
    source = tmp_path / "vendor.c"
    source.write_text("#include <stdlib.h>\nshort GT_Open(short a, short b) { exit(a + b + 40); }\n", encoding="ascii")
    assert CC is not None
    subprocess.run([CC, "-shared", "-fPIC", "-o", folder / "libgts.so", source], check=True)
    program = tmp_path / "program.py"
    program.write_text(f"import ctypes; ctypes.CDLL('{folder}/libgts.so').GT_Open(0, 1)", encoding="ascii")
    command: tuple[object, ...] = (sys.executable, program)
    if way == "rpath":
        link = (f"-L{folder}", f"-Wl,--disable-new-dtags,-rpath,{folder}")
        command = (compiled(tmp_path, '#include "gts.h"\nint main(void) { return GT_Open(0, 1); }', Abi.GUS, *link),)
    assert subprocess.run(list(map(str, command)), check=False).returncode == 41
    assert recorded(tmp_path, *command).exit_code == 0
    assert calls(tmp_path / "calls.gts") == ["GT_Open(0,1) = 0"]


def test_a_process_that_goes_on(tmp_path: Path) -> None:
    """The program leaves a process behind that still makes calls: its listing stays as it writes it."""
    source = f"""#define _GNU_SOURCE
#include <unistd.h>
{BEGIN}
int main(void)
{{
    int ready[2];
    char c;
    if (pipe(ready) != 0)
        return 1;
    if (fork() == 0) {{
        begin();
        if (write(ready[1], "x", 1) != 1)
            return 1;
        usleep(700000);
        GT_Close();
        return 0;
    }}
    return read(ready[0], &c, 1) == 1 ? 0 : 1;
}}
"""
    recording = recorded(tmp_path, compiled(tmp_path, source))
    assert recording.is_cut
    assert calls(tmp_path / "calls.gts") == OPENED
    end = time.monotonic() + 20
    while len(calls(tmp_path / "calls.gts")) == 3 and time.monotonic() < end:
        time.sleep(0.05)
    assert calls(tmp_path / "calls.gts") == [*OPENED, "GT_Close() = 0"]
    assert "ended" not in (tmp_path / "calls.gts").read_text(encoding="ascii")


def test_it_is_read_back(tmp_path: Path) -> None:
    """The report of a recorded program is that of its calls one by one, apart from their lines."""
    body = """
short run; long segment;
begin();
GT_SetAxisMode(7, 1); GT_LaserPowerMode(0, 100, 0, 0); GT_LaserOutFrq(10, 0);
for (int stage = 0; stage < 2; stage++) {
    GT_BufLaserOn(1, 0, 0);
    for (int i = 1; i <= 4; i++) {
        GT_BufLaserPrfCmd(1, 10.5 * i, 0, 0);
        if (i != 3)
            GT_LnXY(1, 2000 * i, stage ? 3000 : 0, i == 2 ? 80 : 50, 2, 0, 0);
    }
    GT_BufLaserOff(1, 0, 0);
    GT_CrdStart(1, 0);
    do GT_CrdStatus(1, &run, &segment, 0); while (run);
    GT_CrdClear(1, 0);
}
"""
    by_hand = [
        OPENED[1].removesuffix(" = 0"),
        "GT_CrdClear(1,0)",
        "GT_SetAxisMode(7,1)",
        "GT_LaserPowerMode(0,100,0,0)",
    ]
    by_hand += ["GT_LaserOutFrq(10,0)"]
    for y in (0, 3000):
        by_hand.append("GT_BufLaserOn(1,0,0)")
        for i, vel in ((1, 50), (2, 80), (3, 0), (4, 50)):
            by_hand.append(f"GT_BufLaserPrfCmd(1,{10.5 * i},0,0)")
            by_hand += [f"GT_LnXY(1,{2000 * i},{y},{vel},2,0,0)"] if vel else []
        by_hand += ["GT_BufLaserOff(1,0,0)", "GT_CrdStart(1,0)", "GT_CrdStatus(1,run,segment,0)", "GT_CrdClear(1,0)"]
    (tmp_path / "by_hand.gts").write_text("\n".join(by_hand) + "\n", encoding="ascii")
    of_c(tmp_path, body)
    reports = [
        json.loads(gusjob("report", "--format", "json", tmp_path / f"{name}.gts").stdout)
        for name in ("calls", "by_hand")
    ]
    for report in reports:
        del report["job"], report["segments"]["line"], report["diagnostics"]
        report.pop("marks", None)
    assert len(reports[0]["segments"]["kind"]) == 6
    assert reports[0] == reports[1]


def test_every_line_is_whole_when_a_program_breaks_off(tmp_path: Path) -> None:
    """Also when the last reading is shorter than the one that it replaces."""
    body = """
double pos[2];
begin(); GT_LnXY(1, 1000, -700, 50, 20, 0, 0); GT_CrdStart(1, 0);
for (int i = 0; i < atoi(args[1]); i++)
    GT_GetCrdPos(1, pos);
kill(getpid(), 9);
"""
    head = "#define _GNU_SOURCE\n#include <signal.h>\n#include <unistd.h>\n"
    source = f"{head}{BEGIN}\nint main(int n, char **args)\n{{{body}}}\n"
    program = compiled(tmp_path, source)
    lengths = []
    for polls in range(1, 11):
        recorded(tmp_path, program, polls)
        (last,) = lines(tmp_path / "calls.gts")[5:]
        lengths.append(len(last.partition(" // ")[0]))
        assert LINE.fullmatch(last.rstrip())
        assert re.search(rf" // {polls} times, the last at [0-9.]+ *$", last) or polls == 1
    assert any(after < before for before, after in itertools.pairwise(lengths))


def test_an_origin_at_the_head_and_a_given_one(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Positions count from there; without the flag originPos is not looked at."""
    body = r"""
double pos[2]; short run; long segment;
begin(); GT_LnXY(1, 1000, -300, 50, 20, 0, 0); GT_CrdStart(1, 0);
do GT_CrdStatus(1, &run, &segment, 0); while (run);
GT_GetCrdPos(1, pos); printf("%g %g\n", pos[0], pos[1]);
prm.setOriginFlag = 0; prm.originPos[0] = 2147483647;
if (GT_SetCrdPrm(1, &prm)) return 1;
GT_GetCrdPos(1, pos); printf("%g %g\n", pos[0], pos[1]);
prm.setOriginFlag = 1; prm.originPos[0] = 5000; prm.originPos[1] = -2000;
if (GT_SetCrdPrm(1, &prm)) return 1;
GT_GetCrdPos(1, pos); printf("%g %g\n", pos[0], pos[1]);
"""
    assert of_c(tmp_path, body).exit_code == 0
    assert capfd.readouterr().out.splitlines() == ["1000 -300", "0 0", "-4000 1700"]


def test_an_axis_that_is_switched_off_in_motion(tmp_path: Path) -> None:
    """The motion stops, and the listing says it in a call that its reader knows."""
    body = """
short GT_AxisOff(short); double pos[2];
begin(); GT_LnXY(1, 100000, 0, 50, 2, 0, 0); GT_CrdStart(1, 0);
for (int i = 0; i < 100; i++) GT_GetCrdPos(1, pos);
GT_AxisOff(3); GT_AxisOff(1); GT_AxisOff(2); GT_Close();
"""
    of_c(tmp_path, body)
    off = lines(tmp_path / "calls.gts")[6:]
    assert [line.partition("] ")[2] for line in off] == [
        "GT_AxisOff(3) = 0",
        "GT_AxisOff(1) = 0",
        "GT_Stop(256,256) = 0 // by GT_AxisOff",
        "AT_REST(1)",
        "GT_AxisOff(2) = 0",
        "GT_Close() = 0",
    ]
    assert times(tmp_path / "calls.gts")[7] == times(tmp_path / "calls.gts")[8] == times(tmp_path / "calls.gts")[9]


def test_nothing_is_replaced_if_the_program_does_not_start(tmp_path: Path) -> None:
    before = "// recorded by gusjob record, ABI gus\n// my notes\n"
    (tmp_path / "calls.gts").write_text(before, encoding="ascii")
    assert not isinstance(record(RecordOptions(command=("./none",), output=tmp_path / "calls.gts")), Recording)
    assert not isinstance(record(RecordOptions(command=(), output=tmp_path / "calls.gts")), Recording)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"calls.gts": before}


def test_a_second_recording_with_the_same_name_is_refused(tmp_path: Path) -> None:
    """While the first one runs; also after its gusjob was killed, as long as its program makes calls."""
    source = f"""#define _GNU_SOURCE
#include <unistd.h>
{BEGIN}
int main(void) {{ char c; begin(); return write(1, "x", 1) != 1 || read(0, &c, 1) < 0; }}
"""
    program = compiled(tmp_path, source)
    for kills in (False, True):
        command = [sys.executable, "-m", "gusjob", "record", "-o", str(tmp_path / "calls.gts"), "--", str(program)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
            assert process.stdin is not None and process.stdout is not None
            assert process.stdout.read(1) == b"x"
            if kills:
                process.kill()
                process.wait()
            refused = record(RecordOptions(command=("true",), output=tmp_path / "calls.gts"))
            assert isinstance(refused, str) and "another recording writes this listing" in refused
            assert record(RecordOptions(command=("true",), output=tmp_path / "other.gts"))
            process.stdin.close()
            process.stdout.read()
        assert calls(tmp_path / "calls.gts") == OPENED
        assert process.returncode == (-9 if kills else 0)


def test_a_link_as_output(tmp_path: Path) -> None:
    """The listing is written where it leads."""
    (tmp_path / "deep").mkdir()
    (tmp_path / "calls.gts").symlink_to(tmp_path / "deep" / "real.gts")
    for _ in range(2):
        assert of_c(tmp_path, "GT_Open(0, 1);").calls == 1
    assert (tmp_path / "calls.gts").is_symlink()
    assert calls(tmp_path / "deep" / "real.gts") == ["GT_Open(0,1) = 0"]


def test_the_clock_goes_on(tmp_path: Path) -> None:
    """A program that waits with it for 100 ms."""
    body = """
short GT_GetClock(unsigned long *, unsigned long *); unsigned long now, end;
begin(); GT_GetClock(&now, 0);
for (end = now + 100; now < end;) GT_GetClock(&now, 0);
"""
    of_c(tmp_path, body)
    (line,) = [line for line in lines(tmp_path / "calls.gts") if "Clock" in line]
    assert line.startswith("[2.06] GT_GetClock(10") and " // 5" in line


def test_many_kinds_of_readings(tmp_path: Path) -> None:
    """A monitor's: each has one line, and what is no reading stays where it is."""
    body = """
double pos[8]; long status; unsigned long now; short run; long segment;
short GT_GetSts(short, long *, short, unsigned long *); short GT_GetPrfPos(short, double *, short, unsigned long *);
short GT_GetClock(unsigned long *, unsigned long *); short GT_ClrSts(short, short);
begin();
for (int i = 0; i < 500; i++) {
    for (short axis = 1; axis <= 8; axis++) { GT_GetSts(axis, &status, 1, 0); GT_GetPrfPos(axis, pos, 1, 0); }
    GT_GetClock(&now, 0); GT_CrdStatus(1, &run, &segment, 0); GT_GetCrdPos(1, pos);
}
GT_ClrSts(1, 8); GT_ClrSts(1, 8);
"""
    of_c(tmp_path, body)
    assert len(calls(tmp_path / "calls.gts")) == 3 + 19 + 2


def test_a_position_in_three_dimensions(tmp_path: Path) -> None:
    body = """
double pos[4] = {7, 7, 7, 7};
prm.dimension = 3; prm.profile[2] = 3;
begin(); GT_GetCrdPos(1, pos);
return pos[2] == 0 && pos[3] == 7 ? 0 : 1;
"""
    assert of_c(tmp_path, body).exit_code == 0
    assert calls(tmp_path / "calls.gts")[-1] == "GT_GetCrdPos(1,{0,0,0}) = 0"


def test_wrong_variables_are_named(tmp_path: Path) -> None:
    program = compiled(tmp_path, f"{BEGIN}int main(void) {{ return GT_Open(0, 1); }}")
    variable = "DYLD_LIBRARY_PATH" if sys.platform == "darwin" else "LD_LIBRARY_PATH"
    environ = {variable: str(tmp_path / "link"), "GUSJOB_RECORD_TIME": "slow", "GUSJOB_RECORD_LIMIT": "1e6"}
    done = subprocess.run([program], cwd=tmp_path, env=environ, check=True, capture_output=True, text=True)
    assert done.stderr.splitlines() == [
        "gusjob record: GUSJOB_RECORD_TIME: not fast or real: slow",
        "gusjob record: GUSJOB_RECORD_LIMIT: not a whole number from 1 on: 1e6",
    ]


def test_more_than_a_thousand_processes(tmp_path: Path) -> None:
    source = f"""#define _GNU_SOURCE
#include <sys/wait.h>
#include <unistd.h>
{BEGIN}
int main(void)
{{
    for (int i = 0; i < 1200; i++) {{
        if (fork() == 0) {{ GT_Open(0, 1); _exit(0); }}
        wait(0);
    }}
    return 0;
}}
"""
    assert len(recorded(tmp_path, compiled(tmp_path, source)).listings) == 1200


@pytest.mark.skipif(sys.platform != "linux", reason="the loader of Linux")
@pytest.mark.parametrize("name", ["libgts.so.1", "libGTS.so", "gts.dll", "GTS.dll", "libgts.so.2.1"])
def test_other_names_of_the_vendors_library(tmp_path: Path, name: str) -> None:
    """By their path, with a version, in other letters."""
    source = tmp_path / "vendor.c"
    source.write_text("#include <stdlib.h>\nshort GT_Open(short a, short b) { exit(a + b + 40); }\n", encoding="ascii")
    assert CC is not None
    subprocess.run([CC, "-shared", "-fPIC", "-o", tmp_path / name, source], check=True)
    program = tmp_path / "program.py"
    program.write_text(f"import ctypes; ctypes.CDLL('{tmp_path}/{name}').GT_Open(0, 1)", encoding="ascii")
    assert recorded(tmp_path, sys.executable, program).exit_code == 0
    assert calls(tmp_path / "calls.gts") == ["GT_Open(0,1) = 0"]


@pytest.mark.skipif(sys.platform != "linux", reason="the loader of Linux")
def test_a_process_that_loads_the_library_late(tmp_path: Path) -> None:
    """When the program and its recording are over."""
    script = tmp_path / "late.py"
    script.write_text(
        "import ctypes, sys\nprint(flush=True)\nsys.stdin.read()\nctypes.CDLL('libgts.so').GT_Open(0, 1)\n",
        encoding="ascii",
    )
    program = tmp_path / "program.py"
    program.write_text(
        "import subprocess, sys\n"
        f"late = subprocess.Popen([sys.executable, {str(script)!r}], stdin=open(sys.argv[1]), stdout=subprocess.PIPE)\n"
        "late.stdout.readline()\n",
        encoding="ascii",
    )
    os.mkfifo(tmp_path / "pipe")
    held = os.open(tmp_path / "pipe", os.O_RDWR)
    recorded(tmp_path, sys.executable, program, tmp_path / "pipe")
    os.close(held)  # Its input ends.
    end = time.monotonic() + 20
    while not (tmp_path / "calls.gts").exists() and time.monotonic() < end:
        time.sleep(0.05)
    time.sleep(0.1)
    assert calls(tmp_path / "calls.gts") == ["GT_Open(0,1) = 0"]


@pytest.mark.skipif(sys.platform != "linux", reason="the loader of Linux")
def test_a_cache_that_the_loader_can_not_take(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "a:b"))
    with pytest.raises(BuildError, match="the loader takes no path with : ;"):
        record(RecordOptions(command=("true",), output=tmp_path / "calls.gts"))


def test_the_vendors_library_in_wine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wine searches its own folders first, in whatever letters."""
    monkeypatch.setenv("WINEPREFIX", str(tmp_path / "prefix"))
    options = RecordOptions(command=("true",), output=tmp_path / "calls.gts", target=Target.X86_64_WINDOWS)
    assert vendor_library(options) is None
    folder = tmp_path / "prefix" / "drive_c" / "windows" / "system32"
    folder.mkdir(parents=True)
    (folder / "GTS.DLL").write_bytes(b"the vendor's own")
    found = vendor_library(options)
    assert found is not None and found.name == "GTS.DLL"


def test_the_folder_of_the_listing_vanishes(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    body = f'begin(); if (system("rm -r {tmp_path}/there") != 0) return 1;'
    program = compiled(tmp_path, f"{BEGIN}\nint main(void)\n{{\n{body}\nreturn 0;\n}}\n")
    recording = record(RecordOptions(command=(str(program),), output=tmp_path / "there" / "calls.gts"))
    assert isinstance(recording, Recording)
    assert (recording.exit_code, recording.is_cut, recording.listings) == (0, True, ())


def test_parameters_that_were_not_cleared(tmp_path: Path) -> None:
    """What the call does not need is not looked at."""
    body = """
memset(&prm, 0x55, sizeof prm);
prm.dimension = 2; prm.profile[0] = 1; prm.profile[1] = 2;
prm.synVelMax = 500; prm.synAccMax = 20; prm.evenTime = 0; prm.setOriginFlag = 0;
begin();
return GT_LnXY(1, 1000, 0, 50, 2, 0, 0);
"""
    program = compiled(tmp_path, f"#include <string.h>\n{BEGIN}\nint main(void)\n{{{body}}}\n")
    assert recorded(tmp_path, program).exit_code == 0


def test_a_stop_in_the_last_ramp(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """It leaves the switch behind the motion, as in the report of the listing."""
    body = r"""
double pos[2]; short run; long segment, left; unsigned short on;
short GT_GetHSIOOpt(unsigned short *, short);
begin(); GT_BufLaserOn(1, 0, 0); GT_LnXY(1, 10000, 0, 50, 2, 0, 0); GT_BufLaserOff(1, 0, 0); GT_CrdStart(1, 0);
do GT_GetCrdPos(1, pos); while (pos[0] < 9700);
GT_Stop(0x100, 0);
do GT_CrdStatus(1, &run, &segment, 0); while (run);
GT_GetCrdPos(1, pos); GT_CrdSpace(1, &left, 0); GT_GetHSIOOpt(&on, 0);
printf("%g %ld %d\n", pos[0], left, on);
"""
    of_c(tmp_path, body)
    assert capfd.readouterr().out == "10000 4095 1\n"
    assert "GT_GetHSIOOpt reads 1 on channel 0" in gusjob("report", tmp_path / "calls.gts", "--table").stdout
