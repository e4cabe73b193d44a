"""Strokes on axes: many as few lines, markers, and how thick they may be."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.lines import Line2D

from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.view.plot.color_scale import BINS, OVER, ColoredPath
from gusjob.view.strokes import Line

PT_PER_INCH = 72.0
OVER_COLOR = "#d7191c"
"""What lies above the range of the colours."""
_MAP, _LAST = "viridis", 0.82
"""Without its yellow end, which nobody sees on white paper."""
_SINGLE = 0.3
_JOINED_MM = 1e-9
_CHUNK, _CHUNK_PT = 20_000, 100_000.0
"""Strokes in one line, and its length: a rasterizer's memory of a path is limited, and it sorts what is in it."""

LINE_STYLES: dict[str, dict[str, Any]] = {
    "jump": {"color": "#8c959f", "linewidth": 0.7, "dashes": (5, 3)},
    "run-in": {"color": "#c2571a", "linewidth": 1.0, "dashes": (1.5, 1.2)},
    "run-out": {"color": "#8a2be2", "linewidth": 1.0, "dashes": (6, 1.5, 1.2, 1.5)},
    "other light": {"color": "#c4cad1", "linewidth": 1.0},
    "commanded path": {"color": "#8c959f", "linewidth": 0.5},
}
"""Strokes that are not coloured."""
MARKERS: dict[str, dict[str, Any]] = {
    "light on": {"marker": "o", "markersize": 5.5, "markerfacecolor": "none", "markeredgewidth": 0.8},
    "light off": {"marker": "x", "markersize": 4.5, "markeredgewidth": 0.8},
}
INK = "#1f2328"


@dataclass(frozen=True, slots=True, kw_only=True)
class Viewport:
    """The part of the plane that axes show, mm, and their scale. `small`: it is read in um."""

    x0: float
    y0: float
    x1: float
    y1: float
    pt_per_mm: float
    dpi: int
    small: bool

    def of(self, line: Line) -> Bools:
        """Which strokes may be seen: their box touches it, and a little more for the thickness of lines."""
        edge = 6.0 / self.pt_per_mm
        inside = np.maximum(line.x0, line.x1) >= self.x0 - edge
        inside &= np.minimum(line.x0, line.x1) <= self.x1 + edge
        inside &= np.maximum(line.y0, line.y1) >= self.y0 - edge
        inside &= np.minimum(line.y0, line.y1) <= self.y1 + edge
        return np.asarray(inside)


def selected_lines(line: Line, at: Indices | slice) -> Line:
    """Some strokes of a line."""
    return Line(x0=line.x0[at], y0=line.y0[at], x1=line.x1[at], y1=line.y1[at])


# Colours.


def color_map(shade: ColoredPath) -> ListedColormap:
    """One colour a bin, and one for what lies above."""
    full = matplotlib.colormaps[_MAP]
    places = [_SINGLE] if shade.is_constant else (np.arange(BINS) + 0.5) / BINS * _LAST
    return ListedColormap([full(place) for place in places], over=OVER_COLOR)


def norm(shade: ColoredPath) -> Normalize:
    """Values to places in the map; of a single value, anything around it."""
    if shade.is_constant:
        around = abs(shade.high) or 1.0
        return Normalize(shade.high - around, shade.high + around)
    return Normalize(shade.low, shade.high)


# Lines.


def polyline(line: Line) -> Floats:
    """Strokes as one line, (k, 2): those that go on from each other joined, NaN where they do not."""
    if not len(line.x0):
        return np.empty((0, 2))
    joined = np.zeros(len(line.x0), dtype=np.bool_)
    joined[1:] = np.hypot(line.x0[1:] - line.x1[:-1], line.y0[1:] - line.y1[:-1]) < _JOINED_MM
    last = np.cumsum(np.where(joined, 1, 3)) - 1
    points = np.full((last[-1] + 1, 2), np.nan)
    points[last, 0], points[last, 1] = line.x1, line.y1
    fresh = last[~joined] - 1
    points[fresh, 0], points[fresh, 1] = line.x0[~joined], line.y0[~joined]
    return points[1:]


def draw_line(axes: Axes, line: Line, sight: Viewport, *, zorder: float, rasterized: bool, **style: Any) -> None:
    """Strokes in one style."""
    long = np.cumsum(line.length_mm) * sight.pt_per_mm // _CHUNK_PT
    edges = np.flatnonzero(np.diff(long) > 0) + 1
    edges = np.unique([*edges.tolist(), *range(0, len(long), _CHUNK), len(long)])
    for first, behind in pairwise(edges.tolist()):
        points = polyline(selected_lines(line, slice(first, behind)))
        look = {"solid_capstyle": "round", "solid_joinstyle": "round", **style}
        dashes = look.pop("dashes", ())
        drawn = Line2D(points[:, 0], points[:, 1], zorder=zorder, **look)
        if dashes:
            drawn.set_linestyle((0, dashes))
        drawn.set_snap(False)  # What is snapped to pixels does not meet its neighbour.
        drawn.set_rasterized(rasterized)
        axes.add_line(drawn)


