"""The report page in a browser: its drawings, what a user can do with it, and that a hostile job does nothing in it."""

from __future__ import annotations

import csv
import re
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("jinja2", reason="jinja2 is not installed")

from support.browser import Chromium, Tab, chromium, rest
from support.page_actions import click_path, click_time, hover_path, order, pixel, pixels, selected
from support.pages import (
    DWELL,
    HOSTILE,
    IMAGE,
    JUMP,
    MARK,
    SCRIPT,
    columns_of,
    diagnostics,
    field_of_marks,
    hostile_page,
    page_of,
    rich_page,
    round_trip,
    square,
    written,
)

from gusjob.i18n.phrases import number as as_text
from gusjob.view.page.render import MAX_BYTES, Page, render

__all__ = ["chromium"]
"""A fixture of this module."""

pytestmark = pytest.mark.browser


def all_select(row: int) -> dict[str, Any]:
    return {"row": row, "hash": f"#s={row}", "grid": [row], "shown": row, "marker": row, "line": True}


def check_selected(tab: Tab, row: int) -> None:
    found = selected(tab)
    title = found.pop("title")
    assert found == all_select(row)
    assert title.startswith(f"Segment {row + 1} of ")


@pytest.fixture(scope="module")
def open_square(chromium: Chromium, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    with chromium.open(written(page_of(columns_of(square())), tmp_path_factory.mktemp("square"))) as tab:
        yield tab.ready().keep_state()


@pytest.fixture(scope="module")
def open_rich(chromium: Chromium, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    with chromium.open(written(rich_page(), tmp_path_factory.mktemp("rich"))) as tab:
        yield tab.ready().keep_state()


@pytest.fixture
def square_tab(open_square: Tab) -> Iterator[Tab]:
    """The page of a square as it was opened: opening it for each test would take a second."""
    yield open_square.reset()
    assert open_square.complaints == [] and open_square.requests == []


@pytest.fixture
def rich_tab(open_rich: Tab) -> Iterator[Tab]:
    """The page with both channels, all kinds and marks as it was opened."""
    yield open_rich.reset()
    assert open_rich.complaints == [] and open_rich.requests == []


@pytest.fixture
def fresh_tab(chromium: Chromium, tmp_path: Path) -> Iterator[Tab]:
    """The same page, opened anew: the browser remembers where Tab went."""
    with chromium.open(written(rich_page(), tmp_path)) as tab:
        yield tab.ready()
        assert tab.complaints == [] and tab.requests == []


def test_emission_is_drawn_where_it_was(square_tab: Tab) -> None:
    sides = {10: (50, 0), 20: (60, 10), 30: (50, 20), 40: (40, 10)}
    seen = dict(zip(sides, map(tuple, pixels(square_tab, sides.values())), strict=True))
    assert all(color[3] > 200 for color in seen.values()) and len(set(seen.values())) == 4
    lightness = [sum(color[:3]) for color in seen.values()]
    assert lightness == sorted(lightness), "the highest power is the lightest, as on a dark ground"
    assert pixel(square_tab, 50, 10)[3] == 0 and pixel(square_tab, 20, 5)[3] == 0
    jump = pixels(square_tab, [(x, 0) for x in np.arange(5, 35, 0.25)])
    assert {color[3] > 0 for color in jump} == {True, False}, "a jump is dashed"
    square_tab.page.uncheck("#show-jumps")
    square_tab.drawn()
    assert all(color[3] == 0 for color in pixels(square_tab, [(x, 0) for x in np.arange(5, 35, 0.5)]))
    assert pixel(square_tab, 50, 0)[3] > 200


def test_the_legend_says_range_and_unit(square_tab: Tab) -> None:
    def legend() -> str:
        return " ".join(square_tab.page.inner_text(".scale-key").split())

    assert legend() == "emitted power, % 10 40"
    square_tab.page.select_option("#color-by", "velocity")
    assert legend() == "velocity, mm/s 100 200"
    square_tab.page.select_option("#color-by", "energy")
    assert legend() == "energy per mm, %·ms/mm 100 200"
    square_tab.page.select_option("#color-by", "order")
    assert legend() == "order in time, ms 40 615"
    assert square_tab.page.inner_text("#scale-bar").split()[1] in ("mm", "um")


@pytest.mark.slow
def test_the_scale_bar_is_true(square_tab: Tab) -> None:
    for _ in range(3):
        text = square_tab.page.inner_text("#scale-bar").split()
        mm = float(text[0]) * {"mm": 1, "um": 1e-3}[text[1]]
        found = square_tab.page.evaluate(
            """() => { const { map } = gusjob.path.view;
            const wide = document.getElementById("scale-bar").getBoundingClientRect().width;
            return wide / map.options.crs.scale(map.getZoom()); }"""
        )
        assert found == pytest.approx(mm, rel=1e-3)
        for _ in range(4):
            square_tab.page.click(".leaflet-control-zoom-in")
            rest(square_tab.page, 350)
        square_tab.drawn()


def test_click_on_a_stroke_selects_it_everywhere(square_tab: Tab) -> None:
    click_path(square_tab, 50, 20)
    check_selected(square_tab, 3)
    words = square_tab.page.inner_text("#details-body").split()
    assert words[words.index("length") :][:3] == ["length", "mm", "20"]
    click_path(square_tab, 20, 0)
    assert selected(square_tab)["row"] in (0, 5), "a jump can be selected too"
    click_path(square_tab, 50, 10)
    assert selected(square_tab)["row"] in (0, 5), "a click beside all strokes changes nothing"


def test_click_in_the_time_view_selects(square_tab: Tab) -> None:
    click_time(square_tab, 300)
    check_selected(square_tab, 2)
    click_time(square_tab, 682)
    check_selected(square_tab, 6)


def test_the_time_view_shows_velocity_and_power(square_tab: Tab) -> None:
    data = square_tab.page.evaluate("gusjob.time.view.plot.data")
    assert data[0][:6] == pytest.approx([0, 40, 40, 240, 240, 440])
    assert data[1][:6] == [1000, 1000, 100, 100, 100, 100]
    assert data[2][:6] == [0, 0, 10, 10, 20, 20]
    assert data[0][-1] == pytest.approx(685)


def test_the_time_view_zooms_and_comes_back(square_tab: Tab) -> None:
    page = square_tab.page

    def window() -> tuple[float, float]:
        rest(page, 120)
        found = page.evaluate("[gusjob.time.view.plot.scales.x.min, gusjob.time.view.plot.scales.x.max]")
        return found[0], found[1]

    assert window() == pytest.approx((0, 685))
    page.focus("#time")
    page.keyboard.press("+")
    assert window() == pytest.approx((685 / 4, 685 * 3 / 4))
    page.keyboard.press("ArrowLeft")
    assert window() == pytest.approx((685 * 0.15, 685 * 0.65))
    page.keyboard.press("Home")
    assert window() == pytest.approx((0, 685))
    page.locator("#time").scroll_into_view_if_needed()
    box = page.locator("#time .u-over").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 4, box["y"] + 50)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60, steps=5)
    page.mouse.up()
    assert window() == pytest.approx((685 / 4, 685 / 2), rel=0.02)
    assert selected(square_tab)["row"] is None, "a drag is no click"
    page.mouse.wheel(0, -100)
    low, high = window()
    assert high - low == pytest.approx(685 / 4 / 1.25, rel=0.02)
    page.mouse.dblclick(box["x"] + 50, box["y"] + 50)
    assert window() == pytest.approx((0, 685))


