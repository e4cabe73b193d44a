"""The pictures in grammar/ show the trace: drawn again they are the same, and they show what their texts say."""

from __future__ import annotations

import math
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from support import pictures
from support.pictures import BEAM_VIEWS, CORNER, HEAT, LAG_US, PICTURES, ROW, SKY_VIEWS, VEL, Point
from support.tools import ROOT

from gusjob.report.rows import make_report
from gusjob.simulate.quality.energy_bins import BIN_MM

SVG = "{http://www.w3.org/2000/svg}"
PULSE_MM = 1.5e-3
"""What lies at a whole pulse may be off by so much."""
PX = 0.01
"""Two decimals."""
CORNERS = {1: (0, 1, 2), 2: (0, 1, 2), 3: (0, 2)}
"""At which points of the row a mark begins, by mode."""

Pair = tuple[float, float]


def drawn(name: str) -> ElementTree.Element:
    return ElementTree.fromstring((ROOT / "grammar" / name).read_text(encoding="utf-8"))


def group(name: str, of: str) -> ElementTree.Element:
    found = drawn(name).find(f"{SVG}g[@id='{of}']")
    assert found is not None
    return found


def dots(inside: ElementTree.Element, kind: str) -> list[Point]:
    circles = inside.findall(f"{SVG}circle[@class='{kind}']")
    return [Point(float(c.attrib["cx"]), float(c.attrib["cy"])) for c in circles]


def lines(inside: ElementTree.Element, kind: str) -> list[list[Point]]:
    shapes = inside.findall(f"*[@class='{kind}']")
    return [[Point(*map(float, at.split(","))) for at in s.attrib["points"].split()] for s in shapes]


def behind(start: Pair, end: Pair, mm: float) -> Point:
    """So many mm behind the first point on the way to (and beyond) the second."""
    return Point(*start).plus(Point(*start).to(Point(*end)), mm)


def near(found: list[Point], wanted: list[Point], within: float) -> None:
    assert len(found) == len(wanted)
    for a, b in zip(found, wanted, strict=True):
        assert a.away(b) <= within, (a, b)


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_equal_what_is_drawn(name: str, rewrite: bool) -> None:
    path, fresh = ROOT / "grammar" / name, PICTURES[name]()
    if rewrite:
        path.write_text(fresh, encoding="utf-8", newline="\n")
    else:
        assert path.read_bytes() == fresh.encode(), "run pytest --rewrite"


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_are_plain_drawings(name: str) -> None:
    """Shapes and text only: nothing that runs, leads or loads; all inside, small and in two decimals."""
    root = drawn(name)
    allowed = {f"{SVG}{tag}" for tag in ("svg", "title", "g", "rect", "circle", "polyline", "polygon", "text")}
    assert {element.tag for element in root.iter()} <= allowed
    width, height = int(root.attrib["width"]), int(root.attrib["height"])
    assert width == 800
    for element in root.iter():
        for key, value in element.attrib.items():
            assert not key.startswith("on") and "href" not in key
            assert "url(" not in value and "nan" not in value
            if key in ("cx", "cy", "x", "y", "points"):
                places = value.replace(",", " ").split()
                assert all(len(at.partition(".")[2]) <= 2 for at in places)
                across, down = (places[::2], places[1::2]) if key == "points" else (places, [])
                across, down = ([], across) if key.endswith("y") else (across, down)
                assert all(0 <= float(at) <= width for at in across)
                assert all(0 <= float(at) <= height for at in down)
    assert (ROOT / "grammar" / name).stat().st_size < 40_000


@pytest.mark.parametrize(
    ("value", "shown"), [(1.0, "1"), (0.1 + 0.2, "0.3"), (10.625, "10.63"), (10.625 - 1e-12, "10.63"), (-1e-9, "0")]
)
def test_numbers_do_not_hang_on_last_digits(value: float, shown: str) -> None:
    assert pictures.number(value) == shown


# The commanded path.


@pytest.mark.parametrize("mode", SKY_VIEWS)
def test_marks_and_switch_points_of_each_mode(mode: int) -> None:
    """Light comes v * TIMELAG behind each S on the mark, and goes v * TIMELAG behind each E on the run-out."""
    inside, view, lag = group("skywrite.svg", f"mode-{mode}"), SKY_VIEWS[mode], VEL * LAG_US / 1e6
    begins, within = CORNERS[mode], PULSE_MM * view.scale + PX
    ends = [*begins[1:], 3]
    near(dots(inside, "on"), [view.px(behind(ROW[k], ROW[k + 1], lag)) for k in begins], within)
    near(dots(inside, "off"), [view.px(behind(ROW[k], ROW[k - 1], -lag)) for k in ends], within)
    places = [k for pair in zip(begins, ends, strict=True) for k in pair]
    near(dots(inside, "end"), [view.px(Point(*ROW[k])) for k in places], within)
    assert len(lines(inside, "light")) == len(begins)
    assert len(lines(inside, "mark")) == 3
    # Mode 1 runs both ways, and needs no jump from side to side.
    runs, jumps = {1: (6, 2), 2: (3, 4), 3: (2, 3)}[mode]
    assert [len(lines(inside, kind)) for kind in ("run-in", "run-out", "jump")] == [runs, runs, jumps]


