"""The machine profile: found, read, refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from gusjob.config.machine import Laser, Machine
from gusjob.config.profile import MAX_PROFILE_MB, find_profile, parse_profile, read_profile
from gusjob.controllers.gus.ranges import PowerMode


def test_the_documented_defaults() -> None:
    machine = Machine()
    assert machine.pulses_per_mm == (1000, 1000)
    assert machine.field_x_mm == machine.field_y_mm == (-150, 150)
    assert (machine.max_velocity_mm_s, machine.max_acceleration_mm_s2) == (10_000, 1e6)
    assert (machine.period_us, machine.lookahead_time_ms, machine.lookahead_acc_pulse_per_ms2) == (250, 5, 1)
    assert machine.chord_tolerance_um == 1
    assert machine.laser(0).rated_w is None
    # In the controller's units, by hand: 10 m/s at 1 um a pulse is 10000 pulse/ms; 10^6 mm/s2 is 1000 pulse/ms2.
    assert (machine.max_velocity_pulse_per_ms, machine.max_acceleration_pulse_per_ms2) == (10_000, 1000)


def test_nearest_profile_upwards_is_found(tmp_path: Path) -> None:
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    assert find_profile(inner / "x.job") is None or tmp_path not in (find_profile(inner / "x.job") or Path()).parents
    (tmp_path / "gusjob.toml").write_text("period_us = 100\n", encoding="utf-8")
    assert find_profile(inner / "x.job") == tmp_path.resolve() / "gusjob.toml"
    (inner / "gusjob.toml").write_text("period_us = 50\n", encoding="utf-8")
    assert find_profile(inner / "x.job") == inner.resolve() / "gusjob.toml"


def test_a_whole_profile() -> None:
    profile = parse_profile(
        'name = "A"\npulses_per_mm = [800, 400]\nfield_x_mm = [-10, 20]\n[lookahead]\ntime_ms = 2\n'
        '[[laser]]\nchannel = 1\nrated_w = 50\nname = "YAG"\n'
    )
    assert profile.diagnostics == ()
    machine = profile.machine
    assert machine.pulses_per_mm == (800, 400)
    assert not machine.equal_axes
    assert machine.lookahead_time_ms == 2
    assert machine.laser(1) == Laser(channel=1, name="YAG", rated_w=50)
    assert machine.laser(0).rated_w is None


def test_watts_by_mode() -> None:
    laser = Laser(channel=0, rated_w=40)
    assert laser.watts_per_unit(PowerMode.DUTY, 0) == 0.4
    assert laser.watts_per_unit(PowerMode.DUTY2, 0) == 0.4
    assert laser.watts_per_unit(PowerMode.ANALOG, 0) == 4
    # 10 us at 1 kHz are 1 % of the time.
    assert laser.watts_per_unit(PowerMode.FREQUENCY, 10) == pytest.approx(0.4)
    assert Laser(channel=0).watts_per_unit(PowerMode.DUTY, 0) is None


def test_a_profile_that_is_none(tmp_path: Path) -> None:
    assert [f.rule.code for f in read_profile(tmp_path / "no.toml").diagnostics] == ["GJ001"]
    (tmp_path / "bytes.toml").write_bytes(b"name = '\xff'")
    assert [f.rule.code for f in read_profile(tmp_path / "bytes.toml").diagnostics] == ["GJ002"]
    assert [f.rule.code for f in parse_profile("laser = 3\nlookahead = 1\n").diagnostics] == ["GJ603", "GJ603"]
    (tmp_path / "nul.toml").write_bytes(b"name = '\0'")
    assert [f.rule.code for f in read_profile(tmp_path / "nul.toml").diagnostics] == ["GJ002"]
    (tmp_path / "large.toml").write_bytes(b"#" * (MAX_PROFILE_MB * 1_000_000 + 1))
    assert [f.rule.code for f in read_profile(tmp_path / "large.toml").diagnostics] == ["GJ003"]
    profile = parse_profile("period_us = 1e400\nchord_tolerance_um = true\n")
    assert sorted(f.rule.code for f in profile.diagnostics) == ["GJ603", "GJ604"]
    assert profile.machine == Machine()
