"""Rules of jobs hold for calls: just inside nothing is reported, just outside the rule is."""

from __future__ import annotations

import re
from pathlib import Path
from random import Random

import pytest
from msgspec.structs import replace
from support.job_writer import Writer
from support.tools import MACHINE, ROOT, run_listing

from gusjob.config.machine import Laser, Machine
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.listing_checks import HOLD_FOR_CALLS
from gusjob.diagnostics.rules import RULES
from gusjob.pipeline import Checked, Compiled, Origin, compile_calls, compile_file, examine, load

HEAD = (
    "GT_SetAxisMode(7,1)\nGT_LaserPowerMode({mode},{high},{low},0)\nGT_LaserOutFrq(10,0)\n"
    "GT_SetCrdPrm(1,{{2,{{1,2,0,0,0,0,0,0}},{vel},1000,0,1,{{0,0,0,0,0,0,0,0}}}})\n"
)
DUTY = HEAD.format(mode=0, high=80, low=10, vel=10000)
FREQUENCY = HEAD.format(mode=1, high=100, low=10, vel=10000).replace("GT_LaserOutFrq(10,0)", "GT_SetPulseWidth(35,0)")
ON, OFF, START = "GT_BufLaserOn(1,0,0)\n", "GT_BufLaserOff(1,0,0)\n", "GT_CrdStart(1,0)\n"
WAIT = "GT_CrdStatus(1,run,segment,0)\n"
POWER = "GT_BufLaserPrfCmd(1,30,0,0)\n"
FAST = "500,1000,0,0"
"""1000 pulse from rest to rest take 2 ms at 500 pulse/ms, and 0.5 ms for its ramps at 1000 pulse/ms2."""


def line(x: int, y: int = 0, speed: str = FAST) -> str:
    return f"GT_LnXY(1,{x},{y},{speed})\n"


def mark(*path: str) -> str:
    return ON + "".join(path) + OFF


def codes(text: str, machine: Machine = MACHINE) -> list[str]:
    return run_listing(text, machine).codes()


SQUARE = mark(line(1000), line(1000, 1000), line(0, 1000), line(0))

KNOWN = {rule.code for rule in HOLD_FOR_CALLS}

