"""Rules whose bounds are closed forms: just inside is quiet, just outside is not."""

from __future__ import annotations

import pytest
from support.tools import MACHINE, MARK, diagnostics_in

from gusjob.controllers.gus.lower import compile_job
from gusjob.controllers.gus.model import find_diagnostics
from gusjob.frontend import check_text, read_job, read_listing
from gusjob.simulate.emission import Emission
from gusjob.simulate.power import HeldPower, SegmentEmission

FAST = "LASER MODE DUTY CARRIER 10\nVEL 1000\nACC 1000000\nLASER POWER 30\n"
"""1 mm from rest to rest takes 1 ms at 1000 mm/s and 1 ms for both ramps of 1000 mm/s at 10^6 mm/s2."""


def codes(text: str) -> list[str]:
    return [code for _, code in diagnostics_in(text)]


@pytest.mark.parametrize(("off_us", "said"), [(2049, []), (2050, ["GJ313"])])
def test_an_off_delay_bridges_a_jump_of_two_ms(off_us: int, said: list[str]) -> None:
    path = "LASER ON\nLINE X 50\nLASER OFF\nJUMP X 51\nLASER ON\nLINE X 90\nLASER OFF\n"
    assert codes(f"LASER DELAY ON 50 OFF {off_us}\n{FAST}{path}") == said


@pytest.mark.parametrize(("gap_us", "said"), [(2000, []), (2001, ["GJ312"])])
def test_a_gap_outlasts_a_mark_of_two_ms(gap_us: int, said: list[str]) -> None:
    assert codes(f"{FAST}LASER FPK WIDTH 10 GAP {gap_us} OFFDELAY 0\nLASER ON\nLINE X 1\nLASER OFF\n") == said


@pytest.mark.parametrize(("delays", "said"), [("ON 1 OFF 200", ["GJ403", "GJ406"]), ("ON 9 OFF 9", ["GJ406"])])
def test_light_of_the_delays_alone_needs_a_power(delays: str, said: list[str]) -> None:
    assert codes(f"{MARK}LASER DELAY {delays}\nLASER ON\nLASER OFF\nLINE X 5\n") == said


def test_what_a_line_with_a_fault_may_hold_is_not_missed() -> None:
    assert codes(MARK + "LASER POWER 30\nLASER ON\nLNE X 5\nLASER OFF\n") == ["GJ102"]


@pytest.mark.parametrize(("end", "said"), [(3.5, []), (3.6, ["GJ514"])])
def test_a_right_angle_changes_the_velocity_by_the_root_of_two(end: float, said: list[str]) -> None:
    """Look-ahead allows 5 ms x 1 pulse/ms2, that is 5 mm/s: 3.535 mm/s through a right angle."""
    source, _ = check_text(f"{MARK}LINE X 5 END {end}\nLINE Y 5\n".encode(), "x.job")
    assert source is not None
    assert [f.rule.code for f in compile_job(read_job(source, MACHINE)[0], MACHINE)[1]] == said


def test_faults_need_no_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A listing of twelve days has 4 * 10^9 ticks; what is wrong with it hangs on none of them."""
    text = (
        "GT_LaserPowerMode(0,100,0,0)\nGT_CrdClear(1,0)\nGT_BufLaserPrfFollow(1,0.1,5,50,0,0)\nGT_BufLaserOn(1,0,0)\n"
        "GT_LnXY(1,1000000000,0,1,2,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )
    periods_ms: list[float] = []

    emitted = HeldPower.emitted

    def seen(power: HeldPower, emission: Emission) -> tuple[SegmentEmission, float]:
        periods_ms.append(power.period_ms)
        return emitted(power, emission)

    monkeypatch.setattr(HeldPower, "emitted", seen)
    source, _ = check_text(text.encode(), "x.gts")
    assert source is not None
    assert "GJ709" in [f.rule.code for f in find_diagnostics(read_listing(source)[0], MACHINE)]
    assert periods_ms[0] >= 1e9 / 200_000