def test_previous_next_and_line(square_tab: Tab) -> None:
    page = square_tab.page
    page.click("#next")
    check_selected(square_tab, 0)
    assert page.get_attribute("#previous", "aria-disabled") == "true"
    page.click("#next")
    check_selected(square_tab, 1)
    page.click("#previous")
    check_selected(square_tab, 0)
    page.fill("#line", "8")
    page.press("#line", "Enter")
    check_selected(square_tab, 4)
    page.fill("#line", "9")
    page.click("#go")
    check_selected(square_tab, 5)
    assert "line 9 has no segment: the next is line 10" in page.inner_text("#line-none")
    page.fill("#line", "99")
    page.click("#go")
    check_selected(square_tab, 5)
    assert "no segment" in page.inner_text("#line-none")


@pytest.mark.slow
def test_a_link_selects_and_survives_reload(chromium: Chromium, tmp_path: Path) -> None:
    path = written(page_of(columns_of(square())), tmp_path)
    with chromium.open(path, fragment="#s=4") as tab:
        check_selected(tab.ready(), 4)
        tab.page.click("#previous")
        tab.page.reload()
        check_selected(tab.ready(), 3)
        tab.page.evaluate("location.hash = '#s=1'")
        check_selected(tab, 1)
        assert tab.complaints == []
    for wrong in ("#s=7", "#s=-1", "#s=x", "#s=99999999999", "#<img src=x onerror=alert(1)>"):
        with chromium.open(path, fragment=wrong) as tab:
            assert selected(tab.ready())["row"] is None and tab.complaints == []


def test_arrow_keys_in_the_table_move_the_selection(square_tab: Tab) -> None:
    square_tab.page.click('#segments-grid [row-index="2"] [col-id="line"]')
    check_selected(square_tab, 2)
    square_tab.page.keyboard.press("ArrowDown")
    check_selected(square_tab, 3)
    square_tab.page.keyboard.press("ArrowUp")
    square_tab.page.keyboard.press("ArrowUp")
    check_selected(square_tab, 1)


def test_a_selection_out_of_sight_is_brought_into_it(square_tab: Tab) -> None:
    page = square_tab.page
    page.click("#next")
    page.click("#next")
    square_tab.drawn()
    page.evaluate("gusjob.path.view.map.setView([100, -100], 20, { animate: false })")
    page.click("#next")
    page.wait_for_function("() => gusjob.path.view.map.getBounds().contains([10, 60])", timeout=20_000)
    page.evaluate("gusjob.time.zoomTo(0, 10)")
    rest(page, 100)
    click_path(square_tab, 60, 10)
    page.click("#next")
    rest(page, 100)
    assert selected(square_tab)["marker"] == 3


