"""Diagnostics of a stream need no ticks."""

from __future__ import annotations

import pytest
from support.tools import MACHINE, find_diagnostics

from gusjob.frontend import check_text, read_listing
from gusjob.simulate.emission import Emission
from gusjob.simulate.power import HeldPower, SegmentEmission


def test_diagnostics_need_no_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    """A listing of twelve days has 4 * 10^9 ticks; its diagnostics need none of them."""
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
