"""Pictures of the path: pixels and texts at places, in colours and sizes that follow from the job alone."""

from __future__ import annotations

import base64
import io
import math
import re
import subprocess
import sys
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib
import numpy as np
import numpy.typing as npt
import pytest
from click.testing import CliRunner, Result
from fontTools.fontBuilder import FontBuilder  # type: ignore[import-untyped]  # fontTools has no types
from fontTools.pens.ttGlyphPen import TTGlyphPen  # type: ignore[import-untyped]  # nor here
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from msgspec.structs import replace
from PIL import Image
from support.tools import MACHINE, MARK, ROOT, stream_of

from gusjob.cli import cli
from gusjob.cli.plot_command import _COLOURS
from gusjob.config.machine import Laser, Machine, parse_scanner
from gusjob.controllers.gus.model import simulate_stream
from gusjob.simulate import Trace
from gusjob.view.plot.picture import ColorBy, PlotArea, figure_of, picture

SVG = "{http://www.w3.org/2000/svg}"
HREF = "{http://www.w3.org/1999/xlink}href"
JUMP, RUN_IN, RUN_OUT, OVER, INK = "#6b7480", "#c48700", "#cc79a7", "#c04f00", "#1f2328"
WHITE = (255, 255, 255)

STEPS = (
    MARK
    + """LASER POWER 20
LASER ON
LINE X 10 Y 0
LASER OFF
JUMP X 0 Y 4
LASER POWER 50
LASER ON
LINE X 10
LASER OFF
JUMP X 0 Y 8
LASER POWER 80
LASER ON
LINE X 10
LASER OFF
"""
)
"""Three lines of 10 mm at Y 0, 4 and 8, with 20, 50 and 80 %, and slanting jumps between them."""
ONE = MARK + "LASER POWER 40\nJUMP X 0 Y 5\nLASER ON\nLINE X 10\nLASER OFF\n"
FLAT = MARK + "LASER POWER 40\nLASER ON\nLINE X 10\nLASER OFF\n"
"""From rest to rest: 110 ms, ramps of 10 ms and 0.5 mm."""
DELAY_US = 250.0


def trace_of(text: str, machine: Machine = MACHINE) -> Trace:
    trace, _ = simulate_stream(stream_of(text, machine), machine)
    assert trace is not None
    return trace


def figure(text: str, machine: Machine = MACHINE, **how: Any) -> Figure:
    return figure_of(trace_of(text, machine), machine, **how)


