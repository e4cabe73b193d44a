"""The page in Simplified Chinese: no English word that people read is left in it, and it works as in English."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

pytest.importorskip("jinja2", reason="jinja2 is not installed")

from click.testing import CliRunner
from support.browser import Chromium, Tab, chromium, rest
from support.chinese import CHINESE
from support.page_actions import click_path, click_time, hover_path, order, selected
from support.pages import (
    IMAGE,
    JUMP,
    SCRIPT,
    columns_of,
    diagnostics,
    field_of_marks,
    hostile_page,
    html,
    page_of,
    rich_page,
    square,
    written,
)
from support.tools import ROOT

from gusjob.cli import cli
from gusjob.cli.page import too_long
from gusjob.cli.serve import PageServer
from gusjob.i18n.language import set_language
from gusjob.i18n.phrases import Phrase, localized
from gusjob.report.answer import LEFT_ON
from gusjob.simulate.kinds import SegmentKind
from gusjob.view.page import texts as page_texts
from gusjob.view.page.render import Page

__all__ = ["chromium"]
"""A fixture of this module."""

pytestmark = pytest.mark.browser

STATIC = ROOT / "gusjob" / "view" / "page" / "static"


@pytest.fixture(autouse=True)
def _chinese() -> Iterator[None]:
    set_language("zh")
    yield
    set_language("en")


# What is left of English.

KNOWN = {
    "units, and what makes them": ("mm/s", "ms/mm", "mm", "um", "us", "ms", "s", "kHz", "V", "J", "nm"),
    "coordinates": ("x", "y"),
    "a channel, as in the files that programs read": ("ch0", "ch1"),
    "files": ("part.job", "ring.job", "square.job", "a.job", "long.job"),
    "the scanner's model, an option's value": ("first-order",),
    "rules and the controller's calls": ("GJ503", "GJ304", "GT_GetHSIOOpt"),
    "programs": ("gusjob", "Leaflet", "Flatbush", "FlatQueue", "uPlot", "AG Grid Community", "gusjob plot",
                 "report --format parquet"),
    "their licences": ("BSD-2-Clause", "ISC", "MIT"),
    "keys of a keyboard": ("CTRL ENTER", "ENTER", "SPACE", "Home", "Enter"),
    "formats, languages and interfaces": ("CSV", "JSON", "JavaScript", "DecompressionStream"),
}  # fmt: skip
"""What stays as it is in Chinese too, by the reason why."""

SEEN = """() => {
  const found = [document.title];
  const seen = (e) => e.checkVisibility({ checkVisibilityCSS: true, checkOpacity: true });
  const heard = (e) => seen(e) && !e.closest(".licence, .source"); // A licence, and the job's own lines.
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walk.nextNode(); node; node = walk.nextNode()) {
    const e = node.parentElement;
    if (!["SCRIPT", "STYLE"].includes(e.tagName) && (heard(e) || e.closest("select, .ag-aria-description-container")))
      found.push(node.textContent);
  }
  for (const e of document.body.querySelectorAll("*")) {
    if (!heard(e)) continue;
    for (const name of ["aria-label", "aria-description", "aria-valuetext", "title", "placeholder", "alt"])
      found.push(e.getAttribute(name));
    if (e.matches("input:not([type=checkbox])")) found.push(e.value);
  }
  return [...found, ...(window.drawn || [])].filter((text) => text && text.trim());
}"""
DRAWN = """window.drawn = new Set(); const draw = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {
  window.drawn.add(String(text)); return draw.call(this, text, ...at); };"""
"""Texts that are drawn are kept, for no page can be asked for them."""


def english(*texts: str) -> set[str]:
    """English words in texts."""
    known = sorted((word for words_ in KNOWN.values() for word in words_), key=len, reverse=True)
    named = re.compile(r"(?<![A-Za-z])(?:" + "|".join(map(re.escape, known)) + r")(?![A-Za-z])")
    return {word for text in texts for word in re.findall(r"[A-Za-z][\w-]*", named.sub("", text))}


def check(tab: Tab, *wanted: str) -> None:
    """No English word is seen or heard; these texts are among what is."""
    texts = tab.page.evaluate(SEEN)
    assert english(*texts) == set()
    assert any(CHINESE.search(text) for text in texts)
    for text in wanted:
        assert any(text in " ".join(found.split()) for found in texts), text


def rich() -> Page:
    """The page that has most, with messages as they are in Chinese."""
    page = rich_page()
    for diagnostic in page.diagnostics:
        diagnostic["message"] = "此处有误"
        for note in diagnostic.get("notes", ()):
            note["message"] = "在此处赋值"
    assert page.answer is not None
    findings = tuple(replace(f, text=f.text if f.name == LEFT_ON else "此处最热") for f in page.answer.findings)
    answer = replace(page.answer, headline=("1 个警告", "624 ms"), setting=("无配置文件",), findings=findings)
    return replace(page, answer=answer)


@pytest.fixture(scope="module")
def rich_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    set_language("zh")
    try:
        return written(rich(), tmp_path_factory.mktemp("rich"))
    finally:
        set_language("en")


@pytest.fixture(name="tab")
def _tab(chromium: Chromium, rich_path: Path) -> Iterator[Tab]:
    with chromium.open(rich_path, before=DRAWN) as tab:
        yield tab.ready()
        assert tab.complaints == [] and tab.requests == []


def test_english_words_are_seen() -> None:
    assert english("长度 mm", "ch0 开", "part.job:12", "使用 Leaflet 1.9（BSD-2-Clause）") == set()
    assert english("ch0 on", "a mm of part.job") == {"on", "a", "of"}
    assert english("Enters", "xy", "notBlank") == {"Enters", "xy", "notBlank"}


def test_no_english_word_is_left(tab: Tab) -> None:
    page = tab.page
    assert page.get_attribute("html", "lang") == "zh-CN"
    page.click("#totals summary")
    check(tab, "part.job - gusjob 报告", "功率报告", "振镜模型", "关光时：维持脉冲", "1 个警告、1 个提示", "3 次",
          "作业结束时，通道 1 的激光未关闭。", "第 4 行：GT_GetHSIOOpt 在通道 0 读得 1。", "未选中任何段", "标刻质量",
          "显示 27 行，共 27 行", "0 至 623.7 ms，全长 623.7 ms", "ch1 开", "通道 1 的功率，V",
          "输出功率，通道 0，%", "放大", "缩小", "浅色", "本页不从别处加载任何内容。")  # fmt: skip
    click_path(tab, -15, 0)
    hover_path(tab, -15, 0)
    check(
        tab, "part.job 第 12 行：标刻（第 3 段）", "800 mm/s，ch0 10 %", "第 3 段（共 27 段）：标刻，part.job 第 12 行"
    )
    click_time(tab, 500)
    check(tab, "ring.job 第 3 行：标刻（第 26 段）", "400 mm/s，ch0 35 % (87.5 %·ms/mm)、ch1 4.5 V (11.25 V·ms/mm)")
    click_time(tab, 5)
    check(tab, "2000 mm/s，不出光")
    page.fill("#line", "5")
    page.click("#go")
    check(tab, "第 5 行没有插补段：已转到其后的第 10 行")
    page.fill("#line", "99")
    page.click("#go")
    check(tab, "从第 99 行起没有插补段")
    for by, wanted in (("energy", "每毫米能量"), ("velocity", "速度，mm/s"), ("order", "时间顺序，ms")):
        page.select_option("#color-by", by)
        check(tab, wanted)
    page.click("#tab-marks")
    rest(page, 300)
    check(tab, "开光偏差 um", "显示 7 行，共 7 行")
    for name in ("segments", "marks"):
        columns = page.evaluate(f"gusjob.table.grids.{name}.columns.map((c) => [c.name, c.head, c.title])")
        assert english(*(text for _, *texts in columns for text in texts)) == set()
        assert all(CHINESE.search(title) for _, _, title in columns)


@pytest.mark.slow
def test_no_english_word_is_left_in_the_grid(tab: Tab) -> None:
    page = tab.page
    page.locator("#segments-grid").scroll_into_view_if_needed()
    page.hover('#segments-grid .ag-header-cell[col-id="stage"]')
    rest(page, 900)
    check(tab, "作业的阶段")
    for column, options in (
        ("kind", ["包含", "不包含", "等于", "不等于", "开头是", "结尾是", "为空", "不为空"]),
        ("length_mm", ["等于", "不等于", "小于", "小于或等于", "大于", "大于或等于", "介于", "为空", "不为空"]),
    ):
        page.click(f'#segments-grid .ag-floating-filter[col-id="{column}"] button >> visible=true')
        rest(page, 300)
        page.locator(".ag-filter .ag-picker-field-wrapper").first.click()
        rest(page, 300)
        assert page.locator(".ag-list-item").all_inner_texts() == options
        check(tab)
        page.keyboard.press("Escape")
        page.locator(".ag-filter .ag-filter-body input >> visible=true").first.fill("2")
        rest(page, 500)
        check(tab, "且", "或", "筛选……")
        page.keyboard.press("Escape")
        page.mouse.click(5, 5)
        page.click("#segments-clear")
        rest(page, 300)

    def filtered(**model: Any) -> str:
        """What the grid writes of a filter of the kinds."""
        page.evaluate("(m) => gusjob.table.grids.segments.api.setFilterModel(m)", {"kind": model})
        rest(page, 300)
        check(tab)
        return page.input_value('#segments-grid .ag-floating-filter[col-id="kind"] input >> visible=true')

    one = {"filterType": "text", "type": "contains", "filter": "标"}
    assert filtered(filterType="text", type="notBlank") == "不为空"
    assert filtered(filterType="text", operator="AND", conditions=[one, {"type": "notBlank"}]) == "标 且 不为空"
    assert filtered(filterType="text", operator="OR", conditions=[one, {"type": "blank"}]) == "标 或 为空"
    page.evaluate(
        """gusjob.table.grids.segments.api.setFilterModel({ length_mm: { filterType: "number", type: "inRange",
        filter: 1, filterTo: 3 } })"""
    )
    rest(page, 300)
    page.click('#segments-grid .ag-floating-filter[col-id="length_mm"] button >> visible=true')
    rest(page, 300)
    page.locator(".ag-filter .ag-filter-body input >> visible=true").nth(0).fill("9")
    rest(page, 500)
    check(tab, "从", "到", "必须小于或等于 3")
    page.keyboard.press("Escape")
    page.mouse.click(5, 5)
    assert filtered(filterType="text", type="equals", filter="无") == "无"
    check(tab, "没有符合条件的行", "显示 0 行，共 27 行")
    page.click("#segments-clear")
    rest(page, 300)
    page.click('#segments-grid .ag-header-cell[col-id="line"] .ag-header-cell-text')
    page.click('#segments-grid [row-index="2"] [col-id="segment"]')
    page.keyboard.press("ArrowDown")
    rest(page, 300)
    check(tab, "按 SPACE 取消选中此行")
    page.evaluate("gusjob.table.grids.segments.api.setFilterModel({ line: { type: 'greaterThan', filter: 11 } })")
    page.evaluate("gusjob.select(0, 'hash')")
    rest(page, 300)
    check(tab, "所选段已被筛选条件滤除。")


def long_report() -> Any:
    class Long:
        def __len__(self) -> int:
            return 10**9

    return Long()


@pytest.mark.slow
def test_no_english_word_is_left_in_other_pages(
    chromium: Chromium, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    empty = {name: {n: c[:0] for n, c in columns.items()} for name, columns in columns_of(square()).items()}
    dark = [{"line": 1, "kind": JUMP, "x": 5.0, "vel": 10.0}]
    even = [{"line": 1, "kind": 0, "x": 5.0, "vel": 10.0, "p0": 40.0}]
    changing = columns_of(square())
    changing["strokes"]["ch0_unit"] = (changing["strokes"]["row"] >= 3).astype(np.uint8)
    changing["rows"]["ch0_unit"] = (np.arange(7) >= 3).astype(np.int8)
    units = {
        "channels": [
            {"channel": 0, "unit": "%", "units": ["%", "V"], "watts_per_unit": None, "peak_per_mm": [None] * 2}
        ]
    }
    none = {"job": "a.job", "version": "1"}
    error = diagnostics()[0] | {"severity": "error", "message": "此处有误", "notes": []}
    remarks = [
        Phrase("Channel {channel} is left ON.", channel=0),
        Phrase(
            "Emission while standing still is not drawn (channel {channel}: {power} {unit}·ms).",
            power="3",
            unit="%",
            channel=1,
        ),
    ]  # fmt: skip
    told = page_of(columns_of(square()), facts={"exact": False, "remarks": remarks, "marks_left_out": True})
    told.facts["totals"] |= {"run_in_mm": 1.0, "run_out_mm": 2.0}
    told.facts["totals"]["channels"][0] |= {"before_motion_power_ms": 3.0, "off_output": {"prevoltage_v": 2.0}}
    pages: list[tuple[Page, tuple[str, ...], dict[str, Any]]] = [
        (page_of(empty), ("作业没有运动：没有可绘制的内容。", "未评价标刻段。"), {}),
        (Page(facts=none, tables={}, diagnostics=[], marking=None), ("没有报告。",), {}),
        (Page(facts=none, tables={}, diagnostics=[error], marking=None), ("作业有错误，未运行。", "1 个错误"), {}),
        (Page(facts=none | {"reason": too_long(long_report())}, tables={}, diagnostics=[], marking=None),
         ("1,000,000,000",), {}),
        (page_of(columns_of(dark)), ("不出光",), {}),
        (page_of(columns_of(even)), ("处处为 40", "显示 1 行，共 1 行"), {}),
        (page_of(changing, facts=units), ("ch0 单位", "通道 0，V"), {}),
        (told, ("引入段", "引出段", "首次运动之前", "关光时：预电压", "段数很多", "标刻段表已略去", "未绘出"), {}),
        (page_of(columns_of(square()), diagnostics=[error] * 60), ("另有 10 项",), {}),
        (rich(), ("DecompressionStream",), {"before": "delete window.DecompressionStream"}),
        (rich(), ("没有 JavaScript",), {"scripts": False}),
    ]  # fmt: skip
    for page_, wanted, more in pages:
        with chromium.open(written(page_, tmp_path), **more) as tab:
            if len(page_.tables.get("rows", {}).get("line", ())) and not more:
                tab.ready().page.evaluate("gusjob.select(0, 'hash')")
            if more.get("scripts") is False:
                text = tab.page.inner_text("body")
                for own in tab.page.locator(".source").all_inner_texts():
                    text = text.replace(own, "")
                assert english(text) == set() and wanted[0] in text
                continue
            check(tab, *wanted)
            assert tab.complaints == []
    large = page_of(field_of_marks(60_000))
    monkeypatch.setattr("gusjob.view.page.render.MAX_BYTES", len(html(large)) - 400_000)
    with chromium.open(written(large, tmp_path)) as tab:
        check(tab.ready(), "位有效数字")


def test_data_that_are_cut_off(chromium: Chromium, tmp_path: Path) -> None:
    path = tmp_path / "cut.html"
    path.write_text(html(rich()).replace('"count":27,', '"count":270000,', 1), encoding="utf-8")
    with chromium.open(path) as tab:
        tab.page.wait_for_function("document.getElementById('status').textContent.includes('无法')")
        assert "无法显示数据：页面的数据不完整" in tab.page.inner_text("#status")


@pytest.mark.parametrize("width", [360, 1280])
def test_nothing_overflows(chromium: Chromium, rich_path: Path, width: int) -> None:
    with chromium.open(rich_path, width=width, height=740, fragment="#s=2") as tab:
        page = tab.ready().page
        for name in ("segments", "marks"):
            page.click(f"#tab-{name}")
            rest(page, 200)
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            cut = page.evaluate(
                """(width) => [...document.querySelectorAll("body *")].filter((e) => e.checkVisibility()
                  && !e.closest("svg, .leaflet-pane, .u-over, .ag-body, .ag-header, .scroll, pre")
                  && ((e.matches("button, .bar, .under, dt, dd, h1, h2, label, .legend, .key, .ag-header-cell-text")
                      && e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== "inline")
                    || (e.matches("button, select, label, .key, h2, p") && e.getBoundingClientRect().right > width)))
                  .map((e) => e.outerHTML.slice(0, 80))""",
                width,
            )
            heads = page.evaluate(
                """[...document.querySelectorAll(".ag-header-cell-text")]
                .filter((e) => e.scrollWidth > e.clientWidth + 1).map((e) => e.textContent)"""
            )
            assert cut == [] and heads == []
        assert tab.complaints == []


# It works as in English.


def in_english(page: Page, folder: Path) -> Path:
    set_language("en")
    try:
        return written(page, folder, "english.html")
    finally:
        set_language("zh")


@pytest.mark.slow
def test_order_filters_and_files_are_as_in_english(chromium: Chromium, tmp_path: Path) -> None:
    cases: list[tuple[list[tuple[str, str]], dict[str, Any]]] = [
        ([("kind", "asc")], {}), ([("kind", "desc"), ("length_mm", "asc")], {}), ([("file", "desc")], {}),
        ([], {"length_mm": {"filterType": "number", "type": "greaterThan", "filter": 20}}),
        ([], {"length_mm": {"filterType": "number", "type": "blank"}}),
        ([], {"length_mm": {"filterType": "number", "type": "notBlank"}}),
        ([], {"kind": {"filterType": "text", "type": "notBlank"}}),
        ([], {"file": {"filterType": "text", "type": "startsWith", "filter": "ring"}}),
    ]  # fmt: skip
    kinds = {"标刻": "mark", "跳转": "jump", "引入": "run-in", "引出": "run-out", "停留": "dwell"}
    found: dict[str, list[Any]] = {}
    for language, path in (("en", in_english(rich(), tmp_path)), ("zh", written(rich(), tmp_path))):
        with chromium.open(path) as tab:
            page = tab.ready().page
            rows: list[Any] = [order(tab, sort, filters) for sort, filters in cases]
            for chinese, word in kinds.items():
                text = chinese if language == "zh" else word
                rows.append(order(tab, [], {"kind": {"filterType": "text", "type": "contains", "filter": text}}))
                assert rows[-1]
            page.evaluate("gusjob.table.grids.segments.api.setFilterModel(null)")
            rest(page, 300)
            for name in ("segments", "marks"):
                page.click(f"#tab-{name}")
                rest(page, 300)
                with page.expect_download() as download:
                    page.click(f"#{name}-csv")
                rows += [download.value.suggested_filename, Path(download.value.path()).read_bytes()]
                rows.append(page.evaluate(f"gusjob.table.grids.{name}.columns.map((c) => c.name)"))
            rows.append(page.evaluate("gusjob.facts"))
            found[language] = rows
            assert tab.complaints == [] and tab.requests == []
    assert found["zh"] == found["en"]


def test_selection_by_all_ways(tab: Tab) -> None:
    page = tab.page

    def check_row(row: int) -> None:
        state = selected(tab)
        assert state["title"].startswith(f"第 {row + 1} 段（共 27 段）：")
        assert (state["row"], state["hash"], state["grid"], state["line"]) == (row, f"#s={row}", [row], True)

    click_path(tab, -15.3, 0)
    check_row(2)
    click_time(tab, 500)
    check_row(25)
    page.click("#previous")
    check_row(24)
    page.locator("#segments-grid").scroll_into_view_if_needed()
    page.fill('#segments-grid .ag-floating-filter[col-id="kind"] input >> visible=true', "标刻")
    rest(page, 700)
    assert page.inner_text("#segments-count") == "显示 7 行，共 27 行"
    page.click('#segments-grid [row-index="1"] [col-id="line"]')
    check_row(6)
    page.keyboard.press("ArrowDown")
    check_row(10)


@pytest.mark.slow
def test_a_watched_page_says_whether_it_follows(chromium: Chromium) -> None:
    server = PageServer()
    try:
        with chromium.open(server.url) as tab:
            assert tab.page.get_attribute("html", "lang") == "zh-CN"
            assert tab.page.inner_text("p") == "页面尚未就绪；稍后重新加载。"
        events = server.new_events()
        server.show(html(page_of(columns_of(square()), watched=events)).encode(), events)
        with chromium.open(server.url) as tab:
            page = tab.ready().page
            page.wait_for_function("document.getElementById('watched').textContent === '随作业更新'")
            page.evaluate("gusjob.select(3, 'hash')")
            events = server.new_events()
            page.evaluate("document.documentElement.dataset.old = '1'")
            server.show(html(page_of(columns_of([*square(), *square()]), watched=events)).encode(), events)
            page.wait_for_selector("html:not([data-old])", state="attached")
            tab.ready()
            assert page.inner_text("#segments-count") == "显示 14 行，共 14 行"
            check(tab, "随作业更新")
            assert tab.complaints == []
    finally:
        server.close()


@pytest.mark.slow
def test_hostile_texts_do_nothing(chromium: Chromium, tmp_path: Path) -> None:
    page_ = hostile_page()
    odd = "{line} {kind} $& $1 {} {0} 中文 {x"
    page_.facts["notes"]["files"][1] = odd
    text = html(page_)
    assert SCRIPT not in text and "<img" not in re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    with chromium.open(written(page_, tmp_path), before="window.alert = () => { document.title = 'ran'; }") as tab:
        page = tab.ready().page
        assert SCRIPT in page.inner_text("h1") and IMAGE in page.inner_text(".diagnostic .message >> nth=0")
        page.evaluate("gusjob.select(25, 'hash')")
        assert page.inner_text("#details-title") == f"第 26 段（共 27 段）：标刻，{odd} 第 3 行"
        assert page.evaluate("document.querySelectorAll('img, iframe, object').length") == 0
        assert not page.title().startswith("ran") and tab.complaints == [] and tab.requests == []


# The words.


def test_the_scripts_say_what_the_table_has() -> None:
    used = set()
    for path in STATIC.glob("*.js"):
        for call in re.findall(r'\blocalized\(("\w[^{)]*)', path.read_text(encoding="utf-8")):
            script, *names = re.findall(r'"([\w-]+)"', call)
            assert names, call
            used |= {(script, name) for name in names}
    table = {(script, name) for script, phrases in page_texts._SCRIPTS.items() for name in phrases}
    assert table - used == {("kinds", kind.word) for kind in SegmentKind}
    assert used < table


@pytest.mark.parametrize("language", ["en", "zh"])
def test_scripts_fill_in_fields_as_phrases_do(tab: Tab, language: str) -> None:
    set_language(language)
    tab.page.evaluate("(texts) => { gusjob.texts = texts; }", page_texts.script_texts())
    for script, phrases in page_texts._SCRIPTS.items():
        for name, phrase in phrases.items():
            for values in (["a", "b", "c", "d"], ["中文", "b", "中 c", "d"], ["a", "文", "c 中", "文"]):
                fields = dict(zip(phrase.fields, values, strict=False))
                shown = tab.page.evaluate("(call) => gusjob.localized(...call)", [script, name, fields])
                assert shown == localized(Phrase(phrase.template, **fields)), (script, name)


def test_the_grids_words_are_its_own() -> None:
    source = (STATIC / "vendor" / "ag-grid-community.min.noStyle.js").read_text(encoding="utf-8")
    for name, phrase in page_texts._GRID.items():
        assert re.search(rf"\b{name}\b", source), name
        if name not in ("ariaRowSelect", "ariaRowDeselect"):  # Made of parts.
            assert phrase.partition("$")[0] in source, name


def test_english_is_what_it_was() -> None:
    """Behind Chinese the same bytes; AG Grid and the template speak for themselves."""
    chinese = html(rich())
    set_language("en")
    first = html(rich())
    assert page_texts.script_texts()["grid"] == {} and '<html lang="en">' in first and '"grid":{}' in first
    set_language("zh")
    assert html(rich()) == chinese != first
    set_language("en")
    assert html(rich()) == first
    template = (STATIC / "page.html").read_text(encoding="utf-8")
    own = re.sub(r"\{\{.*?\}\}|\{%.*?%\}", "", template.partition("<body>")[2])
    # Texts of the template itself, without markup and figures.
    assert re.findall(r">([^<]*[A-Za-z]{2}[^<]*)<|aria-label=\"([^\"]*[A-Za-z])", re.sub(r"&#\d+;", "", own)) == [
        ("gusjob ", "")
    ]


# The command.


def test_report_in_chinese(tmp_path: Path) -> None:
    path = tmp_path / "long.job"
    path.write_text("VEL 100\nACC 1000\nLINE X 200\n", encoding="utf-8")
    set_language("en")
    texts = {}
    for language in ("zh", "en"):
        out = tmp_path / f"{language}.html"
        done = CliRunner().invoke(cli, ["report", str(path), "--lang", language, "-o", str(out)])
        set_language("en")
        assert done.exit_code in (0, 1), done.output
        texts[language] = re.sub(r"<(script|style)>.*?</\1>", "", out.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert '<html lang="zh-CN">' in texts["zh"] and '<html lang="en">' in texts["en"]
    messages = {
        language: re.findall(r'class="message">(.*?)</span>', text, re.DOTALL) for language, text in texts.items()
    }
    assert len(messages["zh"]) == len(messages["en"]) > 0
    assert all(CHINESE.search(message) for message in messages["zh"])
    assert not CHINESE.search("".join(messages["en"]))
    facts = [json.loads(re.findall(r'id="gusjob-facts">(.*?)</script>', text)[0]) for text in texts.values()]
    assert facts[0] == facts[1] and not CHINESE.search(json.dumps(facts, ensure_ascii=False))
