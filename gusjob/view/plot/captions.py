"""Texts of a picture: totals, and notes on what the picture does not show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gusjob.i18n.phrases import figure as figure_text
from gusjob.report.rows import Report
from gusjob.view.plot.color_scale import ColoredPath
from gusjob.view.strokes import FINE_STROKES, Strokes, undrawn_emission

_LENGTHS = (("mark_mm", "marks"), ("jump_mm", "jumps"), ("run_in_mm", "run-ins"), ("run_out_mm", "run-outs"))


def head(report: Report, colored_paths: Sequence[ColoredPath]) -> list[str]:
    """Return the totals; with several panels those of a channel are the title of its panel instead."""
    totals, scanner = report.totals, report.notes["scanner"]
    lengths = ", ".join(
        f"{name} {figure_text(totals[key])} mm" for key, name in _LENGTHS if totals[key] or name == "marks"
    )
    beam = f"; scanner {scanner['model']} {figure_text(scanner['tracking_error_us'])} us" if scanner else ""
    count = totals["segments"]
    segments = f"{count:,} segment{'s' if count != 1 else ''}, {figure_text(totals['duration_ms'])} ms"
    channels = [channel_totals(report, colored) for colored in colored_paths] if len(colored_paths) == 1 else []
    return [f"{segments}; {lengths}{beam}", *channels]


def channel_totals(report: Report, colored: ColoredPath) -> str:
    """Return the totals of a panel's channel."""
    parts = []
    for entry in report.totals["channels"]:
        if entry["channel"] == colored.channel and entry["power_max"] is not None:
            part = (
                f"highest {figure_text(entry['power_max'])} {entry['unit']}, on {figure_text(entry['emission_ms'])} ms"
            )
            parts.append(part if entry["joules"] is None else f"{part}, {figure_text(entry['joules'])} J")
    return f"channel {colored.channel}: {'; '.join(parts)}"


def notes(report: Report, strokes: Strokes, colored_paths: Sequence[ColoredPath], channel: int | None) -> list[str]:
    """Return the notes on the whole picture."""
    if not len(report):
        return ["No motion: there is no path to draw."]
    found = []
    if not colored_paths:
        found.append(f"No emission{'' if channel is None else f' of channel {channel}'} on this path.")
    found += [text for colored in colored_paths for text in _values_above_range(colored)]
    drawn = {colored.channel for colored in colored_paths}
    for emission in strokes.emissions:
        if emission.channel in drawn:
            found += undrawn_emission(report, strokes, emission)
    if not strokes.exact:
        found.append(f"More than {FINE_STROKES:,} strokes: the velocity is each segment's highest, the power its mean.")
    return found


def _values_above_range(colored: ColoredPath) -> Iterator[str]:
    """Yield a note on values above the range of the color scale."""
    if colored.exceeds_range and np.isfinite(colored.highest):
        rest = "; where the beam stands still it has no value" if colored.at_rest.any() else ""
        yield (
            f"99 % of the length has at most {figure_text(colored.high, 4)} {colored.unit}. Red is above: "
            f"{colored.label} reaches {figure_text(colored.highest, 4)} {colored.unit}{rest}."
        )
    elif colored.exceeds_range:
        yield f"The beam stands still during all emission: {colored.label} has no value."
