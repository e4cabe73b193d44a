"""The HTML page: totals as text, columns packed for the browser, scripts allowed by their hashes."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from typing import Any

import jinja2
import numpy as np
import numpy.typing as npt
from markupsafe import Markup
from msgspec import Struct
from msgspec.structs import replace

from gusjob.diagnostics.model import Severity
from gusjob.i18n.phrases import Phrase, all_of, localized, plural, printable
from gusjob.ir.overrides import overrides_text
from gusjob.kinematics.units import MS_PER_S
from gusjob.report.answer import LEFT_ON, Answer, Finding
from gusjob.report.quantities import TABLE_DIGITS, short
from gusjob.simulate.quality.marks import MARKING_WORDS, marking_unit
from gusjob.view.page.encode import UNITS_PER_MM, Encoded, encode
from gusjob.view.page.ranges import ranges_of
from gusjob.view.page.texts import page_language, script_texts, template_text
from gusjob.view.palette import DARK, LIGHT, Palette

MAX_BYTES = 30_000_000
"""Size limit of a page: a browser opens it in seconds, and most mail servers accept it."""

_VENDORED = ("leaflet.js", "flatbush.js", "uPlot.iife.min.js", "ag-grid-community.min.noStyle.js")
_OURS = ("data.js", "colors.js", "tiles.js", "path.js", "time.js", "table.js", "page.js")
_ALONE = ("data.js", "colors.js", "page.js")
"""Scripts of a page without columns: the color theme, and updates of a watched job."""
_STYLES = ("vendor/leaflet.css", "vendor/uPlot.min.css", "page.css")
_COLUMNS = Markup("<gusjob-columns>")
"""Placeholder of the columns. Texts of the job can't contain it, since their `<` is escaped."""
_SHOWN = 50
"""Number of diagnostics that are visible without a click."""
_DIRECTORY_BYTES = 32_768
_CUT = 240
"""Number of characters that are shown of a source line, around the diagnostic."""
_DIGITS = 6

Figure = tuple[str, str, str]
"""Name, value and unit."""


class Page(Struct, frozen=True, kw_only=True, eq=False):
    """The content of a page. Its texts are untrusted. Phrases are localized when the page is rendered.

    Attributes:
        facts: Job, version, totals, and the meaning of the columns.
        tables: Columns of "rows" (one row per segment), "strokes" and, if they were computed, "marks"; {} if the job
            was not run.
        diagnostics: As in the JSON but with localized messages, each with the text of its line as `source`.
        marking: As in the totals.
        watched: Path of the event stream that announces a new page; "" if there is none.
        answer: What the page begins with; None without a run.
    """

    facts: dict[str, Any]
    tables: Mapping[str, Mapping[str, npt.NDArray[Any]]]
    diagnostics: list[dict[str, Any]]
    marking: list[dict[str, Any]] | None
    watched: str = ""
    answer: Answer | None = None


def render(page: Page) -> Iterator[bytes]:
    """Yield the page in pieces, UTF-8. Values are rounded as far as needed to stay within MAX_BYTES."""
    shell = _shell(page, None)
    if not _interactive(page):
        yield shell.encode("utf-8", "replace")
        return
    budget = MAX_BYTES - len(shell.encode("utf-8", "replace")) - _DIRECTORY_BYTES
    found = encode(page.tables, budget, page.facts.get("units_per_mm", UNITS_PER_MM))
    if found.size > budget and page.tables.get("marks"):
        left = {name: part for name, part in page.tables.items() if name != "marks"}
        page = replace(page, tables=left, facts={**page.facts, "marks_left_out": True})
        found = encode(page.tables, budget, page.facts.get("units_per_mm", UNITS_PER_MM))
    head, _, tail = _shell(page, found).partition(str(_COLUMNS))
    yield head.encode("utf-8", "replace")
    yield from found.text()
    yield tail.encode("utf-8", "replace")


def _interactive(page: Page) -> bool:
    """Return whether there is anything to draw."""
    rows = page.tables.get("rows", {})
    strokes = page.tables.get("strokes", {})
    return bool(rows and strokes and len(rows["line"]) and len(strokes["row"]))


