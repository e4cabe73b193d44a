"""Laser rules whose bounds are closed forms: just inside nothing is reported, just outside the rule is."""

from __future__ import annotations

import pytest
from support.tools import MACHINE, MARK, diagnostics_in, job_of, stream_of

from gusjob.controllers.gus.model import simulate_stream
from gusjob.lint import check

FAST = "LASER MODE DUTY CARRIER 10\nVEL 1000\nACC 1000000\nLASER POWER 30\n"
"""1 mm from rest to rest takes 1 ms at 1000 mm/s and 1 ms for both ramps of 1000 mm/s at 10^6 mm/s2."""


def codes(text: str) -> list[str]:
    return [code for _, code in diagnostics_in(text)]


@pytest.mark.parametrize(("off_us", "expected"), [(2049, []), (2050, ["GJ313"])])
def test_an_off_delay_bridges_a_jump_of_two_ms(off_us: int, expected: list[str]) -> None:
    path = "LASER ON\nLINE X 50\nLASER OFF\nJUMP X 51\nLASER ON\nLINE X 90\nLASER OFF\n"
    assert codes(f"LASER DELAY ON 50 OFF {off_us}\n{FAST}{path}") == expected


@pytest.mark.parametrize(("gap_us", "expected"), [(2000, []), (2001, ["GJ312"])])
def test_a_gap_outlasts_a_mark_of_two_ms(gap_us: int, expected: list[str]) -> None:
    assert codes(f"{FAST}LASER FPK WIDTH 10 GAP {gap_us} OFFDELAY 0\nLASER ON\nLINE X 1\nLASER OFF\n") == expected


@pytest.mark.parametrize(("delays", "expected"), [("ON 1 OFF 200", ["GJ403", "GJ406"]), ("ON 9 OFF 9", ["GJ406"])])
def test_emission_of_the_delays_alone_needs_a_power(delays: str, expected: list[str]) -> None:
    assert codes(f"{MARK}LASER DELAY {delays}\nLASER ON\nLASER OFF\nLINE X 5\n") == expected


def test_what_an_unreadable_line_may_contain_is_not_reported_as_missing() -> None:
    assert codes(MARK + "LASER POWER 30\nLASER ON\nLNE X 5\nLASER OFF\n") == ["GJ102"]


MARK_OF_2_MS = "LASER ON\nLINE X 1\nLASER OFF\n"
PAUSE_OF_2_MS = "LASER ON\nLINE X 50\nLASER OFF\nJUMP X 51\nLASER ON\nLINE X 90\nLASER OFF\n"


@pytest.mark.parametrize(
    ("delays", "path", "expected"),
    [
        ("LASER DELAY ON 2001 OFF 5000\n", MARK_OF_2_MS, "the on delay of 2001 us is longer than this mark"),
        (
            "LASER DELAY ON 100 OFF 100\nLASER FPK WIDTH 10 GAP 2000 OFFDELAY 0\n",
            MARK_OF_2_MS,
            "emission begins 2100 us after the start of this mark (on delay 100 us, FPK GAP 2000 us), which takes at "
            "most 2000 us: there is no emission",
        ),
        (
            "LASER DELAY ON 100 OFF 100\nLASER FPK WIDTH 10 GAP 2000 OFFDELAY 1\n",
            MARK_OF_2_MS,
            "emission begins 2100 us after the start of this mark (on delay 100 us, FPK GAP 2000 us), which takes at "
            "most 2000 us: emission begins after the mark",
        ),
        # The edges of the switch cross: it never goes on, and the first pulse killer's own off delay changes nothing.
        ("LASER DELAY ON 3000 OFF 500\nLASER FPK WIDTH 10 GAP 0 OFFDELAY 9000\n", MARK_OF_2_MS, "there is no emission"),
        ("LASER DELAY ON 50 OFF 2050\n", PAUSE_OF_2_MS, "the off delay of 2050 us"),
        # The switch stays on over the jump, so the gap of the first pulse killer comes once, before the first mark.
        (
            "LASER DELAY ON 0 OFF 2000\nLASER FPK WIDTH 10 GAP 500 OFFDELAY 0\n",
            PAUSE_OF_2_MS,
            "the off delay of 2000 us",
        ),
        (
            "LASER DELAY ON 0 OFF 100\nLASER FPK WIDTH 10 GAP 0 OFFDELAY 1900\n",
            PAUSE_OF_2_MS,
            "emission ends 2000 us after the mark before (off delay 100 us, FPK OFFDELAY 1900 us)",
        ),
        ("LASER DELAY ON 0 OFF 100\nLASER FPK WIDTH 10 GAP 1 OFFDELAY 1900\n", PAUSE_OF_2_MS, None),
    ],
)
def test_delays_of_the_switch_and_of_the_first_pulse_killer(delays: str, path: str, expected: str | None) -> None:
    """The words are those of the delay, and what is said of the emission is what the simulation has."""
    text = "LOOKAHEAD OFF\n" + delays + FAST + path
    found = [d for d in check(job_of(text), MACHINE) if d.rule.code in ("GJ312", "GJ313")]
    assert len(found) == (expected is not None)
    emission = simulate_stream(stream_of(text), MACHINE)[0]
    assert emission is not None
    intervals = emission.channels[0].emission
    if expected is None:
        assert len(intervals.stage) == 2
        return
    assert expected in found[0].message
    if path is PAUSE_OF_2_MS:
        assert len(intervals.stage) == 1
    else:
        assert len(intervals.stage) == ("there is no emission" not in found[0].message)


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("LASER ON\nDWELL 5\nLINE X 1\nLASER OFF\n", []),  # A pierce.
        ("LASER ON\nDWELL 5\nLASER POWER 20\nDWELL 6\nLINE X 1\nLASER OFF\n", []),
        ("LASER ON\nDWELL 5\nLASER OFF\n", []),  # A shot.
        ("LASER ON NOW\nDWELL 5\nLINE X 1\nLASER OFF NOW\n", []),
        ("LASER ON\nLINE X 1\nLASER OFF\nDWELL 5\n", []),
        ("LASER ON\nLINE X 1\nDWELL 5\nLASER OFF\n", [7]),  # The end of a mark.
        ("LASER ON\nLINE X 1\nDWELL 5\nLASER OFF NOW\n", [7]),
        ("LASER ON\nLINE X 1\nDWELL 5\nDWELL 6\nLASER OFF\n", [7, 8]),
        ("LASER ON\nLINE X 1\nWAIT\nDWELL 5\nLASER OFF\n", [8]),  # Another stage.
        ("LASER ON\nREPEAT 2\nDWELL 5\nLINE X 1\nLASER POWER 20\nLINE X 0\nEND\nLASER OFF\n", [7]),
        ("LASER ON NOW\nLINE X 1\nLASER OFF NOW\nLASER ON NOW\nDWELL 5\nLASER OFF NOW\n", []),  # Another mark.
        ("CHANNEL 1\nLASER MODE ANALOG\nLASER POWER 3\nLASER ON\nLINE X 1\nDWELL 5\nLASER OFF\n", [10]),
    ],
)
def test_only_the_start_of_a_mark_may_stand_still(path: str, expected: list[int]) -> None:
    assert [line for line, code in diagnostics_in(f"{MARK}LASER POWER 30\n{path}") if code == "GJ404"] == expected
