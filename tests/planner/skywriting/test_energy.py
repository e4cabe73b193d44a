"""Energy of marks: even along a mark, and none outside."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from msgspec.structs import replace
from oracles.skywriting import Sky, Step
from support.skywriting import BEAM, FAST, case_of, head, marked, must
from support.tools import MACHINE, run_job

from gusjob.config.machine import Scanner, ScannerModel


# Energy.
@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("follow", [False, True])
@pytest.mark.parametrize("shift", [0.0, -20.0])
def test_energy_per_mm_is_constant(mode: int, follow: bool, shift: float) -> None:
    sky = Sky(mode=mode, timelag=200.0, shift=shift, nprev=60, npost=46)
    for seed in range(6):
        rng = Random(seed)
        vel, acc = rng.choice((200.0, 1000.0)), rng.choice((250.0, 1000.0))
        steps = head(sky, vel, acc)
        if follow:
            steps.append(Step(op="follow", value=5000.0))
        for _ in range(4):
            x, y = rng.randint(-9000, 9000), rng.randint(-9000, 9000)
            steps = marked(
                [*steps, Step(op="jump", at=(x, y))], (x + rng.randint(1000, 9000), y + rng.randint(0, 9000))
            )
        case = must(case_of(steps))
        power = 1.0 + 79.0 * vel / 5000.0 if follow else 50.0
        found = case.trace.channels[0].emitted
        emits = found.emission_ms > 0
        assert found.power_min[emits] == pytest.approx(power, rel=1e-3)
        assert found.power_max[emits] == pytest.approx(power, rel=1e-3)
        expected = sum(m.rows[0].way.length / vel - shift / 1000 for m in case.plan.marks) * power
        slack = len(case.plan.marks) * 2 * BEAM / vel * power
        assert found.power_ms.sum() == pytest.approx(expected, abs=slack)


@pytest.mark.parametrize("vel", [200.0, 1000.0])
def test_power_at_a_flat_corner_acts_where_the_beam_is(vel: float) -> None:
    """TIMELAG behind the corner."""
    sky = Sky(mode=3, timelag=250.0)
    steps = [*head(sky, vel), Step(op="on"), Step(op="line", at=(10000.0, 5000.0)), Step(op="power", value=20.0)]
    steps += [Step(op="line", at=(20000.0, 5000.0)), Step(op="off")]
    found = must(case_of(steps)).trace.channels[0].emitted
    assert found.power_ms.sum() == pytest.approx((5000.0 * 50 + 10000.0 * 20) / vel, abs=2 * BEAM * 50 / vel)


def test_power_at_a_sharp_corner_is_that_of_each_mark() -> None:
    sky = Sky(mode=2, timelag=250.0)
    steps = [*head(sky), Step(op="on"), Step(op="line", at=(10000.0, 5000.0)), Step(op="power", value=20.0)]
    steps += [Step(op="line", at=(10000.0, 15000.0)), Step(op="off")]
    found = must(case_of(steps)).trace.channels[0].emitted
    assert found.power_ms.sum() == pytest.approx((5000.0 * 50 + 10000.0 * 20) / FAST, abs=2 * BEAM * 50 / FAST)


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_power_set_before_laser_off_follows_the_beam(mode: int) -> None:
    """LINE, LASER POWER, LASER OFF: all of the mark has the power that it was run with."""
    sky = Sky(mode=mode, timelag=250.0)
    steps = [*head(sky), Step(op="on"), Step(op="line", at=(10000.0, 5000.0)), Step(op="power", value=20.0)]
    steps += [Step(op="off"), Step(op="jump", at=(0.0, 0.0))]
    steps += [Step(op="on"), Step(op="line", at=(10000.0, 0.0)), Step(op="off")]
    found = must(case_of(steps)).trace.channels[0].emitted
    assert found.power_ms.sum() == pytest.approx((5000.0 * 50 + 10000.0 * 20) / FAST, abs=2 * BEAM * 50 / FAST)


_PATHS = {
    "line": ("LINE X 25 Y 3.5\n", 1),
    "arc": ("ARC CCW X 20 Y 10 R 5\n", 1),
    "circle": ("ARC CW I -3 J 2\n", 1),
    "polyline": ("LINE X 23\nLINE X 26 Y 0.3\nARC CCW X 26.3 Y 3 R 2\nLINE X 22 Y 5\n", None),
}


@pytest.mark.parametrize("power", ["LASER POWER 50", "LASER FOLLOW MIN 1 MAX 50 AT 800"])
@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("path", _PATHS)
def test_marks_have_even_power_and_exact_ends(path: str, mode: int, power: str) -> None:
    """With a pure delay of TIMELAG: ends within a pulse, 50 % at 800 mm/s everywhere, none outside."""
    lines, count = _PATHS[path]
    found = run_job(
        f"LASER MODE DUTY CARRIER 10\n{power}\nVEL 800\nACC 500000\n"
        f"SKYWRITE MODE {mode} TIMELAG 250us NPREV 60 NPOST 60 LIMIT 0.999\n"
        f"JUMP X 20 Y 0\nLASER ON\n{lines}LASER OFF\nJUMP X 0\n",
        replace(MACHINE, scanner=Scanner(model=ScannerModel.DELAY, tracking_error_us=250.0)),
    )
    marks = found.report.marks
    assert marks is not None
    assert len(marks["line"]) == (count or 4)
    for name in ("on_error_um", "off_error_um", "on_miss_um", "off_miss_um"):
        assert np.abs(marks[name]).max() <= 2, name
    assert marks["outside_power_ms"].max() <= 50 * 2 / 800
    assert marks["power_per_mm_mid"] == pytest.approx(50 / 0.8, rel=1e-3)
    # Half a pulse where an arc is split is 1 % of one bin of 50 um, and 0.13 % of sixty.
    assert marks["power_per_mm_rms_pct"] == pytest.approx(0, abs=0.1 if path in ("line", "circle") else 0.15)
