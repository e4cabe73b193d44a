"""The controller protocol and its implementation."""

from __future__ import annotations

import json

import pytest
from support.tools import MACHINE, MARK, job_of

from gusjob.controllers.gus import GUS

JOB = MARK + "LASER POWER 40\nLASER ON\nLINE X 1\nLASER OFF\n"


def test_a_job_is_compiled_and_simulated() -> None:
    stream, diagnostics = GUS.compile(job_of(JOB), MACHINE)
    assert diagnostics == []
    trace, diagnostics = GUS.simulate(stream, MACHINE)
    assert trace is not None
    assert diagnostics == []
    assert trace.channels[0].emitted.power_ms.tolist() == pytest.approx([800])


def test_formats() -> None:
    stream, _ = GUS.compile(job_of(JOB), MACHINE)
    written = {form: b"".join(GUS.write(stream, form)).decode() for form in GUS.formats}
    assert written["gts"].splitlines()[0] == "GT_SetAxisMode(7,1)"
    assert json.loads(written["json"])["schema"] == "gusjob-calls/1"
    assert "static int run_job(void)" in written["c"]
    with pytest.raises(ValueError, match="gts, json, c"):
        GUS.write(stream, "pdf")