def rgb(text: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(text[1:])
    return red, green, blue


def color_of(bin_number: int) -> tuple[int, int, int]:
    """The colour of one of 64 bins: the lower 59 % of viridis."""
    red, green, blue, _ = matplotlib.colormaps["viridis"](bin_number / 63 * 0.59, bytes=True)
    return int(red), int(green), int(blue)


def near(found: tuple[int, int, int], wanted: tuple[int, int, int], by: int = 5) -> bool:
    return max(abs(a - b) for a, b in zip(found, wanted, strict=True)) <= by


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture's pixels, and where a place in mm lies among them."""

    figure: Figure
    pixels: npt.NDArray[np.uint8]

    def at(self, x_mm: float, y_mm: float, panel: int = 0) -> tuple[int, int, int]:
        x, y = self.px(x_mm, y_mm, panel)
        red, green, blue = self.pixels[int(y), int(x)].tolist()
        return red, green, blue

    def px(self, x_mm: float, y_mm: float, panel: int = 0) -> tuple[float, float]:
        """Column and row."""
        axes = [a for a in self.figure.axes if a.get_label() != "colours"][panel]
        x, y = axes.transData.transform((x_mm, y_mm))
        return x, self.pixels.shape[0] - y

    def along(
        self, start: tuple[float, float], end: tuple[float, float], steps: int = 400
    ) -> list[tuple[int, int, int]]:
        share = np.linspace(0, 1, steps)
        return [self.at(start[0] + (end[0] - start[0]) * s, start[1] + (end[1] - start[1]) * s) for s in share]

    def about(self, x_mm: float, y_mm: float, radius_pt: float) -> list[tuple[int, int, int]]:
        """Pixels on a circle."""
        x, y = self.px(x_mm, y_mm)
        radius = radius_pt / 72 * self.figure.dpi
        turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
        found = self.pixels[(y + radius * np.sin(turn)).astype(int), (x + radius * np.cos(turn)).astype(int)]
        return [(r, g, b) for r, g, b in found.tolist()]


def shot(text: str, machine: Machine = MACHINE, **how: Any) -> Shot:
    drawn = figure(text, machine, **{"dpi": 120, **how})
    return Shot(drawn, np.asarray(Image.open(io.BytesIO(picture(drawn, "png"))).convert("RGB")))


def svg_of(drawn: Figure) -> ElementTree.Element:
    return ElementTree.fromstring(picture(drawn, "svg"))


def texts(drawn: Figure) -> list[str]:
    return ["".join(e.itertext()).strip() for e in svg_of(drawn).iter(f"{SVG}text")]


def all_text(drawn: Figure) -> str:
    return " ".join(texts(drawn))


def gusjob(*args: object) -> Result:
    return CliRunner().invoke(cli, [str(a) for a in args], catch_exceptions=False)


def job(tmp_path: Path, text: str = ONE, name: str = "a.job") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


# Colours.


def test_powers_have_their_colours() -> None:
    seen = shot(STEPS)
    for y, number in ((0, 0), (4, 32), (8, 63)):
        assert near(seen.at(3.3, y), color_of(number)), y
    assert seen.at(3.3, 1.1) == seen.at(7.7, 6.9) == WHITE


def test_the_highest_lies_on_top() -> None:
    """Drawn last, but lower: the crossing keeps the higher power's colour."""
    text = MARK + "LASER POWER 80\nJUMP X -5 Y 0\nLASER ON\nLINE X 5\nLASER OFF\nJUMP X 0 Y -5\nLASER POWER 20\n"
    seen = shot(text + "LASER ON\nLINE Y 5\nLASER OFF\n")
    assert near(seen.at(0, 0), color_of(63))
    assert near(seen.at(0, 2.5), color_of(0))


def test_velocity_along_a_ramp() -> None:
    """From rest with 10000 mm/s2 to 100 mm/s in 0.5 mm, in eight pieces of equal time."""
    seen = shot(FLAT, by=ColorBy.VELOCITY, area=PlotArea(box_mm=(0, -0.2, 0.6, 0.2)))
    low, high = 100 / 16, 100.0
    for piece in (3, 5, 7):
        place = ((piece + 0.5) / 8) ** 2 * 0.5
        value = (piece + 0.5) / 8 * 100
        assert near(seen.at(place, 0), color_of(int((value - low) / (high - low) * 64))), piece
    assert near(seen.at(0.55, 0), color_of(63))
    assert {"velocity, mm/s", "6.25", "100"} <= set(texts(seen.figure))


def test_time() -> None:
    """At constant speed the colour goes with the way; the mark takes 110 ms, of which 10 ms are ramps."""
    seen = shot(FLAT, by=ColorBy.ORDER)
    for x in (2.6, 5.1, 7.4):
        number = (x / 100 * 1e3 + 5) / 110 * 64
        assert any(near(seen.at(x, 0), color_of(int(number) + off)) for off in (-1, 0, 1)), x
    assert "time, ms" in texts(seen.figure)


RAMP = [40 * (math.sqrt(k + 1) - math.sqrt(k)) * math.sqrt(2 * 0.05 / 0.01) / 0.05 for k in range(3)]
"""40 % from rest with 0.01 mm/ms2, in the first bins of 0.05 mm, %*ms/mm."""


def test_energy_per_mm_ends_where_few_is_above() -> None:
    """40 % at 100 mm/s are 400 %*ms/mm; at both ends 2 bins of 0.05 mm are 2 % of 10 mm."""
    seen = shot(FLAT, by=ColorBy.ENERGY)
    assert near(seen.at(5.2, 0), color_of(0))
    found, words = texts(seen.figure), all_text(seen.figure)
    assert {"energy per mm, %·ms/mm", "400", f"max {RAMP[0]:.4g}"} <= set(found)
    assert {f"> {value:.4g}" for value in RAMP[1:]} & set(found)
    assert f"the highest energy per mm is {RAMP[0]:.4g} %·ms/mm" in words
    close = shot(FLAT, by=ColorBy.ENERGY, area=PlotArea(box_mm=(-0.005, -0.01, 0.015, 0.01)))
    assert near(close.at(0.006, 0), rgb(OVER))


def test_energy_in_joules() -> None:
    """30 W * 40 % / 100 mm/s = 120 mJ/mm; the highest in the report's unit too."""
    machine = replace(MACHINE, lasers=(Laser(channel=0, rated_w=30.0),))
    drawn = figure(FLAT, machine, by=ColorBy.ENERGY)
    assert {"energy per mm, mJ/mm", "120"} <= set(texts(drawn))
    assert f"is {RAMP[0] * 0.3:.4g} mJ/mm ({RAMP[0]:.4g} %·ms/mm in the report)" in all_text(drawn)


def test_a_low_value_on_a_short_way_is_under_the_range() -> None:
    """0.1 mm with 5 %, then a line of 10 mm with 50 to 80 %."""
    rest = "".join(f"LASER POWER {50 + k}\nLINE X {10 + k}\n" for k in range(31))
    seen = shot(MARK + "LASER POWER 5\nLASER ON\nLINE X 0.2\n" + rest + "LASER OFF\n")
    found = texts(seen.figure)
    assert {"50", "80", "< 50", "min 5"} <= set(found)
    assert "Sky blue is below 50 %; the lowest power is 5 %." in found
    assert near(seen.at(0.1, 0), rgb("#499ac8"), 12)


@pytest.mark.parametrize(
    ("powers", "labels"),
    [((20.001, 20.002), ["20"]), ((20.0, 20.01, 20.03), ["20", "20.01", "20.03"]), ((40.0,), ["40"])],
)
def test_labels_of_a_narrow_range_differ(powers: tuple[float, ...], labels: list[str]) -> None:
    lines = "".join(
        f"LASER POWER {power}\nLASER ON\nLINE X {(k + 1) % 2 * 10} Y {k}\nLASER OFF\n" for k, power in enumerate(powers)
    )
    assert [tick.get_text() for tick in figure(MARK + lines).axes[1].get_yticklabels()] == labels


def test_one_value_is_one_colour() -> None:
    drawn = figure(ONE)
    bar = drawn.axes[1]
    assert [label.get_text() for label in bar.get_yticklabels()] == ["40"]
    seen = Shot(drawn, np.asarray(Image.open(io.BytesIO(picture(drawn, "png"))).convert("RGB")))
    colour = seen.at(5.2, 5)
    middle = bar.get_window_extent()
    for share in (0.1, 0.4, 0.9):
        row = int(seen.pixels.shape[0] - middle.y0 - middle.height * share)
        assert tuple(seen.pixels[row, int(middle.x0 + middle.width / 2)].tolist()) == colour != WHITE


def test_the_bar_tells_unit_and_range() -> None:
    found = texts(figure(STEPS))
    assert {"power, %", "20", "50", "80"} <= set(found)


# Motion without emission.


def test_jumps_are_grey_and_dashed() -> None:
    seen = shot(STEPS)
    way = seen.along((9, 0.4), (1, 3.6))
    grey = [near(pixel, rgb(JUMP), 40) for pixel in way]
    white = [pixel == WHITE for pixel in way]
    assert 0.2 < np.mean(grey) < 0.8 and np.mean(white) > 0.2
    assert np.count_nonzero(np.diff(np.array(white).astype(int)) == 1) > 5
    without = shot(STEPS, jumps=False)
    assert "jump" not in texts(without.figure)
    assert not any(near(pixel, rgb(JUMP), 20) for pixel in without.along((9, 0.4), (1, 3.6)))


def test_runs_have_their_own_colours() -> None:
    """Run-in: 380 us at 1000 mm/s, and 1 mm to come to speed; run-out 250 us and 1 mm."""
    text = "LASER MODE DUTY CARRIER 20\nSKYWRITE MODE 2 TIMELAG 250us\nVEL 1000\nACC 500000\nLASER POWER 40\n"
    seen = shot(text + "JUMP X 0 Y 3\nLASER ON\nLINE X 5\nLASER OFF\nJUMP X 0 Y 0\n")
    before, behind = seen.along((-1.33, 3), (-0.05, 3)), seen.along((5.35, 3), (6.2, 3))
    assert sum(near(pixel, rgb(RUN_IN), 12) for pixel in before) > 20
    assert sum(near(pixel, rgb(RUN_OUT), 12) for pixel in behind) > 20
    assert not any(near(pixel, rgb(JUMP), 12) for pixel in [*before, *behind])
    assert seen.at(-1.5, 3.1) == seen.at(6.3, 3.1) == WHITE
    assert {"run-in", "run-out", "jump"} <= set(texts(seen.figure))


def test_switch_points() -> None:
    """On: a ring, through which the line goes. Off: a cross."""
    seen = shot(ONE, dpi=200)
    ring = [near(pixel, rgb(INK), 60) for pixel in seen.about(0, 5, 2.75)]
    assert np.mean(ring) > 0.7
    assert near(seen.at(0.02, 5), seen.at(5.2, 5))
    assert near(seen.at(10, 5), rgb(INK), 60)
    ring = [near(pixel, rgb(INK), 60) for pixel in seen.about(10, 5, 2.75)]
    assert np.mean(ring) < 0.5
    assert {"laser on", "laser off"} <= set(texts(seen.figure))


def test_switch_points_too_close_are_counted() -> None:
    row = "REPEAT 300 AS k\nJUMP X 0 Y (k * 0.1)\nLASER ON\nLINE X 10\nLASER OFF\nEND\n"
    found = texts(figure(MARK + "LASER POWER 40\n" + row))
    assert "laser on" not in found
    assert any(text.startswith("600 switch points are not drawn") for text in found)
    near_by = texts(figure(MARK + "LASER POWER 40\n" + row, area=PlotArea(box_mm=(0, 0, 3, 2))))
    assert "laser on" in near_by and "not drawn" not in " ".join(near_by)


def test_too_many_switch_points_are_counted() -> None:
    """420 lines, 3 mm and more apart: none is close to another, but nobody reads 840 points."""
    rows = (
        "REPEAT 20 AS i\nREPEAT 21 AS k\nJUMP X (k * 7) Y (i * 5)\nLASER ON\nLINE X (k * 7 + 4)\nLASER OFF\nEND\nEND\n"
    )
    found = texts(figure(MARK + "LASER POWER 40\n" + rows))
    assert any(text.startswith("840 switch points are not drawn") for text in found)
    fewer = texts(figure(MARK + "LASER POWER 40\n" + rows.replace("REPEAT 20", "REPEAT 18")))
    assert "laser on" in fewer and "not drawn" not in " ".join(fewer)


def test_emission_at_rest_is_a_dot() -> None:
    seen = shot(MARK + "LASER POWER 40\nJUMP X 3 Y 2\nLASER ON\nDWELL 20ms\nLASER OFF\nJUMP X 0 Y 0\n", dpi=300)
    full = matplotlib.colormaps["viridis"](0.3, bytes=True)
    colour = int(full[0]), int(full[1]), int(full[2])
    assert np.mean([near(pixel, colour) for pixel in seen.about(3, 2, 3.6)]) > 0.9
    assert "emission at rest" in texts(seen.figure)


# The frame.


def test_axes_are_equal_and_the_scale_bar_is_true() -> None:
    drawn = figure(STEPS)
    axes = drawn.axes[0]
    box, (x0, x1), (y0, y1) = axes.get_window_extent(), axes.get_xlim(), axes.get_ylim()
    assert box.width / (x1 - x0) == pytest.approx(box.height / (y1 - y0), rel=1e-9)
    assert x0 < 0 < 10 < x1 and y0 < 0 < 8 < y1
    root = svg_of(drawn)
    path = next(g for g in root.iter(f"{SVG}g") if g.get("id") == "scale-bar").find(f".//{SVG}path")
    assert path is not None
    across = [float(x) for x in re.findall(r"[ML] (\S+) \S+", path.attrib["d"])]
    pt_per_mm = box.width / drawn.dpi * 72 / (x1 - x0)
    label = [text for text in texts(drawn) if re.fullmatch(r"\d+ mm", text)]
    assert len(label) == 1
    assert (max(across) - min(across)) / pt_per_mm == pytest.approx(float(label[0].split()[0]), rel=1e-5)


def test_small_paths_are_read_in_um() -> None:
    text = ONE.replace("X 10", "X 0.2").replace("Y 5", "Y 0.1")
    found = texts(figure(text))
    assert {"X, um", "Y, um", "200"} <= set(found)
    assert "X, mm" not in found


def test_the_field() -> None:
    seen = shot(ONE, area=PlotArea(field=True), dpi=200)
    for start, end in (((-150, -140), (-150, 140)), ((-140, 150), (140, 150))):
        dark = [near(pixel, rgb(INK), 90) for pixel in seen.along(start, end)]
        assert 0.3 < np.mean(dark) < 0.95
    assert "field" in texts(seen.figure)
    assert "field" not in texts(figure(ONE))


def test_zoom() -> None:
    drawn = figure(STEPS, area=PlotArea(box_mm=(2, 3, 4, 5)))
    (x0, x1), (y0, y1) = drawn.axes[0].get_xlim(), drawn.axes[0].get_ylim()
    assert ((x0 + x1) / 2, (y0 + y1) / 2) == pytest.approx((3, 4))
    assert min(x1 - x0, y1 - y0) == pytest.approx(2)
    seen = shot(STEPS, area=PlotArea(box_mm=(2, 3, 4, 5)))
    assert near(seen.at(3.1, 4), color_of(32))


def test_size_and_dpi() -> None:
    image = Image.open(io.BytesIO(picture(figure(ONE, size_in=(6.0, 5.0), dpi=80), "png")))
    assert image.size == (480, 400)
    assert float(svg_of(figure(ONE, size_in=(6.0, 5.0))).attrib["width"].removesuffix("pt")) == 432


def test_notes_that_do_not_fit_are_counted() -> None:
    """Two panels with energies above the range, and emission after the end, on a picture of 5 x 3.4 inches."""
    text = TWO.replace("VEL 100", "LASER DELAY ON 0us OFF 2000us CHANNEL 1\nVEL 100")
    found = texts(figure(text, by=ColorBy.ENERGY, size_in=(5.0, 3.4)))
    assert any(re.fullmatch(r"\d remarks do not fit: make the picture larger\.", line) for line in found)
    assert "make the picture larger" not in all_text(figure(text, by=ColorBy.ENERGY))


def test_totals() -> None:
    words = all_text(figure(FLAT))
    assert "1 segment, 110 ms; marks 10 mm" in words
    assert "channel 0: highest 40 %, on 110 ms" in words


# Scanner, channels, units.


def test_emission_is_drawn_at_the_beam() -> None:
    """The beam is 250 us late: when emission ends it still has a*t*t/2 to go, and emission begins at rest."""
    scanner = parse_scanner(f"delay:{DELAY_US}us")
    assert not isinstance(scanner, str)
    machine = replace(MACHINE, scanner=scanner)
    text = "LASER MODE DUTY CARRIER 20\nVEL 1000\nACC 1000000\n" + ONE.removeprefix(MARK)
    left_mm = 1e6 * (DELAY_US * 1e-6) ** 2 / 2
    seen = shot(text, machine, area=PlotArea(box_mm=(9.9, 4.95, 10.01, 5.05)), dpi=300)
    full = matplotlib.colormaps["viridis"](0.3, bytes=True)
    colour = int(full[0]), int(full[1]), int(full[2])
    assert near(seen.at(10 - left_mm - 0.006, 5), colour)
    assert near(seen.at(10 - left_mm, 5), rgb(INK), 60)
    assert near(seen.at(10 - left_mm + 0.01, 5), rgb(JUMP), 60)
    assert "commanded path" in texts(seen.figure)
    assert "scanner delay 250 us" in all_text(seen.figure)
    exact = shot(text, area=PlotArea(box_mm=(9.9, 4.95, 10.01, 5.05)))
    assert near(exact.at(10 - left_mm + 0.01, 5), colour)


TWO = """LASER MODE DUTY CARRIER 10
LASER MODE ANALOG CHANNEL 1
VEL 100
ACC 10000
LASER POWER 40
LASER POWER 3 CHANNEL 1
JUMP X 0 Y 2
LASER ON
LASER ON CHANNEL 1
LINE X 10
LASER OFF
LINE Y 8
LASER OFF CHANNEL 1
"""


def test_two_channels_are_two_panels() -> None:
    seen = shot(TWO)
    found = texts(seen.figure)
    assert {"power, %", "power, V"} <= set(found)
    assert any(text.startswith("channel 1: highest 3 V") for text in found)
    colour = seen.at(5.2, 2, 0)
    assert colour == seen.at(5.2, 2, 1) == seen.at(10, 5.2, 1) != WHITE
    assert near(seen.at(10, 5.2, 0), rgb("#b0b7bf"), 4) and "other emission" in found
    one = texts(figure(TWO, channel=1))
    assert "power, V" in one and "power, %" not in one
    assert "No emission of channel 1 on this path." in texts(figure(ONE, channel=1))


def test_a_panel_for_each_unit() -> None:
    text = ONE + "WAIT\nLASER MODE ANALOG\nLASER POWER 6\nJUMP X 0 Y 8\nLASER ON\nLINE X 10\nLASER OFF\n"
    found = texts(figure(text))
    assert {"power, %", "power, V"} <= set(found)
    assert texts(figure(text, by=ColorBy.VELOCITY)).count("velocity, mm/s") == 1
    machine = replace(MACHINE, lasers=(Laser(channel=0, rated_w=10.0),))
    assert texts(figure(text, machine, by=ColorBy.ENERGY)).count("energy per mm, mJ/mm") == 1


# Texts.


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("$x^2$ \\frac_{", "$x^2$ \\frac_{"),
        ("<script>&amp;", "<script>&amp;"),
        ("a\nb", "a\ufffdb"),
        ("größe ±µ", "größe ±µ"),
        ("", "job"),
    ],
)
def test_names_are_shown_as_they_are(name: str, shown: str) -> None:
    drawn = figure_of(replace(trace_of(ONE), name=name), MACHINE, dpi=72)
    assert texts(drawn).count(shown) == 1
    assert picture(drawn, "png").startswith(b"\x89PNG")