INSIDE_AND_OUTSIDE = [
    # 28 kHz * 35 us = 98 % of the period, 29 kHz: 101.5 %.
    (FREQUENCY + "GT_BufLaserPrfCmd(1,28,0,0)\n" + mark(line(1000)), "28,0,0", "29,0,0", "GJ207"),
    (FREQUENCY + "GT_LaserPrfCmd(28,0)\n" + mark(line(1000)), "28,0", "29,0", "GJ207"),
    # The power is in force before its pulse width: 20 kHz * 50 us is the whole period.
    (FREQUENCY + "GT_BufLaserPrfCmd(1,20,0,0)\n" + mark(line(1000)), "Width(35", "Width(50", "GJ207"),
    (DUTY + "GT_BufLaserPrfCmd(1,80,0,0)\n" + mark(line(1000)), "80,0,0)\n" + ON, "81,0,0)\n" + ON, "GJ206"),
    (DUTY + "GT_LaserPrfCmd(10,0)\n" + mark(line(1000)), "PrfCmd(10", "PrfCmd(9", "GJ206"),
    # 0.1 %/(pulse/ms) * 500 pulse/ms + 10 % = 60 %.
    (DUTY + "GT_BufLaserPrfFollow(1,0.1,10,60,0,0)\n" + mark(line(1000)), "10,60", "10,59", "GJ209"),
    # synVelMax limits the velocity that follow sees: 400 pulse/ms give 50 %, 401 pulse/ms 50.1 %.
    (
        DUTY.replace("10000,1000", "400,1000") + "GT_BufLaserPrfFollow(1,0.1,10,50,0,0)\n" + mark(line(1000)),
        "400,1000",
        "401,1000",
        "GJ209",
    ),
    (DUTY + "GT_SetLevelDelay(60,60,0)\n" + POWER + mark(line(1000)), "60,60", "60,61", "GJ306"),
    # The second argument is the on delay: 2500 us is all of the mark's time.
    (DUTY + "GT_SetLevelDelay(2500,2500,0)\n" + POWER + mark(line(1000)), "2500,2500", "2501,2501", "GJ312"),
    (DUTY + "GT_EnaFPK(10,2500,0,0)\n" + POWER + mark(line(1000)), "2500", "2501", "GJ312"),
    # From -1000 to 0 after the square: 2500 us of jump and 50 us of on delay.
    (
        DUTY + "GT_SetLevelDelay(2549,50,0)\n" + POWER + SQUARE + line(-1000) + mark(line(-90_000)),
        "2549",
        "2550",
        "GJ313",
    ),
    (DUTY + POWER + ON + "GT_BufDelay(1,5,0)\n" + line(1000) + line(2000) + OFF, ON, line(-1000) + ON, None),
    (
        DUTY + POWER + ON + line(1000) + line(2000) + OFF,
        line(2000),
        "GT_BufDelay(1,5,0)\n" + line(2000),
        "GJ404",
    ),
    # At the end of a mark, too; a dwell before the motion pierces.
    (DUTY + POWER + ON + line(1000) + OFF, OFF, "GT_BufDelay(1,5,0)\n" + OFF, "GJ404"),
    (DUTY + POWER + ON + line(1000) + OFF, ON, ON + "GT_BufDelay(1,5,0)\n" + "GT_BufDelay(1,6,0)\n", None),
    # 100 pulse are 0.1 mm, the largest overlap that only joins marks.
    (DUTY + POWER + mark(line(1000)) + line(900, 0) + mark(line(3000)), line(900, 0), line(899, 0), "GJ407"),
    (DUTY + POWER + mark(line(1000)) + START + WAIT + line(2000), OFF, "", "GJ405"),
    (DUTY + POWER + mark(line(1000)) + mark(line(2000)), line(2000), "", "GJ406"),
    (DUTY + POWER + mark(line(1000)) + line(0) + mark(line(0, 1000)), line(0, 1000), line(1000), "GJ407"),
    (DUTY + POWER + mark(line(1000), line(2000)), line(2000), line(0), "GJ407"),
    (DUTY + POWER + mark(line(1000)) + mark(line(2000)), OFF + ON, ON, "GJ408"),
    (DUTY + POWER + mark(line(1000)), line(1000), line(1000) + line(1000), "GJ513"),
    # 10 m/s are 10,000 pulse/ms.
    (
        DUTY.replace("10000,1000", "30000,1000") + line(1000, speed="10000,1000,0,0"),
        "10000,1000,0",
        "10001,1000,0",
        "GJ504",
    ),
    (DUTY.replace("10000,1000", "400,1000") + line(1000, speed="10,1000,0,0"), "10,1000,0", "10,1001,0", "GJ504"),
    # v^2/r: 1000 pulse/ms on 1 mm take 1000 pulse/ms2, the machine's limit.
    (
        DUTY + "GT_ArcXYC(1,2000,0,1000,0,1,1000,1000,1000,0)\nGT_ArcXYC(1,0,0,-1000,0,1,1000,1000,0,0)\n",
        "0,1,1000,1000,1000",
        "0,1,1010,1000,1010",
        "GJ508",
    ),
    (DUTY + POWER + mark(line(1000)) + POWER.replace("30", "10") + POWER + mark(line(2000)), "1,10,", "1,11,", "GJ210"),
    # sqrt(1000 pulse/ms2 * 203 pulse) = 450.6 pulse/ms, 90 % of 500; with 202 pulse it is 449.4.
    (DUTY + POWER + mark(line(203)), "203,0", "202,0", "GJ516"),
    # Its end velocity is not reached: that is reported by itself.
    # It is sqrt(2 * 1000 pulse/ms2 * 100 pulse) = 447 pulse/ms.
    (DUTY + POWER + mark(line(250)), "250,0,500,1000,0", "100,0,500,1000,499", None),
    # Power that follows the velocity makes up for it.
    (DUTY + "GT_BufLaserPrfFollow(1,0.1,10,60,0,0)\n" + mark(line(1000)), line(1000), line(10), None),
]


@pytest.mark.parametrize(("text", "inside", "outside", "code"), INSIDE_AND_OUTSIDE)
def test_a_rule_begins_at_its_bound(text: str, inside: str, outside: str, code: str | None) -> None:
    assert inside in text
    assert not KNOWN & set(codes(text + START))
    changed = text.replace(inside, outside)
    assert KNOWN & set(codes(changed + START)) == ({code} if code else set())


