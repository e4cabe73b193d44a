"""What each statement becomes: calls worked out by hand from language.md."""

from __future__ import annotations

import itertools

import pytest
from support.tools import MARK, calls_of, diagnostics_in, job_of, path_calls

from gusjob.config.machine import Machine
from gusjob.frontend import check_text, read_job, read_listing


def body(text: str) -> list[str]:
    """The calls of a marked-up path, without head and frame."""
    return [c for c in calls_of(MARK + text) if c.startswith(("GT_Buf", "GT_Ln", "GT_Arc"))]


def setup(text: str) -> list[str]:
    return [c for c in calls_of(text) if "Crd" not in c]


@pytest.mark.parametrize(
    ("statement", "calls"),
    [
        ("LASER MODE DUTY CARRIER 20", ["GT_SetAxisMode(7,1)", "GT_LaserPowerMode(0,100,0,0)", "GT_LaserOutFrq(20,0)"]),
        (
            "LASER MODE DUTY2 MAX 90 CARRIER 0.5MHz MIN 5% CHANNEL 1",
            ["GT_SetAxisMode(8,1)", "GT_LaserPowerMode(3,90,5,1)", "GT_LaserOutFrq(500,1)"],
        ),
        (
            "LASER MODE FREQUENCY WIDTH 10",
            ["GT_SetAxisMode(7,1)", "GT_LaserPowerMode(1,2000,0,0)", "GT_SetPulseWidth(10,0)"],
        ),
        ("LASER MODE ANALOG MAX 5V", ["GT_LaserPowerMode(2,5,0,0)"]),
        ("LASER DELAY ON 100 OFF 0.15ms", ["GT_SetLevelDelay(150,100,0)"]),
        ("LASER STANDBY FREQ 5 DUTY 10", ["GT_SetWaitPulse(1,5,10,0)"]),
        ("LASER STANDBY OFF", ["GT_SetWaitPulse(0,2000,0,0)"]),
        ("LASER PREVOLT 35mV", ["GT_SetPreVltg(1,0.035,0)"]),
        ("LASER PREVOLT OFF", ["GT_SetPreVltg(0,0,0)"]),
        ("LASER FPK WIDTH 20 GAP 15 OFFDELAY 10", ["GT_EnaFPK(20,15,10,0)"]),
        ("LASER FPK OFF", ["GT_DisFPK(0)"]),
        (
            "LASER DISTANCE REF X 1 Y -2.5 RATIO X 0.1 Y -0.2 A 1 MIN 10 MAX 90 SOURCE ACTUAL",
            [
                "GT_SetLaserDisMode(1,1,{1000,-2500,0,0},{1000,1000,1000,1000},0)",
                "GT_SetLaserDisRatio({0.1,-0.2,0,1},10,90,0)",
            ],
        ),
        ("LASER DISTANCE OFF", ["GT_SetLaserDisMode(0,0,{0,0,0,0},{1000,1000,1000,1000},0)"]),
        ("LASER ON NOW", ["GT_SetHSIOOpt(1,0)"]),
        ("LASER OFF NOW CHANNEL 1", ["GT_SetHSIOOpt(0,1)"]),
        ("LASER POWER 12.5 NOW", ["GT_LaserPrfCmd(12.5,0)"]),
    ],
)
def test_setup_statements(statement: str, calls: list[str]) -> None:
    assert setup(statement) == calls