def test_long_names_are_cut_in_the_middle() -> None:
    found = texts(figure_of(replace(trace_of(ONE), name="a" * 200 + "z" * 200), MACHINE))
    assert any(re.fullmatch(r"a+\.\.\.z+", text) for text in found)


@pytest.fixture
def chinese_font(tmp_path: Path) -> Iterator[None]:
    """A font of two characters under a name that is known for having them."""
    pen = TTGlyphPen(None)
    pen.moveTo((0, 0))
    for corner in ((0, 800), (800, 800), (800, 0)):
        pen.lineTo(corner)
    pen.closePath()
    builder = FontBuilder(1000, isTTF=True)
    names = [".notdef", "zhong", "wen"]
    builder.setupGlyphOrder(names)
    builder.setupCharacterMap({0x4E2D: "zhong", 0x6587: "wen"})
    builder.setupGlyf(dict.fromkeys(names, pen.glyph()))
    builder.setupHorizontalMetrics(dict.fromkeys(names, (1000, 0)))
    builder.setupHorizontalHeader(ascent=800, descent=-200)
    builder.setupNameTable({"familyName": "SimHei", "styleName": "Regular"})
    builder.setupOS2()
    builder.setupPost()
    builder.save(tmp_path / "hei.ttf")
    before = list(fontManager.ttflist)
    fontManager.addfont(tmp_path / "hei.ttf")
    yield
    fontManager.ttflist[:] = before


