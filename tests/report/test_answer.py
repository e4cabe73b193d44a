"""The answer of a report, against figures by hand."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from support.tools import MACHINE, MARK, Ran, run_job, run_listing

from gusjob.config.machine import Laser
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Severity, Span
from gusjob.i18n.width import width as columns_of
from gusjob.report.answer import Answer, Finding, answer_of
from gusjob.report.quantities import duration, energy, length, percent, power_time, short
from gusjob.report.text import report_text

OFF = MARK + "LOOKAHEAD OFF\n"
RATED = replace(MACHINE, lasers=(Laser(channel=0, rated_w=30.0),))


def answer(ran: Ran) -> Answer:
    return answer_of(ran.report, ran.diagnostics)


def named(ran: Ran) -> dict[str, Finding]:
    """What stands out, by name."""
    return {str(finding.name): finding for finding in answer(ran).findings}


@pytest.mark.parametrize(
    ("shown", "text"),
    [
        (short(None), "-"), (short(0.0), "0"), (short(-0.0), "0"), (short(1.23456), "1.23"), (short(5711.36), "5711"),
        (short(20139.4), "20139"), (short(999.6), "1000"), (short(0.00012345), "0.000123"),
        (short(1234.5678, 4), "1235"), (short(123.45678, 4), "123.5"),
        (duration(0.0), "0 ms"), (duration(0.0625), "0.0625 ms"), (duration(999.4), "999 ms"),
        (duration(999.7), "1 s"), (duration(1000.0), "1 s"),
        (duration(33_640.0), "33.6 s"), (duration(599_000.0), "599 s"), (duration(754_400.0), "12 min 34 s"),
        (duration(3_599_700.0), "1 h 00 min"), (duration(11_100_000.0), "3 h 05 min"),
        (length(0.0), "0 mm"), (length(0.045), "45 um"), (length(198.49), "198 mm"), (length(10_176.0), "10.2 m"),
        (length(999.9), "1 m"),
        (energy(124.2), "124 J"), (energy(0.5995), "600 mJ"), (energy(2.5e-5), "25 uJ"), (energy(12_300.0), "12.3 kJ"),
        (energy(0.0), "0 J"),
        (power_time(262_718.0, "%"), "263 %·s"), (percent(0.974), "97 %"), (percent(0.004), "0.4 %"),
    ],
)  # fmt: skip
def test_quantities(shown: str, text: str) -> None:
    assert shown == text


def test_the_headline_of_a_rated_laser() -> None:
    """Two lines of 10 mm at 100 mm/s and 10000 mm/s2 take 110 ms each; 60 % of 30 W for 110 ms are 1.98 J."""
    ran = run_job(OFF + "LASER POWER 60\nJUMP X 10\nLASER ON\nLINE X 20\nLASER OFF\n", RATED)
    assert " · ".join(answer(ran).headline) == (
        "OK, no warnings · 220 ms · laser on 110 ms · peak 60 % (18 W) · 10 mm marked · 1.98 J"
    )
    assert answer(ran).worst is None
    assert named(ran)["time"].text == "marks 50 %, jumps 50 %"


def test_the_headline_without_emission_and_with_two_channels() -> None:
    assert " · ".join(answer(run_job(MARK + "JUMP X 10\n")).headline) == (
        "OK, no warnings · 110 ms · laser never on · 0 mm marked"
    )
    two = MARK + "LASER MODE ANALOG CHANNEL 1\nLASER POWER 5 CHANNEL 1\nLASER POWER 40\nLASER ON\nLASER ON CHANNEL 1\n"
    ran = run_job(two + "LINE X 10\nLASER OFF\nLASER OFF CHANNEL 1\n")
    assert " · ".join(answer(ran).headline) == "OK, no warnings · 110 ms · 10 mm marked"
    assert named(ran)["channel 0"].text == "on 110 ms, peak 40 %, 4.4 %·s"
    assert named(ran)["channel 1"].text == "on 110 ms, peak 5 V, 0.55 V·s"


@pytest.mark.parametrize(
    ("severities", "status", "worst"),
    [
        ([], "OK, no warnings", None),
        ([Severity.NOTE], "OK, no warnings", None),
        ([Severity.WARNING], "OK, 1 warning", Severity.WARNING),
        ([Severity.WARNING, Severity.WARNING, Severity.NOTE], "OK, 2 warnings", Severity.WARNING),
        ([Severity.ERROR], "1 error", Severity.ERROR),
        ([Severity.ERROR, Severity.ERROR, Severity.WARNING], "2 errors, 1 warning", Severity.ERROR),
    ],
)
def test_the_status(severities: list[Severity], status: str, worst: Severity | None) -> None:
    of = {rule.severity: rule for rule in rules.RULES.values()}
    found = [Diagnostic(rule=of[severity], span=Span(line=1), fields={}, path="x") for severity in severities]
    made = answer_of(run_job(MARK + "JUMP X 1\n").report, found)
    assert (made.headline[0], made.worst) == (status, worst)


def test_what_stands_out_names_its_line() -> None:
    """Two long marks at 100 mm/s; one of 0.1 mm, which takes 2*sqrt(L/a) = 6.32 ms: 15.8 mm/s on average."""
    job = OFF + "LASER DELAY ON 0 OFF 600us\nLASER POWER 50\n"
    for x in (20, 40):
        job += f"JUMP X {x - 10}\nLASER ON\nLINE X {x}\nLASER OFF\n"
    job += "JUMP X 50\nLASER ON\nLINE X 50.1\nLASER OFF\nJUMP X 60\n"
    found = named(run_job(job))
    assert found["slowest"].line == 17
    assert found["slowest"].text == "15.8 mm/s on average, typical 90.9 mm/s"
    assert found["in jumps"].text == "emission for 1.8 ms, at most 0.6 ms in one jump"
    assert found["worst end"].text == "1.8 um from the intended point, late"  # a*t^2/2
    assert "times the typical 500 %·ms/mm" in found["hottest"].text


def test_energy_per_mm_of_a_steady_mark() -> None:
    """Half of 30 W at 100 mm/s: 150 mJ/mm between the ends, which are hotter."""
    ran = run_job(MARK + "LASER POWER 50\nLASER ON\nLINE X 100\nLASER OFF\n", RATED)
    assert named(ran)["hottest"].text.endswith("times the typical 150 mJ/mm")


def test_a_limit_and_a_laser_that_stays_on() -> None:
    text = (
        "GT_SetAxisMode(7,1)\nGT_LaserPowerMode(0,30,0,0)\nGT_LaserOutFrq(10,0)\nGT_CrdClear(1,0)\n"
        "GT_BufLaserPrfCmd(1,50,0,0)\nGT_BufLaserOn(1,0,0)\nGT_LnXY(1,10000,0,100,10,0,0)\nGT_CrdStart(1,0)\n"
    )
    found = named(run_listing(text))
    assert found["limited"].text == "a limit changes the power for 110 ms, 100 % of the emission"
    assert found["limited"].line == 7
    assert found["LEFT ON"].text == "the laser of channel 0 is still on at the end"


@pytest.mark.parametrize(("miss_um", "named_ends"), [(0.0, []), (0.01, []), (0.25, ["worst start", "worst end"])])
def test_only_ends_that_are_off_by_more_than_a_fraction_of_a_unit_are_named(
    miss_um: float, named_ends: list[str]
) -> None:
    """The controller's units are 1 um; rounding of sums leaves misses far below."""
    ran = run_job(MARK + "LASER POWER 50\nLASER ON\nLINE X 10\nLASER OFF\n")
    miss = dict.fromkeys(("on_miss_um", "off_miss_um"), np.array([miss_um]))
    report = replace(ran.report, marks={**(ran.report.marks or {}), **miss})
    names = [str(finding.name) for finding in answer_of(report, ran.diagnostics).findings]
    assert [name for name in names if name.startswith("worst")] == named_ends


