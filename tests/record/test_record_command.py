"""`gusjob record`: options, messages, exit status, signals."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import pytest
from support.cli import gusjob, write
from support.recorded import CC, calls, compiled, needs_compiler

from gusjob.cli.record_command import command
from gusjob.config.machine import Abi
from gusjob.record.build import Target

pytestmark = needs_compiler

PROGRAM = (
    '#include "gts.h"\n#include <stdlib.h>\nint main(int n, char **a) { GT_Open(0, 1); return n > 1 ? atoi(a[1]) : 0; }'
)


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture(name="program")
def _program(tmp_path: Path) -> Path:
    return compiled(tmp_path, PROGRAM)


def test_it_records(tmp_path: Path, program: Path) -> None:
    done = gusjob("record", "--", program)
    assert (done.exit_code, done.output) == (0, f"gusjob: 1 line recorded in {tmp_path}/calls.gts\n")
    assert calls(tmp_path / "calls.gts") == ["GT_Open(0,1) = 0"]
    quiet = gusjob("record", "-q", "--", program)
    assert (quiet.exit_code, quiet.output) == (0, "")


def test_a_program_that_fails(tmp_path: Path, program: Path) -> None:
    """Its listing is written; the exit status is 1, whatever the program's code is."""
    done = gusjob("record", "-o", "a.gts", "--", program, 2)
    assert done.exit_code == 1
    assert done.output.splitlines() == [
        f"gusjob: 1 line recorded in {tmp_path}/a.gts",
        "gusjob: the program ended with exit code 2",
    ]
    assert gusjob("record", "-q", "--", program, 2).output == "gusjob: the program ended with exit code 2\n"


def test_a_program_that_is_found_in_the_path(tmp_path: Path) -> None:
    """It runs without a shell: its arguments are its own."""
    program = write(tmp_path, "import sys; print(sys.argv[1:])", "program.py")
    command = [
        sys.executable,
        "-m",
        "gusjob",
        "record",
        "--",
        Path(sys.executable).name,
        str(program),
        "a b",
        "$X",
        "-o",
    ]
    environ = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(command, capture_output=True, text=True, env=environ, check=False)
    assert done.stdout == "['a b', '$X', '-o']\n"
    assert done.returncode == 1
    assert done.stderr.startswith("gusjob: the program made no call of the stand-in: ")
    assert not (tmp_path / "calls.gts").exists()


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ([], "there is no program: write it after --"),
        (["--fault", "GT_LnXY", "--", "x"], "GT_LnXY: write NAME:N:CODE"),
        (["--fault", "GT_LnXY:0:1", "--", "x"], "GT_LnXY:0:1: write NAME:N:CODE"),
        (["--fault", "GT_LnXY:1:0", "--", "x"], "GT_LnXY:1:0: code 0 is no fault"),
        (["--fault", "GT_Lnxy:1:1", "--", "x"], "GT_Lnxy is not a function of the library"),
        (["--library-name", "../x.so", "--", "x"], "../x.so is not a file name"),
        (["--abi", "gtn", "--", "x"], "'gtn' is not one of 'gus', 'gts', 'gts-multi'"),
        (["--limit", "0", "--", "x"], "0 is not in the range"),
        (["--build-library", "lib", "--", "x"], "--build-library runs no program"),
        (["--", "./none"], "gusjob: ./none: can't be started: no such file or directory"),
        (["-o", "none/calls.gts", "--", "true"], "none/calls.gts: can't write: no such file or directory"),
        (["-o", "/dev/null", "--", "true"], "/dev/null: can't write: it is not a file"),
        (["-o", "program", "--", "./program"], "program is an input of this command"),
        (["-o", "job.gts", "--", "true"], "job.gts is not a recorded listing"),
        (["-o", "in.gts", "--", "true", "./in.gts"], "in.gts is an input of this command"),
    ],
)
def test_wrong_usage(tmp_path: Path, program: Path, args: list[str], message: str) -> None:
    write(tmp_path, "GT_Close()\n", "job.gts")
    write(tmp_path, "// recorded by gusjob record\n", "in.gts")
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    done = gusjob("record", *args)
    assert done.exit_code == 2
    assert message in done.output
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


