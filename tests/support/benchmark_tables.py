"""The figures of tests/bench/all.py as the tables of docs/benchmarks.md."""

from __future__ import annotations

from typing import Any

BEGIN = "<!-- Written by tests/bench/all.py from benchmarks.json. -->"
END = "<!-- End of the figures. -->"


def with_tables(document: str, figures: dict[str, Any]) -> str:
    """A document with the tables of some figures in place of those that it has."""
    before, _, rest = document.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{tables(figures)}\n{END}{after}"


def tables(figures: dict[str, Any]) -> str:
    """All tables, with the machine on which they were made."""
    machine = figures["machine"]
    made = f"{machine['cores']} cores, Python {machine['python']}, numpy {machine['numpy']}, lark {machine['lark']}"
    lines = [f"gusjob {figures['gusjob']}; {made}. The best of {figures['runs']} runs.", ""]
    start = figures["start"]
    lines += [f"Start: `check` of ten lines takes {start['check_s']:.3f} s,"]
    lines += [f"{start['check_s'] / start['imports_s']:.2f} times as long as `import numpy, lark, click`.", ""]
    has_before = any("before_s" in row for row in figures["rows"])
    header = ["job", "statements", "command", "seconds", "plain lark / this", "peak MB"]
    header += ["before", "this / before"] if has_before else []
    lines += [_line(header), _line(["---", "--:", "---", *["--:"] * (len(header) - 3)])]
    lines += [_line(_cells(row, has_before=has_before)) for row in figures["rows"]]
    return "\n".join([*lines, ""])


def _cells(row: dict[str, Any], *, has_before: bool) -> list[str]:
    lark, peak = row["lark_s"], row["peak_mb"]
    cells = [row["kind"], f"{row['statements']:,}", f"`{row['command']}`", f"{row['seconds']:.2f}"]
    cells += ["" if lark is None else f"{lark / row['seconds']:.1f}", "" if peak is None else f"{peak:.0f}"]
    if has_before:
        cells += [f"{row['before_s']:.2f}", f"{row['seconds'] / row['before_s']:.2f}"]
    return cells


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"
