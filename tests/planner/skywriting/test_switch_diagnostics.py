"""Switches that have no motion, marks without emission, marks that are not at speed."""

from __future__ import annotations

import pytest
from support.skywriting import HEAD_MM, compiled, diagnostics_of

from gusjob.config.machine import Machine
from gusjob.diagnostics.model import Severity


@pytest.mark.parametrize(("shift", "to"), [("5000", 10.0), ("299.5us", 5.3), ("6000", 10.0)])
def test_a_mark_without_emission_is_an_error(shift: str, to: float) -> None:
    """SHIFT as long as the mark, or longer, or shorter by less than a pulse."""
    text = (
        "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 1000\nACC 500000\n"
        f"SKYWRITE MODE 2 TIMELAG 250us SHIFT {shift}\nJUMP X 5\nLASER ON\nLINE X {to}\nLASER OFF\nJUMP X 0\n"
    )
    assert "GJ810" in {f.rule.code for f in compiled(text)[1]}


LAG = "SKYWRITE MODE 2 TIMELAG 400us"
LONG_DELAY = (
    "LASER DELAY OFF, with OFFDELAY of LASER FPK, is too long for this mark: reduce it, or raise LASER DELAY ON"
)
KILLER = "LASER MODE FREQUENCY WIDTH 5 MAX 100\nLASER POWER 30\nLASER FPK WIDTH 20 GAP 15 OFFDELAY 150\n"


@pytest.mark.parametrize(
    ("settings", "mark", "expected"),
    [
        (f"{LAG} SHIFT 150us", "LINE X 5.1", [("GJ810", 50.0, "the mark is shorter than SHIFT")]),
        (f"{LAG} SHIFT 9000us", "LINE X 5.1", [("GJ810", 8900.0, "the mark is shorter than SHIFT")]),
        (f"{LAG} SHIFT 99.5us", "LINE X 5.1", [("GJ810", None, "SHIFT leaves less than a pulse of the mark")]),
        (f"{LAG}\nLASER DELAY ON 0 OFF 300", "LINE X 5.1", [("GJ810", 200.0, LONG_DELAY)]),
        (f"{LAG}\nLASER DELAY ON 200 OFF 500", "LINE X 5.05\nLINE X 5.1", [("GJ810", 250.0, LONG_DELAY)] * 2),
        (f"{LAG}\nLASER DELAY ON 0 OFF 100", "LINE X 5.1", [("GJ810", None, LONG_DELAY)]),
        (f"{KILLER}{LAG}", "LINE X 5.1", [("GJ810", 50.0, LONG_DELAY)]),
        (f"{LAG} SHIFT 60us\nLASER DELAY ON 0 OFF 60", "LINE X 5.1", [("GJ810", 20.0, LONG_DELAY)]),
        (
            f"{LAG.replace('2', '3')}\nLASER DELAY ON 0 OFF 300",
            "LINE X 15\nLASER POWER 40\nLINE X 15.1",
            [("GJ809", 200.0, "shorten LASER DELAY OFF")],
        ),
        (LAG, "LINE X 5.0004", [("GJ810", None, "the mark is shorter than a pulse")]),
        (
            "LASER DELAY ON 50000 OFF 50000\nSKYWRITE MODE 2 TIMELAG 200us",
            "LINE X 15",
            [
                ("GJ809", 44800.0, "shorten LASER DELAY ON, or raise NPREV"),
                ("GJ809", 34800.0, "shorten LASER DELAY OFF, or raise NPREV"),
            ],
        ),
    ],
)
def test_one_cause_and_the_true_one(settings: str, mark: str, expected: list[tuple[str, float | None, str]]) -> None:
    """A mark of 100 us at 1000 mm/s."""
    text = HEAD_MM + f"LASER POWER 30\n{settings}\nJUMP X 5\nLASER ON\n{mark}\nLASER OFF\nJUMP X 50\n"
    found = [f for f in diagnostics_of(text) if f.rule.code in ("GJ809", "GJ810")]
    values = [f.fields.get("late", f.fields.get("early")) for f in found]
    causes = [f.fields.get("cause", f.fields.get("mend")) for f in found]
    assert [(f.rule.code, cause) for f, cause in zip(found, causes, strict=True)] == [e[::2] for e in expected]
    assert values == [value if value is None else pytest.approx(value, rel=0.02) for _, value, _ in expected]


