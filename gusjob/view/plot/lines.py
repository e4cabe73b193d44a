"""Line drawing: strokes and markers on axes, their styles and widths."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.lines import Line2D
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.view.palette import LIGHT
from gusjob.view.plot.color_scale import OVER, UNDER, ColoredPath
from gusjob.view.strokes import Line

PT_PER_INCH = 72.0
_JOINED_MM = 1e-9
_CHUNK, _CHUNK_PT = 20_000, 100_000.0
"""Maximum number of strokes, and length, of one line: a rasterizer's memory is limited, and it sorts a path."""

LINE_STYLES: dict[str, dict[str, Any]] = {
    "jump": {"color": LIGHT.jump, "linewidth": 0.7, "dashes": (5, 3)},
    "run-in": {"color": LIGHT.run_in, "linewidth": 1.0, "dashes": (1.5, 1.2)},
    "run-out": {"color": LIGHT.run_out, "linewidth": 1.0, "dashes": (6, 1.5, 1.2, 1.5)},
    "other emission": {"color": LIGHT.other, "linewidth": 1.0},
    "commanded path": {"color": LIGHT.command, "linewidth": 0.5},
}
"""Styles of strokes that are not colored."""
MARKERS: dict[str, dict[str, Any]] = {
    "laser on": {"marker": "o", "markersize": 5.5, "markerfacecolor": "none", "markeredgewidth": 0.8},
    "laser off": {"marker": "x", "markersize": 4.5, "markeredgewidth": 0.8},
}
INK = LIGHT.ink


class Viewport(Struct, frozen=True, kw_only=True):
    """The part of the plane that axes show, mm, and their scale. `small`: labels are in um."""

    x0: float
    y0: float
    x1: float
    y1: float
    pt_per_mm: float
    dpi: int
    small: bool

    def of(self, line: Line) -> Bools:
        """Return the strokes that may be visible: their box, with a margin for the line, is in the viewport."""
        edge = 6.0 / self.pt_per_mm
        inside = np.maximum(line.x0, line.x1) >= self.x0 - edge
        inside &= np.minimum(line.x0, line.x1) <= self.x1 + edge
        inside &= np.maximum(line.y0, line.y1) >= self.y0 - edge
        inside &= np.minimum(line.y0, line.y1) <= self.y1 + edge
        return np.asarray(inside)


def selected_lines(line: Line, at: Indices | slice) -> Line:
    """Return some strokes of a line."""
    return Line(x0=line.x0[at], y0=line.y0[at], x1=line.x1[at], y1=line.y1[at])


# Colors.


def color_map(colored: ColoredPath) -> ListedColormap:
    """Return the color map: a color for each bin, and for values below and above the range."""
    tones = [LIGHT.single] if colored.range.is_single else list(LIGHT.scale)
    return ListedColormap(tones, under=LIGHT.under, over=LIGHT.over)


def norm(colored: ColoredPath) -> Normalize:
    """Return the normalization of values for the color map."""
    ends = colored.range
    if ends.is_single:
        around = abs(ends.high) or 1.0
        return Normalize(ends.high - around, ends.high + around)
    return Normalize(ends.low, ends.high)


# Lines.


def polyline(line: Line) -> Floats:
    """Join strokes to one line, (k, 2), with NaN where a stroke does not begin at the end of the one before."""
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


def draw_line(axes: Axes, line: Line, viewport: Viewport, *, zorder: float, rasterized: bool, **style: Any) -> None:
    """Draw strokes in one style."""
    long = np.cumsum(line.length_mm) * viewport.pt_per_mm // _CHUNK_PT
    edges = np.flatnonzero(np.diff(long) > 0) + 1
    edges = np.unique([*edges.tolist(), *range(0, len(long), _CHUNK), len(long)])
    for first, behind in pairwise(edges.tolist()):
        points = polyline(selected_lines(line, slice(first, behind)))
        look = {"solid_capstyle": "round", "solid_joinstyle": "round", **style}
        dashes = look.pop("dashes", ())
        drawn = Line2D(points[:, 0], points[:, 1], zorder=zorder, **look)
        if dashes:
            drawn.set_linestyle((0, dashes))
        drawn.set_snap(False)  # Lines that are snapped to pixels would not meet.
        drawn.set_rasterized(rasterized)
        axes.add_line(drawn)