@pytest.mark.slow
def test_order_and_filters_give_the_rows_that_numpy_gives(chromium: Chromium, tmp_path: Path) -> None:
    tables = field_of_marks(3000)
    rows = tables["rows"]
    rows["length_mm"][10:20] = [0.0, -0.0, 1e-7, 3.0, 3.0, 0.5, 0.5, 0.5, 7.0, -1.0]
    power = rows["ch0_power_max"].astype(np.float32)
    length = rows["length_mm"].astype(np.float32)
    kind = rows["kind"]
    number = np.arange(3000)
    with chromium.open(written(page_of(tables), tmp_path)) as tab:
        tab.ready()
        assert order(tab, [], {}) == number.tolist()
        assert order(tab, [("length_mm", "asc")], {}) == np.argsort(length, kind="stable").tolist()
        assert order(tab, [("length_mm", "desc")], {}) == np.argsort(-length, kind="stable").tolist()
        up = np.argsort(power, kind="stable")
        assert order(tab, [("ch0_power_max", "asc")], {}) == up.tolist(), "NaN last"
        assert order(tab, [("ch0_power_max", "desc")], {}) == np.argsort(-power, kind="stable").tolist(), "NaN last"
        assert order(tab, [("start_ms", "desc")], {}) == number[::-1].tolist()
        by_kind = np.lexsort((number, -length, kind != JUMP))
        assert order(tab, [("kind", "asc"), ("length_mm", "desc")], {}) == by_kind.tolist()

        def kept(name: str, **model: Any) -> list[int]:
            return order(tab, [], {name: {"filterType": "number", **model}})

        assert kept("length_mm", type="equals", filter=3) == [13, 14]
        shown = [f"{value:.4g}" for value in length.tolist()]
        alike = [number for number, text in enumerate(shown) if text == shown[100]]
        assert len(alike) > 1 and kept("length_mm", type="equals", filter=float(shown[100])) == alike
        assert kept("length_mm", type="lessThan", filter=0.05) == np.flatnonzero(length < 0.05).tolist()
        assert kept("ch0_power_max", type="greaterThan", filter=60.5) == np.flatnonzero(power > 60.5).tolist()
        assert kept("ch0_power_max", type="blank") == np.flatnonzero(np.isnan(power)).tolist()
        between = np.flatnonzero((rows["line"] >= 20) & (rows["line"] <= 25))
        assert kept("line", type="inRange", filter=20, filterTo=25) == between.tolist()
        either = {"filterType": "number", "operator": "OR", "conditions": [
            {"filterType": "number", "type": "equals", "filter": 3},
            {"filterType": "number", "type": "equals", "filter": 5}]}  # fmt: skip
        assert order(tab, [], {"line": either}) == np.flatnonzero(np.isin(rows["line"], (3, 5))).tolist()
        words = {"kind": {"filterType": "text", "type": "contains", "filter": "AR"}}
        marks = np.flatnonzero(kind == MARK)
        assert order(tab, [("length_mm", "desc")], words) == marks[np.argsort(-length[marks], kind="stable")].tolist()
        assert tab.page.inner_text("#segments-count") == "1,500 of 3,000 rows"
        tab.page.evaluate("gusjob.select(0, 'hash')")
        assert "hides the selected segment" in tab.page.inner_text("#segments-panel")
        tab.page.click("#segments-clear")
        rest(tab.page, 300)
        assert tab.page.inner_text("#segments-count") == "3,000 of 3,000 rows"
        assert tab.page.is_hidden("#segments-hidden")
        assert tab.complaints == []


def test_order_and_filter_by_hand(square_tab: Tab) -> None:
    page = square_tab.page
    page.locator("#segments-grid").scroll_into_view_if_needed()
    page.click('#segments-grid .ag-header-cell[col-id="length_mm"] .ag-header-cell-text')
    rest(page, 300)
    first = page.locator('#segments-grid [row-index="0"] [col-id="kind"]')
    assert first.inner_text() == "dwell"
    page.fill('#segments-grid .ag-floating-filter[col-id="kind"] input >> visible=true', "mark")
    rest(page, 700)
    assert page.inner_text("#segments-count") == "4 of 7 rows"
    with page.expect_download() as download:
        page.click("#segments-csv")
    lines = Path(download.value.path()).read_text(encoding="utf-8").splitlines()
    assert download.value.suggested_filename == "square.job-segments.csv"
    head = lines[0].split(",")
    assert head[:4] == ["segment", "line", "kind", "stage"] and len(lines) == 5
    assert [line.split(",")[head.index("line")] for line in lines[1:]] == ["5", "6", "7", "8"]
    assert [float(line.split(",")[head.index("ch0_power_max")]) for line in lines[1:]] == [10, 20, 30, 40]


def test_columns_that_say_nothing_are_hidden(square_tab: Tab, rich_tab: Tab) -> None:
    names = square_tab.page.evaluate("gusjob.table.grids.segments.columns.map((c) => c.name)")
    assert not {"ch0_joules", "ch0_clamped_ms"} & set(names) and {"segment", "start_ms", "ch0_power_max"} < set(names)
    rich_tab.page.click("#tab-marks")
    marks = rich_tab.page.evaluate("gusjob.table.grids.marks.columns.map((c) => c.name)")
    assert "corner_miss_um" not in marks and "on_error_um" in marks and "row" not in marks


