"""Report pages made by hand: every value is known without the simulator."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from gusjob.diagnostics.model import Severity
from gusjob.i18n.phrases import Phrase
from gusjob.report.answer import LEFT_ON, Answer, Finding
from gusjob.simulate.quality.marks import MARKING_WORDS
from gusjob.view.page.encode import Encoded, decode, encode
from gusjob.view.page.render import MAX_BYTES, Page, render

Columns = dict[str, npt.NDArray[Any]]


KINDS = ["mark", "jump", "run_in", "run_out", "dwell"]


MARK, JUMP, RUN_IN, RUN_OUT, DWELL = range(5)


NAN = float("nan")


def columns_of(steps: list[dict[str, Any]], channels: int = 1, *, beam: bool = False) -> dict[str, Columns]:
    """Rows and strokes of steps: line, kind, x, y, vel, ms; p0, p1: power (None: off); `cut`: how many strokes."""
    rows: dict[str, list[float]] = {}
    strokes: dict[str, list[float]] = {}

    def add(to: dict[str, list[float]], **values: float) -> None:
        for name, value in values.items():
            to.setdefault(name, []).append(value)

    at, start = (0.0, 0.0), 0.0
    for number, s in enumerate(steps):
        end = (s.get("x", at[0]), s.get("y", at[1]))
        cut = s.get("cut", 1)
        way = s.get("way") or [
            (at[0] + (end[0] - at[0]) * (k + 1) / cut, at[1] + (end[1] - at[1]) * (k + 1) / cut) for k in range(cut)
        ]
        length = float(sum(np.hypot(b[0] - a[0], b[1] - a[1]) for a, b in zip([at, *way], way, strict=False)))
        ms = s.get("ms") or length / s["vel"] * 1e3
        add(rows, line=s["line"], kind=s["kind"], stage=s.get("stage", 1), x_mm=end[0], y_mm=end[1], length_mm=length,
            start_ms=start, duration_ms=ms, vel_mean_mm_s=length / ms * 1e3,
            vel_max_mm_s=s.get("vel", 0.0))  # fmt: skip
        if "file" in s:
            add(rows, file=s["file"])
        for c in range(channels):
            p = s.get(f"p{c}")
            on = p is not None
            add(rows, **{f"ch{c}_emission_ms": ms * on, f"ch{c}_power_min": p if on else NAN,
                         f"ch{c}_power_mean": p if on else NAN, f"ch{c}_power_max": p if on else NAN,
                         f"ch{c}_power_ms": ms * p if on else 0.0, f"ch{c}_joules": NAN,
                         f"ch{c}_clamped_ms": 0.0})  # fmt: skip
        for x, y in way:
            add(strokes, row=number, duration_ms=ms / len(way), x_mm=x, y_mm=y, vel0=s.get("vel", 0.0),
                vel1=s.get("vel", 0.0))  # fmt: skip
            if beam:
                add(strokes, beam_x_mm=x - 0.3, beam_y_mm=y)
            for c in range(channels):
                p = s.get(f"p{c}")
                mm = length / len(way)
                per_mm = p * ms / len(way) / mm if p is not None and mm else NAN
                add(strokes, **{f"ch{c}_on": float(p is not None), f"ch{c}_power": p or 0.0, f"ch{c}_per_mm": per_mm})
        at, start = end, start + ms
    kinds = {"line": np.int32, "kind": np.int8, "stage": np.int32, "file": np.int16, "row": np.int32}

    def made(found: dict[str, list[float]]) -> Columns:
        return {
            n: np.array(v, dtype=np.int8 if n.endswith("_on") else kinds.get(n, np.float64)) for n, v in found.items()
        }

    return {"rows": made(rows), "strokes": made(strokes)}


def page_of(tables: dict[str, Columns], *, units: Iterable[str] = ("%",), **more: Any) -> Page:
    """A page of these columns, whose totals are summed up here."""
    rows = tables["rows"]
    kind = rows["kind"]
    channels = []
    for number, unit in enumerate(units):
        power = rows[f"ch{number}_power_max"]
        known = ~np.isnan(power)
        channels.append(
            {
                "channel": number, "unit": unit, "emission_ms": float(rows[f"ch{number}_emission_ms"].sum()),
                "power_ms": float(rows[f"ch{number}_power_ms"].sum()),
                "power_max": float(power[known].max()) if known.any() else None, "joules": None, "clamped_ms": 0.0,
                "before_motion_power_ms": 0.0, "off_output": None, "lit_at_end": False,
            }
        )  # fmt: skip
    facts: dict[str, Any] = {
        "schema": "gusjob-page/1", "job": "square.job", "version": "0.1.0", "period_us": 250.0,
        "totals": {
            "segments": len(kind), "stages": 1, "duration_ms": float(rows["duration_ms"].sum()),
            "mark_mm": float(rows["length_mm"][kind == MARK].sum()),
            "jump_mm": float(rows["length_mm"][kind == JUMP].sum()), "run_in_mm": 0.0, "run_out_mm": 0.0,
            "channels": channels, "marking": None,
        },
        "notes": {"scanner": None, "readings": []}, "field_mm": {"x": [-150, 150], "y": [-150, 150]},
        "start_mm": [0.0, 0.0], "kinds": KINDS, "exact": True,
        "channels": [
            {"channel": n, "unit": u, "watts_per_unit": None, "peak_per_mm": [None]} for n, u in enumerate(units)
        ],
    }  # fmt: skip
    facts.update(more.pop("facts", {}))
    return Page(
        facts=facts, tables=tables, diagnostics=more.pop("diagnostics", []), marking=more.pop("marking", None), **more
    )


def square() -> list[dict[str, Any]]:
    """Two jumps, and a square of 20 mm whose sides get 10, 20, 30, 40 %."""
    return [
        {"line": 3, "kind": JUMP, "x": 40.0, "y": 0.0, "vel": 1000.0},
        {"line": 5, "kind": MARK, "x": 60.0, "y": 0.0, "vel": 100.0, "p0": 10.0},
        {"line": 6, "kind": MARK, "x": 60.0, "y": 20.0, "vel": 100.0, "p0": 20.0},
        {"line": 7, "kind": MARK, "x": 40.0, "y": 20.0, "vel": 200.0, "p0": 30.0},
        {"line": 8, "kind": MARK, "x": 40.0, "y": 0.0, "vel": 200.0, "p0": 40.0, "cut": 4},
        {"line": 10, "kind": JUMP, "x": 0.0, "y": 20.0, "vel": float(np.hypot(40, 20)) / 0.04},
        {"line": 12, "kind": DWELL, "ms": 5.0},
    ]


def written(page: Page, tmp_path: Path, name: str = "page.html") -> Path:
    path = tmp_path / name
    with path.open("wb") as out:
        out.writelines(render(page))
    return path


def field_of_marks(count: int) -> dict[str, Columns]:
    """So many segments, half of them jumps: a raster of short marks in 1000 columns; power and velocity wander."""
    number = np.arange(count)
    mark = number % 2 == 1
    random = np.random.default_rng(7)
    line, place = np.divmod(number // 2, 1000)
    x = place * 0.2 - 100 + np.where(mark, 0.1, 0.0) + random.normal(0, 2e-3, count)
    y = line * (200 / max(count / 2000, 1)) - 100 + random.normal(0, 2e-3, count)
    length = np.hypot(np.diff(x, prepend=0.0), np.diff(y, prepend=0.0))
    velocity = np.where(mark, 500 + 300 * np.sin(number / 5000) + random.normal(0, 5, count), 4000.0)
    power = np.where(mark, 40 + 30 * np.cos(number / 9000) + random.normal(0, 1, count), NAN)
    ms = length / velocity * 1e3
    zero, on = np.zeros(count), mark.astype(np.int8)
    rows = {
        "line": (number % 2000 + 1).astype(np.int32), "kind": np.where(mark, MARK, JUMP).astype(np.int8),
        "stage": (number // 4096 + 1).astype(np.int32), "x_mm": x, "y_mm": y, "length_mm": length,
        "start_ms": np.cumsum(ms) - ms, "duration_ms": ms, "vel_mean_mm_s": velocity, "vel_max_mm_s": velocity * 1.01,
        "ch0_emission_ms": np.where(mark, ms, 0.0), "ch0_power_min": power, "ch0_power_mean": power,
        "ch0_power_max": power, "ch0_power_ms": np.where(mark, power * ms, 0.0), "ch0_joules": np.full(count, NAN),
        "ch0_clamped_ms": zero,
    }  # fmt: skip
    strokes = {
        "row": number.astype(np.int32), "duration_ms": ms, "x_mm": x, "y_mm": y, "vel0": velocity * 1.01,
        "vel1": velocity * 1.01, "ch0_on": on, "ch0_power": np.where(mark, power, 0.0),
        "ch0_per_mm": power * ms / length,
    }  # fmt: skip
    return {"rows": rows, "strokes": strokes}


def arc(x: float, y: float, radius: float, pieces: int) -> list[tuple[float, float]]:
    """Ends of the strokes of a full circle that starts on its right."""
    angles = np.linspace(0, 2 * np.pi, pieces + 1)[1:]
    return [(x + radius * float(np.cos(a)), y + radius * float(np.sin(a))) for a in angles]


def rich_steps() -> list[dict[str, Any]]:
    """Both channels, all kinds, two files, an arc of 180 strokes."""
    steps: list[dict[str, Any]] = []
    for k in range(6):
        y = 6.0 * k
        steps += [
            {"line": 10, "kind": JUMP, "x": -32.0, "y": y, "vel": 2000.0, "file": 0},
            {"line": 11, "kind": RUN_IN, "x": -30.0, "y": y, "vel": 800.0, "file": 0},
            {"line": 12, "kind": MARK, "x": 0.0, "y": y, "vel": 800.0, "p0": 10.0 + 10 * k, "cut": 5, "file": 0},
            {"line": 13, "kind": RUN_OUT, "x": 2.0, "y": y, "vel": 800.0, "file": 0},
        ]
    steps += [
        {"line": 2, "kind": JUMP, "x": 45.0, "y": 15.0, "vel": 2000.0, "file": 1, "stage": 2},
        {"line": 3, "kind": MARK, "x": 45.0, "y": 15.0, "vel": 400.0, "p0": 35.0, "p1": 4.5, "file": 1, "stage": 2,
         "way": arc(30.0, 15.0, 15.0, 180)},
        {"line": 4, "kind": DWELL, "ms": 8.0, "p1": 2.0, "file": 1, "stage": 2},
    ]  # fmt: skip
    return steps


def marks_columns(rows: Columns) -> Columns:
    """A mark for each row of light: errors grow from mark to mark."""
    lit = np.flatnonzero(rows["kind"] == MARK)
    count = len(lit)
    grow = np.arange(count, dtype=np.float64)
    return {
        "line": rows["line"][lit], "channel": np.zeros(count, dtype=np.int8), "start_ms": rows["start_ms"][lit],
        "length_mm": rows["length_mm"][lit], "on_error_um": grow * 2, "off_error_um": -grow, "on_miss_um": grow * 2,
        "off_miss_um": grow, "outside_power_ms": grow * 0, "power_per_mm_mid": 50 + grow,
        "power_per_mm_peak": 70 + grow,
        "power_per_mm_rms_pct": grow / 7, "corner_miss_um": np.full(count, NAN), "row": lit.astype(np.int32),
    }  # fmt: skip


def marking_of(marks: Columns) -> list[dict[str, Any]]:
    worst = {n: float(np.nanmax(np.abs(marks[n]))) if not np.isnan(marks[n]).all() else None for n in MARKING_WORDS}
    typical = {n: float(np.median(np.abs(marks[n]))) if not np.isnan(marks[n]).all() else None for n in MARKING_WORDS}
    return [{"channel": 0, "unit": "%", "marks": len(marks["line"]), "worst": worst, "typical": typical}]


SCRIPT = "</script><script>alert(1)</script>"


IMAGE = '"><img src=x onerror=alert(1)>'


HOSTILE = f"{SCRIPT} {IMAGE} {{{{7*7}}}} \u2028 \u202e \u2066 <!--"


def diagnostics() -> list[dict[str, Any]]:
    return [
        {"path": "part.job", "line": 12, "column": 10, "end_line": 12, "end_column": 15, "severity": "warning",
         "code": "GJ503", "message": "X 180 mm is outside the machine's field -150..150 mm", "count": 3,
         "source": "  LINE X (n*w) ; far",
         "notes": [{"path": "part.job", "line": 2, "column": 1, "end_line": 2, "end_column": 11,
                    "message": "w is set here"}]},
        {"path": "part.job", "line": 14, "column": 1, "end_line": 14, "end_column": 4, "severity": "note",
         "code": "GJ304", "message": "the laser is switched on for 0.2 ms only", "source": "LASER ON"},
    ]  # fmt: skip


def answer_of(text: str = "1474 %·ms/mm") -> Answer:
    """An answer with a mark, a segment, and what is neither."""
    return Answer(
        worst=Severity.WARNING,
        headline=("1 warning", "624 ms", text),
        setting=("no profile", text),
        findings=(
            Finding(name=LEFT_ON, text=Phrase("the laser of channel {channel} is still on at the end", channel=1)),
            Finding(name=Phrase("hottest"), text=text, line=12, mark=3),
            Finding(name=Phrase("slowest"), text=text, line=3, file="ring.job", segment=25),
        ),
    )


def rich_page() -> Page:
    tables = columns_of(rich_steps(), 2, beam=True)
    tables["marks"] = marks_columns(tables["rows"])
    page = page_of(
        tables,
        units=("%", "V"),
        diagnostics=diagnostics(),
        marking=marking_of(tables["marks"]),
        answer=answer_of(),
        facts={
            "job": "part.job",
            "notes": {
                "scanner": {"model": "first-order", "tracking_error_us": 250.0}, "files": ["part.job", "ring.job"],
                "readings": [{"line": 4, "channel": 0, "value": 1}],
            },
            "beam_start_mm": [0.0, 0.0],
        },
    )  # fmt: skip
    page.facts["totals"]["channels"][0] |= {
        "joules": 12.5,
        "clamped_ms": 3.0,
        "off_output": {"standby_khz": 5.0, "standby_pct": 1.0},
    }
    page.facts["totals"]["channels"][1]["lit_at_end"] = True
    return page


def hostile_page() -> Page:
    """Every text of a job, as bad as it gets."""
    page = replace(rich_page(), answer=answer_of(HOSTILE))
    page.facts["job"] = HOSTILE
    page.facts["notes"]["files"] = [HOSTILE, IMAGE]
    page.facts["notes"]["scanner"]["model"] = HOSTILE
    page.facts["channels"][0]["unit"] = page.facts["totals"]["channels"][0]["unit"] = HOSTILE
    assert page.marking is not None
    page.marking[0]["unit"] = HOSTILE
    for diagnostic in page.diagnostics:
        diagnostic |= {
            "path": HOSTILE,
            "message": HOSTILE,
            "source": HOSTILE,
            "code": HOSTILE,
            "column": 5,
            "end_column": 20,
        }
        for note in diagnostic.get("notes", ()):
            note |= {"path": HOSTILE, "message": HOSTILE, "source": HOSTILE}
    return page


def html(page: Page) -> str:
    return b"".join(render(page)).decode()


def round_trip(tables: dict[str, Columns], budget: int = MAX_BYTES) -> tuple[Encoded, dict[str, Columns]]:
    found = encode(tables, budget)
    text = b"".join(found.text())
    assert len(text) == found.size
    return found, decode(found.directory, base64.b64decode(text, validate=True))