@pytest.mark.skipif(sys.platform != "linux", reason="the loader of Linux")
def test_a_missing_function_is_named(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A program of a newer library. The loader ends it at the call, or before it begins."""
    newer = tmp_path / "newer"
    newer.mkdir()
    functions = write(
        newer, "short GT_Open(short a, short b) { return a + b; } short GT_Teleport(short a) { return a; }", "x.c"
    )
    assert CC is not None
    subprocess.run([CC, "-shared", "-fPIC", "-o", newer / "libgts.so", functions], check=True)
    source = '#include "gts.h"\nshort GT_Teleport(short);\nint main(void) { GT_Open(0, 1); return GT_Teleport(1); }'
    program = compiled(tmp_path, source, Abi.GUS, f"-L{newer}", "-Wl,-z,lazy")
    done = gusjob("record", "--", program)
    assert done.exit_code == 1
    assert "GT_Teleport" in capfd.readouterr().err
    assert calls(tmp_path / "calls.gts") == ["GT_Open(0,1) = 0"]
    assert done.output.splitlines()[1:] == [
        "gusjob: the program ended with exit code 127",
        "gusjob: the stand-in lacks GT_Teleport, which the program names: leave these calls out to record it",
    ]


def test_faults_and_the_abi_of_the_profile(tmp_path: Path) -> None:
    write(tmp_path, '[controller]\nabi = "gts"\n', "gusjob.toml")
    program = compiled(
        tmp_path, '#include "gts.h"\nint main(void) { GT_Open(0, 1); return GT_Open(0, 1) == -6 ? 0 : 9; }'
    )
    assert gusjob("record", "--fault", "GT_Open:2:-6", "--", program).exit_code == 0
    assert (tmp_path / "calls.gts").read_text().startswith("// recorded by gusjob record, ABI gts, time fast\n")
    assert calls(tmp_path / "calls.gts") == ["GT_Open(0,1) = 0", "GT_Open(0,1) = -6"]


def test_a_broken_profile(tmp_path: Path, program: Path) -> None:
    """The ABI that it names must not be ignored."""
    write(tmp_path, '[controller]\nabi = "gtx"\n', "gusjob.toml")
    done = gusjob("record", "--", program)
    assert (done.exit_code, (tmp_path / "calls.gts").exists()) == (2, False)
    assert done.output.endswith("; the ABI is not known: correct it, or use --abi\n")
    assert gusjob("record", "--abi", "gus", "--", program).exit_code == 0


@pytest.mark.skipif(sys.platform == "win32" or sys.maxsize < 2**32, reason="long has 64 bits")
def test_a_program_that_declares_int(tmp_path: Path) -> None:
    """It passes negative places, and has room for 32 bits where the answer goes."""
    source = """
#include <string.h>
short GT_Open(short, short); short GT_SetCrdPrm(short, void *); short GT_CrdClear(short, short);
short GT_LnXY(short, int, int, double, double, double, short); short GT_CrdSpace(short, int *, short);
static struct {
    short dimension, profile[8];
    double vel, acc;
    short even, flag;
    int origin[8];
} prm = {2, {1, 2}, 500, 20, 0, 1, {0, -7}};
int main(void)
{
    int space[2] = {0, 77};
    GT_Open(0, 1); GT_SetCrdPrm(1, &prm); GT_LnXY(1, -10000, -1, 50, 2, 0, 0); GT_CrdSpace(1, space, 0);
    return space[1] != 77;
}
"""
    program = compiled(tmp_path, source)
    done = gusjob("record", "--long", 32, "--", program)
    assert (done.exit_code, "--long" in done.output) == (0, False)
    sent = [
        "GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},500,20,0,1,{0,-7,0,0,0,0,0,0}}) = 0",
        "GT_LnXY(1,-10000,-1,50,2,0,0) = 0",
    ]
    assert calls(tmp_path / "calls.gts") == ["GT_Open(0,1) = 0", *sent, "GT_CrdSpace(1,4095,0) = 0"]
    done = gusjob("record", "--", program)
    assert "record it with --long 32" in done.output
    assert "GT_LnXY(1,4294957296,4294967295,50,2,0,0) = 7" in calls(tmp_path / "calls.gts")


def test_the_inputs(tmp_path: Path) -> None:
    source = '#include "gts.h"\nint main(void) { long d; GT_Open(0, 1); GT_GetDi(0, &d); return d != 5; }'
    assert gusjob("record", "--di", 5, "--", compiled(tmp_path, source)).exit_code == 0


@pytest.mark.skipif(sys.platform != "linux", reason="ELF programs")
def test_why_there_is_no_call(tmp_path: Path) -> None:
    """What the program's file shows."""
    source = write(tmp_path, "int main(void) { return 0; }", "x.c")
    assert CC is not None
    subprocess.run([CC, "-o", tmp_path / "plain", source], check=True)
    done = gusjob("record", "--", "./plain")
    assert done.exit_code == 1
    assert "no call of the stand-in: it loads no library of the vendor, one of another name" in done.output
    if subprocess.run([CC, "-static", "-o", tmp_path / "static", source], check=False).returncode == 0:
        assert "static is linked statically: it loads no library" in gusjob("record", "--", "./static").output
    (tmp_path / "x.exe").write_bytes(b"MZ".ljust(60, b"\0") + struct.pack("<I4sH", 64, b"PE\0\0", 0x14C))
    done = gusjob("record", "--", "true", "x.exe")
    assert "x.exe is a Windows program: record it with --target x86-windows" in done.output


def test_another_name_of_the_library(tmp_path: Path) -> None:
    program = write(tmp_path, "import ctypes; ctypes.CDLL('libmotion.so.2').GT_Open(0, 1)", "program.py")
    done = gusjob("record", "--library-name", "libmotion.so.2", "--", sys.executable, program)
    assert done.exit_code == 0
    assert calls(tmp_path / "calls.gts") == ["GT_Open(0,1) = 0"]


def test_the_library_is_written(tmp_path: Path) -> None:
    done = gusjob("record", "--build-library", "lib")
    name = "libgts.dylib" if sys.platform == "darwin" else "libgts.so"
    assert done.exit_code == 0
    assert [path.name for path in (tmp_path / "lib").iterdir()] == [name]
    assert f"lib/{name}" in done.output
    for variable in (
        "GUSJOB_RECORD ",
        "GUSJOB_RECORD_DI",
        "GUSJOB_RECORD_TIME",
        "GUSJOB_RECORD_FAULTS",
        "GUSJOB_RECORD_LIMIT",
    ):
        assert variable in done.output
    assert gusjob("record", "--build-library", "lib").exit_code == 0
    (tmp_path / "lib" / name).write_bytes(b"the vendor's own")
    done = gusjob("record", "--build-library", "lib")
    assert done.exit_code == 2
    assert f"lib/{name} is not a gusjob stand-in" in done.output
    assert (tmp_path / "lib" / name).read_bytes() == b"the vendor's own"


WAITING = """
#include "gts.h"
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>
static void stop(int number) { (void)number; GT_Stop(0x100, 0); GT_Close(); _exit(5); }
int main(void)
{
    alarm(30);
    signal(SIGINT, stop);
    signal(SIGTERM, stop);
    GT_Open(0, 1);
    if (write(1, "x", 1) != 1) return 1;
    for (;;) pause();
}
"""


def test_a_signal_that_comes_early(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The program runs, but its start has not yet returned."""
    program, popen = compiled(tmp_path, WAITING), subprocess.Popen

    def started(args: Any, **options: Any) -> Any:
        if args[0] != str(program):
            return popen(args, **options)
        process = popen(args, **options, stdout=subprocess.PIPE)
        assert process.stdout is not None
        with process.stdout as output:
            assert output.read(1) == b"x"
        os.kill(os.getpid(), signal.SIGTERM)
        return process

    monkeypatch.setattr(subprocess, "Popen", started)
    done = gusjob("record", "--", program)
    assert done.output.splitlines()[-1] == "gusjob: the program ended with exit code 5"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_are_for_the_program(tmp_path: Path, number: signal.Signals) -> None:
    """It ends in its own way, and the recording ends after it."""
    program = compiled(tmp_path, WAITING)
    command = [sys.executable, "-m", "gusjob", "record", "--", str(program)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.read(1) == "x"
        process.send_signal(number)
        _, errors = process.communicate(timeout=30)
    assert process.returncode == 1
    assert errors.splitlines()[-1] == "gusjob: the program ended with exit code 5"
    assert calls(tmp_path / "calls.gts") == ["GT_Open(0,1) = 0", "GT_Stop(256,0) = 0", "GT_Close() = 0"]


def test_the_targets_of_the_option() -> None:
    (option,) = (parameter for parameter in command.params if parameter.name == "target")
    assert isinstance(option.type, click.Choice)
    assert list(option.type.choices) == list(Target)


def test_a_listing_that_is_cut(tmp_path: Path) -> None:
    body = "GT_Open(0, 1); for (int i = 0; i < 40000; i++) GT_LaserPrfCmd(i % 100, 0); return 0;"
    done = gusjob("record", "--limit", 1, "--", compiled(tmp_path, f'#include "gts.h"\nint main(void) {{ {body} }}'))
    assert done.exit_code == 1
    assert "the listing is not complete: it has reached its limit" in done.output
    assert 1_000_000 <= (tmp_path / "calls.gts").stat().st_size < 1_000_300