def test_a_laser_that_is_too_slow_for_its_frequencies() -> None:
    text = DUTY + POWER + mark(line(1000)) + START
    laser = Laser(channel=0, max_frequency_khz=10)
    assert "GJ208" not in codes(text, replace(MACHINE, lasers=(laser,)))
    slow = replace(MACHINE, lasers=(replace(laser, max_frequency_khz=9.9),))
    (found,) = [f for f in run_listing(text, slow).diagnostics if f.rule.code == "GJ208"]
    assert text.splitlines()[found.span.line - 1] == "GT_LaserOutFrq(10,0)"


@pytest.mark.parametrize(("count", "expected"), [(5461, False), (5462, True)])
def test_a_host_that_is_too_slow_for_its_segments(count: int, expected: bool) -> None:
    # A segment of 1250 pulse takes 2.5 ms, in which 100 calls/s send a quarter of a call: with each one the FIFO, which
    # holds 4096, loses three quarters.
    path = "".join(line((k + 1) % 2 * 1250, speed="500,1000,500,0") for k in range(count))
    assert ("GJ515" in codes(DUTY + path + START, replace(MACHINE, host_calls_per_s=100.0))) == expected


@pytest.mark.parametrize(
    ("path", "count"),
    [
        (SQUARE + SQUARE, 0),  # A second pass of a contour.
        (SQUARE + line(5000) + mark(line(6000)) + line(0) + SQUARE + line(5000) + mark(line(6000)), 0),  # And of all.
        (SQUARE + line(1000) + mark(line(1000, 1000)), 1),  # One side alone.
        (SQUARE + line(0, 1000) + mark(line(0)) + mark(line(1000)), 2),  # Two sides, in another order.
        ((mark(line(1000)) + line(0)) * 3, 2),  # The same line three times.
        (mark(*[f"GT_ArcXYC(1,0,0,500,0,1,{FAST})\n"] * 3), 0),  # Turns of a circle.
        (mark(line(1000), line(0), line(1000)), 2),  # There and back and there.
    ],
)
def test_another_pass_is_intended_and_a_doubled_line_is_not(path: str, count: int) -> None:
    assert codes(DUTY + POWER + path + START).count("GJ407") == count


def test_another_immediate_power_is_another_mark() -> None:
    again = START + WAIT + "GT_LaserPrfCmd({power},0)\n" + line(0) + mark(line(1000)) + START
    text = DUTY + "GT_LaserPrfCmd(30,0)\n" + mark(line(1000))
    assert "GJ407" in codes(text + again.format(power=30))
    assert "GJ407" not in codes(text + again.format(power=40))


def questionable(text: str) -> list[str]:
    found = run_listing(text).diagnostics
    return [text.splitlines()[f.span.line - 1] for f in found if f.rule.code == "GJ702"]


@pytest.mark.parametrize(("crd", "fifo", "expected"), [(1, 0, 0), (1, 1, 1), (2, 0, 1)])
def test_the_status_of_a_fifo_that_does_not_run_waits_for_nothing(crd: int, fifo: int, expected: int) -> None:
    status = f"GT_CrdStatus({crd},run,segment,{fifo})"
    text = f"{DUTY}{line(1000)}{START}{status}\n{line(2000)}{START}"
    ran = run_listing(text)
    assert questionable(text) == [status] * expected
    assert ("GJ701" in ran.codes()) == bool(expected)  # The second start meets a motion.
    assert len(ran.column("duration_ms")) == 2


@pytest.mark.parametrize("call", ["GT_SetLevelDelay(50,50,0)", "GT_LaserOutFrq(20,0)"])
def test_a_setting_while_the_motion_runs(call: str) -> None:
    assert questionable(DUTY + POWER + mark(line(1000)) + START + call + "\n") == [call]
    assert questionable(DUTY + POWER + mark(line(1000)) + START + WAIT + call + "\n") == []