def _shell(page: Page, found: Encoded | None) -> str:
    """Render the page without the columns."""
    interactive = _interactive(page)
    names = [*(f"vendor/{name}" for name in _VENDORED), *_OURS] if interactive else [*_ALONE]
    scripts = [_script(name) for name in names]
    totals = page.facts.get("totals")
    versions = json.loads(_read("vendor/versions.json"))
    return _template().render(
        language=page_language(),
        texts=_json(script_texts()),
        job=printable(str(page.facts.get("job", ""))),
        overrides=printable(overrides_text(page.facts.get("overrides") or {})),
        version=str(page.facts.get("version", "")),
        policy=_policy(scripts, watched=bool(page.watched)),
        styles=Markup("\n".join([*map(_style, _STYLES if interactive else _STYLES[-1:]), _colors()])),
        scripts=[Markup(script) for script in scripts],
        facts=_json(_facts(page, found)),
        columns=_COLUMNS,
        interactive=interactive,
        watched=bool(page.watched),
        has_marks="marks" in page.tables and bool(page.tables["marks"]),
        answer=_answer(page) if page.answer else None,
        summary=_summary(page.facts, totals) if totals else [],
        channels=[_channel_summary(entry) for entry in totals["channels"]] if totals else [],
        readings=_readings(page.facts),
        remarks=_remarks(page.facts, found),
        why_no_report=localized(page.facts.get("reason") or _why_no_report(page.diagnostics)),
        diagnostics=[_diagnostic(diagnostic) for diagnostic in page.diagnostics],
        counts=_counts(page.diagnostics),
        shown=_SHOWN,
        marking=_marking(page.marking or []),
        no_marking=bool(totals) and page.marking is None,
        libraries=_libraries(versions),
        licences=[(v["name"], _read(f"vendor/{v['file']}")) for v in versions if v["file"].endswith("LICENSE.txt")],
    )


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals["_"] = template_text
    return environment.from_string(_read("page.html"))


def _libraries(versions: Sequence[Mapping[str, str]]) -> str:
    """Return the libraries of the page, with version and licence."""
    known = dict.fromkeys((v["name"], v["version"], v["licence"]) for v in versions)
    return localized(
        all_of(Phrase("{name} {version} ({licence})", name=n, version=v, licence=of) for n, v, of in known)
    )


def _read(name: str) -> str:
    """Read a file of static/, with the line ends from which a browser computes a script's hash."""
    data = files("gusjob.view.page").joinpath("static", *name.split("/")).read_bytes()
    return data.decode("utf-8").replace("\r\n", "\n")


def _script(name: str) -> str:
    """Return a script without the reference to its source map, which is not included."""
    return re.sub(r"\n//# sourceMappingURL=\S+\s*$", "\n", _read(name))


def _style(name: str) -> str:
    """Return a style sheet without references to images, which are not included."""
    return re.sub(r"url\([^)]*\)", "none", _read(name))


def _policy(scripts: Sequence[str], *, watched: bool) -> str:
    """Return the content security policy: nothing is loaded or sent, and only the given scripts run."""
    hashes = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    return "; ".join(
        [
            "default-src 'none'",
            "script-src " + " ".join(f"'sha256-{one}'" for one in hashes),
            "style-src 'unsafe-inline'",
            "img-src data: blob:",
            f"connect-src {chr(39)}{'self' if watched else 'none'}{chr(39)}",
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )


def _facts(page: Page, found: Encoded | None) -> dict[str, Any]:
    return {
        **page.facts,
        "watched": page.watched,
        "digits": found.digits if found else _DIGITS,
        "directory": found.directory if found else [],
        "palette": {name: _scale(of) for name, of in (("light", LIGHT), ("dark", DARK))},
        "ranges": ranges_of(page.facts, page.tables["strokes"]) if found else [],
    }


# Colors.


def _scale(palette: Palette) -> dict[str, Any]:
    """Return the colors of the path's values."""
    return {"scale": palette.scale, "under": palette.under, "over": palette.over, "single": palette.single}


def _colors() -> str:
    """Return the style of the other colors of the path and the curves, for both themes."""
    names = {
        "map": "ground",
        "path-jump": "jump",
        "path-run-in": "run_in",
        "path-run-out": "run_out",
        "path-other": "other",
        "path-command": "command",
        "path-switch": "ink",
        "velocity": "velocity",
    }
    pairs = {name: (getattr(LIGHT, of), getattr(DARK, of)) for name, of in names.items()}
    pairs |= {f"power{n}": pair for n, pair in enumerate(zip(LIGHT.power, DARK.power, strict=True))}
    pairs |= {"value-under": (LIGHT.under, DARK.under), "value-over": (LIGHT.over, DARK.over)}
    return ":root {" + "".join(f" --{name}: light-dark({a}, {b});" for name, (a, b) in pairs.items()) + " }"


# The answer.


def _answer(page: Page) -> dict[str, Any]:
    """Return the texts of the answer; each finding with the fragment that selects its segment or mark."""
    answer = page.answer
    assert answer is not None
    return {
        "status": answer.worst.value if answer.worst else "ok",
        "headline": [printable(localized(part)) for part in answer.headline],
        "setting": [printable(localized(part)) for part in answer.setting],
        "findings": [
            {
                "name": localized(finding.name),
                "place": localized(finding.place),
                "text": printable(localized(finding.text)),
                "link": _fragment(page, finding),
                "alarm": finding.name == LEFT_ON,
            }
            for finding in answer.findings
        ],
    }


def _fragment(page: Page, finding: Finding) -> str:
    """Return the fragment that selects a finding's mark or segment; "" if it has none."""
    if not _interactive(page):
        return ""
    if finding.segment is not None:
        return f"#s={finding.segment}"
    marks = page.tables.get("marks")
    if finding.mark is None or not marks:
        return ""
    return f"#m={finding.mark}"


def _json(value: object) -> Markup:
    """Encode JSON for a script element: nothing in it ends the element or opens a comment."""
    text = json.dumps(_plain(value), separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))


