"""Listings from calls, and where a report of the package differs from the plain reference (oracles/power.py)."""

from __future__ import annotations

import math
from typing import Any

from oracles.power import Call

from gusjob.config.machine import Machine
from gusjob.controllers.gus.model import simulate_stream
from gusjob.frontend import check_text, read_listing
from gusjob.report.rows import Report, make_report
from gusjob.simulate.kinds import SegmentKind

RELATIVE, ABSOLUTE = 1e-9, 1e-10
NUMBERS = ("emission_ms", "power_ms", "power_min", "power_max", "clamped_ms")
CORNERS = [(65, 0), (0, 65), (63, 16), (16, 63), (60, 25), (25, 60), (56, 33), (33, 56), (52, 39), (39, 52)]
"""Whole points at 65 from the origin, for arcs that end exactly on their circle."""


def text_of(value: Any) -> str:
    """An argument as a listing has it."""
    return f"{{{','.join(map(text_of, value))}}}" if isinstance(value, tuple) else str(value)


def listing_of(calls: list[Call]) -> str:
    """Calls as a listing, one a line."""
    return "".join(f"{name}({','.join(map(text_of, args))})\n" for name, *args in calls)


def report_of(text: str, machine: Machine) -> Report:
    """What the package reports of a listing."""
    source, _ = check_text(text.encode(), "x.gts")
    assert source is not None
    stream, diagnostics = read_listing(source)
    assert not diagnostics
    trace, _ = simulate_stream(stream, machine, is_listing=True)
    assert trace is not None
    return make_report(trace, machine)


def near(a: float, b: float) -> bool:
    """Equal within rounding."""
    return math.isclose(a, b, rel_tol=RELATIVE, abs_tol=ABSOLUTE)


def differences(rows: list[dict[str, Any]], report: Report) -> list[str]:
    """Where the reference and the package do not say the same."""
    found = [] if len(rows) == len(report) else [f"{len(rows)} rows, {len(report)} in the package"]
    for i, row in enumerate(rows[: len(report)]):
        kind = SegmentKind.DWELL if row["dwell"] else SegmentKind.MARK if row["commanded"] else SegmentKind.JUMP
        pairs = [("kind", kind, report.columns["kind"][i])]
        pairs += [(n, row[n], report.columns[n][i]) for n in ("start_ms", "duration_ms", "length_mm", "x_mm", "y_mm")]
        for channel, values in row["channels"].items():
            if f"ch{channel}_emission_ms" not in report.columns:
                pairs.append((f"ch{channel}_emission_ms, no column", values["emission_ms"], 0.0))
                continue
            for name in NUMBERS:
                theirs = report.columns[f"ch{channel}_{name}"][i]
                if name not in ("power_min", "power_max"):
                    pairs.append((f"ch{channel}_{name}", values[name], theirs))
                elif values[name] is None:
                    assert math.isnan(theirs) or report.columns[f"ch{channel}_emission_ms"][i] < ABSOLUTE
                elif values["emission_ms"] > ABSOLUTE:
                    pairs.append((f"ch{channel}_{name}", values[name], theirs))
        found += [f"row {i} {name}: {a!r}, {float(b)!r} in the package" for name, a, b in pairs if not near(a, b)]
    return found
