"""The profile's [budget] as a gate: each limit at its figure and just below it, in closed form, at the line."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace
from support.cli import gusjob, write
from support.tools import stream_of

from gusjob.config.machine import Budget, Laser, Machine
from gusjob.controllers.gus.model import simulate_stream
from gusjob.simulate.quality.budget import over_budget

JOB = (
    "LOOKAHEAD OFF\nLASER MODE DUTY CARRIER 10 MAX 60\nVEL 100\nACC 10000\n"
    "LASER POWER 40\nLASER ON\nLINE X 10\nLASER OFF\n"  # 7: 110 ms, 10 ms and 0.5 mm to speed up
    "LASER DELAY ON 5ms OFF 5ms\nLASER FOLLOW MIN 0 MAX 80 AT 100\nLASER ON\nLINE X 0\nLASER OFF\n"  # 12
)
MACHINE = Machine(lasers=(Laser(channel=0, rated_w=50.0),))


def broken(budget: Budget) -> list[tuple[object, ...]]:
    """(code, line, value) of what is above a budget."""
    trace, _ = simulate_stream(stream_of(JOB, MACHINE), MACHINE)
    assert trace is not None
    found = over_budget(trace, replace(MACHINE, budget=budget))
    return [
        (diagnostic.rule.code, diagnostic.span.line, round(float(diagnostic.fields["value"]), 6))
        for diagnostic in found
    ]


@pytest.mark.parametrize(
    ("name", "code", "line", "value"),
    [
        ("duration_s", "GJ605", 12, 0.22),
        ("power_pct", "GJ606", 12, 60.0),
        ("power_w", "GJ606", 12, 30.0),
        # Above 75 mm/s more than 60 % is asked for: from the tick at 7.75 ms to 102.5 ms.
        ("clamped_ms", "GJ608", 12, 94.75),
        # 5 ms after a start with 10000 mm/s2: 125 um.
        ("on_error_um", "GJ609", 12, 125.0),
    ],
)
def test_a_limit_is_broken_just_above_it(name: str, code: str, line: int, value: float) -> None:
    assert broken(Budget(**{name: value * (1 + 1e-9)})) == []
    assert broken(Budget(**{name: value * (1 - 1e-6)})) == [(code, line, pytest.approx(value, rel=1e-6))]


def test_energy_per_mm_is_the_peak_of_a_mark() -> None:
    """The first 0.05 mm from rest take sqrt(2 * 0.05 / 10000) s = 3.162 ms at 40 %: 2529.8 %*ms/mm, 1.2649 J/mm."""
    assert broken(Budget(energy_pct_ms_per_mm=2530)) == []
    assert broken(Budget(energy_pct_ms_per_mm=2529)) == [("GJ607", 7, pytest.approx(2529.822, rel=1e-6))]
    assert broken(Budget(energy_j_per_mm=1.2649)) == [("GJ607", 7, pytest.approx(1.264911, rel=1e-6))]
    assert broken(Budget(energy_khz_ms_per_mm=0, energy_v_ms_per_mm=0, power_khz=0, power_v=0)) == []


def test_without_rated_power_there_are_no_watts() -> None:
    trace, _ = simulate_stream(stream_of(JOB), Machine())
    assert trace is not None
    assert over_budget(trace, Machine(budget=Budget(power_w=0, energy_j_per_mm=0))) == []


def test_a_budget_is_a_gate(tmp_path: Path) -> None:
    """check, report and run say so and fail; the report is made all the same."""
    path = write(tmp_path, JOB)
    assert gusjob("check", path).exit_code == 0
    write(tmp_path, "[budget]\npower_pct = 50\n", "gusjob.toml")
    for command in ("check", "report", "run"):
        done = gusjob(command, path)
        assert done.exit_code == 1, command
        assert "x.job:12:1: error[GJ606]: channel 0 emits 60 %; the budget is 50 %" in done.output, command
    out = tmp_path / "x.json"
    assert gusjob("report", path, "-o", out).exit_code == 1
    assert '"code":"GJ606"' in out.read_text(encoding="utf-8")


def test_the_line_is_the_included_files_own(tmp_path: Path) -> None:
    write(tmp_path, "\nLINE X 10\n", "part.job")
    write(tmp_path, "[budget]\nduration_s = 0.1\n", "gusjob.toml")
    path = write(tmp_path, 'LOOKAHEAD OFF\nVEL 100\nACC 10000\nINCLUDE "part.job"\n')
    assert "part.job:2:1: error[GJ605]: the run takes 0.11 s" in gusjob("check", path).output


@pytest.mark.parametrize("entry", ["power = 3", "power_pct = -1", 'power_pct = "50"'])
def test_a_budget_that_is_wrong(tmp_path: Path, entry: str) -> None:
    write(tmp_path, f"[budget]\n{entry}\n", "gusjob.toml")
    done = gusjob("check", write(tmp_path, JOB))
    assert done.exit_code == 1
    assert "gusjob.toml:2:" in done.output