@pytest.mark.parametrize(("length", "slow"), [(0.405, [("ends", 900.0)]), (0.485, [])])
def test_how_much_slower_a_mark_may_end(length: float, slow: list[tuple[str, float]]) -> None:
    """From rest at a flat corner v^2 = 2*a*s: 900 mm/s behind 405 um, 985 behind 485."""
    text = HEAD_MM + "SKYWRITE MODE 3 TIMELAG 250us LIMIT 0.5\nJUMP X 5\nLASER ON\nLINE X 10\n"
    text += f"LINE X {10 + 0.8 * length} Y {0.6 * length}\nLASER OFF\nJUMP X 0\n"
    found = [
        f.fields for f in diagnostics_of(text, Machine(lookahead_acc_pulse_per_ms2=1e-6)) if f.rule.code == "GJ811"
    ]
    assert [(f["what"], f["value"]) for f in found] == [(what, pytest.approx(v, rel=1e-3)) for what, v in slow]


@pytest.mark.parametrize("other", [0, 1])
def test_switching_at_a_flat_corner_is_no_mark_without_emission(other: int) -> None:
    """Off and on at one point, of one channel or of two, is no mark without emission."""
    text = HEAD_MM + f"LASER MODE DUTY CARRIER 10 CHANNEL {other}\nLASER POWER 50 CHANNEL {other}\n"
    text += "SKYWRITE MODE 3 TIMELAG 250us\nJUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\n"
    text += f"LASER ON CHANNEL {other}\nLINE X 20\nLASER OFF CHANNEL {other}\n"
    assert [f.rule.code for f in diagnostics_of(text) if f.severity is not Severity.NOTE] == []


def test_a_delay_does_not_hide_a_mark_without_emission() -> None:
    """On is called before off, but acts 100 us behind it."""
    text = HEAD_MM + "SKYWRITE MODE 2 TIMELAG 400us SHIFT 200us\nLASER DELAY ON 300 OFF 0\nJUMP X 5\nLASER ON\n"
    assert "GJ810" in {f.rule.code for f in diagnostics_of(text + "LINE X 5.1\nLASER OFF\nJUMP X 9\n")}


@pytest.mark.parametrize(("lag", "coarse"), [(300, False), (450, True)])
def test_laser_off_nearly_at_rest_is_reported(lag: int, coarse: bool) -> None:
    """Braking from 500 mm/s in 0.5 ms: 200 mm/s at 0.3 ms, 50 at 0.45."""
    text = HEAD_MM.replace("VEL 1000", "VEL 500") + f"SKYWRITE MODE 2 TIMELAG {lag}us NPREV 75 NPOST 0\nJUMP X 1\n"
    found = diagnostics_of(text + "LASER ON\nLINE X 5\nLASER OFF\nJUMP X 0\n")
    assert ("GJ812" in {f.rule.code for f in found}) == coarse


@pytest.mark.parametrize(("lag", "late"), [(2410, []), (2420, [5.8])])
def test_how_late_laser_off_may_be_behind_the_last_mark(lag: int, late: list[float]) -> None:
    """Mode 1: down in 1 ms, back to E in sqrt(2) ms."""
    text = HEAD_MM + f"SKYWRITE MODE 1 TIMELAG {lag}us NPREV 0 NPOST 0\nJUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\n"
    found = diagnostics_of(text, Machine(lookahead_acc_pulse_per_ms2=1e-6))
    assert [f.fields["early"] for f in found if f.rule.code == "GJ809"] == [pytest.approx(v, abs=0.1) for v in late]
