"""Text in pictures: fonts, widths, line breaks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, fontManager, get_font
from matplotlib.textpath import text_to_path

from gusjob.i18n.phrases import printable
from gusjob.view.palette import LIGHT

INK, FAINT = LIGHT.ink, "#57606a"
LINE_SPACING = 1.35
_FAMILY = "DejaVu Sans"
_OTHERS = (
    "Noto Sans CJK SC",
    "Noto Sans SC",
    "Source Han Sans SC",
    "Source Han Sans CN",
    "Microsoft YaHei",
    "PingFang SC",
    "Hiragino Sans GB",
    "SimHei",
    "SimSun",
    "WenQuanYi Zen Hei",
    "WenQuanYi Micro Hei",
    "Droid Sans Fallback",
    "Noto Sans CJK JP",
    "Noto Sans CJK TC",
    "Arial Unicode MS",
)
"""Fonts for characters that the first one lacks, mostly Chinese, if they are installed."""
_NOT_STYLE = ("backend", "date", "docstring", "interactive", "savefig.directory", "timezone", "tk", "toolbar", "webagg")
"""Settings of a session, not of a picture; they stay as they are."""
_PT_PER_INCH = 72.0


@contextmanager
def style() -> Iterator[None]:
    """Use matplotlib's defaults instead of the user's settings, and make output reproducible."""
    plain = {key: value for key, value in matplotlib.rcParamsDefault.items() if not key.startswith(_NOT_STYLE)}
    with matplotlib.rc_context(plain):
        matplotlib.rcParams.update(
            {
                "font.family": font_families(),
                "font.size": 8.0,
                "svg.hashsalt": "gusjob",
                "svg.fonttype": "none",
                "pdf.fonttype": 42,
                "text.parse_math": False,
            }
        )
        yield


def font_families() -> list[str]:
    """Return the installed fonts in order of preference."""
    there = set(fontManager.get_font_names())
    return [_FAMILY, *(name for name in _OTHERS if name in there)]


def showable(text: str) -> str:
    """Escape the characters of a user's text that no font has."""
    clean = printable(text)
    if clean.isascii():
        return clean
    covered = {code for name in font_families() for code in get_font(fontManager.findfont(name)).get_charmap()}
    return "".join(c if ord(c) in covered else c.encode("ascii", "backslashreplace").decode() for c in clean)


def width_in(text: str, size_pt: float, weight: str = "normal") -> float:
    """Return the width of a text, inches."""
    font = FontProperties(family=font_families(), size=size_pt, weight=weight)
    return float(text_to_path.get_text_width_height_descent(text, font, ismath=False)[0]) / _PT_PER_INCH


def wrapped(text: str, size_pt: float, max_width_in: float) -> list[str]:
    """Break a text into lines that fit."""
    lines: list[str] = []
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and width_in(longer, size_pt) <= max_width_in:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def shortened(text: str, size_pt: float, max_width_in: float, weight: str) -> str:
    """Shorten a text in its middle so that it fits."""
    kept = len(text)
    while kept > 2 and width_in(_cut(text, kept), size_pt, weight) > max_width_in:
        kept = min(kept - 1, int(kept * 0.9))
    return _cut(text, kept)


def _cut(text: str, kept: int) -> str:
    return text if kept >= len(text) else f"{text[: (kept + 1) // 2]}...{text[len(text) - kept // 2 :]}"


def put_text(figure: Figure, x_in: float, y_in: float, text: str, size_pt: float, **more: Any) -> None:
    """Write a text with its lower left corner at a position, inches."""
    figure.text(
        x_in,
        y_in,
        text,
        transform=figure.dpi_scale_trans,
        fontsize=size_pt,
        family=font_families(),
        parse_math=False,
        **{"color": FAINT, "va": "baseline", "ha": "left", **more},
    )


def line_in(size_pt: float) -> float:
    """Return the height of a line of text, inches."""
    return size_pt * LINE_SPACING / _PT_PER_INCH
