"""Texts of a picture: totals, and notes on what the picture does not show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gusjob.report.quantities import duration, energy, length, short
from gusjob.report.rows import Report
from gusjob.view.color_range import label
from gusjob.view.plot.color_scale import ColoredPath
from gusjob.view.strokes import FINE_STROKES, Strokes, undrawn_emission

_LENGTHS = (("mark_mm", "marks"), ("jump_mm", "jumps"), ("run_in_mm", "run-ins"), ("run_out_mm", "run-outs"))


def head(report: Report, colored_paths: Sequence[ColoredPath]) -> list[str]:
    """Return the totals; with several panels those of a channel are the title of its panel instead."""
    totals, scanner = report.totals, report.notes["scanner"]
    lengths = ", ".join(f"{name} {length(totals[key])}" for key, name in _LENGTHS if totals[key] or name == "marks")
    beam = f"; scanner {scanner['model']} {short(scanner['tracking_error_us'])} us" if scanner else ""
    count = totals["segments"]
    segments = f"{count:,} segment{'s' if count != 1 else ''}, {duration(totals['duration_ms'])}"
    channels = [channel_totals(report, colored) for colored in colored_paths] if len(colored_paths) == 1 else []
    return [f"{segments}; {lengths}{beam}", *channels]


def channel_totals(report: Report, colored: ColoredPath) -> str:
    """Return the totals of a panel's channel."""
    parts = []
    for entry in report.totals["channels"]:
        if entry["channel"] == colored.channel and entry["power_max"] is not None:
            part = f"highest {short(entry['power_max'])} {entry['unit']}, on {duration(entry['emission_ms'])}"
            parts.append(part if entry["joules"] is None else f"{part}, {energy(entry['joules'])}")
    return f"channel {colored.channel}: {'; '.join(parts)}"


def notes(report: Report, strokes: Strokes, colored_paths: Sequence[ColoredPath], channel: int | None) -> list[str]:
    """Return the notes on the whole picture."""
    if not len(report):
        return ["No motion: there is no path to draw."]
    found = []
    if not colored_paths:
        found.append(f"No emission{'' if channel is None else f' of channel {channel}'} on this path.")
    several = len(colored_paths) > 1
    found += [text for colored in colored_paths for text in _values_out_of_range(colored, several=several)]
    drawn = {colored.channel for colored in colored_paths}
    for emission in strokes.emissions:
        if emission.channel in drawn:
            found += undrawn_emission(report, strokes, emission)
    if not strokes.exact:
        found.append(f"More than {FINE_STROKES:,} strokes: the velocity is each segment's highest, the power its mean.")
    return found


def _values_out_of_range(colored: ColoredPath, *, several: bool) -> Iterator[str]:
    """Yield notes on values out of the range of the color scale."""
    ends, unit = colored.range, colored.unit
    of = f"Channel {colored.channel}: " if several else ""
    if ends.has_higher:
        reported = f" ({colored.most_reported} in the report)" if colored.most_reported else ""
        yield (
            f"{of}Red-brown is above {label(ends.high)} {unit}; "
            f"the highest {colored.label} is {label(ends.most)} {unit}{reported}."
        )
    if ends.has_lower:
        low, least = label(ends.low), label(ends.least)
        yield f"{of}Sky blue is below {low} {unit}; the lowest {colored.label} is {least} {unit}."
    if np.isinf(colored.value).any():
        yield f"{of}Where a mark does not move, {colored.label} has no value: red-brown."
