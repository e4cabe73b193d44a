"""Each range at its ends and at the next float beyond."""

from __future__ import annotations

import math

import pytest

from gusjob.controllers.gus import ranges
from gusjob.controllers.gus.ranges import TABLE, Membership, PowerMode, Range


@pytest.mark.parametrize("allowed", TABLE, ids=lambda r: r.name)
def test_ends(allowed: Range) -> None:
    for end, is_open, beyond in (
        (allowed.low, allowed.low_open, -math.inf),
        (allowed.high, allowed.high_open, math.inf),
    ):
        if math.isinf(end):
            assert allowed.classify_one(end) is Membership.OUTSIDE
            continue
        on_end = Membership.ON_TOLERATED_END if allowed.ends_tolerated else Membership.OUTSIDE
        assert allowed.classify_one(end) is (on_end if is_open else Membership.INSIDE)
        assert allowed.classify_one(math.nextafter(end, beyond)) is Membership.OUTSIDE
        assert allowed.classify_one(math.nextafter(end, -beyond)) is Membership.INSIDE


@pytest.mark.parametrize("allowed", TABLE, ids=lambda r: r.name)
def test_no_nan_and_no_fraction_where_the_type_is_whole(allowed: Range) -> None:
    assert allowed.classify_one(math.nan) is Membership.OUTSIDE
    assert not allowed.carries(math.nan)
    assert not allowed.carries(math.inf)
    assert bool(allowed.carries(1.5)) is not allowed.whole
    assert allowed.carries(1.0)


def test_the_manuals_ranges() -> None:
    """二.2, 四.2, by hand from the manual."""
    assert str(ranges.CARRIER_KHZ) == "(0, 2000] kHz"
    assert str(ranges.PULSE_WIDTH_US) == "(0, 65535] us"
    assert str(ranges.STANDBY_KHZ) == "(0, 2000] kHz"
    assert str(ranges.STANDBY_PCT) == "[0, 100] %"
    assert str(ranges.PREVOLTAGE_V) == "[0, 10] V"
    assert str(ranges.SWITCH_DELAY_US) == "[0, 65535] us"
    assert str(ranges.FPK_WIDTH_US) == "(0, 65535] us"
    assert str(ranges.FPK_GAP_US) == "[0, 65535] us"
    assert str(ranges.CRD) == "[1, 2]"
    assert [str(ranges.POWER[m]) for m in PowerMode] == ["(0, 100) %", "(0, 2000) kHz", "(0, 10) V", "(0, 100) %"]
    assert [str(ranges.POWER_NOW[m]) for m in PowerMode] == ["[0, 100] %", "[0, 2000] kHz", "[0, 10] V", "[0, 100] %"]


def test_no_second_copy_of_a_number() -> None:
    """The telling numbers of the manual stand in ranges.py alone."""
    import re

    from support.tools import ROOT

    for path in (ROOT / "gusjob").rglob("*.py"):
        if path.name == "ranges.py":
            continue
        text = re.sub(r"#.*|\"[^\"\n]*\"|\"\"\".*?\"\"\"", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        assert not re.search(r"(?<![\w.])(65535|32767|16383|1073741823)(?![\w.])", text), path
