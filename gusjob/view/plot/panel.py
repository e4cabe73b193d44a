"""A panel of a picture: the path with the emission of one channel in color."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.kinematics.arrays import Bools, Floats
from gusjob.simulate import Trace
from gusjob.simulate.kinds import SegmentKind
from gusjob.view.plot.color_scale import ColoredPath, switch_points, uncolored_strokes
from gusjob.view.plot.frame import Layout, PanelBox, color_bar, set_axes
from gusjob.view.plot.lines import (
    LINE_STYLES,
    MARKERS,
    Viewport,
    dot_pt,
    draw_colored,
    draw_line,
    draw_points,
    selected_lines,
    too_close,
    width_pt,
)
from gusjob.view.plot.text import INK
from gusjob.view.strokes import Strokes

RASTER_STROKES = 20_000
"""A path with more visible strokes is rasterized in SVG and PDF too."""
MAX_SWITCHES = 800
"""Maximum number of switch points that are drawn."""
MAX_DASHED = 100_000
"""Maximum number of strokes that are drawn with dashes."""
FIELD_DASHES = (0, (7, 4))


class PlotPanel(Struct, frozen=True, kw_only=True):
    """One panel. `colored`: None without emission. `jumps`: whether motion without emission is drawn."""

    strokes: Strokes
    machine: Machine
    trace: Trace
    colored: ColoredPath | None
    viewport: Viewport
    jumps: bool

    def draw(self, figure: Figure, panel_box: PanelBox, layout: Layout) -> None:
        """Draw the panel."""
        axes = set_axes(figure, panel_box, self.viewport, layout.size_in)
        self._draw_field(axes)
        raster = self._is_rasterized()
        many = self._count() > MAX_DASHED
        for word, mask in self._uncolored().items():
            line_style = dict(LINE_STYLES[word])
            if many:
                line_style.pop("dashes", None)
                line_style |= {"linewidth": 0.25, "solid_capstyle": "butt"}
            line = selected_lines(self.strokes.path, np.flatnonzero(mask))
            line_style["linewidth"] = min(line_style["linewidth"], width_pt(line, self.viewport))
            zorder = 2.0 + 0.1 * list(LINE_STYLES)[::-1].index(word)
            draw_line(axes, line, self.viewport, zorder=zorder, rasterized=raster, **line_style)
        if self.colored is None:
            return
        seen = self.viewport.of(self.colored.line)
        moves = selected_lines(self.colored.line, np.flatnonzero(seen & ~self.colored.at_rest))
        dot = dot_pt(self.colored, seen, self.viewport)
        width = width_pt(moves, self.viewport)
        draw_colored(axes, self.colored, self.viewport, seen, width, dot, rasterized=raster)
        if not self._switches_unreadable():
            for word, points in self._switches().items():
                draw_points(axes, points, zorder=4.0, rasterized=False, markeredgecolor=INK, **MARKERS[word])
        color_bar(figure, panel_box, self.colored, layout.size_in)

    def legend(self) -> list[str]:
        """Return the entries of the legend."""
        found = [word for word, mask in self._uncolored().items() if mask.any()]
        if self.colored is not None:
            if (self.viewport.of(self.colored.line) & self.colored.at_rest).any():
                found.append("emission at rest")
            if not self._switches_unreadable():
                found += [word for word, points in self._switches().items() if len(points)]
        return [*found, *["field"] * self._field_is_visible()]

    def notes(self) -> list[str]:
        """Return notes on what the panel does not show."""
        found, count = [], self._count()
        if self._switches_unreadable():
            number = sum(map(len, self._switches().values()))
            found.append(f"{number:,} switch points are not drawn: they are too many or too close together.")
        if count >= RASTER_STROKES:
            found.append(f"The path is rasterized, in SVG and PDF too: {count:,} strokes.")
        if count > MAX_DASHED and self.jumps:
            found.append("Jumps, run-ins and run-outs are drawn without dashes: there are too many.")
        return found

    def _is_rasterized(self) -> bool:
        """Return whether the path is rasterized in every format."""
        return self._count() >= RASTER_STROKES

    def _uncolored(self) -> dict[str, Bools]:
        """Return the visible strokes that are not colored, by line style."""
        off, other = uncolored_strokes(self.strokes, self.colored)
        kind = self.trace.kind[self.strokes.row]
        seen = self.viewport.of(self.strokes.path)
        found = {"commanded path": ~off & ~other & seen} if self.strokes.beam is not None else {}
        found["other emission"] = other & seen
        if self.jumps:
            off = off & seen & (self.strokes.duration_ms > 0) & ~self.trace.schedule.dwell[self.strokes.row]
            found["jump"] = off & (kind != SegmentKind.RUN_IN) & (kind != SegmentKind.RUN_OUT)
            found["run-in"], found["run-out"] = off & (kind == SegmentKind.RUN_IN), off & (kind == SegmentKind.RUN_OUT)
        return found

    def _count(self) -> int:
        """Return the number of visible strokes."""
        emission = 0 if self.colored is None else int(self.viewport.of(self.colored.line).sum())
        return emission + sum(int(mask.sum()) for mask in self._uncolored().values())

    def _switches(self) -> dict[str, Floats]:
        """Return the visible switch points, by marker."""
        if self.colored is None:
            return {}
        viewport, found = self.viewport, {}
        for word, points in zip(MARKERS, switch_points(self.strokes, self.colored), strict=True):
            x, y = points[:, 0], points[:, 1]
            found[word] = points[(x >= viewport.x0) & (x <= viewport.x1) & (y >= viewport.y0) & (y <= viewport.y1)]
        return found

    def _switches_unreadable(self) -> bool:
        """Return whether there are too many switch points, or they are too close together."""
        found = self._switches()
        if sum(map(len, found.values())) > MAX_SWITCHES:
            return True
        return any(too_close(points, self.viewport, MARKERS[word]["markersize"]) for word, points in found.items())

    def _draw_field(self, axes: Axes) -> None:
        """Draw the limits of the machine's field."""
        (x0, x1), (y0, y1) = self.machine.field_x_mm, self.machine.field_y_mm
        axes.add_patch(
            Rectangle(
                (x0, y0), x1 - x0, y1 - y0, fill=False, edgecolor=INK, linewidth=0.8, linestyle=FIELD_DASHES, zorder=1
            )
        )

    def _field_is_visible(self) -> bool:
        """Return whether a limit of the field is visible."""
        (x0, x1), (y0, y1), at = self.machine.field_x_mm, self.machine.field_y_mm, self.viewport
        across = x0 < at.x1 and x1 > at.x0 and (at.y0 < y0 < at.y1 or at.y0 < y1 < at.y1)
        upright = y0 < at.y1 and y1 > at.y0 and (at.x0 < x0 < at.x1 or at.x0 < x1 < at.x1)
        return across or upright
