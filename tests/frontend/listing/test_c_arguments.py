"""Arguments of calls arrive as C converts them: against ctypes, which wraps whole numbers as every compiler does."""

from __future__ import annotations

import ctypes
import math
from random import Random

import numpy as np
import pytest
from support.tools import run_listing

from gusjob.controllers.gus.calls import CType
from gusjob.controllers.gus.executor import execute
from gusjob.frontend import check_text, read_listing
from gusjob.frontend.listing.c_arguments import arriving

C_TYPES = {
    CType.SHORT: ctypes.c_int16,
    CType.USHORT: ctypes.c_uint16,
    CType.LONG: ctypes.c_int32,  # 4 bytes, as on Windows.
    CType.ULONG: ctypes.c_uint32,
}
POWER = "GT_BufLaserPrfCmd(1,30,0,0)\n"
START = "GT_CrdStart(1,0)\n"


def conversions(text: str) -> list[tuple[str, str, float, float | None]]:
    """Code, argument, number and what arrives, of what is reported of a text's arguments."""
    source, _ = check_text(text.encode(), "x.c")
    assert source is not None
    stream, found = read_listing(source)
    assert [d.message for d in found if d.severity.name == "ERROR"] == []
    reported = [d for d in execute(stream).diagnostics if d.rule.code in ("GJ717", "GJ718")]
    assert all(d.severity.name == "ERROR" for d in reported)
    return [
        (d.rule.code, d.fields["argument"], d.fields["value"], d.fields["arrives"] if d.rule.code == "GJ717" else None)
        for d in reported
    ]


@pytest.mark.parametrize("c", C_TYPES)
def test_whole_numbers_wrap_and_fractions_are_cut(c: CType) -> None:
    random, high = Random(1), C_TYPES[c](-1).value or 1
    numbers = [0, 1, -1, 2**15 - 1, 2**15, -(2**15) - 1, 2**16, 70_000, 2**31, -(2**31), 2**32 - 1, 2**32, -(2**40) + 5]
    numbers += [random.randint(-(2**50), 2**50) for _ in range(500)] + [high]
    given = np.array(numbers, dtype=np.float64)
    expected = [float(C_TYPES[c](number).value) for number in numbers]
    assert arriving(given, np.zeros(len(given), dtype=np.bool_), c).tolist() == expected
    real = arriving(given, np.ones(len(given), dtype=np.bool_), c).tolist()
    for number, value, arrives in zip(numbers, real, expected, strict=True):
        assert value == arrives if number == arrives else math.isnan(value)
    assert arriving(np.array([10.5, -0.9, 0.999]), np.ones(3, dtype=np.bool_), c).tolist() == [10.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        ("GT_LnXY(1,10.5,0,50,2,0,0)", [("GJ717", "x", 10.5, 10.0)]),
        ("GT_LnXY(1,1e1,-0.5,50,2,0,0)", [("GJ717", "y", -0.5, 0.0)]),
        ("GT_BufDelay(1,-1,0)", [("GJ717", "ms", -1.0, 65535.0)]),
        ("GT_BufDelay(1,70000,0)", [("GJ717", "ms", 70000.0, 4464.0)]),
        ("GT_BufDelay(1,70000.0,0)", [("GJ718", "ms", 70000.0, None)]),
        ("GT_BufDelay(1,60000+10000,0)", [("GJ717", "ms", 70000.0, 4464.0)]),
        ("GT_BufDelay(1,7e4*1,0)", [("GJ718", "ms", 70000.0, None)]),
        ("GT_BufLaserOn(65537,0,0)", [("GJ717", "crd", 65537.0, 1.0)]),
        (
            "GT_BufLaserOn(1.5,0.5,0.5)",
            [("GJ717", "crd", 1.5, 1.0), ("GJ717", "fifo", 0.5, 0.0), ("GJ717", "channel", 0.5, 0.0)],
        ),
        ("GT_LnXY(1,3e9,0,50,2,0,0)", [("GJ718", "x", 3e9, None)]),
        ("GT_LnXY(1,3000000000,0,50,2,0,0)", [("GJ717", "x", 3e9, 3e9 - 2**32)]),
        ("GT_BufLaserPrfFollow(1,0.1,5.5,50,0,0)", [("GJ717", "minPower", 5.5, 5.0)]),
        (
            "GT_SetLevelDelay(10.5,-1,0)",
            [("GJ717", "highLevelDelay", 10.5, 10.0), ("GJ717", "lowLevelDelay", -1.0, 65535.0)],
        ),
        ("GT_SetPulseWidth(1e5,0)", [("GJ718", "width", 1e5, None)]),
        ("GT_LaserPowerMode(0.9,100,0.5,0)", [("GJ717", "laserPowerMode", 0.9, 0.0)]),
        ("GT_SetLaserDisMode(1,0,{0.5,0,0,0},{1000.5,1,1,1},0)", [("GJ717", "pPos", 0.5, 0.0)]),
        ("GT_SetCrdPrm(1,{2.5,{1,2,0,0,0,0,0,0},10.5,1,0,1,{0,0,0,0,0,0,0,0}})", [("GJ717", "dimension", 2.5, 2.0)]),
        ("GT_CrdStart(1.5,0)", [("GJ717", "mask", 1.5, 1.0)]),
        # These fit: a double takes every number, and a cast says that the fraction goes.
        ("GT_LnXY(1,10.0,(long)10.5,50.5,2,0,0)", []),
        ("GT_LaserPrfCmd(10.5,0)", []),
    ],
)
def test_an_argument_that_does_not_arrive_as_written_is_an_error(
    call: str, expected: list[tuple[str, str, float, float | None]]
) -> None:
    assert conversions(f"rtn = {call};\n") == expected


