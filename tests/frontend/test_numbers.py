"""Numbers: which texts are numbers, and which ones are too large, too small or of no known unit."""

from __future__ import annotations

import math
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gusjob.config.profile import parse_profile
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.parse.job_reader import read_job_text
from gusjob.frontend.parse.statement_parser import parse_statement
from gusjob.frontend.source import Source
from gusjob.kinematics.units import UNITS
from gusjob.pipeline import Simulated, examine_file, simulate_file

HEAD = "LASER MODE DUTY CARRIER 10kHz\nVEL 100\nACC 10000\nLASER POWER 40\nLASER ON\n"
TAIL = "LINE X 10 Y 5\nARC CW X 0 Y 0 R 50\nLASER OFF\nJUMP X 1\n"


def found_in(line: str) -> list[Diagnostic]:
    _, found = parse_statement(line, 1)
    # The scan of line shapes finds the same, for a line of a known shape, too.
    for before in ("", re.sub("[0-9]", "7", line) + "\n"):
        scanned = read_job_text(Source(name="a.job", data=(before + line).encode())).diagnostics
        last = [d for d in scanned if d.span.line == 1 + before.count("\n")]
        assert [(d.rule.code, d.span.column, d.message) for d in last] == [
            (d.rule.code, d.span.column, d.message) for d in found
        ]
    return found


@pytest.mark.parametrize(
    ("line", "number", "hint"),
    [
        ("LINE Y 0x10", "0x10", "; write 16, or a blank before X"),
        ("LINE Y0X10", "0X10", "; write 16, or a blank before X"),
        ("LINE Y=-0x1f X 3", "0x1f", "; write 31, or a blank before X"),
        ("LINE Y 0xA", "0xA", "; write 10, or a blank before X"),
        ("LINE Y 0x10Y5", "0x10Y5", "; write a blank before X"),
        ("LET a = 0xff", "0xff", "; write 255, or a blank before X"),
        ("REPEAT 0x10", "0x10", "; write 16, or a blank before X"),
        ("LINE Y (1 + 0x10)", "0x10", "; write 16, or a blank before X"),
        ("LINE Y 0b101", "0b101", "; write 5"),
        ("LINE Y 0o17", "0o17", "; write 15"),
        ("LINE X 1_000", "1_000", "; write 1000"),
        ("LINE X 1,5 Y 2", "1,5", "; write a decimal point, and no separator of thousands"),
        ("LINE X 1,000.5", "1,000.5", "; write a decimal point, and no separator of thousands"),
        ("LINE X 10e", "10e", "; digits are missing after e"),
        ("LINE X 1E-", "1E", "; digits are missing after E"),
        ("LINE X 1.2.3", "1.2.3", "; it has two decimal points"),
    ],
)
def test_what_is_no_decimal_number(line: str, number: str, hint: str) -> None:
    (found,) = found_in(line)
    assert (found.rule.code, found.message) == ("GJ157", f"'{number}' is not a decimal number{hint}")
    assert line[found.span.column - 1 : found.span.end_column - 1] == number


@pytest.mark.parametrize(
    ("line", "x", "y"),
    [
        ("LINE Y 0 X10", 10, 0),
        ("LINE Y 10X5", 5, 10),
        ("LINE Y10X5", 5, 10),
        ("LINE Y 0.0X5", 5, 0),
        ("LINE Y 00X5", 5, 0),
        ("LINE Y 0X 5", 5, 0),
        ("LINE Y 0X=5", 5, 0),
        ("LINE Y 0X-5", -5, 0),
        ("LINE X1e2Y5", 100, 5),
        ("LINE X 0Y10", 0, 10),
    ],
)
def test_glued_words_that_have_one_meaning(line: str, x: float, y: float) -> None:
    for text in (line, f"{line}\n{line}", f"LINE Y 7X7\nLINE Y7X7\nLINE Y 7.7X7\nLINE Y 7X-7\n{line}"):
        read = read_job_text(Source(name="a.job", data=text.encode()))
        assert not read.diagnostics
        assert (read.rows.column(0)[-1], read.rows.column(1)[-1]) == (x, y)


@given(st.integers(0, 10**15))
def test_any_hexadecimal_number_is_named_by_its_value(value: int) -> None:
    (found,) = found_in(f"LINE Y {value:#x}")
    assert found.message == f"'{value:#x}' is not a decimal number; write {value}, or a blank before X"


