"""A Windows program with the library that is built for it, under Wine."""

from __future__ import annotations

import math
import os
import subprocess
from pathlib import Path

import pytest
from support.recorded import WINE, calls, compiled_for_windows, lines, needs_wine, times

from gusjob.config.machine import Abi
from gusjob.record.build import Target
from gusjob.record.recording import Recording, RecordOptions, record, write_library

pytestmark = [needs_wine, pytest.mark.slow]

PROGRAM = """
#include <stdio.h>
#include <windows.h>
typedef struct {
    short dimension, profile[8];
    double synVelMax, synAccMax;
    short evenTime, setOriginFlag;
    long originPos[8];
} TCrdPrm;
#define FUNCTION(name, ...) short (__stdcall *name)(__VA_ARGS__) = (void *)GetProcAddress(gts, "GT_" #name)
int main(void)
{
    HMODULE gts = LoadLibraryA("gts.dll");
    TCrdPrm prm = {2, {1, 2}, 500, 20, 0, 1, {0, -7}};
    short run;
    long segment;
    if (!gts)
        return 3;
    FUNCTION(Open, short, short);
    FUNCTION(SetCrdPrm, short, TCrdPrm *);
    FUNCTION(BufLaserFollowRatio, short, double, double, double, short, short);
    FUNCTION(LnXY, short, long, long, double, double, double, short);
    FUNCTION(CrdStart, short, short);
    FUNCTION(CrdStatus, short, short *, long *, short);
    Open(0, 1);
    SetCrdPrm(1, &prm);
    BufLaserFollowRatio(1, 0.5, 1, 99.5, 0, 0);
    for (int i = 1; i < 4; i++)
        LnXY(1, 1000 * i, -500 * i, 50, 2, 0, 0);
    CrdStart(1, 0);
    do {
        CrdStatus(1, &run, &segment, 0);
        Sleep(20);
    } while (run);
    return segment == 4 ? 0 : 4;
}
"""
SENT = [
    "GT_Open(0,1) = 0",
    "GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},500,20,0,1,{0,-7,0,0,0,0,0,0}}) = 0",
    "GT_BufLaserFollowRatio(1,0.5,1,99.5,0,0) = 0",
    *(f"GT_LnXY(1,{1000 * i},{-500 * i},50,2,0,0) = 0" for i in (1, 2, 3)),
    "GT_CrdStart(1,0) = 0",
]


@pytest.fixture(scope="module", name="quiet")
def _quiet(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment for Wine with a prefix of its own."""
    return {**os.environ, "WINEDEBUG": "-all", "WINEPREFIX": str(tmp_path_factory.mktemp("wine"))}


def test_a_program_under_wine(tmp_path: Path, quiet: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("WINEDEBUG", "WINEPREFIX"):
        monkeypatch.setenv(name, quiet[name])
    program = compiled_for_windows(tmp_path, PROGRAM)
    assert WINE is not None
    options = RecordOptions(
        command=(WINE, str(program)), output=tmp_path / "calls.gts", abi=Abi.GTS, target=Target.X86_64_WINDOWS
    )
    recording = record(options)
    assert isinstance(recording, Recording)
    assert recording.exit_code == 0
    assert calls(tmp_path / "calls.gts")[: len(SENT)] == SENT
    rest = next(i for i, line in enumerate(lines(tmp_path / "calls.gts")) if "AT_REST(1)" in line)
    at = times(tmp_path / "calls.gts")
    # To rest and back, without reaching 50 pulse/ms. The origin is at y = -7, so the first way is longer.
    took_ms = sum(2 * math.sqrt(math.hypot(1000, y) / 2) for y in (507, 500, 500))
    assert at[rest] - at[len(SENT) - 1] == pytest.approx(took_ms, abs=1e-3)


def test_a_library_beside_the_program(tmp_path: Path, quiet: dict[str, str]) -> None:
    """As it is used on another computer: without gusjob there."""
    paths = write_library(tmp_path, Abi.GTS, Target.X86_64_WINDOWS)
    assert paths == [tmp_path / "gts.dll"]
    program = compiled_for_windows(tmp_path, PROGRAM)
    assert WINE is not None
    for _ in range(2):
        subprocess.run([WINE, program], cwd=tmp_path, env=quiet, check=True)
    for name in ("calls.gts", "calls.2.gts"):
        assert calls(tmp_path / name)[: len(SENT)] == SENT


def test_the_vendors_library_beside_the_program(tmp_path: Path) -> None:
    """Windows would load it first, and the program would drive the real controller: it is not started."""
    (tmp_path / "gts.dll").write_bytes(b"the vendor's own")
    program = compiled_for_windows(tmp_path, PROGRAM)
    assert WINE is not None
    options = RecordOptions(
        command=(WINE, str(program)), output=tmp_path / "calls.gts", abi=Abi.GTS, target=Target.X86_64_WINDOWS
    )
    refused = record(options)
    assert isinstance(refused, str)
    assert refused.startswith(f"{tmp_path}/gts.dll would be loaded in place of the stand-in")
    assert not (tmp_path / "calls.gts").exists()