def test_a_mark_selects_its_first_segment(rich_tab: Tab) -> None:
    rich_tab.page.click("#tab-marks")
    rest(rich_tab.page, 300)
    assert rich_tab.page.inner_text("#marks-count") == "7 of 7 rows"
    rich_tab.page.click('#marks-grid [row-index="3"] [col-id="line"]')
    assert selected(rich_tab)["row"] == 14
    rich_tab.page.keyboard.press("ArrowDown")
    assert selected(rich_tab)["row"] == 18
    rich_tab.page.focus("#tab-marks")
    rich_tab.page.keyboard.press("ArrowLeft")
    assert rich_tab.page.is_visible("#segments-grid") and rich_tab.page.is_hidden("#marks-grid")


def test_the_page_begins_with_the_answer(rich_tab: Tab) -> None:
    page = rich_tab.page
    text = page.inner_text("main").split("\n")
    assert text[0].split(" ")[:2] == ["1", "warning"] or text[0] == "1 warning"
    assert page.get_attribute("#answer", "class") == "warning"
    findings = page.locator("#findings li")
    assert findings.count() == 3 and findings.nth(0).get_attribute("role") == "alert"
    assert page.locator("#findings a").all_inner_texts() == ["hottest line 12", "slowest ring.job:3"]
    page.click("#findings a >> nth=1")
    check_selected(rich_tab, 25)
    page.click("#findings a >> nth=0")
    assert selected(rich_tab)["row"] == 14
    rest(page, 300)
    assert page.evaluate("gusjob.table.grids.marks.api.getSelectedRows().map((r) => r.row)") == [3]
    assert page.is_visible("#marks-grid")


def test_a_link_to_a_mark(chromium: Chromium, tmp_path: Path) -> None:
    with chromium.open(written(rich_page(), tmp_path), fragment="#m=3") as tab:
        assert selected(tab.ready())["row"] == 14 and tab.page.is_visible("#marks-grid")
        assert tab.complaints == []


def test_the_findings_are_there_without_scripts(chromium: Chromium, tmp_path: Path) -> None:
    with chromium.open(written(rich_page(), tmp_path), scripts=False) as tab:
        assert "slowest ring.job:3" in " ".join(tab.page.inner_text("#answer").split())


def jumps_drawn(tab: Tab) -> bool:
    """Whether a pixel of the jump to the square is drawn."""
    tab.drawn()
    return any(color[3] for color in pixels(tab, [(x, 0) for x in np.arange(5, 35, 0.5)]))


def test_hidden_jumps_stay_hidden(chromium: Chromium, tmp_path: Path) -> None:
    tables = columns_of([step | {"p1": 3.0} if "p0" in step else step for step in square()], 2)
    with chromium.open(written(page_of(tables, units=("%", "V")), tmp_path)) as tab:
        page = tab.ready().page
        assert jumps_drawn(tab) and page.is_visible("#key-jump")
        page.uncheck("#show-jumps")
        assert not jumps_drawn(tab) and page.is_hidden("#key-jump")
        for act in (
            lambda: page.select_option("#theme", "dark"),
            lambda: page.select_option("#color-by", "energy"),
            lambda: page.select_option("#color-channel", "1"),
            lambda: page.click(".leaflet-control-zoom-out"),
            lambda: page.click("#fit-path"),
            lambda: page.reload(),
        ):
            act()
            tab.ready()
            assert not jumps_drawn(tab) and not page.is_checked("#show-jumps")
            assert pixel(tab, 50, 0)[3] > 200
        assert page.input_value("#color-by") == "energy", "the choice of colours is kept, too"
        assert tab.complaints == []


@pytest.mark.parametrize(("width", "spacing"), [(420, 0.5), (1280, 0.15)])
def test_hatch_lines_do_not_merge(chromium: Chromium, tmp_path: Path, width: int, spacing: float) -> None:
    """Some 3 px from line to line over 30 mm: at most half of that is line."""
    steps: list[dict[str, Any]] = []
    for k in range(round(30 / spacing)):
        steps += [
            {"line": 1, "kind": JUMP, "x": 0.0, "y": (k + 1) * spacing, "vel": 1000.0},
            {"line": 2, "kind": MARK, "x": 30.0, "y": (k + 1) * spacing, "vel": 100.0, "p0": 20.0},
        ]
    with chromium.open(written(page_of(columns_of(steps)), tmp_path), width=width) as tab:
        page = tab.ready().page
        page.uncheck("#show-jumps")
        tab.drawn()
        share = page.evaluate(
            """(top) => { const { map, layer } = gusjob.path.view;
            const low = map.project([1, 12], map.getZoom()), high = map.project([top, 12], map.getZoom());
            let lit = 0, all = 0;
            for (let y = Math.ceil(high.y); y < low.y; y++) {
              const tile = Object.values(layer._tiles).find((t) => t.coords.x === Math.floor(low.x / 256)
                && t.coords.y === Math.floor(y / 256));
              const { x: left, y: top } = tile.coords;
              lit += tile.el.getContext("2d").getImageData(low.x - left * 256, y - top * 256, 1, 1).data[3] / 255;
              all++;
            }
            return lit / all; }""",
            29.0,
        )
        assert 0.15 < share < 0.6