def named(name: str) -> list[str]:
    return texts(figure_of(replace(trace_of(ONE), name=name), MACHINE))


def test_chinese_names(chinese_font: None) -> None:
    assert "中文.job" in named("中文.job")


def test_what_no_font_has_is_written_as_its_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gusjob.view.plot.text._OTHERS", ())
    assert "\\u4e2d\\u6587.job" in named("中文.job")


def test_pdf_holds_its_texts() -> None:
    data = picture(figure(STEPS), "pdf")
    assert data.startswith(b"%PDF-1.") and data.rstrip().endswith(b"%%EOF")
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", data, re.DOTALL)
    plain = b"".join(zlib.decompressobj().decompress(s) for s in streams if s[:1] == b"x")
    assert b"DejaVuSans" in data
    assert plain.count(b"BT") >= 10
    assert b"CreationDate" not in data and b"Producer" not in data


# Extremes.


def test_nothing_moves() -> None:
    drawn = figure(MARK)
    assert "No motion: there is no path to draw." in texts(drawn)
    assert "field" in texts(drawn)
    (x0, x1), _ = drawn.axes[0].get_xlim(), drawn.axes[0].get_ylim()
    assert x0 < -150 and x1 > 150
    assert len(drawn.axes) == 1


def test_no_emission() -> None:
    drawn = figure(MARK + "JUMP X 5\n")
    assert "No emission on this path." in texts(drawn)


