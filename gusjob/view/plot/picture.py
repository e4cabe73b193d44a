"""A picture of the path: what the light does where, for print and screen.

From top to bottom: title and totals, the path in mm with a colour bar, scale bar and legend, and in sentences what the
picture does not show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from gusjob.config.machine import Machine
from gusjob.ir.intent import RunKind
from gusjob.kinematics.arrays import Bools, Floats
from gusjob.report.rows import Report, make_report
from gusjob.simulate import Trace
from gusjob.view.plot import pens
from gusjob.view.plot.frame import Cell, Layout, colour_bar, set_axes
from gusjob.view.plot.lettering import INK, line_in, put, shortened, showable, style, wrapped
from gusjob.view.plot.pens import DARK, MARKERS, Sight
from gusjob.view.plot.shades import Colour, Shade, dark_of, shades_of, switch_points
from gusjob.view.plot.words import channel_totals, head, notes
from gusjob.view.strokes import Strokes, strokes_of

__all__ = ["Colour", "View", "figure_of", "picture"]

SIZE_IN = (297 / 25.4, 210 / 25.4)
"""A4, landscape."""
DPI = 200
RASTER_STROKES = 20_000
"""From so many strokes in sight on, they are pixels in SVG and PDF too."""
SWITCHES = 800
"""So many switch points can be read at most."""
DASHED = 100_000
"""So many strokes are dashed; dashes of more can't be told apart."""

_MARGIN = 0.05
_SMALL_MM = 1e-3
_FIELD = (0, (7, 4))
_DOT = "#2a788e"


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """What is to be seen: the whole path, or a box (x0, y0, x1, y1 in mm), or the machine's whole field.

    More is shown in the direction in which the picture has more room.
    """

    box_mm: tuple[float, float, float, float] | None = None
    field: bool = False


_PATH = View()


def figure_of(
    trace: Trace,
    machine: Machine,
    *,
    by: Colour = Colour.POWER,
    channel: int | None = None,
    view: View = _PATH,
    jumps: bool = True,
    size_in: tuple[float, float] = SIZE_IN,
    dpi: int = DPI,
) -> Figure:
    """A picture of a run.

    `by`: what colours tell: emitted power (the mode's unit), energy per mm (J/mm with a prefix, or unit*ms/mm where the
    rated power is unknown), velocity (mm/s) or time (ms or s). `channel`: only this one; None: a panel for each that
    shines. `jumps`: whether motion without light is drawn. `size_in`: width and height, inches; `dpi`: pixels per inch,
    also of what is rasterized.
    """
    strokes = strokes_of(trace, machine)
    report = make_report(trace, machine, marking=False)
    shades = shades_of(strokes, by, channel)
    box = _box(strokes, shades, machine, view, jumps=jumps)
    with style():
        figure = Figure(figsize=size_in, dpi=dpi, facecolor="white")
        totals = head(report, shades)
        layout = Layout(size_in=size_in, panels=max(len(shades), 1), bars=bool(shades), headed=len(shades) > 1)
        layout = layout.fitted(box)
        drawings = [
            _Drawing(strokes=strokes, machine=machine, trace=trace, shade=shade, sight=layout.sight(box, dpi))
            for shade in shades or (None,)
        ]
        general = notes(report, strokes, shades, channel)
        # What is said below takes room, and what is to be said hangs on the room: the second round has it right.
        for _ in range(2):
            said = list(dict.fromkeys([*general, *(note for d in drawings for note in d.notes(jumps=jumps))]))
            words = list(dict.fromkeys(word for d in drawings for word in d.words(jumps=jumps)))
            layout = replace(
                layout,
                head=tuple(line for text in totals for line in wrapped(text, 8.5, layout.text_in)),
                notes=tuple(line for text in said for line in wrapped(text, 8, layout.text_in)),
                legend=tuple(words),
            ).fitted(box)
            if not layout.cells()[0].fits:
                count = len(said)
                layout = replace(
                    layout, notes=(f"{count} remark{'s' * (count != 1)} on this picture: make it larger.",)
                )
                layout = layout.fitted(box)
            drawings = [replace(d, sight=layout.sight(box, dpi)) for d in drawings]
        for cell, drawing in zip(layout.cells(), drawings, strict=True):
            drawing.draw(figure, cell, layout, jumps=jumps)
        _letter(figure, layout, report, shades)
    return figure


