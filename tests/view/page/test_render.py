"""The page as text: its policy, scripts, diagnostics and figures."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from typing import Any

import numpy as np
import pytest

pytest.importorskip("jinja2", reason="jinja2 is not installed")

from support.pages import columns_of, diagnostics, field_of_marks, html, page_of, rich_page, square
from support.tools import ROOT

from gusjob.simulate.quality.marks import MARKING_WORDS
from gusjob.view.page.render import Page


def test_marks_are_left_out_of_a_page_that_can_not_hold_them(monkeypatch: pytest.MonkeyPatch) -> None:
    tables = field_of_marks(2000)
    limit = len(html(page_of(tables))) + 100_000
    random = np.random.default_rng(9)
    count = 50_000
    tables["marks"] = {name: random.normal(0, 1, count) for name in MARKING_WORDS}
    tables["marks"] |= {"line": np.ones(count, dtype=np.int32), "row": np.zeros(count, dtype=np.int32)}
    assert 'id="tab-marks"' in html(page_of(tables, marking=[]))
    monkeypatch.setattr("gusjob.view.page.render.MAX_BYTES", limit)
    text = html(page_of(tables, marking=[]))
    assert "The table of marks is left out" in text and 'id="tab-marks"' not in text
    assert len(text.encode()) <= limit and "rounded to" not in text


def test_only_the_pages_own_scripts_may_run() -> None:
    text = html(page_of(columns_of(square())))
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', text)
    assert policy is not None
    rules = policy[1].replace("&#39;", "'")
    scripts = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    hashes = [base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts]
    assert re.findall(r"'sha256-([^']*)'", rules) == hashes and len(hashes) > 5
    for rule in ("default-src 'none'", "connect-src 'none'", "base-uri 'none'", "form-action 'none'"):
        assert rule in rules
    assert "unsafe-eval" not in rules and "script-src 'unsafe-inline'" not in rules
    assert "connect-src 'self'" in html(page_of(columns_of(square()), watched="/events")).replace("&#39;", "'")


def test_nothing_in_the_static_files_ends_its_element() -> None:
    for path in (ROOT / "gusjob" / "view" / "page" / "static").rglob("*.*"):
        text = path.read_text(encoding="utf-8").lower()
        if path.suffix in (".js", ".css"):
            assert ("</style" if path.suffix == ".css" else "</script") not in text and "<!--" not in text, path
            assert "innerhtml" not in text or "vendor" in path.parts, path


def test_vendored_files_are_what_versions_json_says() -> None:
    folder = ROOT / "gusjob" / "view" / "page" / "static" / "vendor"
    known = json.loads((folder / "versions.json").read_text(encoding="utf-8"))
    for entry in known:
        assert hashlib.sha256((folder / entry["file"]).read_bytes()).hexdigest() == entry["sha256"], entry["file"]
    assert {e["file"] for e in known} | {"versions.json"} == {p.name for p in folder.iterdir()}
    with_licence = {e["name"] for e in known if e["file"].endswith("LICENSE.txt")}
    assert with_licence == {e["name"] for e in known}


def test_a_page_of_a_job_with_errors_has_its_diagnostics() -> None:
    diagnostic = diagnostics()[0] | {"severity": "error"}
    text = html(Page(facts={"job": "a.job", "version": "1"}, tables={}, diagnostics=[diagnostic], marking=None))
    assert "has errors" in text and "GJ503" in text and "<mark>(n*w)</mark>" in text
    assert "agGrid" not in text, "libraries that are not used are left out"


def test_many_diagnostics_are_folded() -> None:
    text = html(page_of(columns_of(square()), diagnostics=[diagnostics()[1]] * 70))
    assert "<summary>20 more</summary>" in text and "70 notes" in text


def test_the_fault_is_marked_in_its_line() -> None:
    def marked(**more: Any) -> tuple[str, str]:
        diagnostic = diagnostics()[1] | more
        text = html(Page(facts={"job": "a", "version": "1"}, tables={}, diagnostics=[diagnostic], marking=None))
        found = re.search(r"</span>([^<]*)<mark>([^<]*)</mark>([^<]*)</pre>", text)
        assert found is not None
        return found[2], found[1] + found[2] + found[3]

    assert marked(source="LINE X 1", column=6, end_column=7) == ("X", "LINE X 1")
    assert marked(source="LINE X 1", column=6, end_line=15, end_column=1) == ("X 1", "LINE X 1")
    assert marked(source="LINE", column=9, end_column=10) == (" ", "LINE ")
    assert marked(source="a\tb", column=3, end_column=4) == ("b", "a b")
    part, line = marked(source="x" * 5000 + "!" + "y" * 5000, column=5001, end_column=5002)
    assert part == "!" and len(line) < 300 and line.startswith("...") and line.endswith("...")


def test_figures_of_the_header() -> None:
    text = re.sub(r"<[^>]*>", " ", html(rich_page()).split('id="totals"')[1].split("</details>")[0])
    words = " ".join(text.split())
    for said in (
        "segments 27",
        "duration 623.7 ms",
        "marks 274.2 mm",
        "scanner first-order 250 us",
        "joules 12.5 J",
        "limited 3 ms",
        "Channel 1 is left ON",
        "while off: standby 5 kHz",
    ):
        assert said in words, said