def test_runs_are_as_long_as_the_picture_says() -> None:
    inside, view = group("skywrite.svg", "mode-2"), SKY_VIEWS[2]
    words = [text.text for text in inside.findall(f"{SVG}text")]
    for kind, mm in (("run-in", 0.5 + 0.38), ("run-out", 0.5 + 0.25)):
        assert f"{kind} {mm:.2f} mm" in words
        for start, end in lines(inside, kind):
            assert start.away(end) / view.scale == pytest.approx(mm, abs=2 * PULSE_MM)
    assert words.count("v*TIMELAG 0.25 mm") == 2


@pytest.mark.parametrize("shift_us", [-100.0, 0.0, 60.5])
@pytest.mark.parametrize("mode", SKY_VIEWS)
def test_light_comes_at_timelag_and_shift(mode: int, shift_us: float) -> None:
    marks = pictures.marks_of(pictures.run(pictures.skywrite_job(mode, shift_us)))
    for mark in marks:
        late = behind(mark.points[0], mark.points[1], VEL * (LAG_US + shift_us) / 1e6)
        assert mark.on.away(late) <= PULSE_MM
        assert mark.off.away(behind(mark.points[-1], mark.points[-2], -VEL * LAG_US / 1e6)) <= PULSE_MM


# The beam.


def test_without_sky_writing_it_burns_deep_at_ends_and_in_the_corner() -> None:
    inside, view = group("beam.svg", "without"), BEAM_VIEWS[False]
    found = dots(inside, "burnt")
    close = [sum(dot.away(view.px(Point(*place))) < 0.25 * view.scale for dot in found) for place in CORNER]
    assert close[0] >= 2 * 3, "at mark speed: at 0, 0.1, 0.2 mm"
    assert close[1] >= 2 * 5, "on both sides"
    assert close[2] >= 3 + 1, "though it ends before E"
    # It stops short of E: the laser is switched off when the command is there.
    assert min(dot.away(view.px(Point(*CORNER[2]))) for dot in found) > 0.05 * view.scale
    energy = pictures.burnt(pictures.run(pictures.beam_job(sky=False), pictures.beam_machine()))[0].energy
    assert energy[0] > 4 and energy[len(energy) // 2 - 2 : len(energy) // 2 + 3].max() > 4 and energy[-1] > 2
    fills = {c.attrib["fill"] for c in inside.findall(f"{SVG}circle[@class='burnt']")}
    assert {pictures.heat(HEAT[0][0]), pictures.heat(HEAT[-1][0])} <= fills


def test_with_sky_writing_dots_lie_from_s_to_e_at_mark_speed() -> None:
    """31 dots a side, 0.1 mm apart, from S to E; the lag's transient leaves 5 um at S."""
    inside, view = group("beam.svg", "with"), BEAM_VIEWS[True]
    found = dots(inside, "burnt")
    wanted = [behind(a, b, k * 0.1) for a, b in pairwise(CORNER) for k in range(31)]
    near(found, [view.px(at) for at in wanted], 0.006 * view.scale + PX)
    fills = [c.attrib["fill"] for c in inside.findall(f"{SVG}circle[@class='burnt']")]
    red = {int(fill[1:3], 16) for fill in fills}
    assert red <= set(range(HEAT[0][1][0] - 2, 256))


@pytest.mark.parametrize("sky", [False, True])
def test_energy_per_mm_is_the_report_s(sky: bool) -> None:
    machine = pictures.beam_machine()
    trace = pictures.run(pictures.beam_job(sky=sky), machine)
    marks, found = make_report(trace, machine).marks, pictures.burnt(trace)
    assert marks is not None
    assert len(found) == len(marks["line"]) == (2 if sky else 1)
    for k, mark in enumerate(found):
        assert mark.run[-1] == pytest.approx(marks["length_mm"][k], rel=1e-4)
        assert np.diff(mark.run) == pytest.approx(mark.run[-1] / math.ceil(mark.run[-1] / BIN_MM - 1e-6))
        # 50 % at 1 mm/ms.
        assert mark.energy.max() * 50 == pytest.approx(marks["power_per_mm_peak"][k], rel=0.01)
        assert (mark.energy.max() < 1.02) == sky
