"""The frame of a picture: positions of its parts, axes in mm, color bars and scale bars."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator
from msgspec import Struct
from msgspec.structs import replace

from gusjob.i18n.phrases import figure as figure_text
from gusjob.view.color_range import label, labelled
from gusjob.view.plot.color_scale import ColoredPath
from gusjob.view.plot.lines import PT_PER_INCH, Viewport, color_map, norm
from gusjob.view.plot.text import FAINT, INK, line_in, put_text, width_in

_LEFT, _RIGHT, _TOP, _BOTTOM = 0.8, 0.25, 0.12, 0.12
_BAR = 1.1
"""Width of a color bar with its labels."""
_HEADING = 0.26
_TICKS = 0.52
"""Height below the axes: tick labels, then the axis' name and the scale bar."""
_LEGEND_ROW = 0.21
_LEAST = 0.4
_UM_BELOW_MM = 1.1
"""Paths up to this size, with their margin, are labelled in um."""
_EDGE, _GRID = "#8c959f", "#e6e8eb"
_DISTINCT = 8
"""Up to so many values are labelled individually on a color bar."""
_MAX_SAMPLES = 10_000
_ARROW, _MOST_ARROW = 0.05, 0.2
"""Height of the arrows of a color bar, as a share of it: with a line of text above the tick's, within these limits."""


class PanelBox(Struct, frozen=True, kw_only=True):
    """Position of a panel's axes, inches from the lower left corner of the picture.

    `right_in`: right end of the panel, with its color bar. `fits`: whether the picture is large enough for it.
    """

    x_in: float
    y_in: float
    width_in: float
    height_in: float
    right_in: float
    fits: bool


