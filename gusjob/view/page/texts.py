"""The texts of the page's scripts, localized. Those of the template are in page.html.

Fields stay in the texts; the scripts fill them in (localized() in data.js).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gusjob.i18n.language import LANGUAGES, language, translated, typeset
from gusjob.i18n.phrases import Phrase, localized

Texts = Mapping[str, Any]


_SCRIPTS = {
    "data": {
        "cut-off": Phrase("the page's data are incomplete"),
        "line": Phrase("line {line}", line="{line}"),
        "line-of-file": Phrase("line {line} of {file}", line="{line}", file="{file}"),
        "and": Phrase("{first}, {second}", first="{first}", second="{second}"),
    },
    "kinds": {
        "mark": Phrase("mark"),
        "jump": Phrase("jump"),
        "run_in": Phrase("run-in"),
        "run_out": Phrase("run-out"),
        "dwell": Phrase("dwell"),
    },
    "measures": {
        "power": Phrase("emitted power"),
        "energy": Phrase("energy per mm"),
        "velocity": Phrase("velocity"),
        "order": Phrase("order in time"),
    },
    "path": {
        "place": Phrase("{place}: {kind} (segment {segment})", place="{place}", kind="{kind}", segment="{segment}"),
        "from-to": Phrase("{low} to {high}", low="{low}", high="{high}"),
        "on": Phrase("{velocity} mm/s, {emission}", velocity="{velocity}", emission="{emission}"),
        "off": Phrase("{velocity} mm/s, laser off", velocity="{velocity}"),
        "legend": Phrase("{what}, {unit}", what="{what}", unit="{unit}"),
        "legend-channel": Phrase(
            "{what}, channel {channel}, {unit}", what="{what}", channel="{channel}", unit="{unit}"
        ),
        "channel": Phrase("channel {channel}, {unit}", channel="{channel}", unit="{unit}"),
        "no-emission": Phrase("no emission"),
        "everywhere": Phrase("{value} everywhere", value="{value}"),
        "under": Phrase("< {value}, min {least}", value="{value}", least="{least}"),
        "over": Phrase("> {value}, max {most}", value="{value}", most="{most}"),
        "zoom-in": Phrase("Zoom in"),
        "zoom-out": Phrase("Zoom out"),
    },
    "time": {
        "range": Phrase(
            "{low} to {high} {unit} of {end} {unit}", low="{low}", high="{high}", end="{end}", unit="{unit}"
        ),
        "velocity": Phrase("velocity"),
        "power": Phrase("power of channel {channel}, {unit}", channel="{channel}", unit="{unit}"),
        "switch": Phrase("ch{channel} on", channel="{channel}"),
    },
    "table": {
        "one": Phrase("{shown} of {count} row", shown="{shown}", count="{count}"),
        "many": Phrase("{shown} of {count} rows", shown="{shown}", count="{count}"),
    },
    "page": {
        "none-selected": Phrase("No segment selected"),
        "segment": Phrase(
            "Segment {segment} of {count}: {kind}, {place}",
            segment="{segment}",
            count="{count}",
            kind="{kind}",
            place="{place}",
        ),
        "no-line": Phrase("no segment at or after line {line}", line="{line}"),
        "next-line": Phrase("line {line} has no segment: the next is line {next}", line="{line}", next="{next}"),
        "follows": Phrase("updates with the job"),
        "follows-no-more": Phrase("no longer updates with the job: is gusjob still running?"),
        "old-browser": Phrase(
            "This browser can't read the page's data (it lacks DecompressionStream): path, curves and tables are not "
            "shown. Use a browser from 2023 or later."
        ),
        "reading": Phrase("Reading the data: {share} %", share="{share}"),
        "drawing": Phrase("Drawing"),
        "failed": Phrase("The data can't be shown: {why}", why="{why}"),
    },
}
"""By script and key."""

_HEADS = {
    "segment": (Phrase("segment"), Phrase("number of the segment, from 1")),
    "line": (Phrase("line"), Phrase("line of the job")),
    "file": (Phrase("file"), Phrase("file of the line")),
    "kind": (Phrase("kind"), Phrase("kind of the segment")),
    "stage": (Phrase("stage"), Phrase("stage of the job")),
    "x_mm": (Phrase("x mm"), Phrase("x of the end")),
    "y_mm": (Phrase("y mm"), Phrase("y of the end")),
    "length_mm": (Phrase("length mm"), Phrase("length")),
    "start_ms": (Phrase("start ms"), Phrase("time from the start of the first stage")),
    "duration_ms": (Phrase("time ms"), Phrase("duration")),
    "vel_mean_mm_s": (Phrase("mm/s"), Phrase("mean velocity")),
    "vel_max_mm_s": (Phrase("max mm/s"), Phrase("highest velocity")),
    "channel": (Phrase("ch"), Phrase("laser channel")),
    "on_error_um": (Phrase("on error um"), Phrase("emission begins late (+) or early (-)")),
    "off_error_um": (Phrase("off error um"), Phrase("emission ends late (+) or early (-)")),
    "on_miss_um": (Phrase("on miss um"), Phrase("distance of the beam from the intended start")),
    "off_miss_um": (Phrase("off miss um"), Phrase("distance of the beam from the intended end")),
    "outside_power_ms": (Phrase("outside"), Phrase("power integral emitted before the start and after the end")),
    "power_per_mm_mid": (Phrase("per mm"), Phrase("power integral per mm, middle")),
    "power_per_mm_peak": (Phrase("peak"), Phrase("highest power integral per mm")),
    "power_per_mm_rms_pct": (Phrase("rms %"), Phrase("RMS deviation of the power integral per mm")),
    "corner_miss_um": (Phrase("corner um"), Phrase("largest distance of the beam from a corner")),
}
"""Columns: short head and description."""

_HEADS_OF_CHANNEL = {
    "emission_ms": (Phrase("on ms"), Phrase("emission time")),
    "power_min": (Phrase("min {unit}", unit="{unit}"), Phrase("lowest power")),
    "power_mean": (Phrase("mean {unit}", unit="{unit}"), Phrase("mean power")),
    "power_max": (Phrase("max {unit}", unit="{unit}"), Phrase("highest power")),
    "power_ms": (Phrase("{unit}·ms", unit="{unit}"), Phrase("power integral")),
    "joules": (Phrase("J"), Phrase("energy")),
    "clamped_ms": (Phrase("limited ms"), Phrase("time for which a limit clamps the power")),
}
_CHANNEL = (
    Phrase("ch{channel} {what}", channel="{channel}", what="{what}"),
    Phrase("channel {channel}: {what}", channel="{channel}", what="{what}"),
)
_UNIT_OF_CHANNEL = Phrase("ch{channel}_unit", channel="{channel}")

_GRID = {
    "filterOoo": Phrase("Filter..."),
    "equals": Phrase("Equals"),
    "notEqual": Phrase("Does not equal"),
    "lessThan": Phrase("Less than"),
    "lessThanOrEqual": Phrase("Less than or equal to"),
    "greaterThan": Phrase("Greater than"),
    "greaterThanOrEqual": Phrase("Greater than or equal to"),
    "inRange": Phrase("Between"),
    "inRangeStart": Phrase("From"),
    "inRangeEnd": Phrase("To"),
    "contains": Phrase("Contains"),
    "notContains": Phrase("Does not contain"),
    "startsWith": Phrase("Begins with"),
    "endsWith": Phrase("Ends with"),
    "blank": Phrase("Blank"),
    "notBlank": Phrase("Not blank"),
    "andCondition": Phrase("AND"),
    "orCondition": Phrase("OR"),
    "noRowsToShow": Phrase("No Rows To Show"),
    "noMatchingRows": Phrase("No Matching Rows"),
    "loadingOoo": Phrase("Loading..."),
    "ariaColumnFiltered": Phrase("Column Filtered"),
    "ariaFilterColumn": Phrase("Press CTRL ENTER to open filter"),
    "ariaFilterFromValue": Phrase("Filter from value"),
    "ariaFilterInput": Phrase("Filter Input"),
    "ariaFilterMenuOpen": Phrase("Open Filter Menu"),
    "ariaFilterToValue": Phrase("Filter to Value"),
    "ariaFilterValue": Phrase("Filter Value"),
    "ariaFilteringOperator": Phrase("Filtering operator"),
    "ariaLabelColumnFilter": Phrase("Column Filter"),
    "ariaLabelInputClear": Phrase("Clear"),
    "ariaLabelSelectField": Phrase("Select Field"),
    "ariaLabelTooltip": Phrase("Tooltip"),
    "ariaRowDeselect": Phrase("Press SPACE to deselect this row"),
    "ariaRowSelect": Phrase("Press SPACE to select this row"),
    "ariaSkeletonCellLoading": Phrase("Row data is loading"),
    "ariaSkeletonCellLoadingFailed": Phrase("Row failed to load"),
    "ariaSortableColumn": Phrase("Press ENTER to sort"),
    "minValueValidation": Phrase("Must be greater than or equal to ${variable}", variable="{variable}"),
    "maxValueValidation": Phrase("Must be less than or equal to ${variable}", variable="{variable}"),
}
"""Texts of AG Grid that are used here, by its keys; the English texts are its own."""


def page_language() -> str:
    """Return the page's language as an HTML language tag."""
    return LANGUAGES[language()].replace("_", "-") or "en"


def template_text(text: str, **fields: str | int) -> str:
    """Localize a text of the template and fill in its fields."""
    return typeset(translated(text), fields).format_map(fields)


def script_texts() -> Texts:
    """Return all texts of the scripts, localized."""
    texts: dict[str, Any] = {
        script: {name: localized(phrase) for name, phrase in phrases.items()} for script, phrases in _SCRIPTS.items()
    }
    texts["heads"] = {name: [localized(head), localized(about)] for name, (head, about) in _HEADS.items()}
    texts["headsOfChannel"] = {
        name: [localized(head), localized(about)] for name, (head, about) in _HEADS_OF_CHANNEL.items()
    }
    texts["ofChannel"] = [localized(phrase) for phrase in _CHANNEL]
    texts["unitOfChannel"] = localized(_UNIT_OF_CHANNEL)
    # AG Grid uses its English texts where a key is missing.
    texts["grid"] = {name: text for name, phrase in _GRID.items() if (text := localized(phrase)) != phrase}
    return texts