def _plain(value: object) -> object:
    """Convert values to JSON types; NaN and infinity become null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


# Figures.


def _figure(head: Phrase, value: float | None) -> Figure:
    """Return a figure from a head that ends with its unit; a long time in s."""
    name, _, unit = localized(head).rpartition(" ")
    if unit == "ms" and value is not None and value >= MS_PER_S:
        return name, short(value / MS_PER_S, TABLE_DIGITS), "s"
    return name, short(value, TABLE_DIGITS), unit


def _summary(facts: Mapping[str, Any], totals: Mapping[str, Any]) -> list[Figure]:
    runs = ((Phrase("run-ins mm"), "run_in_mm"), (Phrase("run-outs mm"), "run_out_mm"))
    found = [
        (localized(Phrase("segments")), f"{totals['segments']:,}", ""),
        (localized(Phrase("stages")), f"{totals['stages']:,}", ""),
        _figure(Phrase("duration ms"), totals["duration_ms"]),
        _figure(Phrase("marks mm"), totals["mark_mm"]),
        _figure(Phrase("jumps mm"), totals["jump_mm"]),
        *(_figure(head, totals[name]) for head, name in runs if totals.get(name)),
    ]
    if facts.get("period_us"):
        found.append(_figure(Phrase("period us"), facts["period_us"]))
    scanner = (facts.get("notes") or {}).get("scanner")
    if scanner:
        lag = short(scanner.get("tracking_error_us"))
        found.append((localized(Phrase("scanner")), printable(str(scanner.get("model", ""))), f"{lag} us"))
    return found


class _ChannelSummary(Struct, frozen=True, kw_only=True):
    name: str
    figures: list[Figure]
    lit_at_end: bool


_OFF_OUTPUT = {
    "standby_khz": Phrase("while off: standby kHz"),
    "standby_pct": Phrase("while off: standby %"),
    "prevoltage_v": Phrase("while off: prevoltage V"),
}


def _channel_summary(entry: Mapping[str, Any]) -> _ChannelSummary:
    """Return the figures of a channel and power unit."""
    unit = printable(str(entry["unit"]))
    found = [
        _figure(Phrase("on ms"), entry["emission_ms"]),
        (localized(Phrase("energy")), *_power_time(entry["power_ms"], unit)),
        (localized(Phrase("highest power")), short(entry["power_max"], TABLE_DIGITS), unit),
    ]
    if entry["joules"] is not None:
        found.append(_figure(Phrase("joules J"), entry["joules"]))
    if entry["clamped_ms"]:
        found.append(_figure(Phrase("limited ms"), entry["clamped_ms"]))
    if entry.get("before_motion_power_ms"):
        before = localized(Phrase("before the first motion"))
        found.append((before, *_power_time(entry["before_motion_power_ms"], unit)))
    found += [_figure(_OFF_OUTPUT[name], value) for name, value in (entry["off_output"] or {}).items()]
    name = localized(Phrase("Channel {channel}", channel=entry["channel"]))
    return _ChannelSummary(name=name, figures=found, lit_at_end=bool(entry["lit_at_end"]))


def _power_time(power_ms: float, unit: str) -> tuple[str, str]:
    """Return value and unit of an integral of power."""
    return short(power_ms / MS_PER_S, TABLE_DIGITS), f"{unit}·s"


def _readings(facts: Mapping[str, Any]) -> list[str]:
    return [
        localized(
            Phrase(
                "Line {line}: GT_GetHSIOOpt reads {value} on channel {channel}.",
                line=r["line"],
                value=r["value"],
                channel=r["channel"],
            )
        )
        for r in (facts.get("notes") or {}).get("readings") or ()
    ]


def _remarks(facts: Mapping[str, Any], found: Encoded | None) -> list[str]:
    remarks: list[str] = []
    if facts.get("exact") is False:
        remarks.append(
            Phrase("The job has many segments: the curves show each segment's highest velocity and mean power.")
        )
    if found is not None and found.digits < _DIGITS:
        remarks.append(
            Phrase(
                "Values in drawings and tables are rounded to about {digits} digits to keep the page small.",
                digits=found.digits,
            )
        )
    remarks += facts.get("remarks", [])
    if facts.get("marks_left_out"):
        remarks.append(Phrase("The table of marks is left out to keep the page small; it is in the JSON report."))
    return [localized(remark) for remark in remarks]


def _marking(entries: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """Return worst and typical value of each mark quality measure that is not 0."""
    return [
        {
            "channel": str(entry["channel"]),
            "word": localized(word),
            "unit": printable(marking_unit(name, entry["unit"])),
            "marks": f"{entry['marks']:,}",
            "worst": short(entry["worst"][name], TABLE_DIGITS),
            "typical": short(entry["typical"][name], TABLE_DIGITS),
        }
        for entry in entries
        for name, word in MARKING_WORDS.items()
        if entry["worst"].get(name)
    ]


# Diagnostics.


def _why_no_report(diagnostics: Sequence[Mapping[str, Any]]) -> Phrase:
    if any(d["severity"] == "error" for d in diagnostics):
        return Phrase("The job was not run because it has errors.")
    return Phrase("There is no report.")


def _counts(diagnostics: Sequence[Mapping[str, Any]]) -> str:
    counted = Counter(str(d["severity"]) for d in diagnostics)
    errors, warnings, notes = (counted[severity.value] for severity in Severity)
    counted_phrases = (
        (errors, plural(errors, Phrase("{count} error", count=errors), Phrase("{count} errors", count=errors))),
        (
            warnings,
            plural(warnings, Phrase("{count} warning", count=warnings), Phrase("{count} warnings", count=warnings)),
        ),
        (notes, plural(notes, Phrase("{count} note", count=notes), Phrase("{count} notes", count=notes))),
    )
    return localized(all_of(phrase for count, phrase in counted_phrases if count))


def _diagnostic(diagnostic: Mapping[str, Any]) -> dict[str, Any]:
    """Return a diagnostic with its source line in three parts: before, in and after its span."""
    severity = Severity(diagnostic["severity"])
    return {
        **_diagnostic_location(diagnostic),
        "severity": severity.value,
        "word": severity.localized,
        "code": printable(str(diagnostic["code"])),
        "count": int(diagnostic.get("count", 1)),
        "notes": [_diagnostic_location(note) for note in diagnostic.get("notes", ())],
    }


def _diagnostic_location(place: Mapping[str, Any]) -> dict[str, Any]:
    source = printable(str(place.get("source") or "").rstrip("\r\n"))
    start = min(max(int(place["column"]) - 1, 0), len(source))
    end = int(place["end_column"]) - 1 if place["end_line"] == place["line"] else len(source)
    end = min(max(end, start + 1), start + _CUT)
    first = max(start - _CUT // 2, 0) if len(source) > _CUT else 0
    last = max(end, first + _CUT)
    return {
        "path": printable(str(place["path"])),
        "line": int(place["line"]),
        "column": int(place["column"]),
        "message": printable(str(place["message"])),
        "source": source,
        "before": ("..." if first else "") + source[first:start],
        "marked": source[start:end] or " ",
        "after": source[end:last] + ("..." if last < len(source) else ""),
    }
