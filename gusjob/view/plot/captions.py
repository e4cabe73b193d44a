"""What is said in a picture of the path: totals, and what the picture does not show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gusjob.i18n.phrases import figure as figure_text
from gusjob.report.rows import Report
from gusjob.view.plot.color_scale import ColoredPath
from gusjob.view.strokes import FINE_STROKES, Strokes, undrawn_emission

_WAYS = (("mark_mm", "marks"), ("jump_mm", "jumps"), ("run_in_mm", "run-ins"), ("run_out_mm", "run-outs"))


def head(report: Report, shades: Sequence[ColoredPath]) -> list[str]:
    """The totals; those of a channel stand above its panel if there are several."""
    totals, scanner = report.totals, report.notes["scanner"]
    ways = ", ".join(
        f"{word} {figure_text(totals[name])} mm" for name, word in _WAYS if totals[name] or word == "marks"
    )
    beam = f"; scanner {scanner['model']} {figure_text(scanner['tracking_error_us'])} us" if scanner else ""
    count = totals["segments"]
    segments = f"{count:,} segment{'s' if count != 1 else ''}, {figure_text(totals['duration_ms'])} ms"
    return [f"{segments}; {ways}{beam}", *(channel_totals(report, shade) for shade in shades[: len(shades) == 1])]


def channel_totals(report: Report, shade: ColoredPath) -> str:
    """Totals of a panel's channel."""
    said = []
    for entry in report.totals["channels"]:
        if entry["channel"] == shade.channel and entry["power_max"] is not None:
            light = (
                f"highest {figure_text(entry['power_max'])} {entry['unit']}, on {figure_text(entry['emission_ms'])} ms"
            )
            said.append(light if entry["joules"] is None else f"{light}, {figure_text(entry['joules'])} J")
    return f"channel {shade.channel}: {'; '.join(said)}"


def notes(report: Report, strokes: Strokes, shades: Sequence[ColoredPath], channel: int | None) -> list[str]:
    """What is to be said of the whole picture."""
    if not len(report):
        return ["No motion: there is no path to draw."]
    said = (
        [] if shades else [f"{'There' if channel is None else f'On channel {channel} there'} is no light on this path."]
    )
    said += [text for shade in shades for text in _above(shade)]
    drawn = {shade.channel for shade in shades}
    said += [
        text
        for light in strokes.emissions
        if light.channel in drawn
        for text in undrawn_emission(report, strokes, light)
    ]
    if not strokes.exact:
        said.append(f"More than {FINE_STROKES:,} strokes: velocity is each segment's highest, power its mean.")
    return said


def _above(shade: ColoredPath) -> Iterator[str]:
    """What lies above the range of the colours."""
    if shade.exceeds_range and np.isfinite(shade.highest):
        rest = ", and where the beam stands it has no value" if shade.at_rest.any() else ""
        yield (
            f"99 % of the length has at most {figure_text(shade.high, 4)} {shade.unit}. Red is above: "
            f"{shade.word} comes to {figure_text(shade.highest, 4)} {shade.unit}{rest}."
        )
    elif shade.exceeds_range:
        yield f"The beam stands wherever there is light: {shade.word} has no value."