@pytest.mark.parametrize(
    ("statement", "call"),
    [
        ("LASER ON", "GT_BufLaserOn(1,0,0)"),
        ("LASER OFF CHANNEL 1", "GT_BufLaserOff(1,0,1)"),
        ("LASER POWER 33.3%", "GT_BufLaserPrfCmd(1,33.3,0,0)"),
        ("LASER FOLLOW RATIO 0.2 MIN 5 MAX 80", "GT_BufLaserPrfFollow(1,0.2,5,80,0,0)"),
        ("LASER FOLLOW MAX 80 MIN 5 AT 50mm/s", "GT_BufLaserPrfFollow(1,1.5,5,80,0,0)"),
        ("LASER FOLLOW MIN 5 MAX 80 AT 25pulse/ms", "GT_BufLaserPrfFollow(1,3,5,80,0,0)"),
        ("DWELL 20", "GT_BufDelay(1,20,0)"),
        ("DWELL 1.5s", "GT_BufDelay(1,1500,0)"),
        ("DWELL 3000us", "GT_BufDelay(1,3,0)"),
        ("LINE X 1 Y 2", "GT_LnXY(1,1000,2000,100,10,0,0)"),
        ("LINE X 1 VEL 50 ACC 5000", "GT_LnXY(1,1000,0,50,5,0,0)"),
        ("line x=1000um y 2pulse vel=3000mm/min", "GT_LnXY(1,1000,2,50,10,0,0)"),
        ("LINE X 0.0005 Y 0.0015", "GT_LnXY(1,0,2,100,10,0,0)"),
        ("ARC CW X 10 I 5 J 0", "GT_ArcXYC(1,10000,0,5000,0,0,100,10,0,0)"),
        ("ARC CCW X 10 Y 0 R -6", "GT_ArcXYR(1,10000,0,-6000,1,100,10,0,0)"),
        ("ARC CCW I -3 J 4", "GT_ArcXYC(1,0,0,-3000,4000,1,100,10,0,0)"),
    ],
)
def test_path_statements(statement: str, call: str) -> None:
    assert body(statement) == [call]


def test_spellings_are_the_same() -> None:
    forms = [
        "LINE X 10 Y -20",
        "LINE X10 Y-20",
        "LINE X=10 Y=-20",
        "line x10y-20",
        "LINE Y -20 X 10",
        "\tLiNe X +10Y -20",
    ]
    assert len({tuple(body(f)) for f in forms}) == 1


def test_comments_blank_lines_and_line_ends() -> None:
    plain = calls_of(MARK + "LINE X 1\nLINE X 2\n")
    odd = MARK.replace("\n", "\r\n") + "\n\n ; a comment 1 2 3\nLINE X 1;glued 9\r\n// LINE X 9\nLINE X 2 // end"
    assert calls_of(odd) == plain
    assert calls_of("\ufeff" + odd) == plain


def test_scientific_numbers_and_their_neighbours() -> None:
    assert body("LINE X 1e1 Y -2.5E-1") == ["GT_LnXY(1,10000,-250,100,10,0,0)"]
    assert body("LINE X .5 Y 5.") == ["GT_LnXY(1,500,5000,100,10,0,0)"]
    assert body("LINE X 007 Y +0.25") == ["GT_LnXY(1,7000,250,100,10,0,0)"]


def test_relative_coordinates_accumulate_nothing() -> None:
    # A tenth of a pulse, a thousand times, is a hundred pulses; I J are relative in both.
    text = "COORDS REL\n" + "LINE X 0.0001\n" * 1000 + "COORDS ABS\nLINE Y 1\nCOORDS REL\nLINE X 1 Y 1\n"
    ends = [c.split(",")[1:3] for c in body(text)]
    assert ends[9] == ["1", "0"]
    assert ends[999] == ["100", "0"]
    assert ends[1000] == ["100", "1000"]
    assert ends[1001] == ["1100", "2000"]


def test_relative_continues_from_the_last_absolute_position() -> None:
    text = "COORDS REL\nLINE X 1\nLINE X 1\nCOORDS ABS\nLINE X 5\nCOORDS REL\nLINE X 1\nLINE X -0.5\n"
    assert [c.split(",")[1] for c in body(text)] == ["1000", "2000", "5000", "6000", "5500"]


def test_units_can_change_within_a_job() -> None:
    text = "UNITS PULSE\nVEL 200\nLINE X 100\nLINE X 0.2mm\nUNITS MM\nLINE X 0.3 Y 5pulse\n"
    assert [c.split(",")[1:4] for c in body(text)] == [["100", "0", "200"], ["200", "0", "200"], ["300", "5", "200"]]