@pytest.mark.parametrize("columns", [40, 80, 200])
def test_findings_are_never_cut(columns: int) -> None:
    """A long path stays whole, and so do texts without blanks, as Chinese has them."""
    ran = run_job(MARK + "JUMP X 1\n")
    path, text = "folder/" * 12 + "part.job", "最热" * 60
    for finding in (
        Finding(name="hottest", text="1179 %·ms/mm", line=8, file=path),
        Finding(name="hottest", text=text, line=8),
    ):
        shown = report_text(ran.report, replace(answer(ran), findings=(finding,)), width=columns)
        assert "…" not in shown
        assert finding.place in shown
        assert finding.text.replace(" ", "") in "".join(shown.split())


@pytest.mark.parametrize("columns", [40, 60, 80, 100, 120, 200])
def test_the_text_fits_a_terminal(columns: int) -> None:
    two = MARK + "LASER MODE ANALOG CHANNEL 1\nLASER POWER 5 CHANNEL 1\nLASER POWER 40\nLASER ON\nLASER ON CHANNEL 1\n"
    ran = run_job(
        two + "LINE X 10\nLINE X 20 Y 30\nLINE X 25.125\nLASER OFF\nLASER OFF CHANNEL 1\nDWELL 1000\nJUMP X 1\n"
    )
    text = report_text(ran.report, answer(ran), tables=True, width=columns)
    assert max(map(columns_of, text.splitlines())) <= columns
    for word in ("line", "kind", "mm/s"):
        assert word in text
    if columns < 100:
        assert "not shown at this width" in text
    wide = report_text(ran.report, answer(ran), tables=True)
    assert "not shown" not in wide


@pytest.mark.parametrize("columns", [40, 60, 68, 76, 80, 90, 100, 120])
def test_no_cell_of_a_long_table_is_cut(columns: int) -> None:
    """The count of the rows that are left out is wider than the column that it is in."""
    laps = "REPEAT 1000\nLASER ON\nLINE X 1\nLASER OFF\nJUMP X 0\nEND\n"
    ran = run_job(MARK + "LASER POWER 40\n" + laps)
    text = report_text(ran.report, answer(ran), tables=True, width=columns)
    assert "1960 more" in text  # 2000 segments, of which 40 are shown.
    assert "960 more" in text
    assert "…" not in text
    assert max(map(columns_of, text.splitlines())) <= columns


def test_the_totals_of_a_channel_that_never_emits() -> None:
    ran = run_job(MARK + "JUMP X 1\n")
    lines = report_text(ran.report, answer(ran), tables=True).splitlines()
    assert "channel 0: laser never on" in lines


def test_times_over_a_second_are_in_seconds() -> None:
    ran = run_job(MARK + "LASER POWER 50\nLASER ON\nLINE X 120\nLINE X 0\nLASER OFF\n")
    text = report_text(ran.report, answer(ran), tables=True)
    head = next(line for line in text.splitlines() if line.startswith("line  kind")).split()
    assert ("ms" in head, head.count("s") >= 2) == (False, True)