def test_outliers_have_their_own_colour(chromium: Chromium, tmp_path: Path) -> None:
    """100 mm in 50 lines with 10 to 59 %, then 0.5 mm with 900 %."""
    steps: list[dict[str, Any]] = [
        {"line": k + 1, "kind": MARK, "x": 2.0 * k + 2, "y": 0.0, "vel": 100.0, "p0": 10.0 + k} for k in range(50)
    ]
    steps.append({"line": 51, "kind": MARK, "x": 100.0, "y": 1.0, "vel": 100.0, "p0": 900.0})
    with chromium.open(written(page_of(columns_of(steps)), tmp_path)) as tab:
        page = tab.ready().page
        shown = " ".join(page.inner_text(".scale-key").split())
        assert shown == "emitted power, % 10 59 > 59, max 900"
        assert pixel(tab, 100, 0.5)[:3] == [0xC0, 0x4F, 0x00]
        page.select_option("#theme", "dark")
        tab.drawn()
        assert pixel(tab, 100, 0.5)[:3] == [0xD5, 0x5E, 0x00]
        assert tab.complaints == []


def test_emission_is_drawn_where_the_beam_is(rich_tab: Tab) -> None:
    page = rich_tab.page
    page.evaluate("gusjob.path.view.map.setView([15, 15], 20, { animate: false })")
    rich_tab.drawn()
    radius = 15 * np.cos(np.pi / 180)
    assert pixel(rich_tab, 30 - radius - 0.3, 15)[3] > 200, "the arc, as the beam goes"
    assert pixel(rich_tab, 30 - radius, 15)[3] == 0, "not as it was commanded"
    page.check("#show-command")
    rich_tab.drawn()
    assert pixel(rich_tab, 30 - radius, 15)[3] > 0
    click_path(rich_tab, 30 - radius - 0.3, 15)
    assert selected(rich_tab)["row"] == 25


def test_channels_switches_and_kinds_look_different(rich_tab: Tab) -> None:
    page = rich_tab.page
    ring, line = (30 - 15 - 0.3, 15.0), (-15.0, 0.0)
    first = pixel(rich_tab, *line)
    page.select_option("#color-channel", "1")
    rich_tab.drawn()
    assert page.inner_text("#legend-name") == "emitted power, channel 1, V"
    other = pixel(rich_tab, *line)
    assert other[3] > 200 and other != first and pixel(rich_tab, *ring)[3] > 200
    at = (-30.3, 12.0)
    around = [(at[0] + dx, at[1] + dy) for dx in np.arange(-1, 1, 0.1) for dy in np.arange(-1, 1, 0.1)]
    before = sum(color[3] > 0 for color in pixels(rich_tab, around))
    page.check("#show-switches")
    rich_tab.drawn()
    assert sum(color[3] > 0 for color in pixels(rich_tab, around)) > before, "a circle where emission begins"
    assert "command" not in page.inner_text(".legend"), "not drawn"
    page.check("#show-command")
    keys = page.inner_text(".legend").split()
    assert {"jump", "run-in", "run-out", "command", "on", "off"} <= set(keys)


def test_zoom_by_keyboard_and_buttons(square_tab: Tab) -> None:
    page = square_tab.page
    zoom = "gusjob.path.view.map.getZoom()"
    before = page.evaluate(zoom)
    page.focus("#map")
    page.keyboard.press("+")
    square_tab.drawn()
    rest(page, 400)
    assert page.evaluate(zoom) > before
    middle = page.evaluate("gusjob.path.view.map.getCenter().lng")
    page.keyboard.press("ArrowRight")
    rest(page, 500)
    assert page.evaluate("gusjob.path.view.map.getCenter().lng") > middle
    page.click("#fit-field")
    square_tab.drawn()
    assert page.evaluate("gusjob.path.view.map.getBounds().contains([[-150, -150], [150, 150]])")
    page.click("#fit-path")
    assert page.evaluate(zoom) == before


def test_hover_shows_line_kind_power_and_velocity(square_tab: Tab) -> None:
    page = square_tab.page
    assert hover_path(square_tab, 50, 20).split("\n") == [
        "line 7: mark (segment 4)",
        "200 mm/s, ch0 30 % (150 %·ms/mm)",
    ]
    page.locator("#time").scroll_into_view_if_needed()
    box = page.locator("#time .u-over").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] * 0.5, box["y"] + 20)
    rest(page, 200)
    assert "line 6: mark" in page.inner_text("#time-hover")


@pytest.mark.parametrize("dark", [False, True])
def test_light_and_dark(chromium: Chromium, tmp_path: Path, dark: bool) -> None:
    back = "Number(getComputedStyle(document.body).backgroundColor.match(/[0-9.]+/)[0])"
    with chromium.open(written(page_of(columns_of(square())), tmp_path), dark=dark) as tab:
        page = tab.ready().page
        assert (page.evaluate(back) < 100) == dark
        strongest = sum(pixel(tab, 40, 10)[:3])
        page.select_option("#theme", "light" if dark else "dark")
        tab.drawn()
        assert (page.evaluate(back) < 100) != dark
        assert (sum(pixel(tab, 40, 10)[:3]) > strongest) != dark, "the highest value stands out from the ground"
        inside = "getComputedStyle(document.querySelector('#segments-grid .ag-cell')).color"
        ink = "getComputedStyle(document.body).color"
        assert page.evaluate(inside) == page.evaluate(ink)
        page.select_option("#theme", "auto")
        assert (page.evaluate(back) < 100) == dark
        assert tab.complaints == []