@pytest.mark.parametrize(
    ("parameters", "fits"),
    [
        ("2,{1,2,0,0,0,0,0,0}", True),
        ("3,{3,1,2,0,0,0,0,0}", True),
        ("1,{1,0,0,0,0,0,0,0}", False),
        ("2,{1,1,0,0,0,0,0,0}", False),
    ],
)
def test_a_coordinate_system_needs_x_and_y(parameters: str, fits: bool) -> None:
    call = f"GT_SetCrdPrm(1,{{{parameters},1000,1000,0,1,{{0,0,0,0,0,0,0,0}}}})"
    assert questionable(f"{call}\n{line(1000)}{START}") == ([] if fits else [call])
    assert questionable(f"{call}\nGT_BufDelay(1,5,0)\n{START}") == []


def test_a_comment_suppresses_a_rule_of_jobs() -> None:
    comment = "  // allow GJ306: the laser is slow to start"
    text = DUTY + f"GT_SetLevelDelay(50,60,0){comment}\n" + POWER + mark(line(1000)) + START
    for data, expected in (
        (text, set()),
        (text.replace(comment, ""), {"GJ306"}),
        (text.replace("50,60", "60,50"), {"GJ145"}),
    ):
        loaded = load(Path("x.gts"), None, data=data.encode())
        assert isinstance(loaded, Checked)
        assert {f.rule.code for f in examine(loaded).diagnostics} == expected


@pytest.mark.parametrize(
    ("text", "of_listing", "of_journal"),
    [
        # 20 kHz * 75 us is 150 % of the period: more than the rated power is not possible.
        (FREQUENCY.replace("(35,", "(75,") + "GT_BufLaserPrfCmd(1,20,0,0)\n" + mark(line(1000)), {"GJ207"}, {"GJ207"}),
        (DUTY + "GT_SetLevelDelay(50,60,0)\n" + POWER + mark(line(1000)), {"GJ306"}, {"GJ306"}),
        (DUTY.replace("(10,0)", "(30,0)") + POWER + mark(line(1000)), {"GJ208"}, {"GJ208"}),
        (DUTY + POWER + mark(line(202)), {"GJ516"}, set()),
    ],
)
def test_a_journal_is_checked_by_what_concerns_its_power(text: str, of_listing: set[str], of_journal: set[str]) -> None:
    """The other rules of jobs its job was checked by."""
    loaded = load(Path("x.gts"), None, data=(text + START).encode())
    assert isinstance(loaded, Checked)
    loaded = replace(loaded, machine=replace(loaded.machine, lasers=(Laser(max_frequency_khz=25.0),)))
    assert of_rules(examine(loaded)) == of_listing
    assert of_rules(examine(replace(loaded, origin=Origin.JOURNAL))) == of_journal


# A job and its calls.


def of_rules(result: Checked) -> set[str]:
    return KNOWN & {f.rule.code for f in result.diagnostics}


def read_back(compiled: Compiled) -> Checked:
    """What is found in the listing of a job."""
    loaded = load(Path("back.gts"), compiled.profile, data="".join(listing(compiled.stream)).encode())
    assert isinstance(loaded, Checked)
    return examine(loaded)


JOBS = sorted(
    [
        *(ROOT / "jobs").rglob("*.job"),
        *(ROOT / "tests" / "good").rglob("*.job"),
        *(ROOT / "tests" / "bad").glob("*.job"),
    ]
)
SUPPRESSED = {"allow.job": {"GJ404"}, "finish.job": {"GJ404"}}
"""Comments are not in the calls."""


@pytest.mark.parametrize("path", JOBS, ids=lambda p: p.name)
def test_the_listing_of_a_job_breaks_the_rules_that_the_job_breaks(path: Path) -> None:
    profile = path.with_suffix(".machine.toml")
    compiled = compile_file(path, profile if profile.exists() else None)
    if isinstance(compiled, Compiled):
        assert of_rules(read_back(compiled)) == of_rules(examine(compiled)) | SUPPRESSED.get(path.name, set())


NOT_IN_CALLS = {
    ("GJ508", "bad"): set[str](),  # The planner has reduced the velocity.
    ("GJ407", "good"): {"GJ407"},  # Two passes of a single line are the same calls as a line that is there twice.
}