def test_the_call_acts_on_the_number_that_arrives() -> None:
    ran = run_listing("GT_LnXY(1,10.5,0,50,2,0,0)\nGT_BufDelay(1,70000,0)\n" + START)
    assert ran.report.columns["x_mm"].tolist() == [0.01, 0.01]
    assert ran.report.columns["duration_ms"][1] == 4464.0
    assert "GJ701" not in ran.codes()


def test_a_call_that_c_does_not_define_has_no_effect() -> None:
    ran = run_listing("GT_LnXY(1,3e9,0,50,2,0,0)\nGT_SetLevelDelay(1e5,0,0)\nGT_LnXY(1,1000,0,50,2,0,0)\n" + START)
    assert ran.report.columns["x_mm"].tolist() == [1.0]
    assert ran.codes().count("GJ718") == 2


def test_what_arrives_is_checked_against_the_range() -> None:
    # 65536 + 20000 arrives as 20000 ms, above the 16383 ms that GT_BufDelay takes (sister).
    codes = run_listing("GT_BufDelay(1,85536,0)\nGT_LnXY(1,1000,0,50,2,0,0)\n" + START).codes()
    assert "GJ717" in codes and "GJ701" in codes
    assert "GJ701" in run_listing("GT_LnXY(300,1000,0,50,2,0,0)\n").codes()


def test_many_lines_of_one_shape_are_converted_at_once() -> None:
    """The lines are read by a template; every tenth x has a fraction, of which C keeps the whole part."""
    lines = [f"GT_LnXY(1,{i}.{5 if i % 10 == 0 else 0},0,50,2,0,0)\n" for i in range(1, 2001)]
    ran = run_listing("".join(lines) + START)
    assert ran.report.columns["x_mm"].tolist() == [i / 1000 for i in range(1, 2001)]
    counted = sum(d.count for d in ran.diagnostics if d.rule.code == "GJ717")
    more = [d.fields["count"] for d in ran.diagnostics if d.fields.get("code") == "GJ717"]
    assert counted + sum(more) == 200