class Layout(Struct, frozen=True, kw_only=True):
    """Positions of all parts of a picture, inches from the lower left corner."""

    size_in: tuple[float, float]
    panels: int
    bars: bool
    headed: bool
    columns: int = 1
    head: tuple[str, ...] = ("", "")
    notes: tuple[str, ...] = ()
    legend: tuple[str, ...] = ()

    @property
    def left_in(self) -> float:
        """Left edge of texts."""
        return 0.25

    @property
    def text_in(self) -> float:
        """Maximum width of a line of text."""
        return self.size_in[0] - self.left_in - _RIGHT

    @property
    def notes_in(self) -> float:
        """Upper edge of the notes."""
        return _BOTTOM + len(self.notes) * line_in(8)

    def panel_boxes(self) -> list[PanelBox]:
        """Return the panels, row by row."""
        rows = -(-self.panels // self.columns)
        below = self.notes_in + 0.08 + len(self._legend_rows()) * _LEGEND_ROW
        above = _TOP + line_in(12) + len(self.head) * line_in(8.5) + 0.1
        width = self.size_in[0] / self.columns
        height = (self.size_in[1] - below - above) / rows
        heading = _HEADING if self.headed else 0.0
        found = []
        for number in range(self.panels):
            row, column = divmod(number, self.columns)
            bottom = below + (rows - 1 - row) * height + _TICKS
            found.append(
                PanelBox(
                    x_in=column * width + _LEFT,
                    y_in=bottom,
                    width_in=max(width - _LEFT - (_BAR if self.bars else 0.0) - _RIGHT, _LEAST),
                    height_in=max(height - _TICKS - heading, _LEAST),
                    fits=height - _TICKS - heading >= _LEAST,
                    right_in=(column + 1) * width - _RIGHT,
                )
            )
        return found

    def viewport(self, box: tuple[float, float, float, float], dpi: int) -> Viewport:
        """Return the viewport of the axes that shows a box, mm."""
        panel = self.panel_boxes()[0]
        x0, y0, x1, y1 = box
        in_per_mm = min(panel.width_in / (x1 - x0), panel.height_in / (y1 - y0))
        x, y = (x0 + x1) / 2, (y0 + y1) / 2
        wide, high = panel.width_in / in_per_mm / 2, panel.height_in / in_per_mm / 2
        return Viewport(
            x0=x - wide,
            y0=y - high,
            x1=x + wide,
            y1=y + high,
            pt_per_mm=in_per_mm * PT_PER_INCH,
            dpi=dpi,
            small=max(x1 - x0, y1 - y0) < _UM_BELOW_MM,
        )

    def fitted(self, box: tuple[float, float, float, float]) -> Layout:
        """Return the layout with the number of panels side by side that shows a box largest."""
        layouts = [replace(self, columns=count) for count in range(1, self.panels + 1)]
        return max(layouts, key=lambda layout: layout.viewport(box, 1).pt_per_mm)

    def legend_positions(self) -> list[tuple[str, tuple[float, float]]]:
        """Return the entries of the legend with their positions."""
        rows = self._legend_rows()
        top = self.notes_in + 0.08 + len(rows) * _LEGEND_ROW
        return [
            (word, (self.left_in + x, top - (number + 0.5) * _LEGEND_ROW))
            for number, row in enumerate(rows)
            for word, x in row
        ]

    def _legend_rows(self) -> list[list[tuple[str, float]]]:
        """Return the entries of the legend with their x positions, in rows that fit."""
        rows: list[list[tuple[str, float]]] = []
        x = math.inf
        for word in self.legend:
            wide = 0.42 + width_in(word, 8) + 0.3
            if x + wide - 0.3 > self.text_in:
                rows.append([])
                x = 0.0
            rows[-1].append((word, x))
            x += wide
        return rows


def set_axes(figure: Figure, panel: PanelBox, viewport: Viewport, size_in: tuple[float, float]) -> Axes:
    """Add axes in mm, or in um for a path below one mm."""
    wide, high = size_in
    axes = figure.add_axes((panel.x_in / wide, panel.y_in / high, panel.width_in / wide, panel.height_in / high))
    axes.set_xlim(viewport.x0, viewport.x1)
    axes.set_ylim(viewport.y0, viewport.y1)
    axes.set_autoscale_on(False)
    factor, unit = (1000.0, "um") if viewport.small else (1.0, "mm")
    axes.set_axisbelow(True)
    axes.grid(color=_GRID, linewidth=0.6)
    for spine in axes.spines.values():
        spine.set(edgecolor=_EDGE, linewidth=0.8, zorder=3.9)
    axes.tick_params(color=_EDGE, labelcolor=FAINT, labelsize=8, length=3)
    for axis, inches in ((axes.xaxis, panel.width_in / 0.9), (axes.yaxis, panel.height_in / 0.45)):
        axis.set_major_locator(MaxNLocator(nbins=max(min(int(inches), 12), 2), steps=[1, 2, 5, 10]))
        axis.set_major_formatter(FuncFormatter(lambda value, _: figure_text(round(value * factor, 9), 10)))
    put_text(figure, panel.x_in, panel.y_in - 0.42, f"X, {unit}", 8.5, color=INK)
    put_text(
        figure,
        panel.x_in - 0.6,
        panel.y_in + panel.height_in / 2,
        f"Y, {unit}",
        8.5,
        color=INK,
        rotation=90,
        va="center",
    )
    _scale_bar(figure, panel, viewport, factor, unit)
    return axes


def _scale_bar(figure: Figure, panel: PanelBox, viewport: Viewport, factor: float, unit: str) -> None:
    """Draw a scale bar of a round length below the axes, on the right."""
    most = panel.width_in / 4 * PT_PER_INCH / viewport.pt_per_mm * factor
    power = 10.0 ** math.floor(math.log10(most))
    length = next(power * step for step in (5, 2, 1) if power * step <= most)
    right, y = panel.x_in + panel.width_in, panel.y_in - 0.37
    left = right - length / factor * viewport.pt_per_mm / PT_PER_INCH
    bar = Line2D([left, left, left, right, right, right], [y + 0.04, y - 0.04, y, y, y - 0.04, y + 0.04])
    bar.set(transform=figure.dpi_scale_trans, color=INK, linewidth=1.2, solid_capstyle="butt", gid="scale-bar")
    figure.add_artist(bar)
    put_text(figure, left - 0.08, y - 0.04, f"{figure_text(length)} {unit}", 8, color=INK, ha="right")


def color_bar(figure: Figure, panel: PanelBox, colored: ColoredPath, size_in: tuple[float, float]) -> None:
    """Add a color bar with labelled ends; arrows mean that there are values beyond them."""
    ends = colored.range
    if ends.is_empty:
        return
    wide, high = size_in
    place = (panel.x_in + panel.width_in + 0.14, panel.y_in, 0.15, panel.height_in)
    axes = figure.add_axes((place[0] / wide, place[1] / high, place[2] / wide, place[3] / high), label="colours")
    mappable = ScalarMappable(norm(colored), color_map(colored))
    extend: Literal["neither", "min", "max", "both"] = (
        ("both" if ends.has_lower else "max") if ends.has_higher else "min" if ends.has_lower else "neither"
    )
    bar = figure.colorbar(
        mappable, cax=axes, extend=extend, extendfrac=min(max(1.7 * line_in(8) / panel.height_in, _ARROW), _MOST_ARROW)
    )
    if bar.solids is not None:
        bar.solids.set_edgecolor("face")
        bar.solids.set_rasterized(False)
    bar.outline.set(edgecolor=_EDGE, linewidth=0.8)
    ticks = _bar_ticks(colored, panel.height_in)
    bar.ax.yaxis.set_major_locator(FixedLocator(ticks))
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: label(value)))
    bar.ax.minorticks_off()
    bar.ax.tick_params(color=_EDGE, labelcolor=FAINT, labelsize=8, length=3)
    up = panel.height_in
    beyond = [
        *[(f"> {label(ends.high)}", up - line_in(8) * 0.8), (f"max {label(ends.most)}", up + 0.05)] * ends.has_higher,
        *[(f"< {label(ends.low)}", 0.0), (f"min {label(ends.least)}", -line_in(8) + 0.01)] * ends.has_lower,
    ]
    for text, at in beyond:
        put_text(figure, place[0] + (0.15 + 0.06 if 0 <= at < up else 0.0), place[1] + at, text, 8)
    wide_texts = [*(label(tick) for tick in ticks), *(text for text, _ in beyond[::2])]
    beside = place[0] + 0.15 + 0.18 + max(width_in(text, 8) for text in wide_texts)
    name = f"{colored.label}, {colored.unit}"
    if width_in(name, 8.5) > panel.height_in + _TICKS:
        name = f"{colored.label},\n{colored.unit}"
    middle = panel.y_in + panel.height_in / 2
    put_text(figure, beside, middle, name, 8.5, color=INK, rotation=90, va="center", multialignment="center")


def _bar_ticks(colored: ColoredPath, height_in: float) -> list[float]:
    """Return the ticks of a color bar: both ends, and round values between them, or all values if they are few."""
    ends = colored.range
    if ends.is_single:
        return [ends.high]
    room = (ends.high - ends.low) * 0.22 / height_in
    values = np.unique(colored.value[:: max(len(colored.value) // _MAX_SAMPLES, 1)]).tolist()
    if len(values) > _DISTINCT or min(np.diff(values), default=0.0) < room:
        count = max(min(int(height_in / 0.5), 10), 2)
        values = list(MaxNLocator(nbins=count, steps=[1, 2, 5, 10]).tick_values(ends.low, ends.high))
    return labelled(ends.low, ends.high, (v for v in values if ends.low + room < v < ends.high - room))