def picture(figure: Figure, form: str) -> bytes:
    """A figure as png, svg or pdf; the same figure gives the same bytes."""
    about: dict[str, dict[str, str | None]] = {
        "png": {"Software": "gusjob"},
        "svg": {"Creator": "gusjob", "Date": None},
        "pdf": {"Creator": "gusjob", "Producer": None, "CreationDate": None},
    }
    out = BytesIO()
    with style():
        figure.savefig(out, format=form, dpi=figure.dpi, metadata=about[form])
    return out.getvalue()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Drawing:
    """One panel. `shade`: None where nothing shines."""

    strokes: Strokes
    machine: Machine
    trace: Trace
    shade: Shade | None
    sight: Sight

    def draw(self, figure: Figure, cell: Cell, layout: Layout, *, jumps: bool) -> None:
        """All of it, from what lies below to what lies on top."""
        axes = set_axes(figure, cell, self.sight, layout.size_in)
        self._field(axes)
        raster = self.rasterized(jumps=jumps)
        many = self._count(jumps=jumps) > DASHED
        for word, mask in self._dark(jumps=jumps).items():
            look = dict(DARK[word])
            if many:
                look.pop("dashes", None)
                look |= {"linewidth": 0.25, "solid_capstyle": "butt"}
            line = pens.part(self.strokes.path, np.flatnonzero(mask))
            look["linewidth"] = min(look["linewidth"], pens.width_pt(line, self.sight))
            zorder = 2.0 + 0.1 * list(DARK)[::-1].index(word)
            pens.draw(axes, line, self.sight, zorder=zorder, rasterized=raster, **look)
        if self.shade is None:
            return
        seen = self.sight.of(self.shade.line)
        moves = pens.part(self.shade.line, np.flatnonzero(seen & ~self.shade.stands))
        dot = pens.dot_pt(self.shade, seen, self.sight)
        width = pens.width_pt(moves, self.sight)
        pens.draw_light(axes, self.shade, self.sight, seen, width, dot, rasterized=raster)
        if not self._left_out():
            for word, points in self._switches().items():
                pens.draw_points(axes, points, zorder=4.0, rasterized=False, markeredgecolor=INK, **MARKERS[word])
        colour_bar(figure, cell, self.shade, layout.size_in)

    def words(self, *, jumps: bool) -> list[str]:
        """What the legend has to tell."""
        found = [word for word, mask in self._dark(jumps=jumps).items() if mask.any()]
        if self.shade is not None:
            if (self.sight.of(self.shade.line) & self.shade.stands).any():
                found.append("light at rest")
            if not self._left_out():
                found += [word for word, points in self._switches().items() if len(points)]
        return [*found, *["field"] * self._field_in_sight()]

    def notes(self, *, jumps: bool) -> list[str]:
        """What the picture does not show."""
        found, count = [], self._count(jumps=jumps)
        if self._left_out():
            number = sum(map(len, self._switches().values()))
            found.append(f"{number:,} switch points are left out: they are too many or too close to be read.")
        if count >= RASTER_STROKES:
            found.append(f"The path is made of pixels, in SVG and PDF too: {count:,} strokes.")
        if count > DASHED and jumps:
            found.append("So many jumps, run-ins and run-outs are drawn without dashes.")
        return found

    def rasterized(self, *, jumps: bool) -> bool:
        """Whether the path is made of pixels in every format."""
        return self._count(jumps=jumps) >= RASTER_STROKES

    def _dark(self, *, jumps: bool) -> dict[str, Bools]:
        """Strokes in sight that are not coloured, by what they are."""
        dark, other = dark_of(self.strokes, self.shade)
        run = np.full(len(dark), RunKind.NONE) if self.trace.run_kind is None else self._intent()
        seen = self.sight.of(self.strokes.path)
        found = {"commanded path": ~dark & ~other & seen} if self.strokes.beam is not None else {}
        found["other light"] = other & seen
        if jumps:
            dark = dark & seen & (self.strokes.duration_ms > 0) & ~self.trace.schedule.dwell[self.strokes.row]
            found["jump"] = dark & (run != RunKind.RUN_IN) & (run != RunKind.RUN_OUT)
            found["run-in"], found["run-out"] = dark & (run == RunKind.RUN_IN), dark & (run == RunKind.RUN_OUT)
        return found

    def _intent(self) -> npt.NDArray[Any]:
        assert self.trace.run_kind is not None
        return np.asarray(self.trace.run_kind[self.strokes.row])

    def _count(self, *, jumps: bool) -> int:
        """Strokes in sight."""
        light = 0 if self.shade is None else int(self.sight.of(self.shade.line).sum())
        return light + sum(int(mask.sum()) for mask in self._dark(jumps=jumps).values())

    def _switches(self) -> dict[str, Floats]:
        """Switch points in sight."""
        if self.shade is None:
            return {}
        sight, found = self.sight, {}
        for word, points in zip(MARKERS, switch_points(self.strokes, self.shade), strict=True):
            x, y = points[:, 0], points[:, 1]
            found[word] = points[(x >= sight.x0) & (x <= sight.x1) & (y >= sight.y0) & (y <= sight.y1)]
        return found

    def _left_out(self) -> bool:
        """Whether switch points can't be read."""
        found = self._switches()
        if sum(map(len, found.values())) > SWITCHES:
            return True
        return any(pens.too_close(points, self.sight, MARKERS[word]["markersize"]) for word, points in found.items())

    def _field(self, axes: Axes) -> None:
        """The limits of the machine's field."""
        (x0, x1), (y0, y1) = self.machine.field_x_mm, self.machine.field_y_mm
        axes.add_patch(
            Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, edgecolor=INK, linewidth=0.8, linestyle=_FIELD, zorder=1)
        )

    def _field_in_sight(self) -> bool:
        """Whether any of its limits is to be seen."""
        (x0, x1), (y0, y1), at = self.machine.field_x_mm, self.machine.field_y_mm, self.sight
        across = x0 < at.x1 and x1 > at.x0 and (at.y0 < y0 < at.y1 or at.y0 < y1 < at.y1)
        upright = y0 < at.y1 and y1 > at.y0 and (at.x0 < x0 < at.x1 or at.x0 < x1 < at.x1)
        return across or upright