def draw_colored(
    axes: Axes, shade: ColoredPath, sight: Viewport, seen: Bools, width_pt: float, dot_pt: float, *, rasterized: bool
) -> None:
    """The pieces in sight, in their colours: the lowest value first, so that the highest lies on top."""
    bins, tones = shade.bins(), color_map(shade)
    for kind, zorder in ((seen & ~shade.at_rest, 3.0), (seen & shade.at_rest, 3.5)):
        for number in np.unique(bins[kind]):
            colour = OVER_COLOR if number == OVER else tones(int(number))
            at = np.flatnonzero(kind & (bins == number))
            if zorder == 3.0:
                line = selected_lines(shade.line, at)
                draw_line(axes, line, sight, zorder=zorder, rasterized=rasterized, color=colour, linewidth=width_pt)
            else:
                at = _distinct_dots(shade, at)
                draw_points(
                    axes, np.column_stack([shade.line.x1[at], shade.line.y1[at]]), zorder=zorder, rasterized=rasterized,
                    color=colour, marker="o", markersize=dot_pt, markeredgewidth=0.0,
                )  # fmt: skip


def _distinct_dots(shade: ColoredPath, at: Indices) -> Indices:
    """One of the dots that lie on each other."""
    places = np.round(np.column_stack([shade.line.x1[at], shade.line.y1[at]]), 6)
    return at[np.sort(np.unique(places, axis=0, return_index=True)[1])]


def draw_points(axes: Axes, points: Floats, *, zorder: float, rasterized: bool, **style: Any) -> None:
    """Markers."""
    drawn = Line2D(points[:, 0], points[:, 1], linestyle="none", zorder=zorder, **style)
    drawn.set_rasterized(rasterized)
    axes.add_line(drawn)


# How much is there.

_CELLS = 64
_SAMPLES = 50_000
_OVERLAP = 1.5
"""Of lines that pixels can't tell apart: no gaps may show in between."""
_THINNEST_PX, _THICKEST_PT = 0.4, 1.7


def width_pt(line: Line, sight: Viewport) -> float:
    """How thick lines may be: half of what is between them, if pixels can show that; else they just touch."""
    length = line.length_mm
    total = float(length.sum())
    if not total > 0:
        return _THICKEST_PT
    upto = np.cumsum(length)
    place = (np.arange(_SAMPLES) + 0.5) / _SAMPLES * total
    at = np.minimum(np.searchsorted(upto, place), len(length) - 1)
    share = np.divide(upto[at] - place, length[at], out=np.zeros(_SAMPLES), where=length[at] > 0)
    x = line.x1[at] + (line.x0[at] - line.x1[at]) * share
    y = line.y1[at] + (line.y0[at] - line.y1[at]) * share
    count, cell_mm2 = _neighbour_counts(x, y, sight)
    apart = cell_mm2 / (count[count > 0] * total / _SAMPLES) * sight.pt_per_mm
    typical = float(np.median(apart)) if len(apart) else _THICKEST_PT
    pixel = PT_PER_INCH / sight.dpi
    wanted = max(typical / 2, min(_OVERLAP * typical, pixel))
    return float(np.clip(wanted, _THINNEST_PX * pixel, _THICKEST_PT))


def dot_pt(shade: ColoredPath, seen: Bools, sight: Viewport) -> float:
    """How large dots may be."""
    at = _distinct_dots(shade, np.flatnonzero(seen & shade.at_rest))
    count, cell_mm2 = _neighbour_counts(shade.line.x1[at], shade.line.y1[at], sight)
    busy = count[count > 0]
    apart = float(np.median(np.sqrt(cell_mm2 / busy))) * sight.pt_per_mm if len(busy) else np.inf
    return float(np.clip(apart, 1.0, 8.0))


def too_close(points: Floats, sight: Viewport, size_pt: float) -> bool:
    """Whether most markers have another one of their kind within their own size."""
    cells = np.floor(points * (sight.pt_per_mm / size_pt))
    return len(np.unique(cells, axis=0)) * 2 < len(points)


def _neighbour_counts(x: Floats, y: Floats, sight: Viewport) -> tuple[Floats, float]:
    """How many points lie in the cell of each point in sight, and the area of a cell, mm2."""
    seen = (x >= sight.x0) & (x <= sight.x1) & (y >= sight.y0) & (y <= sight.y1)
    side_mm = max(sight.x1 - sight.x0, sight.y1 - sight.y0) / _CELLS
    across = ((x[seen] - sight.x0) / side_mm).astype(np.intp)
    upwards = ((y[seen] - sight.y0) / side_mm).astype(np.intp)
    cell = across * (_CELLS + 1) + upwards
    return np.bincount(cell)[cell].astype(np.float64), side_mm**2
