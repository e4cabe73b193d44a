"""What a page is given of a run: how fine, how far, and what is said of what it leaves out."""

from __future__ import annotations

import numpy as np
import pytest
from support.tools import stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.gus.model import simulate_stream
from gusjob.report.rows import make_report
from gusjob.view.page.content import page_of
from gusjob.view.page.encode import decode, encode
from gusjob.view.page.render import MAX_BYTES, Page
from gusjob.view.strokes import strokes_of


def page(text: str, machine: Machine | None = None) -> Page:
    machine = machine or Machine()
    trace, _ = simulate_stream(stream_of(text, machine), machine)
    assert trace is not None
    return page_of(make_report(trace, machine), strokes_of(trace, machine), machine, [])


def ends(found: Page) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the strokes as a browser has them, mm."""
    packed = encode(found.tables, MAX_BYTES, found.facts["units_per_mm"])
    strokes = decode(packed.directory, b"".join(packed.packed))["strokes"]
    return strokes["x_mm"], strokes["y_mm"]


def test_energy_per_mm_of_strokes_below_a_um() -> None:
    """Slow and following: 0.275 um a tick; 1.1 mm/s at half of the range is 54 %, so 54 * 1000 / 1.1 %*ms/mm."""
    found = page(
        "LASER MODE DUTY CARRIER 20kHz\nVEL 1.1mm/s\nACC 50000mm/s2\nLASER FOLLOW MIN 10 MAX 90 AT 2mm/s\nLASER ON\n"
        "LINE X 2 Y 1.5\nLASER OFF\n"
    )
    x, y = ends(found)
    strokes = found.tables["strokes"]
    steady = (strokes["vel0"] > 1.0999) & (strokes["vel1"] > 1.0999)
    energy = (strokes["ch0_power"] * strokes["duration_ms"])[1:] / np.hypot(np.diff(x), np.diff(y))
    assert steady.sum() > 9000
    assert energy[steady[1:]][5:-5] == pytest.approx(54 * 1000 / 1.1, rel=2e-3)


@pytest.mark.parametrize(
    ("scale", "field", "x"),
    [(1000.0, 150, 123.456), (1000.0, 1_000_000, 500_000), (1e6, 150, 0.00004), (7.0, 1_000_000, -999_999)],
)
def test_places_are_right_however_far_or_fine(scale: float, field: float, x: float) -> None:
    """To half a pulse, or to 1 um where the field is so large that 32 bits hold no more."""
    machine = Machine(pulses_per_mm=(scale, scale), field_x_mm=(-field, field), field_y_mm=(-field, field))
    found = page(f"VEL 10\nACC 10\nLINE X {x:.6f}\n", machine)
    assert ends(found)[0][-1] == pytest.approx(x, abs=max(0.51 / scale, 1e-3 if field > 1000 else 0))


def test_emission_that_is_not_drawn_is_noted() -> None:
    """30 ms of off delay at 40 % behind the motion."""
    text = "LASER MODE DUTY CARRIER 20\nLASER DELAY ON 0 OFF 30ms\nVEL 500\nACC 50000\nLASER POWER 40\nLASER ON\n"
    found = page(text + "LINE X 1\nLASER OFF\n")
    assert found.facts["remarks"] == ["Emission while standing still is not drawn (channel 0: 1200 %·ms)."]
    assert page(text.replace("OFF 30ms", "OFF 0") + "LINE X 1\nLASER OFF\n").facts["remarks"] == []