@pytest.mark.parametrize("width", [360, 768, 1280])
def test_no_horizontal_scrolling(chromium: Chromium, tmp_path: Path, width: int) -> None:
    page_ = rich_page()
    page_.diagnostics[0]["source"] = "LINE " + "x" * 400
    page_.diagnostics[0]["message"] = "m" * 300
    page_.facts["job"] = "j" * 200 + ".job"
    with chromium.open(written(page_, tmp_path), width=width, height=740, fragment="#s=2") as tab:
        tab.ready()
        assert tab.page.evaluate("document.documentElement.scrollWidth") <= width
        tab.page.click("#tab-marks")
        rest(tab.page, 200)
        assert tab.page.evaluate("document.documentElement.scrollWidth") <= width
        assert tab.complaints == []


@pytest.mark.slow
def test_all_can_be_reached_by_keyboard(fresh_tab: Tab) -> None:
    page = fresh_tab.page
    page.evaluate("document.body.focus()")
    seen: list[str] = []
    for _ in range(150):
        page.keyboard.press("Tab")
        where, visible, named = page.evaluate(
            """() => { const e = document.activeElement, s = getComputedStyle(e);
            const grid = e.closest(".grid");
            return [grid ? grid.id : e.id || e.className, grid !== null || s.outlineStyle !== "none",
              !!(e.getAttribute("aria-label") || e.getAttribute("aria-labelledby") || e.textContent.trim()
                || (e.labels && e.labels.length))]; }"""
        )
        if where not in seen:
            assert visible and named, where
            seen.append(where)
    wanted = ["skip", "theme", "color-by", "show-jumps", "show-switches", "fit-path", "map", "previous", "next", "line",
              "go", "time-in", "time-all", "time", "tab-segments", "segments-grid", "segments-csv"]  # fmt: skip
    assert [w for w in seen if w in wanted] == wanted
    page.focus("#tab-segments")
    for _ in range(40):
        page.keyboard.press("Tab")
        if page.evaluate("!!document.activeElement.closest('#segments-grid .ag-cell, #segments-grid .ag-header-cell')"):
            break
    for _ in range(4):
        page.keyboard.press("ArrowDown")
    rest(page, 200)
    assert selected(fresh_tab)["row"] is not None, "down from the head into the rows, without a mouse"
    assert page.get_attribute("#details-title", "aria-live") == "polite"


def test_hostile_texts_are_shown_and_do_nothing(chromium: Chromium, tmp_path: Path) -> None:
    path = written(hostile_page(), tmp_path)
    text = path.read_text(encoding="utf-8")
    assert SCRIPT not in text and "<img" not in re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert "\u202e" not in text and "\u2028" not in text.split("<body>")[1].split("<script>")[0]
    shown = HOSTILE.replace("\u2028", "\ufffd").replace("\u202e", "\ufffd").replace("\u2066", "\ufffd")
    with chromium.open(path, before="window.alert = () => { document.title = 'ran'; }") as tab:
        page = tab.ready().page
        assert page.inner_text("h1") == shown
        assert page.inner_text(".diagnostic .message >> nth=0") == shown
        assert shown in page.inner_text(".diagnostic .source >> nth=0")
        assert page.title().startswith(SCRIPT)
        for row in (2, 25):
            page.evaluate("(row) => gusjob.select(row, 'hash')", row)
            assert (shown if row == 2 else IMAGE) in page.inner_text("#details-title")
        assert IMAGE in page.inner_text('#segments-grid [row-id="25"] [col-id="file"]')
        click_path(tab, -15, 0)
        assert shown in hover_path(tab, -15, 0) and shown in page.inner_text("#legend-name")
        click_time(tab, 100)
        assert shown in page.inner_text("#time-hover")
        page.click("#tab-marks")
        with page.expect_download() as download:
            page.click("#marks-csv")
        assert re.fullmatch(r"[\w.-]+", download.value.suggested_filename)
        assert page.evaluate("document.querySelectorAll('img, iframe, object').length") == 0
        assert not page.title().startswith("ran") and "49" not in page.inner_text("h1")
        assert tab.complaints == [] and tab.requests == []


def test_a_name_that_a_spreadsheet_would_run_is_defused(chromium: Chromium, tmp_path: Path) -> None:
    page_ = rich_page()
    page_.facts["notes"]["files"] = ['=cmd|"/c calc"!A1', "a,b.job"]
    with chromium.open(written(page_, tmp_path)) as tab:
        tab.ready().page.locator("#segments-csv").scroll_into_view_if_needed()
        with tab.page.expect_download() as download:
            tab.page.click("#segments-csv")
        lines = list(csv.reader(Path(download.value.path()).read_text(encoding="utf-8").splitlines()))
        assert {line[2] for line in lines[1:]} == {'\'=cmd|"/c calc"!A1', "a,b.job"}


