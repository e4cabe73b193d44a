"""docs/benchmarks.md has the figures of docs/benchmarks.json."""

from __future__ import annotations

import json

from support.benchmark_tables import tables, with_tables
from support.tools import ROOT

DOCS = ROOT / "docs"
ROW = {"kind": "lines", "statements": 1000, "command": "check", "seconds": 0.5, "lark_s": 2.0, "peak_mb": 80.4}
FIGURES = {
    "gusjob": "1.0",
    "machine": {"cores": 4, "python": "3.12.1", "numpy": "2.1", "lark": "1.2"},
    "runs": 2,
    "start": {"imports_s": 0.2, "check_s": 0.3},
    "rows": [ROW],
}


def test_the_tables_are_those_of_the_figures() -> None:
    document = (DOCS / "benchmarks.md").read_text(encoding="utf-8")
    figures = json.loads((DOCS / "benchmarks.json").read_text(encoding="utf-8"))
    assert with_tables(document, figures) == document


def test_a_table() -> None:
    text = tables(FIGURES)
    assert "4 cores, Python 3.12.1, numpy 2.1, lark 1.2. The best of 2 runs." in text
    assert "1.50 times as long" in text
    assert text.endswith("| lines | 1,000 | `check` | 0.50 | 4.0 | 80 |\n")


def test_a_comparison_has_the_older_checkout() -> None:
    text = tables({**FIGURES, "rows": [{**ROW, "before_s": 1.0}]})
    assert text.endswith("| lines | 1,000 | `check` | 0.50 | 4.0 | 80 | 1.00 | 0.50 |\n")