@pytest.mark.parametrize("by", list(ColorBy))
def test_emission_at_rest_only(by: ColorBy) -> None:
    drawn = figure("LASER MODE DUTY CARRIER 10\nLASER POWER 25 NOW\nLASER ON NOW\nDWELL 1s\nLASER OFF NOW\n", by=by)
    found = texts(drawn)
    assert "emission at rest" in found
    note = "Where a mark does not move, energy per mm has no value: red-brown."
    assert (note in found) is (by is ColorBy.ENERGY)


def test_emission_after_the_end_is_noted() -> None:
    """LASER OFF comes 2 ms late, when all motion is over: 40 % * 2 ms."""
    drawn = figure(ONE.replace("VEL 100", "LASER DELAY ON 0us OFF 2000us\nVEL 100"))
    assert "Emission while standing still is not drawn (channel 0: 80 %·ms)." in texts(drawn)
    assert "not drawn" not in all_text(figure(ONE))


BANDS = """LASER MODE DUTY CARRIER 10
VEL 1000
ACC 1000000
FOR band FROM 0 TO 4
  LASER POWER (10 + 20 * band)
  REPEAT 20000 AS k
    JUMP X (band * 10) Y (k * 0.0005)
    LASER ON
    LINE X (band * 10 + 8)
    LASER OFF
  END
END
"""