UNITS_BY_KIND: dict[int, set[str]] = {}
for _name, _unit in UNITS.items():
    UNITS_BY_KIND.setdefault(int(_unit.kind), set()).add(_name)


@pytest.mark.parametrize(
    ("line", "unit", "own"),
    [
        ("LINE X 10cm", "cm", {"um", "mm", "pulse"}),
        ("LINE X 10 inch Y 5", "inch", {"um", "mm", "pulse"}),
        ('LINE X 10"', '"', {"um", "mm", "pulse"}),
        ("VEL 10 cm/s", "cm/s", {"mm/s", "m/s", "mm/min", "pulse/ms"}),
        ("VEL 10mm/h", "mm/h", {"mm/s", "m/s", "mm/min", "pulse/ms"}),
        ("ACC 10mm/s3", "mm/s3", {"mm/s2", "m/s2", "pulse/ms2"}),
        ("DWELL 5min", "min", {"us", "ms", "s"}),
        ("LASER POWER 10W", "W", {"%", "hz", "khz", "mhz", "v", "mv"} - {"hz", "mhz", "mv"}),
        ("LASER DELAY ON 1ns OFF 2", "ns", {"us", "ms", "s"}),
        ("LASER MODE DUTY CARRIER 1GHz", "GHz", {"hz", "khz", "mhz"}),
    ],
)
def test_an_unknown_unit_lists_the_known_ones(line: str, unit: str, own: set[str]) -> None:
    (found,) = found_in(line)
    assert found.rule.code == "GJ101"
    assert found.message.startswith(f"'{unit}' is not a unit: expected ")
    assert line[found.span.column - 1 : found.span.end_column - 1] == unit
    first, others = (
        set(re.findall(r"[a-z0-9/%]+", part.lower())) for part in found.message.split("; other units are ")
    )
    assert own <= first
    assert not own & others
    power = {"%", "hz", "khz", "mhz", "v", "mv"}
    assert others | own | (power if "%" in own else set()) >= set(UNITS)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("LINE ?", "ACC, END, VEL, X, Y"),
        ("LINE X 1 ?", "ACC, END, VEL, Y"),
        ("JUMP X 1 ?", "Y"),
        ("ARC CW X 1 ?", "ACC, END, I, J, R, VEL, Y"),
        ("ARC CW X 1 R 2 ?", "ACC, END, VEL, Y"),
        ("ARC CW I 1 ?", "ACC, END, J, VEL, X, Y"),
        ("LASER MODE DUTY ?", "CARRIER, CHANNEL, MAX, MIN"),
        ("LASER MODE FREQUENCY ?", "CHANNEL, MAX, MIN, WIDTH"),
        ("LASER MODE ANALOG MIN 1 ?", "CHANNEL, MAX"),
        ("LASER DELAY ON 5 ?", "CHANNEL, OFF"),
        ("LASER FPK WIDTH 1 ?", "CHANNEL, GAP, OFFDELAY"),
        ("SKYWRITE MODE 1 TIMELAG 5 ?", "LIMIT, NPOST, NPREV, SHIFT"),
    ],
)
def test_words_are_offered_where_they_belong(line: str, words: str) -> None:
    (found,) = found_in(line)
    assert found.message == f"'?' is not allowed here; expected {words} or the end of the line"


EXTREME = (
    "1e-320",
    "5e-324",
    "1e-300",
    "1e-160",
    "1e-101",
    "1e-100",
    "1e-30",
    "1e-9",
    "1e9",
    "1e15",
    "0." + "0" * 110 + "1",
)
PLACES = {
    "VEL": "VEL {}\n",
    "ACC": "ACC {}\n",
    "JUMPVEL": "JUMPVEL {}\n",
    "END": "LINE X 1 END {}\n",
    "AT": "LASER FOLLOW MIN 10 MAX 50 AT {}\n",
    "AT of an expression": "LET a = {}\nLASER FOLLOW MIN 10 MAX 50 AT (a * a)\n",
    "RATIO": "LASER FOLLOW MIN 10 MAX 50 RATIO {}\n",
    "SCALE": "FRAME SCALE {0}\nLINE X 5\nARC CW X 5 Y 5 I 0 J 2\nEND\n",
    "SCALE twice": "FRAME SCALE {0}\nFRAME SCALE {0}\nLINE X 5\nARC CW X 5 Y 5 I 0 J 2\nEND\nEND\n",
    "SCALE twice, computed": "LET s = {0}\nFRAME SCALE (s)\nFRAME SCALE (1 / s)\nLINE X 5\nEND\nEND\n",
    "SKYWRITE": "VEL {}\nSKYWRITE MODE 3 TIMELAG 100\n",
    "LOOKAHEAD": "LOOKAHEAD TIME {0} ACC {0}\n",
    "I J": "ARC CW I {0} J {0}\n",
    "R": "ARC CW X 1 Y 1 R {}\n",
    "X": "LINE X {}\n",
    "DISTANCE": "LASER DISTANCE REF X {0} Y 0 RATIO X {0} Y 0 MIN 0 MAX 100\n",
}


