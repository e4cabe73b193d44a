"""The colours of pictures and the page: contrast, lightness and difference, for colour-blind eyes too.

Sources: contrast from WCAG 2.2; OKLab from Ottosson (2020); colour blindness from Machado, Oliveira and Fernandes
(2009), severity 1.0.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import numpy.typing as npt
import pytest

from gusjob.view.palette import BINS, DARK, LIGHT, Palette, viridis

Floats = npt.NDArray[np.float64]

EYES = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227969], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}
TO_LMS = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
TO_LAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)
CASES = pytest.mark.parametrize("palette", [LIGHT, DARK], ids=["light", "dark"])


def linear(*colors: str) -> Floats:
    """Linear RGB of colours, (n, 3)."""
    rgb = np.array([list(bytes.fromhex(color[1:])) for color in colors]) / 255
    return np.asarray(np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4))


def contrast(colors: tuple[str, ...], ground: str) -> Floats:
    light = linear(*colors, ground) @ [0.2126, 0.7152, 0.0722] + 0.05
    return np.asarray(np.maximum(light[:-1], light[-1]) / np.minimum(light[:-1], light[-1]))


def oklab(*colors: str, eyes: str = "normal") -> Floats:
    """Lightness and two opponent colours, (n, 3); a difference of 0.02 is just noticeable."""
    seen = np.clip(linear(*colors) @ EYES[eyes].T, 0, 1)
    return np.asarray(np.cbrt(seen @ TO_LMS.T) @ TO_LAB.T)


def test_the_scale_is_viridis() -> None:
    matplotlib = pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    published = matplotlib.colormaps["viridis"](np.arange(256), bytes=True)[:, :3].astype(int)
    ours = np.array([list(bytes.fromhex(viridis(place)[1:])) for place in np.arange(256) / 255])
    assert np.abs(ours - published).max() <= 4


@CASES
@pytest.mark.parametrize("eyes", EYES)
def test_scales_are_monotone_and_even(palette: Palette, eyes: str) -> None:
    lab = oklab(*palette.scale, eyes=eyes)
    assert len(lab) == BINS
    assert (np.diff(lab[:, 0]) > 0).all(), "more is lighter on both grounds"
    assert lab[-1, 0] - lab[0, 0] > 0.3
    steps = np.linalg.norm(np.diff(lab[::9], axis=0), axis=1)
    assert steps.max() < 2 * steps.min()


@CASES
def test_lines_stand_out_from_the_ground(palette: Palette) -> None:
    lines = (palette.under, palette.over, palette.jump, palette.run_in, palette.run_out, palette.single, palette.ink)
    assert contrast((*palette.scale, *lines, palette.velocity, *palette.power), palette.ground).min() >= 3.0
    assert contrast((palette.other, palette.command), palette.ground).min() >= 2.0, "beside what is coloured"


@CASES
@pytest.mark.parametrize("eyes", EYES)
def test_kinds_differ_from_each_other_and_outliers_from_the_scale(palette: Palette, eyes: str) -> None:
    kinds = [palette.under, palette.over, palette.jump, palette.run_in, palette.run_out]
    for first, second in combinations(oklab(*kinds, eyes=eyes), 2):
        assert np.linalg.norm(first - second) > 0.05
    scale = oklab(*palette.scale, eyes=eyes)
    for outlier in oklab(palette.under, palette.over, eyes=eyes):
        assert np.linalg.norm(scale - outlier, axis=1).min() > 0.08
    first, second = oklab(*palette.power, eyes=eyes)
    assert np.linalg.norm(first - second) > 0.1