def draw_colored(
    axes: Axes,
    colored: ColoredPath,
    viewport: Viewport,
    seen: Bools,
    width_pt: float,
    dot_pt: float,
    *,
    rasterized: bool,
) -> None:
    """Draw the visible pieces in their colors, the lowest value first, so that the highest is on top."""
    bins, tones = colored.bins(), color_map(colored)
    for kind, zorder in ((seen & ~colored.at_rest, 3.0), (seen & colored.at_rest, 3.5)):
        for number in np.unique(bins[kind]):
            colour = {OVER: LIGHT.over, UNDER: LIGHT.under}.get(int(number)) or tones(int(number))
            at = np.flatnonzero(kind & (bins == number))
            if zorder == 3.0:
                line = selected_lines(colored.line, at)
                draw_line(axes, line, viewport, zorder=zorder, rasterized=rasterized, color=colour, linewidth=width_pt)
            else:
                at = _distinct_dots(colored, at)
                draw_points(
                    axes,
                    np.column_stack([colored.line.x1[at], colored.line.y1[at]]),
                    zorder=zorder,
                    rasterized=rasterized,
                    color=colour,
                    marker="o",
                    markersize=dot_pt,
                    markeredgewidth=0.0,
                )


def _distinct_dots(colored: ColoredPath, at: Indices) -> Indices:
    """Return one of each group of coinciding dots."""
    places = np.round(np.column_stack([colored.line.x1[at], colored.line.y1[at]]), 6)
    return at[np.sort(np.unique(places, axis=0, return_index=True)[1])]


def draw_points(axes: Axes, points: Floats, *, zorder: float, rasterized: bool, **style: Any) -> None:
    """Draw markers."""
    drawn = Line2D(points[:, 0], points[:, 1], linestyle="none", zorder=zorder, **style)
    drawn.set_rasterized(rasterized)
    axes.add_line(drawn)


# Widths.

_CELLS = 64
_SAMPLES = 50_000
_OVERLAP = 1.5
"""Width of lines that are less than a pixel apart, in times of their distance, so that no gaps are visible."""
_THINNEST_PX, _THICKEST_PT = 0.4, 1.7


def width_pt(line: Line, viewport: Viewport) -> float:
    """Return a line width: half the distance of neighbouring lines if pixels can show that, else so that they touch."""
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
    count, cell_mm2 = _neighbour_counts(x, y, viewport)
    spacing = cell_mm2 / (count[count > 0] * total / _SAMPLES) * viewport.pt_per_mm
    typical = float(np.median(spacing)) if len(spacing) else _THICKEST_PT
    pixel = PT_PER_INCH / viewport.dpi
    width = max(typical / 2, min(_OVERLAP * typical, pixel))
    return float(np.clip(width, _THINNEST_PX * pixel, _THICKEST_PT))


def dot_pt(colored: ColoredPath, seen: Bools, viewport: Viewport) -> float:
    """Return the size of dots."""
    at = _distinct_dots(colored, np.flatnonzero(seen & colored.at_rest))
    count, cell_mm2 = _neighbour_counts(colored.line.x1[at], colored.line.y1[at], viewport)
    crowded = count[count > 0]
    spacing = float(np.median(np.sqrt(cell_mm2 / crowded))) * viewport.pt_per_mm if len(crowded) else np.inf
    return float(np.clip(spacing, 1.0, 8.0))


def too_close(points: Floats, viewport: Viewport, size_pt: float) -> bool:
    """Return whether most markers overlap another one."""
    cells = np.floor(points * (viewport.pt_per_mm / size_pt))
    return len(np.unique(cells, axis=0)) * 2 < len(points)


def _neighbour_counts(x: Floats, y: Floats, viewport: Viewport) -> tuple[Floats, float]:
    """Return the number of points in the cell of each visible point, and the area of a cell, mm2."""
    seen = (x >= viewport.x0) & (x <= viewport.x1) & (y >= viewport.y0) & (y <= viewport.y1)
    side_mm = max(viewport.x1 - viewport.x0, viewport.y1 - viewport.y0) / _CELLS
    across = ((x[seen] - viewport.x0) / side_mm).astype(np.intp)
    upwards = ((y[seen] - viewport.y0) / side_mm).astype(np.intp)
    cell = across * (_CELLS + 1) + upwards
    return np.bincount(cell)[cell].astype(np.float64), side_mm**2
