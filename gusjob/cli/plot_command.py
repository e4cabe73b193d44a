"""`gusjob plot`: pictures of the path."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gusjob.cli.common import (
    exit_code,
    file_argument,
    machine_option,
    need,
    refuse_terminal,
    scanner_option,
    show,
    write,
)
from gusjob.cli.define import define_option
from gusjob.cli.endings import output_format, output_path
from gusjob.cli.language import Command
from gusjob.cli.quiet import quiet_option
from gusjob.cli.standard_input import input_file, stdin_filename_option
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.pipeline import Simulated, simulate_file

if TYPE_CHECKING:
    from gusjob.config.machine import Scanner
    from gusjob.ir.overrides import Overrides
    from gusjob.view.plot.picture import PlotArea

_FORMATS = ("png", "svg", "pdf")
_ENDINGS = {f".{form}": form for form in _FORMATS}
_COLOURS = ("power", "energy", "velocity", "order")
_MM_PER_INCH = 25.4
_SIZE_MM = (297.0, 210.0)
_LEAST_MM, _MOST_MM = (160.0, 120.0), 2000.0
_DPI = 200
_PIXELS = 80_000_000
"""Limit of the size: a larger picture takes more memory than a path of a million segments."""
_LEAST_ZOOM_MM, _FARTHEST_MM = 1e-3, 1e5

Box = tuple[float, float, float, float]


def _size_mm(_context: click.Context, _parameter: click.Parameter, text: str | None) -> tuple[float, float]:
    """Parse width and height: 297x210, 297x210mm, 11.5x8in."""
    if text is None:
        return _SIZE_MM
    found = re.fullmatch(r"(\d{1,4}(?:\.\d{1,6})?)x(\d{1,4}(?:\.\d{1,6})?) ?(mm|in|)", text.strip(), re.ASCII)
    if not found:
        wrong = Phrase("{text} is not a size: write 297x210 (mm) or 11.5x8in", text=printable(text)[:40])
        raise click.BadParameter(localized(wrong))
    factor = _MM_PER_INCH if found[3] == "in" else 1.0
    size = float(found[1]) * factor, float(found[2]) * factor
    if size[0] < _LEAST_MM[0] or size[1] < _LEAST_MM[1] or max(size) > _MOST_MM:
        wrong = Phrase("the size of a picture is from 160 mm x 120 mm to 2000 mm x 2000 mm")
        raise click.BadParameter(localized(wrong))
    return size


def _zoom(_context: click.Context, _parameter: click.Parameter, box: Box | None) -> Box | None:
    """Check that the box has an area."""
    if box is None:
        return None
    x0, y0, x1, y1 = min(box[0], box[2]), min(box[1], box[3]), max(box[0], box[2]), max(box[1], box[3])
    if not all(abs(value) <= _FARTHEST_MM for value in box):  # NaN fails, too.
        raise click.BadParameter(localized(Phrase("coordinates are in mm, from -100000 to 100000")))
    if min(x1 - x0, y1 - y0) < _LEAST_ZOOM_MM:
        raise click.BadParameter(localized(Phrase("the box is at least 0.001 mm wide and high")))
    return x0, y0, x1, y1


@click.command(name="plot", cls=Command)
@file_argument
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(),
    callback=output_path,
    help="Write to this file: .png, .svg or .pdf. - is standard output.",
)
@machine_option
@scanner_option
@define_option
@stdin_filename_option
@click.option(
    "--format", "form", type=click.Choice(_FORMATS), help="Default: by the output file's extension, else png."
)
@click.option(
    "--by",
    type=click.Choice(_COLOURS),
    default=_COLOURS[0],
    show_default=True,
    help="Quantity that the colours show: emitted power, energy per mm, velocity, or time.",
)
@click.option("--channel", type=click.IntRange(0, 1), help="Draw this laser channel only. Default: all that emit.")
@click.option("--no-jumps", is_flag=True, help="Do not draw motion without emission: jumps, run-ins and run-outs.")
@click.option("--zoom", type=float, nargs=4, callback=_zoom, metavar="X0 Y0 X1 Y1", help="Show this box, mm.")
@click.option("--field", is_flag=True, help="Show the machine's whole field. Default: the path.")
@click.option(
    "--size",
    "size_mm",
    callback=_size_mm,
    metavar="WxH",
    show_default="297x210 mm",
    help="Size of the picture in mm, or in inches: 11.5x8in.",
)
@click.option(
    "--dpi",
    type=click.IntRange(50, 1200),
    default=_DPI,
    show_default=True,
    help="Pixels per inch. More pixels allow thinner lines in a dense path, in SVG and PDF too.",
)
@quiet_option
def command(
    path: Path,
    output: Path | None,
    machine_path: Path | None,
    scanner: Scanner | None,
    overrides: Overrides,
    stdin_filename: Path | None,
    form: str | None,
    by: str,
    channel: int | None,
    no_jumps: bool,
    zoom: Box | None,
    field: bool,
    size_mm: tuple[float, float],
    dpi: int,
) -> None:
    """Draw the path: emission, jumps, run-ins, run-outs, switch points and the field.

    With a scanner, emission is drawn where the beam is. A job with errors is not drawn; a listing with errors is.
    """
    form = output_format(form, output, _ENDINGS, bare=False)
    if zoom is not None and field:
        raise click.UsageError(localized(Phrase("--zoom and --field exclude each other")))
    size_in = size_mm[0] / _MM_PER_INCH, size_mm[1] / _MM_PER_INCH
    if size_in[0] * size_in[1] * dpi**2 > _PIXELS:
        wrong = Phrase("--size and --dpi give more than {most} million pixels", most=_PIXELS // 1_000_000)
        raise click.UsageError(localized(wrong))
    need("plot", "matplotlib", to=Phrase("draw a picture"))
    from gusjob.view.plot.picture import PlotArea

    refuse_terminal(form, output)
    file = input_file(path, stdin_filename)
    result = simulate_file(file.path, machine_path, scanner=scanner, data=file.data, overrides=overrides)
    if isinstance(result, Simulated):
        area = PlotArea(box_mm=zoom, field=field)
        write(
            [_drawn(result, form, by, channel, area, size_in, dpi, jumps=not no_jumps)],
            output,
            sources=result.inputs,
        )
    show(result, notes=not isinstance(result, Simulated))
    sys.exit(exit_code(result))


def _drawn(
    result: Simulated,
    form: str,
    by: str,
    channel: int | None,
    area: PlotArea,
    size_in: tuple[float, float],
    dpi: int,
    *,
    jumps: bool,
) -> bytes:
    """Draw the picture in a format."""
    from gusjob.view.plot.picture import ColorBy, figure_of, picture

    figure = figure_of(
        result.trace,
        result.machine,
        by=ColorBy(by),
        channel=channel,
        area=area,
        jumps=jumps,
        size_in=size_in,
        dpi=dpi,
    )
    return picture(figure, form)