@pytest.mark.parametrize("place", PLACES)
def test_no_number_of_a_job_overflows(place: str) -> None:
    """Each extreme number is taken, or has a diagnostic; NumPy never warns."""
    for number in EXTREME:
        text = HEAD + PLACES[place].format(number) + TAIL
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            result = simulate_file(Path("/nowhere/a.job"), data=text.encode())
            examined = examine_file(Path("/nowhere/a.job"), data=text.encode())
        found = (*result.diagnostics, *examined.diagnostics)
        codes = {d.rule.code for d in found if d.severity.value == "error"}
        assert isinstance(result, Simulated) or codes, number
        if float(number) < 1e-100:
            assert codes & {"GJ158", "GJ121"}, number


@pytest.mark.parametrize("number", ["1e-101", "1e-400", "0." + "0" * 100 + "1", "(1e-60 ** 2)"])
def test_a_number_nearer_to_0_than_the_smallest_one(number: str) -> None:
    text = HEAD + f"LINE X {number}\n" + TAIL
    errors = [d for d in examine_file(Path("/nowhere/a.job"), data=text.encode()).diagnostics if d.rule.code == "GJ158"]
    assert [d.span.line for d in errors] == [HEAD.count("\n") + 1]
    assert "the smallest number is 1e-100" in errors[0].message


@pytest.mark.parametrize("number", ["0", "0.000", "0e5", "-0", "1e-100", "1e-17", "(1e-99 * 0)"])
def test_0_and_rounding_noise_are_numbers(number: str) -> None:
    text = HEAD + f"LINE X {number}\n" + TAIL
    assert isinstance(simulate_file(Path("/nowhere/a.job"), data=text.encode()), Simulated)


@pytest.mark.parametrize(
    ("scales", "total"),
    [
        (["1e-7"], 1e-7),
        (["1e7"], 1e7),
        (["0.001", "0.0001"], 1e-7),
        (["1000", "2000"], 2e6),
        (["1e-6"], None),
        (["1e6"], None),
        (["1e-6", "1e6", "1e-6"], None),
        (["0.001", "1000"], None),
    ],
)
def test_frames_have_a_range_of_sizes(scales: list[str], total: float | None) -> None:
    """The product of the scales counts; the frames inside of one that leaves the range have no further error."""
    lines = [f"FRAME SCALE {scale}" for scale in [*scales, "1"]]
    text = HEAD + "\n".join([*lines, "LINE X 0", *["END"] * len(lines)]) + "\nLASER OFF\n"
    result = examine_file(Path("/nowhere/a.job"), data=text.encode())
    found = [d for d in result.diagnostics if d.rule.code == "GJ139"]
    assert [(d.span.line, math.isclose(d.fields["value"], total or 0)) for d in found] == (
        [(HEAD.count("\n") + len(scales), True)] if total else []
    )


ENTRIES = ("pulses_per_mm", "max_velocity_mm_s", "max_acceleration_mm_s2", "host_calls_per_s")


@pytest.mark.parametrize("number", ["5e-324", "1e-308", "1e-30", "0.001", "1e9", "1e308"])
@pytest.mark.parametrize("entry", ENTRIES)
def test_no_number_of_a_profile_overflows(entry: str, number: str, tmp_path: Path) -> None:
    profile, job = tmp_path / "gusjob.toml", tmp_path / "a.job"
    for values in (number, f"[{number}, 1000]") if entry == "pulses_per_mm" else (number,):
        profile.write_text(f"{entry} = {values}\n")
        outside = parse_profile(profile.read_text()).diagnostics
        assert not outside or outside[0].rule.code == "GJ604"
        assert outside or float(number) >= 0.001
        for units in ("", "UNITS PULSE\n"):
            job.write_text(units + HEAD.replace("VEL 100", "VEL 30").replace("10000", "2") + TAIL)
            with np.errstate(all="raise", under="ignore"), warnings.catch_warnings():
                warnings.simplefilter("error")
                simulate_file(job)
                examine_file(job)