def test_velocities_are_modal_and_jumps_have_their_own() -> None:
    text = "LINE X 1 VEL 50\nLINE X 2\nJUMP X 3\nJUMPVEL 400\nJUMPACC 20000\nJUMP X 4\nVEL 70\n"
    text += "ARC CW X 5 R 1 ACC 3000\nJUMP X 6\n"
    speeds = [tuple(c.rstrip(")").split(",")[-4:-2]) for c in body(text)]
    assert speeds == [("50", "10"), ("50", "10"), ("50", "10"), ("400", "20"), ("70", "3"), ("400", "20")]


def test_channels() -> None:
    text = "CHANNEL 1\nLASER POWER 1\nLASER ON CHANNEL 0\nLASER OFF\nCHANNEL 0\nLASER OFF\n"
    assert [c.rstrip(")").split(",")[-1] for c in body(text)] == ["1", "0", "1", "0"]


def test_coordinate_system_and_fifo() -> None:
    calls = calls_of("CRD 2 FIFO 1\n" + MARK + "LINE X 1\nWAIT\nLINE X 2\n")
    assert [c for c in calls if "Crd" in c and "Prm" not in c] == [
        "GT_CrdClear(2,1)",
        "GT_CrdStart(2,2)",
        "GT_CrdStatus(2,run,segment,1)",
        "GT_CrdClear(2,1)",
        "GT_CrdStart(2,2)",
    ]
    assert "GT_LnXY(2,1000,0,100,10,0,1)" in calls


def test_stages() -> None:
    first = "LASER DELAY ON 1 OFF 2\nLASER POWER 5\nLASER ON\nLINE X 1\nLASER OFF\n"
    others = "LASER POWER 6 NOW\nLINE X 2\nWAIT\nWAIT\nLINE X 3\nLASER OFF NOW\n"
    calls = [c.split("(")[0] for c in calls_of(MARK + first + others)]
    assert calls == [
        "GT_SetAxisMode",
        "GT_LaserPowerMode",
        "GT_LaserOutFrq",
        "GT_SetLevelDelay",
        "GT_SetCrdPrm",
        "GT_CrdClear",
        "GT_BufLaserPrfCmd",
        "GT_BufLaserOn",
        "GT_LnXY",
        "GT_BufLaserOff",
        "GT_CrdStart",
        "GT_CrdStatus",
        "GT_LaserPrfCmd",
        "GT_CrdClear",
        "GT_LnXY",
        "GT_CrdStart",
        "GT_CrdStatus",
        "GT_CrdClear",
        "GT_LnXY",
        "GT_CrdStart",
        "GT_CrdStatus",
        "GT_SetHSIOOpt",
    ]


def test_fast_and_slow_reading_agree() -> None:
    """The same numbers written so that a template reads them and so that only the parser does."""
    plain = "".join(f"LINE X {i / 8} Y {-i / 4}\nLASER POWER {1 + i / 100:.2f}\n" for i in range(200))
    odd = "".join(f"LINE X {i / 8:.6e} Y - {i / 4}\nLASER POWER {100 * (1 + i / 100):.3f}e-2\n" for i in range(200))
    assert body(plain) == body(odd)


def test_each_line_is_read_by_its_own_shape() -> None:
    # 'X 1 5 Y' and 'X 1 Y 5' have the same letters and as many digits.
    assert diagnostics_in(MARK + "LINE X 1 Y 5\nLINE X 1 5 Y\nLINE X 1  Y5\n") == [(5, "GJ101")]
    assert diagnostics_in(MARK + "VEL 5mm/s\nVEL 5mm/s2\nACC 5mm/s2\nACC 5mm/s3\n") == [(5, "GJ203"), (7, "GJ101")]


def test_the_same_mode_again_keeps_the_power_and_another_does_not() -> None:
    head = MARK + "LASER POWER 5\nLASER ON\nLINE X 1\nLASER OFF\n"
    tail = "\nLASER ON\nLINE X 2\nLASER OFF\n"
    assert diagnostics_in(head + "LASER MODE DUTY CARRIER 20" + tail) == [(8, "GJ304")]
    assert diagnostics_in(head + "LASER MODE DUTY2 CARRIER 20" + tail) == [(8, "GJ304"), (9, "GJ403")]