def test_many_strokes_are_pixels_in_every_format() -> None:
    """200,000 of them, in five bands of full tone."""
    drawn = figure(BANDS, Machine(expansion_max_statements=1_000_000), size_in=(8.0, 6.0), dpi=100)
    data = picture(drawn, "svg")
    assert len(data) < 500_000
    root = ElementTree.fromstring(data)
    assert re.search(r"The path is rasterized, in SVG and PDF too: (199,999|200,000) strokes\.", all_text(drawn))
    images = list(root.iter(f"{SVG}image"))
    assert len(images) == 1
    packed = base64.b64decode(images[0].attrib[HREF].partition(",")[2])
    colours = np.unique(np.asarray(Image.open(io.BytesIO(packed)).convert("RGB")).reshape(-1, 3), axis=0)
    for number in (0, 16, 32, 48, 63):
        assert np.abs(colours.astype(int) - color_of(number)).max(axis=1).min() <= 4, number


def test_few_strokes_are_lines() -> None:
    assert not list(svg_of(figure(STEPS)).iter(f"{SVG}image"))


def test_lines_are_thinner_where_they_are_many() -> None:
    """0.5 mm apart over 90 mm: between the lines it is white."""
    rows = "REPEAT 180 AS k\nJUMP X 0 Y (k * 0.5)\nLASER ON\nLINE X 90\nLASER OFF\nEND\n"
    seen = shot(MARK + "LASER POWER 40\n" + rows, jumps=False)
    column = [seen.at(43.1, 40 + step * 0.01) for step in range(200)]
    assert sum(min(pixel) > 225 for pixel in column) > 40
    assert sum(min(pixel) < 120 for pixel in column) > 40