def test_a_job_without_motion(chromium: Chromium, tmp_path: Path) -> None:
    full = columns_of(square())
    tables = {name: {n: c[:0] for n, c in columns.items()} for name, columns in full.items()}
    for page_ in (page_of(tables), page_of(tables, marking=[])):
        with chromium.open(written(page_, tmp_path)) as tab:
            assert "no motion" in tab.page.inner_text("main") and "segments" in tab.page.inner_text("#totals")
            tab.page.select_option("#theme", "dark")
            assert tab.complaints == [] and tab.requests == []


def test_a_page_without_tables(chromium: Chromium, tmp_path: Path) -> None:
    page_ = Page(facts={"job": "a.job", "version": "1"}, tables={}, diagnostics=diagnostics(), marking=None)
    with chromium.open(written(page_, tmp_path)) as tab:
        assert "GJ503" in tab.page.inner_text("main") and tab.page.inner_text(".source mark >> nth=0") == "(n*w)"
        assert tab.complaints == [] and tab.requests == []


@pytest.mark.slow
def test_without_emission(chromium: Chromium, tmp_path: Path) -> None:
    steps = [{"line": 1, "kind": JUMP, "x": 5.0, "vel": 10.0}, {"line": 2, "kind": DWELL, "ms": 3.0}]
    for channels in (0, 1):
        page_ = page_of(columns_of(steps, channels), units=("%",)[:channels])
        with chromium.open(written(page_, tmp_path)) as tab:
            assert tab.ready().page.inner_text("#legend-name") == "no emission"
            click_path(tab, 2.5, 0)
            check_selected(tab, 0)
            assert tab.complaints == []


def test_a_channel_whose_unit_changes(chromium: Chromium, tmp_path: Path) -> None:
    tables = columns_of(square())
    tables["strokes"]["ch0_unit"] = (tables["strokes"]["row"] >= 3).astype(np.uint8)
    page_ = page_of(
        tables,
        facts={
            "channels": [
                {"channel": 0, "unit": "%", "units": ["%", "V"], "watts_per_unit": None, "peak_per_mm": [None] * 2}
            ]
        },
    )
    with chromium.open(written(page_, tmp_path)) as tab:
        page = tab.ready().page
        assert page.locator("#color-channel option").all_inner_texts() == ["channel 0, %", "channel 0, V"]
        assert " ".join(page.inner_text(".scale-key").split()) == "emitted power, channel 0, % 10 20"
        page.select_option("#color-channel", "1")
        assert " ".join(page.inner_text(".scale-key").split()) == "emitted power, channel 0, V 30 40"
        assert page.evaluate("gusjob.time.view.plot.series.length") == 4
        assert tab.complaints == []


def test_without_scripts_the_figures_are_there(chromium: Chromium, tmp_path: Path) -> None:
    with chromium.open(written(rich_page(), tmp_path), scripts=False) as tab:
        tab.page.click("#totals summary")
        text = tab.page.inner_text("main")
        for words in ("Without JavaScript", "274.2", "GJ503", "is left ON", "Marking quality", "on error"):
            assert words in text, words
        assert tab.page.is_hidden("#map") and tab.page.is_hidden("#theme")


def test_an_old_browser_shows_what_it_lacks(chromium: Chromium, tmp_path: Path) -> None:
    with chromium.open(written(rich_page(), tmp_path), before="delete window.DecompressionStream") as tab:
        assert "DecompressionStream" in tab.page.inner_text("#status") and tab.complaints == []


@pytest.mark.slow
def test_columns_come_back_in_the_browser(chromium: Chromium, tmp_path: Path) -> None:
    page_ = rich_page()
    tables = {name: dict(columns) for name, columns in page_.tables.items()}
    wanted = round_trip(tables)[1]
    for before in ("", "delete Uint8Array.fromBase64"):
        with chromium.open(written(page_, tmp_path), before=before) as tab:
            tab.ready()
            assert any(e["how"] for e in tab.page.evaluate("gusjob.facts.directory"))
            for table, columns in wanted.items():
                for name, column in columns.items():
                    found = tab.page.evaluate(
                        """([t, n]) => { const c = gusjob.tables[t][n];
                        return Array.from(c.values, (v) => (Number.isNaN(v) ? null : c.scale ? v / c.scale : v)); }""",
                        [table, name],
                    )
                    assert np.array_equal(
                        np.array(found, dtype=np.float64), column.astype(np.float64), equal_nan=True
                    ), name
            starts = tab.page.evaluate("[...gusjob.rows.starts]")
            assert starts[:-1] == pytest.approx(tables["rows"]["start_ms"].tolist(), rel=1e-6, abs=1e-6)


