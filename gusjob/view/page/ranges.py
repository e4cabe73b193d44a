"""Ranges of the page's colour scales."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.kinematics.arrays import Floats
from gusjob.view.color_range import ColorRange, color_range

_Strokes = Mapping[str, npt.NDArray[Any]]


def ranges_of(facts: Mapping[str, Any], strokes: _Strokes) -> list[dict[str, Any]]:
    """Return the range of each quantity for each channel and unit: [low, high, least, most], or None without values."""
    length, start = _length_mm(facts, strokes), np.cumsum(strokes["duration_ms"]) - strokes["duration_ms"]
    velocity = (strokes["vel0"] + strokes["vel1"]) / 2
    found = []
    for name, channel, number, emitting in _emissions(facts, strokes):
        mm, peak = length[emitting], channel["peak_per_mm"][number]
        ranges = {
            "power": color_range(strokes[f"{name}_power"][emitting], mm),
            "energy": color_range(strokes[f"{name}_per_mm"][emitting], mm, peak=np.nan if peak is None else peak),
            "velocity": color_range(velocity[emitting], mm),
            "order": color_range(start[emitting], mm, whole=True),
        }
        found.append({"channel": channel["channel"], "index": number, **{n: _ends(r) for n, r in ranges.items()}})
    return found


def _emissions(
    facts: Mapping[str, Any], strokes: _Strokes
) -> Iterator[tuple[str, Mapping[str, Any], int, npt.NDArray[np.bool_]]]:
    """Yield prefix, facts and number of the unit of each emission, and the strokes with it."""
    for channel in facts.get("channels", ()):
        name = f"ch{channel['channel']}"
        if f"{name}_on" not in strokes:
            continue
        units = channel.get("units", [channel["unit"]])
        unit = strokes.get(f"{name}_unit", np.zeros(len(strokes["row"]), dtype=np.uint8))
        for number in range(len(units)):
            yield name, channel, number, (strokes[f"{name}_on"] != 0) & (unit == number)


def _length_mm(facts: Mapping[str, Any], strokes: _Strokes) -> Floats:
    """Return the length of each stroke where its emission is drawn."""
    beam = "beam_x_mm" in strokes
    x, y = (strokes[f"beam_{axis}_mm" if beam else f"{axis}_mm"] for axis in "xy")
    x0, y0 = facts.get("beam_start_mm" if beam else "start_mm", facts["start_mm"])
    return np.hypot(np.diff(x, prepend=x0), np.diff(y, prepend=y0))


def _ends(found: ColorRange) -> list[float] | None:
    return None if found.is_empty else [found.low, found.high, found.least, found.most]