# The same bytes, and nothing left behind.


@pytest.mark.parametrize("form", ["png", "svg", "pdf"])
def test_same_job_same_bytes(form: str) -> None:
    assert picture(figure(STEPS, dpi=72), form) == picture(figure(STEPS, dpi=72), form)


@pytest.mark.slow
def test_same_bytes_in_another_process(tmp_path: Path) -> None:
    path = job(tmp_path)
    found = set()
    for seed in ("1", "2"):
        command = [sys.executable, "-m", "gusjob", "plot", str(path), "-o", str(tmp_path / f"{seed}.svg")]
        subprocess.run(command, check=True, env={"PYTHONHASHSEED": seed, "PATH": ""}, cwd=ROOT)
        found.add((tmp_path / f"{seed}.svg").read_bytes())
    assert len(found) == 1


def test_settings_of_others_are_left_alone_and_do_not_matter() -> None:
    plain = picture(figure(ONE), "svg")
    with matplotlib.rc_context({"lines.linewidth": 9, "font.size": 20, "axes.facecolor": "red", "text.usetex": True}):
        before = dict(matplotlib.rcParams)
        assert picture(figure(ONE), "svg") == plain
        assert dict(matplotlib.rcParams) == before


# The command.


@pytest.mark.parametrize(
    ("form", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF"), ("PNG", b"\x89PNG")]
)
def test_the_ending_is_the_format(tmp_path: Path, form: str, start: bytes) -> None:
    out = tmp_path / f"out.{form}"
    done = gusjob("plot", job(tmp_path), "-o", out)
    assert (done.exit_code, done.output) == (0, "")
    assert out.read_bytes().startswith(start)


def test_options_reach_the_picture(tmp_path: Path) -> None:
    out, path = tmp_path / "a.svg", job(tmp_path, TWO)
    options = ["--by", "velocity", "--channel", "0", "--zoom", "12", "4", "-1", "-2", "--size", "8x6in", "--no-jumps"]
    assert gusjob("plot", path, "-o", out, *options, "--scanner", "delay:250us").exit_code == 0
    root = ElementTree.parse(out).getroot()
    found = ["".join(e.itertext()).strip() for e in root.iter(f"{SVG}text")]
    assert "velocity of the beam, mm/s" in found and "jump" not in found
    assert root.attrib["width"] == "576pt"
    assert gusjob("plot", path, "-o", out, "--field", "--size", "170x130mm", "--dpi", "72").exit_code == 0
    assert float(ElementTree.parse(out).getroot().attrib["width"].removesuffix("pt")) == pytest.approx(170 / 25.4 * 72)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["-o", "a.gif"], ".png, .svg or .pdf"),
        (["-o", "a"], ".png, .svg or .pdf"),
        (["-o", "png"], ".png, .svg or .pdf"),
        ([], "--output"),
        (["-o", "a.png", "--size", "159x130"], "from 160 mm x 120 mm"),
        (["-o", "a.png", "--size", "2001x300"], "from 160 mm x 120 mm"),
        (["-o", "a.png", "--size", "big"], "is not a size"),
        (["-o", "a.png", "--size", "1e3x200"], "is not a size"),
        (["-o", "a.png", "--size", "2000x2000", "--dpi", "1200"], "million pixels"),
        (["-o", "a.png", "--dpi", "0"], "--dpi"),
        (["-o", "a.png", "--zoom", "0", "0", "0", "5"], "0.001 mm"),
        (["-o", "a.png", "--zoom", "0", "0", "nan", "5"], "coordinates are in mm"),
        (["-o", "a.png", "--zoom", "0", "0", "inf", "5"], "coordinates are in mm"),
        (["-o", "a.png", "--zoom", "0", "0", "5", "5", "--field"], "exclude"),
        (["-o", "a.png", "--by", "colour"], "--by"),
        (["-o", "a.png", "--channel", "2"], "--channel"),
    ],
)
def test_wrong_usage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], word: str) -> None:
    monkeypatch.chdir(tmp_path)
    done = gusjob("plot", job(tmp_path), *options)
    assert done.exit_code == 2
    assert word in done.output.splitlines()[-1]
    assert [p.name for p in tmp_path.iterdir()] == ["a.job"]


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    done = gusjob("plot", job(tmp_path), "-o", tmp_path / "a.png")
    assert done.exit_code == 2
    assert done.output.splitlines() == [
        'gusjob: to draw a picture, install the extra "plot": python -m pip install "gusjob[plot]"'
    ]


