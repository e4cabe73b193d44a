"""Energy per mm is the same in the report, in pictures and on the page, and what follows from power and velocity."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from support.tools import ROOT, stream_of

pytest.importorskip("matplotlib", reason="matplotlib is not installed")

from gusjob.config.machine import Laser, Machine
from gusjob.controllers.gus.model import simulate_stream
from gusjob.pipeline import Simulated, simulate_file
from gusjob.report.answer import answer_of
from gusjob.report.rows import Report, make_report
from gusjob.simulate import Trace
from gusjob.view.page.content import page_of
from gusjob.view.page.ranges import ranges_of
from gusjob.view.plot.color_scale import ColorBy, color_paths
from gusjob.view.strokes import Strokes, strokes_of

JOBS = sorted((ROOT / "jobs").glob("**/*.job"), key=str)
STEADY = (
    "LASER MODE DUTY CARRIER 20\nACC 1e6\nLASER POWER {power}\nVEL {vel}\nJUMP X 5\nLASER ON\nLINE X 105\nLASER OFF\n"
)


def page_energy(report: Report, strokes: Strokes, machine: Machine) -> dict[tuple[int, int], list[float]]:
    """Ranges of the page, by channel and unit."""
    page = page_of(report, strokes, machine, [])
    found = ranges_of(page.facts, page.tables["strokes"])
    return {(one["channel"], one["index"]): one["energy"] for one in found if one["energy"]}


@pytest.mark.parametrize("path", [path for path in JOBS if "shared" not in path.parts], ids=lambda path: path.stem)
def test_the_largest_value_is_the_report_s(path: Path) -> None:
    result = simulate_file(path, None)
    assert isinstance(result, Simulated)
    trace, machine = result.trace, result.machine
    report, strokes = make_report(trace, machine), strokes_of(trace, machine)
    assert report.marks is not None
    page = page_energy(report, strokes, machine)
    drawn = {path.channel: path for path in color_paths(strokes, ColorBy.ENERGY)}
    for channel in trace.channels:
        peaks = report.marks["power_per_mm_peak"][report.marks["channel"] == channel.channel]
        if np.isnan(peaks).all():
            assert (channel.channel, 0) not in page
            continue
        assert len(channel.units) == 1
        assert machine.laser(channel.channel).rated_w is None, "else the picture is in joules"
        assert drawn[channel.channel].range.most == pytest.approx(np.nanmax(peaks), rel=1e-12)
        (emission,) = (emission for emission in strokes.emissions if emission.channel == channel.channel)
        assert np.nanmax(emission.per_mm) == pytest.approx(np.nanmax(peaks), rel=1e-12), "a stroke of its own"
        assert page[channel.channel, 0][3] == pytest.approx(np.nanmax(peaks), rel=1e-12)


def run(text: str, machine: Machine) -> Trace:
    trace, _ = simulate_stream(stream_of(text, machine), machine)
    assert trace is not None
    return trace


@pytest.mark.parametrize(("power", "vel"), [(40.0, 100.0), (3.5, 1200.0)])
def test_constant_power_at_constant_velocity(power: float, vel: float) -> None:
    """The usual value is power / velocity; the largest is that of the first 0.05 mm from rest with 1 mm/ms2."""
    trace = run(STEADY.format(power=power, vel=vel), Machine())
    report, strokes = make_report(trace, Machine()), strokes_of(trace, Machine())
    low, _, least, most = page_energy(report, strokes, Machine())[0, 0]
    assert low == pytest.approx(power / vel * 1000, rel=1e-3) and least == pytest.approx(low, rel=1e-3)
    fast, rise_mm = vel / 1000, (vel / 1000) ** 2 / 2
    first = power * (fast + (0.05 - rise_mm) / fast if rise_mm < 0.05 else np.sqrt(2 * 0.05)) / 0.05
    assert report.marks is not None and report.marks["power_per_mm_mid"] == pytest.approx([power / vel * 1000])
    assert most == pytest.approx(first)
    assert most == pytest.approx(report.marks["power_per_mm_peak"].max(), rel=1e-12)
    (colored,) = color_paths(strokes, ColorBy.ENERGY)
    assert colored.range.most == most and np.median(colored.value) >= low


def test_in_joules_where_the_power_is_rated() -> None:
    """30 W at 100 %: 0.3 mJ a %*ms."""
    machine = replace(Machine(), lasers=(Laser(channel=0, rated_w=30.0),))
    trace = run(STEADY.format(power=40, vel=100), machine)
    report, strokes = make_report(trace, machine), strokes_of(trace, machine)
    (colored,) = color_paths(strokes, ColorBy.ENERGY)
    assert report.marks is not None
    assert colored.unit == "mJ/mm" and colored.range.low == pytest.approx(0.3 * 400, rel=1e-4)
    peak = report.marks["power_per_mm_peak"].max()
    assert colored.range.most == pytest.approx(0.3 * peak)
    assert colored.most_reported == f"{peak:.4g} %·ms/mm"
    hottest: Any = next(finding for finding in answer_of(report, []).findings if finding.name == "hottest")
    assert f"{0.3 * peak:.3g} mJ/mm" in hottest.text or f"{0.3e-3 * peak:.3g} J/mm" in hottest.text