def test_figures_read_alike_on_both_sides(square_tab: Tab) -> None:
    random = np.random.default_rng(5)
    values = [
        *(random.uniform(1, 10, 300) * 10.0 ** random.integers(-4, 9, 300)).tolist(),
        0.0,
        0.1,
        1e5,
        123456.0,
        -7.0,
    ]
    found = square_tab.page.evaluate("(values) => values.map((v) => gusjob.figure(v))", values)
    assert found == [as_text(float(f"{v:.6g}") + 0.0) for v in values]
    assert square_tab.page.evaluate("[NaN, null, 1e-9, 2.5e25, -0].map((v) => gusjob.figure(v))") == [
        "-", "-", "0.000000001", "25000000000000000000000000", "0",
    ]  # fmt: skip


def test_rounding_is_noted(chromium: Chromium, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page_ = page_of(field_of_marks(60_000))
    whole = len(b"".join(render(page_)))
    monkeypatch.setattr("gusjob.view.page.render.MAX_BYTES", whole - 400_000)
    path = written(page_, tmp_path)
    assert path.stat().st_size <= whole - 400_000
    with chromium.open(path) as tab:
        digits = tab.ready().page.evaluate("gusjob.facts.digits")
        assert digits < 6 and f"rounded to about {digits} digits" in tab.page.inner_text("#totals")


@pytest.mark.slow
def test_a_million_segments(chromium: Chromium, tmp_path: Path) -> None:
    tables = field_of_marks(1_000_000)
    path = written(page_of(tables, facts={"exact": False}), tmp_path)
    assert path.stat().st_size < MAX_BYTES
    begin = time.perf_counter()
    with chromium.open(path) as tab:
        page = tab.ready().page
        assert time.perf_counter() - begin < 30
        assert "highest velocity and mean power" in page.inner_text("#totals")
        assert pixel(tab, 0, 0)[3] > 0
        assert pixel(tab, 120, 0)[3] == 0
        took = page.evaluate(
            """() => { const g = gusjob, from = performance.now();
            const sort = [{ colId: "ch0_power_max", sort: "desc" }];
            const filters = { kind: { type: "equals", filter: "mark" } };
            g.chosen(g.table.grids.segments.columns, g.count, sort, filters);
            g.select(765432, ""); return performance.now() - from; }"""
        )
        assert took < 3000
        rest(page, 800)
        check_selected(tab, 765_432)
        assert page.evaluate("gusjob.time.view.plot.data[0].length") < 20_000
        page.evaluate("gusjob.time.zoomTo(1000, 1010)")
        rest(page, 200)
        starts = tables["rows"]["start_ms"]
        inside = int(((starts > 1000) & (starts < 1010)).sum())
        assert abs(page.evaluate("gusjob.time.view.plot.data[0].length") / 2 - inside) <= 2
        assert tab.complaints == [] and tab.requests == []


class Watched(BaseHTTPRequestHandler):
    """Serves a page, and tells once that it has changed."""

    page = b""
    change = threading.Event()

    def do_GET(self) -> None:
        self.send_response(200)
        events = self.path == "/events"
        self.send_header("Content-Type", "text/event-stream" if events else "text/html; charset=utf-8")
        self.end_headers()
        if not events:
            self.wfile.write(self.page)
            return
        self.wfile.write(b": hello\n\n")
        self.wfile.flush()
        if self.change.wait(20):
            self.change.clear()
            self.wfile.write(b"data: changed\n\n")

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        return


@pytest.mark.slow
def test_a_watched_page_is_reloaded_and_keeps_its_view(chromium: Chromium) -> None:
    Watched.page = b"".join(render(page_of(columns_of(square()), watched="/events")))
    server = ThreadingHTTPServer(("127.0.0.1", 0), Watched)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        with chromium.open(f"http://127.0.0.1:{server.server_port}/") as tab:
            page = tab.ready().page
            page.wait_for_function("document.getElementById('watched').textContent === 'updates with the job'")
            page.evaluate("gusjob.path.view.map.setView([10, 50], 22, { animate: false })")
            page.evaluate("gusjob.time.zoomTo(100, 300)")
            page.select_option("#color-by", "velocity")
            page.uncheck("#show-jumps")
            order(tab, [("length_mm", "desc")], {"kind": {"filterType": "text", "type": "equals", "filter": "mark"}})
            page.evaluate("gusjob.select(2, 'hash'); document.documentElement.dataset.old = '1'")
            page.evaluate("history.replaceState(null, '', '#s=2')")
            Watched.page = b"".join(render(page_of(columns_of([*square(), *square()]), watched="/events")))
            Watched.change.set()
            page.wait_for_selector("html:not([data-old])", state="attached")
            tab.ready()
            rest(page, 500)
            assert page.evaluate("gusjob.count") == 14
            check_selected(tab, 2)
            assert page.evaluate(
                "[gusjob.path.view.map.getZoom(), gusjob.path.view.map.getCenter().lng]"
            ) == pytest.approx([22, 50], abs=0.1)
            assert page.evaluate("[gusjob.time.view.from, gusjob.time.view.to]") == pytest.approx([100, 300])
            assert page.input_value("#color-by") == "velocity" and not page.is_checked("#show-jumps")
            assert page.inner_text("#segments-count") == "8 of 14 rows"
            assert tab.complaints == []
            assert {r.removeprefix(f"http://127.0.0.1:{server.server_port}") for r in tab.requests} == {"/events"}
    finally:
        Watched.change.set()
        server.shutdown()
        server.server_close()
