"""A picture of the path with the emission in color, for print and screen.

From top to bottom: title and totals, the panels with color bars and scale bars, the legend, and notes on what the
picture does not show.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from msgspec import Struct
from msgspec.structs import replace

from gusjob.config.machine import Machine
from gusjob.ir.overrides import overrides_text
from gusjob.report.rows import Report, make_report
from gusjob.simulate import Trace
from gusjob.view.palette import LIGHT
from gusjob.view.plot.captions import channel_totals, head, notes
from gusjob.view.plot.color_scale import ColorBy, ColoredPath, color_paths
from gusjob.view.plot.frame import Layout
from gusjob.view.plot.lines import (
    LINE_STYLES,
    MARKERS,
)
from gusjob.view.plot.panel import FIELD_DASHES, PlotPanel
from gusjob.view.plot.text import INK, line_in, put_text, shortened, showable, style, wrapped
from gusjob.view.strokes import Strokes, strokes_of

__all__ = ["ColorBy", "PlotArea", "figure_of", "picture"]

SIZE_IN = (297 / 25.4, 210 / 25.4)
"""A4, landscape."""
DPI = 200
_MARGIN = 0.05
_SMALL_MM = 1e-3


class PlotArea(Struct, frozen=True, kw_only=True):
    """The area to show: the whole path, or a box (x0, y0, x1, y1 in mm), or the machine's whole field.

    The picture shows more in the direction in which it is larger than the area.
    """

    box_mm: tuple[float, float, float, float] | None = None
    field: bool = False


_PATH = PlotArea()


def figure_of(
    trace: Trace,
    machine: Machine,
    *,
    by: ColorBy = ColorBy.POWER,
    channel: int | None = None,
    area: PlotArea = _PATH,
    jumps: bool = True,
    size_in: tuple[float, float] = SIZE_IN,
    dpi: int = DPI,
) -> Figure:
    """Draw a picture of a run.

    Args:
        trace: The run.
        machine: Its machine.
        by: Quantity that the colors show: emitted power (the mode's unit), energy per mm (J/mm with a prefix, or
            unit*ms/mm if the rated power is unknown), velocity (mm/s) or time (ms or s).
        channel: Only this channel; None: a panel for each channel with emission.
        area: The area to show.
        jumps: Whether to draw motion without emission.
        size_in: Width and height, inches.
        dpi: Pixels per inch, also of rasterized parts.
    """
    strokes = strokes_of(trace, machine, energy=by is ColorBy.ENERGY)
    report = make_report(trace, machine, marking=False)
    colored_paths = color_paths(strokes, by, channel)
    box = _area_box(strokes, colored_paths, machine, area, jumps=jumps)
    with style():
        figure = Figure(figsize=size_in, dpi=dpi, facecolor="white")
        layout = Layout(
            size_in=size_in,
            panels=max(len(colored_paths), 1),
            bars=bool(colored_paths),
            headed=len(colored_paths) > 1,
        ).fitted(box)
        viewport = layout.viewport(box, dpi)
        panels = [
            PlotPanel(strokes=strokes, machine=machine, trace=trace, colored=colored, viewport=viewport, jumps=jumps)
            for colored in colored_paths or (None,)
        ]
        totals, general_notes = head(report, colored_paths), notes(report, strokes, colored_paths, channel)
        # The notes take space from the panels, and depend on the size of the panels: the second pass is right.
        for _ in range(2):
            layout = _with_texts(layout, totals, general_notes, panels).fitted(box)
            if not layout.panel_boxes()[0].fits:
                count = len(_all_notes(general_notes, panels))
                remarks = "remark does" if count == 1 else "remarks do"
                layout = replace(layout, notes=(f"{count} {remarks} not fit: make the picture larger.",)).fitted(box)
            panels = [replace(panel, viewport=layout.viewport(box, dpi)) for panel in panels]
        for panel_box, panel in zip(layout.panel_boxes(), panels, strict=True):
            panel.draw(figure, panel_box, layout)
        _draw_texts(figure, layout, report, colored_paths)
    return figure


def _with_texts(layout: Layout, totals: list[str], general_notes: list[str], panels: list[PlotPanel]) -> Layout:
    """Return a layout with the texts around the panels."""
    all_notes = _all_notes(general_notes, panels)
    return replace(
        layout,
        head=tuple(line for text in totals for line in wrapped(text, 8.5, layout.text_in)),
        notes=tuple(line for text in all_notes for line in wrapped(text, 8, layout.text_in)),
        legend=tuple(dict.fromkeys(name for panel in panels for name in panel.legend())),
    )


def _all_notes(general_notes: list[str], panels: list[PlotPanel]) -> list[str]:
    return list(dict.fromkeys([*general_notes, *(note for panel in panels for note in panel.notes())]))


def picture(figure: Figure, form: str) -> bytes:
    """Write a figure as png, svg or pdf; the same figure gives the same bytes."""
    about: dict[str, dict[str, str | None]] = {
        "png": {"Software": "gusjob"},
        "svg": {"Creator": "gusjob", "Date": None},
        "pdf": {"Creator": "gusjob", "Producer": None, "CreationDate": None},
    }
    out = BytesIO()
    with style():
        figure.savefig(out, format=form, dpi=figure.dpi, metadata=about[form])
    return out.getvalue()


def _area_box(
    strokes: Strokes, colored_paths: Sequence[ColoredPath], machine: Machine, area: PlotArea, *, jumps: bool
) -> tuple[float, float, float, float]:
    """Return the box to show, mm; with a margin, unless `area` is a box."""
    if area.box_mm is not None:
        return area.box_mm
    lines = [colored.line for colored in colored_paths]
    if jumps or not colored_paths:
        lines.append(strokes.path)
    x = np.concatenate([side for line in lines for side in (line.x0, line.x1)])
    y = np.concatenate([side for line in lines for side in (line.y0, line.y1)])
    if area.field or not len(x):
        (x0, x1), (y0, y1) = machine.field_x_mm, machine.field_y_mm
    else:
        x0, x1, y0, y1 = float(x.min()), float(x.max()), float(y.min()), float(y.max())
    edge = _MARGIN * max(x1 - x0, y1 - y0)
    edge = edge if edge > _SMALL_MM * _MARGIN else 0.5  # A single point is shown with 1 mm around it.
    return x0 - edge, y0 - edge, x1 + edge, y1 + edge


def _draw_texts(figure: Figure, layout: Layout, report: Report, colored_paths: Sequence[ColoredPath]) -> None:
    """Write title, totals, legend and notes."""
    x, y = layout.left_in, layout.size_in[1] - 0.12 - line_in(12)
    job = f"{report.job}  -D {overrides_text(report.overrides)}" if report.overrides else report.job
    title = shortened(showable(job) or "job", 12, layout.text_in, "bold")
    put_text(figure, x, y + 0.04, title, 12, color=INK, weight="bold")
    for number, line in enumerate(layout.head):
        put_text(figure, x, y - (number + 1) * line_in(8.5), line, 8.5)
    if len(colored_paths) > 1:
        for panel_box, colored in zip(layout.panel_boxes(), colored_paths, strict=True):
            text = shortened(channel_totals(report, colored), 8.5, panel_box.right_in - panel_box.x_in, "bold")
            put_text(
                figure, panel_box.x_in, panel_box.y_in + panel_box.height_in + 0.07, text, 8.5, color=INK, weight="bold"
            )
    for number, line in enumerate(layout.notes):
        put_text(figure, x, layout.notes_in - (number + 1) * line_in(8) + 0.03, line, 8)
    for name, (at_x, at_y) in layout.legend_positions():
        figure.add_artist(_legend_sample(figure, name, at_x, at_y))
        put_text(figure, at_x + 0.42, at_y - 0.035, name, 8)


def _legend_sample(figure: Figure, word: str, x_in: float, y_in: float) -> Line2D:
    """Return the line or marker of an entry of the legend."""
    line_style: dict[str, Any] = {"linestyle": "none", "markeredgecolor": INK, **MARKERS.get(word, {})}
    if word == "emission at rest":
        line_style = {"linestyle": "none", "marker": "o", "color": LIGHT.single, "markersize": 7, "markeredgewidth": 0}
    elif word not in MARKERS:
        line_style = (
            {"color": INK, "linewidth": 0.8, "dashes": FIELD_DASHES[1]} if word == "field" else dict(LINE_STYLES[word])
        )
        line_style["linestyle"] = (0, line_style.pop("dashes")) if "dashes" in line_style else "-"
    x = [x_in + 0.2] if "marker" in line_style else [x_in, x_in + 0.36]
    return Line2D(x, [y_in] * len(x), transform=figure.dpi_scale_trans, **line_style)
