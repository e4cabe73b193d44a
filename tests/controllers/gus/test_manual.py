"""The manual's routines, pasted as they stand, with their broken lines: read, checked, interpreted, compiled."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.tools import ROOT, calls_of, run_listing

from gusjob.diagnostics.model import Severity
from gusjob.pipeline import examine_file

MANUAL = ROOT / "tests" / "manual"


def text_of(name: str) -> str:
    return (MANUAL / f"{name}.c").read_text(encoding="utf-8")


def own_calls(name: str) -> list[str]:
    """The routine's calls by a plain regex, arrays put in by hand."""
    arrays = {"pos": "{0,0,0,0}", "scale": "{1000,1000,1000,1000}", "ratio": "{0.1,0.1,0.1,0.1}"}
    found = []
    for call in re.findall(r"GT_\w+\([^)]*\)", "\n".join(s.split("//")[0] for s in text_of(name).splitlines())):
        for array, value in arrays.items():
            call = re.sub(rf"\b{array}\b", value, call)
        found.append(call.replace(",00)", ",0)"))
    return found


@pytest.mark.parametrize("path", sorted(MANUAL.glob("*.c")), ids=lambda p: p.stem)
def test_every_line_is_read(path: Path) -> None:
    diagnostics = examine_file(path, None).diagnostics
    assert [f.message for f in diagnostics if f.severity is Severity.ERROR] == []


@pytest.mark.parametrize(
    ("name", "unit", "power"), [("311_duty", "%", 25), ("312_frequency", "kHz", 20), ("313_analog", "V", 2.5)]
)
def test_immediate_routines_leave_the_laser_on(name: str, unit: str, power: float) -> None:
    ran = run_listing(text_of(name))
    (channel,) = ran.report.totals["channels"]
    assert (channel["unit"], channel["lit_at_end"]) == (unit, True)
    assert "GJ708" in ran.codes()
    # The manual shows no motion: no time passes, no light is counted. One dwell shows the power that stands.
    ran = run_listing(text_of(name) + "GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n")
    assert ran.column("ch0_power_ms") == [pytest.approx(10 * power)]


def test_analog_routine_gets_the_warning_of_its_own_comment() -> None:
    assert "GJ702" in run_listing(text_of("313_analog")).codes()


def test_direct_routine() -> None:
    # 100 mm at 50 pulse/ms and 2 pulse/ms2: 25 ms up, 25 ms down over 625 pulse each, the rest at 50.
    first = 25 + 25 + (100_000 - 1250) / 50
    diagonal = (100_000**2 + 10_000**2) ** 0.5
    second = 50 + (diagonal - 1250) / 50
    ran = run_listing(text_of("43_direct"))
    assert ran.column("duration_ms") == pytest.approx([first, second], rel=1e-12)
    assert ran.column("ch0_power_ms") == pytest.approx([50 * first, 30 * second], rel=1e-12)
    assert ran.column("ch0_emission_ms") == pytest.approx([first, second], rel=1e-12)


def test_follow_routine() -> None:
    # x = 0.1*vel + 10, sampled every 0.25 ms and held. Segment 1 starts on a tick, all its corners fall on ticks (25,
    # 2000, 2025 ms): held from the left, the ramp up lacks what the ramp down has too much, so the sum is the integral:
    # 10 * 2025 + 0.1 * 100000 pulse = 30250 %*ms.
    ran = run_listing(text_of("43_follow"))
    energy = ran.column("ch0_power_ms")
    assert energy[0] == pytest.approx(30250, rel=1e-12)
    # Segment 2 begins on the tick at 2025 ms; 25 ms up; its end lies between ticks. Sum the ticks by hand.
    diagonal = (100_000**2 + 10_000**2) ** 0.5
    duration = 50 + (diagonal - 1250) / 50
    total, tick = 0.0, 0
    while tick * 0.25 < duration:
        t = tick * 0.25
        vel = min(2 * t, 50, 2 * (duration - t))
        total += (0.1 * vel + 10) * min(0.25, duration - t)
        tick += 1
    assert energy[1] == pytest.approx(total, rel=1e-9)
    assert ran.column("ch0_power_max") == pytest.approx([15, 15])
    assert ran.column("ch0_power_min") == pytest.approx([10, 10], abs=0.05)


def test_distance_routine() -> None:
    # follow 0.1*vel + 0, at most 10 (never reached: 5), plus 0.1 % per mm in X and in Y, all within 10..100: at the
    # far end of segment 1 the distance is 100 mm and the velocity 0, a tick before it 0.5 pulse/ms.
    ran = run_listing(text_of("53_distance"))
    total = 0.0
    for tick in range(8100):
        t = tick * 0.25
        vel = min(2 * t, 50, 2 * (2025 - t))
        x = t * t if t < 25 else 625 + 50 * (t - 25) if t < 2000 else 100_000 - (2025 - t) ** 2
        total += min(max(0.1 * vel + 0.1 * x / 1000, 10), 100) * 0.25
    assert ran.column("ch0_power_ms")[0] == pytest.approx(total, rel=1e-9)
    assert ran.column("ch0_power_max")[0] == pytest.approx(0.1 * 50 + 0.1 * 99.375, rel=1e-9)


@pytest.mark.parametrize("name", ["311_duty", "312_frequency", "313_analog", "43_direct", "43_follow", "53_distance"])
def test_calls_of_the_routines_are_read_unchanged(name: str) -> None:
    from gusjob.controllers.gus.listing import listing
    from gusjob.frontend import check_text, read_listing

    source, _ = check_text(text_of(name).encode(), "x.c")
    assert source is not None
    stream, diagnostics = read_listing(source)
    assert diagnostics == []
    assert "".join(listing(stream)).splitlines() == own_calls(name)


def test_jobs_compile_to_the_manuals_calls() -> None:
    """LOOKAHEAD OFF gives 四.3's first routine call for call, behind GT_SetCrdPrm (language.md)."""
    compiled = calls_of((ROOT / "jobs" / "manual_direct.job").read_text(encoding="utf-8"))
    assert [c for c in compiled if not c.startswith("GT_SetCrdPrm")] == [
        "GT_SetAxisMode(7,1)",
        "GT_LaserPowerMode(0,100,0,0)",
        "GT_LaserOutFrq(10,0)",
        "GT_CrdClear(1,0)",
        "GT_BufLaserOn(1,0,0)",
        "GT_BufLaserPrfCmd(1,50,0,0)",
        "GT_LnXY(1,100000,0,50,2,0,0)",
        "GT_BufLaserPrfCmd(1,30,0,0)",
        "GT_LnXY(1,0,10000,50,2,0,0)",
        "GT_BufLaserOff(1,0,0)",
        "GT_CrdStart(1,0)",
    ]