@pytest.mark.parametrize("code", sorted(KNOWN))
@pytest.mark.parametrize("kind", ["bad", "good"])
def test_the_listing_of_an_example_breaks_its_rule(code: str, kind: str) -> None:
    text = getattr(RULES[code], kind)
    loaded = load(Path("example.job"), None, data=text.encode())
    assert isinstance(loaded, Checked)
    compiled = compile_calls(loaded)
    if isinstance(compiled, Compiled):
        assert of_rules(read_back(compiled)) == NOT_IN_CALLS.get((code, kind), of_rules(examine(loaded)))


ONLY_IN_CALLS = {"GJ407", "GJ513", "GJ516"}
"""Passes of a single segment; arcs that rounding makes
lines without length; the velocity that the planner gives an arc of a mark, in calls a velocity as any other."""
ONLY_IN_JOBS = {"GJ508", "GJ209", "GJ313", "GJ408"}
"""The planner slows arcs down, moves ends to whole pulses, and leaves out a second LASER ON under SKYWRITE."""


def test_the_listings_of_random_jobs_break_the_rules_that_the_jobs_break() -> None:
    compared, seen = 0, set[str]()
    for seed in range(150):
        loaded = load(Path("random.job"), None, data=Writer(rng=Random(seed)).job().encode())
        assert isinstance(loaded, Checked)
        compiled = compile_calls(loaded)
        if isinstance(compiled, Compiled):
            of_job, of_calls = of_rules(examine(compiled)), of_rules(read_back(compiled))
            assert of_calls - of_job <= ONLY_IN_CALLS, seed
            assert of_job - of_calls <= ONLY_IN_JOBS, seed
            compared, seen = compared + 1, seen | of_calls
    assert compared > 50
    assert {"GJ406", "GJ209", "GJ210", "GJ405", "GJ306", "GJ408", "GJ404"} <= seen


def test_a_pulse_width_does_not_matter_in_a_duty_mode() -> None:
    text = FREQUENCY + "GT_LaserPowerMode(0,100,0,0)\nGT_LaserOutFrq(10,0)\nGT_LaserPrfCmd(90,0)\n"
    assert "GJ207" not in codes(text + mark(line(1000)) + START)


@pytest.mark.parametrize(("lost", "count"), [(40, 1), (30, 0), (10, 0)])
def test_an_unused_power_that_is_used_elsewhere_may_be_one_of_a_loop(lost: int, count: int) -> None:
    powers = f"GT_BufLaserPrfCmd(1,{lost},0,0)\nGT_BufLaserPrfCmd(1,50,0,0)\n"
    text = DUTY + POWER + mark(line(1000)) + powers + line(2000) + mark(line(3000)) + START
    assert codes(text).count("GJ210") == count


def test_the_guide_lists_the_rules_that_hold() -> None:
    guide = (ROOT / "docs" / "checking.md").read_text(encoding="utf-8")
    sentence = guide.partition("these hold for listings")[2].partition("A listing does not show")[0]
    listed = {f"GJ{first + k}" for first, last in _spans(sentence) for k in range(last - first + 1)}
    assert {code for code in listed if code in RULES} == KNOWN | {"GJ202"}


def _spans(text: str) -> list[tuple[int, int]]:
    return [(int(a), int(b or a)) for a, b in re.findall(r"GJ(\d+)(?: to GJ(\d+))?", text)]


def test_what_a_line_that_cannot_be_read_may_contain_is_not_reported_as_missing() -> None:
    text = DUTY + POWER + mark(line(1000)) + mark(line(2000)) + START
    for last, expected in (("0)", set()), ("speed)", set()), ("", {"GJ408"})):
        off = OFF.replace("0)", last) if last else ""
        loaded = load(Path("x.gts"), None, data=text.replace(OFF, off, 1).encode())
        assert isinstance(loaded, Checked)
        assert of_rules(examine(loaded)) == expected


def test_positions_are_those_of_the_machine() -> None:
    """With a new origin the same target is another place; with the origin of the start it is the same one."""
    crd = "GT_SetCrdPrm(1,{{2,{{1,2,0,0,0,0,0,0}},500,20,0,{flag},{{0,0,0,0,0,0,0,0}}}})\n"
    for flag, codes in ((0, set()), (1, {"GJ513"})):
        system = crd.format(flag=flag)
        ran = run_listing(DUTY + POWER + system + mark(line(1000)) + START + WAIT + system + mark(line(1000)) + START)
        assert set(ran.codes()) & {"GJ513"} == codes
