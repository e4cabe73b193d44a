"""Run-ins and run-outs in the machine's field."""

from __future__ import annotations

import math

import pytest
from msgspec.structs import replace
from oracles import skywriting as ref
from oracles.skywriting import Point, Sky, Step
from support.skywriting import HEAD_MM, compiled, diagnostics_of, head, marked
from support.tools import MACHINE, job_of

from gusjob.controllers.gus.lower import compile_job


@pytest.mark.parametrize(
    ("at", "to", "what", "axis", "over"),
    [
        ((-149500.0, 0.0), (-100000.0, 0.0), "run-in", "X", -149.5 - 0.88 + 150.0),
        ((0.0, 100000.0), (0.0, 149252.0), "run-out", "Y", 149.252 + 0.75 - 150.0),
        ((0.0, -149122.0), (0.0, -140000.0), "run-in", "Y", -149.122 - 0.88 + 150.0),
    ],
)
def test_how_far_outside_the_field(at: Point, to: Point, what: str, axis: str, over: float) -> None:
    sky = Sky(mode=2, timelag=250.0)
    text = ref.job_text([*marked([*head(sky)[:-1], Step(op="jump", at=at)], to)])
    _, localized = compile_job(job_of(text), MACHINE)
    found = [f for f in localized if f.rule.code == "GJ808"]
    assert [(f.fields["what"], f.fields["axis"]) for f in found] == [(what, axis)]
    assert found[0].fields["over"] == pytest.approx(abs(over), abs=1.5e-3)


def test_inside_the_field_to_the_pulse() -> None:
    sky = Sky(mode=2, timelag=250.0)
    steps = marked([*head(sky)[:-1], Step(op="jump", at=(-149120.0, 0.0))], (149250.0, 0.0))
    assert not {f.rule.code for f in compiled(ref.job_text(steps))[1]} & {"GJ808"}


def test_the_worst_point_outside_the_field_is_reported() -> None:
    """100 mm to -149.5 mm and 880 um more: -150.38."""
    text = HEAD_MM + "SKYWRITE MODE 2 TIMELAG 250us\nJUMP X -149.5\nLASER ON\nLINE X -100\nLASER OFF\n"
    assert [f.fields["value"] for f in diagnostics_of(text) if f.rule.code == "GJ808"] == [
        pytest.approx(-150.38, abs=2e-3)
    ]


def test_a_run_in_may_leave_the_field_between_its_ends() -> None:
    """Centre 149.505 mm to the left, radius 0.5: S is 0.3 rad behind the leftmost point, P 0.63 rad before S."""
    x, y = -149.505 - 0.5 * math.cos(0.3), -0.5 * math.sin(0.3)
    to = f"X {-149.505 - 0.5 * math.cos(1.8):.6f} Y {-0.5 * math.sin(1.8):.6f} R 0.5"
    text = HEAD_MM.replace("VEL 1000", "VEL 500") + f"SKYWRITE MODE 2 TIMELAG 250us\nJUMP X {x:.6f} Y {y:.6f}\n"
    found = [f.fields for f in diagnostics_of(text + f"LASER ON\nARC CCW {to}\nLASER OFF\n") if f.rule.code == "GJ808"]
    assert [(f["what"], f["value"]) for f in found] == [("run-in", pytest.approx(-150.005, abs=1.5e-3))]


def test_each_axis_has_its_own_field() -> None:
    text = HEAD_MM + "SKYWRITE MODE 2 TIMELAG 250us\nJUMP Y 40\nLASER ON\nLINE Y 49.5\nLASER OFF\nJUMP Y 0\n"
    found = diagnostics_of(text, replace(MACHINE, field_y_mm=(-50.0, 50.0)))
    assert [f.fields["axis"] for f in found if f.rule.code == "GJ808"] == ["Y"]
