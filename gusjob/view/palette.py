"""Colours of pictures and the page, for a white and a dark ground.

The colour scale is viridis (Smith and van der Walt, 2015, CC0): perceptually uniform, and monotone in lightness for
colour-blind eyes too. Higher values are always nearer to its yellow end; each ground uses the part of the scale that
has a contrast of 3:1 or more. The other colours are those of Okabe and Ito, darkened on white until they have that
contrast, and greys.
"""

from __future__ import annotations

from msgspec import Struct

BINS = 64
"""Number of colours of a scale."""

_VIRIDIS = (
    "440154", "470d60", "48186a", "482374", "472d7b", "453781", "424086", "3e4989", "3b528b", "375b8d", "33638d",
    "2f6b8e", "2c728e", "297a8e", "26828e", "23898e", "21918c", "1f988b", "1fa088", "22a785", "28ae80", "32b67a",
    "3fbc73", "4ec36b", "5ec962", "70cf57", "84d44b", "98d83e", "addc30", "c2df23", "d8e219", "ece51b", "fde725",
)  # fmt: skip
"""33 of its 256 colours, equally spaced."""


class Palette(Struct, frozen=True, kw_only=True):
    """Colours on one ground, as #rrggbb.

    Attributes:
        ground: The background.
        scale: From low to high values, (BINS,).
        under: Values below the range of the scale.
        over: Values above it.
        single: The colour of a path that has one value only.
        jump: Motion without emission; `run_in` and `run_out`: the same in sky writing.
        other: Emission that has no value, such as another channel's.
        command: The commanded path beside the beam's.
        ink: Switch points and texts.
        velocity: Curve of the velocity.
        power: Curves of the power of each channel.
    """

    ground: str
    scale: tuple[str, ...]
    under: str
    over: str
    single: str
    jump: str
    run_in: str
    run_out: str
    other: str
    command: str
    ink: str
    velocity: str
    power: tuple[str, str]


def viridis(place: float) -> str:
    """Return the colour at a place of the whole scale, 0 to 1."""
    at = min(max(place, 0.0), 1.0) * (len(_VIRIDIS) - 1)
    low = min(int(at), len(_VIRIDIS) - 2)
    first, second = bytes.fromhex(_VIRIDIS[low]), bytes.fromhex(_VIRIDIS[low + 1])
    mixed = (round(a + (b - a) * (at - low)) for a, b in zip(first, second, strict=True))
    return "#" + bytes(mixed).hex()


def _scale(low: float, high: float) -> tuple[str, ...]:
    """Return the part of the scale between two places."""
    return tuple(viridis(low + (high - low) * number / (BINS - 1)) for number in range(BINS))


LIGHT = Palette(
    ground="#ffffff",
    scale=_scale(0.0, 0.59),
    under="#499ac8",
    over="#c04f00",
    single=viridis(0.3),
    jump="#6b7480",
    run_in="#c48700",
    run_out="#cc79a7",
    other="#b0b7bf",
    command="#8c959f",
    ink="#1f2328",
    velocity="#0072b2",
    power=("#c04f00", "#009e73"),
)
DARK = Palette(
    ground="#101418",
    scale=_scale(0.35, 1.0),
    under="#56b4e9",
    over="#d55e00",
    single=viridis(0.7),
    jump="#66707b",
    run_in="#e69f00",
    run_out="#cc79a7",
    other="#4a535d",
    command="#7d8792",
    ink="#e3e7eb",
    velocity="#56b4e9",
    power=("#d55e00", "#009e73"),
)