def _box(
    strokes: Strokes, shades: Sequence[Shade], machine: Machine, view: View, *, jumps: bool
) -> tuple[float, float, float, float]:
    """What must be seen, mm, without a margin where it was asked for by numbers."""
    if view.box_mm is not None:
        return view.box_mm
    lines = [shade.line for shade in shades]
    if jumps or not shades:
        lines.append(strokes.path)
    x = np.concatenate([side for line in lines for side in (line.x0, line.x1)])
    y = np.concatenate([side for line in lines for side in (line.y0, line.y1)])
    if view.field or not len(x):
        (x0, x1), (y0, y1) = machine.field_x_mm, machine.field_y_mm
    else:
        x0, x1, y0, y1 = float(x.min()), float(x.max()), float(y.min()), float(y.max())
    edge = _MARGIN * max(x1 - x0, y1 - y0)
    edge = edge if edge > _SMALL_MM * _MARGIN else 0.5  # A point alone is shown with a mm around it.
    return x0 - edge, y0 - edge, x1 + edge, y1 + edge


def _letter(figure: Figure, layout: Layout, report: Report, shades: Sequence[Shade]) -> None:
    """Title, totals, legend and sentences."""
    x, y = layout.left_in, layout.size_in[1] - 0.12 - line_in(12)
    name = shortened(showable(report.job) or "job", 12, layout.text_in, "bold")
    put(figure, x, y + 0.04, name, 12, color=INK, weight="bold")
    for number, line in enumerate(layout.head):
        put(figure, x, y - (number + 1) * line_in(8.5), line, 8.5)
    if len(shades) > 1:
        for cell, shade in zip(layout.cells(), shades, strict=True):
            text = shortened(channel_totals(report, shade), 8.5, cell.right_in - cell.x_in, "bold")
            put(figure, cell.x_in, cell.y_in + cell.height_in + 0.07, text, 8.5, color=INK, weight="bold")
    for number, line in enumerate(layout.notes):
        put(figure, x, layout.notes_in - (number + 1) * line_in(8) + 0.03, line, 8)
    for word, (at_x, at_y) in layout.legend_places():
        figure.add_artist(_sample(figure, word, at_x, at_y))
        put(figure, at_x + 0.42, at_y - 0.035, word, 8)


def _sample(figure: Figure, word: str, x_in: float, y_in: float) -> Line2D:
    """A legend's line or marker."""
    look: dict[str, Any] = {"linestyle": "none", "markeredgecolor": INK, **MARKERS.get(word, {})}
    if word == "light at rest":
        look = {"linestyle": "none", "marker": "o", "color": _DOT, "markersize": 7, "markeredgewidth": 0}
    elif word not in MARKERS:
        look = {"color": INK, "linewidth": 0.8, "dashes": _FIELD[1]} if word == "field" else dict(DARK[word])
        look["linestyle"] = (0, look.pop("dashes")) if "dashes" in look else "-"
    x = [x_in + 0.2] if "marker" in look else [x_in, x_in + 0.36]
    return Line2D(x, [y_in] * len(x), transform=figure.dpi_scale_trans, **look)