def test_jobs_with_errors_are_not_drawn(tmp_path: Path) -> None:
    done = gusjob("plot", job(tmp_path, ONE + "LINE X 900\n"), "-o", tmp_path / "a.png")
    assert done.exit_code == 1
    assert "error[" in done.stderr and done.stdout == ""
    assert not (tmp_path / "a.png").exists()
    assert gusjob("plot", tmp_path / "none.job", "-o", tmp_path / "a.png").exit_code == 2


def test_warnings_are_shown_and_the_job_is_drawn(tmp_path: Path) -> None:
    done = gusjob("plot", job(tmp_path, ONE.replace("VEL", "LASER DELAY ON 20 OFF 10\nVEL")), "-o", tmp_path / "a.png")
    assert done.exit_code == 0
    assert "warning[" in done.stderr and (tmp_path / "a.png").exists()


def test_listings_are_drawn(tmp_path: Path) -> None:
    calls = tmp_path / "a.gts"
    assert gusjob("compile", job(tmp_path), "-o", calls).exit_code == 0
    assert gusjob("plot", calls, "-o", tmp_path / "a.png").exit_code == 0


def test_help_needs_no_matplotlib() -> None:
    code = (
        "import sys; from gusjob.cli import main; sys.argv = ['gusjob', 'plot', '--help']\n"
        "try: main()\nexcept SystemExit: pass\n"
        "print([m for m in ('matplotlib', 'gusjob.view.plot', 'gusjob.simulate') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert tuple(ColorBy) == _COLOURS