def test_an_error_does_not_hide_the_rest() -> None:
    found = diagnostics_in(MARK + "QQ\nLINE X 999\nLINE X\nLASER POWER 101\n")
    assert found == [(4, "GJ102"), (6, "GJ101"), (5, "GJ503"), (7, "GJ201")]


def test_units_of_axes_that_differ() -> None:
    machine = Machine(pulses_per_mm=(1000.0, 500.0))
    # 30 mm and 40 mm: 50 mm, in pulses 30000 and 20000: 36055.5; 100 mm/s take 0.5 s: 72.11 pulse/ms.
    (call,) = path_calls(MARK + "LINE X 30 Y 40\n", machine)
    x, y, vel, acc = (float(v) for v in call.rstrip(")").split(",")[1:5])
    assert (x, y) == (30000, 20000)
    pulses = (30000**2 + 20000**2) ** 0.5
    assert vel == pytest.approx(pulses / 500, rel=1e-12)
    assert acc == pytest.approx(pulses / 50 * 10000 / 1e6, rel=1e-12)


def test_an_arc_on_unequal_axes_becomes_chords_within_the_tolerance() -> None:
    machine = Machine(pulses_per_mm=(1000.0, 500.0))
    calls = path_calls(MARK + "LINE X 5\nARC CCW X -5 R 5\nLINE X 0\n", machine)
    points = [[float(v) for v in c.split(",")[1:3]] for c in calls]
    ring = [(x / 1000, y / 500) for x, y in points[:-1]]
    assert len(ring) > 20
    for x, y in ring:
        assert (x * x + y * y) ** 0.5 == pytest.approx(5, abs=0.0015)
    for (x0, y0), (x1, y1) in itertools.pairwise(ring):
        middle = ((x0 + x1) / 2, (y0 + y1) / 2)
        assert 5 - (middle[0] ** 2 + middle[1] ** 2) ** 0.5 < 0.001 + 0.0015
    assert ring[-1] == (-5, 0)


def test_a_forced_end_on_an_arc_of_chords_is_that_of_the_last_chord() -> None:
    machine = Machine(pulses_per_mm=(1000.0, 500.0))
    text = MARK + "LOOKAHEAD OFF\nARC CCW X 0 Y 0 I 5 J 0 END 1pulse/ms\nLINE X -5\n"
    ends = [c.rstrip(")").split(",")[-2] for c in path_calls(text, machine)]
    assert "0" not in ends[:-2], "it is one arc, which does not stop"
    assert ends[-2:] == ["1", "0"]


def test_spans_of_words() -> None:
    job = job_of(MARK + "  LINE X 10 Y=-20 VEL 50mm/s ; x\n")
    span = job.locate(4, "Y")
    assert (span.line, span.column, span.end_column) == (4, 15, 18)
    whole = job.locate(4, "")
    assert (whole.column, whole.end_column) == (3, 29)


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        # Both ends of the straight angle are +180 degrees: rounding up to zero leaves no sign.
        ("atan2(ceil(-0.5), -1)", 180.0),
        ("atan2(round(-0.3), -1)", 180.0),
        ("atan2(0, -1)", 180.0),
    ],
)
def test_rounding_gives_no_minus_zero(expression: str, value: float) -> None:
    assert body(f"LINE X 1 Y ({expression} / 100)") == [f"GT_LnXY(1,1000,{value * 10:.0f},100,10,0,0)"]


def test_a_line_that_ends_too_soon_has_no_hint() -> None:
    source, _ = check_text(b"LINE X\n", "a.job")
    assert source is not None
    _, (diagnostic, *_) = read_job(source, Machine())
    assert diagnostic.message == "a number is missing after X"


def test_an_octal_number_is_shown_as_it_was_written() -> None:
    source, _ = check_text(b"GT_LnXY(1,010 020,0,50,2,0,0)\n", "a.gts")
    assert source is not None
    _, (diagnostic, *_) = read_listing(source)
    assert "'020'" in diagnostic.message
