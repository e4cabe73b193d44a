"""Every job in jobs/ checks clean, has a golden report, and its listing reads back to the same calls and report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from support.tools import ROOT, stream_in

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.model import simulate_stream
from gusjob.diagnostics.model import Severity
from gusjob.frontend import check_text, read_listing
from gusjob.pipeline import examine_file
from gusjob.report.answer import answer_of
from gusjob.report.rows import Report, make_report
from gusjob.report.text import report_text

JOBS = sorted(p for p in (ROOT / "jobs").rglob("*.job") if p.parent.name != "shared")
GOLDEN = ROOT / "tests" / "golden"


def stream_of(path: Path) -> Stream:
    stream = stream_in(examine_file(path, None))
    assert stream is not None
    return stream


def report_of(stream: Stream, machine: Machine) -> Report:
    trace, _ = simulate_stream(stream, machine)
    assert trace is not None
    return make_report(trace, machine)


def test_there_are_jobs_and_no_stale_goldens() -> None:
    assert len(JOBS) >= 10
    assert {p.stem for p in GOLDEN.glob("*.txt")} == {p.stem for p in JOBS}


@pytest.mark.parametrize("path", JOBS, ids=lambda p: p.stem)
def test_checks_clean(path: Path) -> None:
    assert [f.message for f in examine_file(path, None).diagnostics if f.severity is not Severity.NOTE] == []


@pytest.mark.parametrize("path", JOBS, ids=lambda p: p.stem)
def test_golden(path: Path, rewrite: bool) -> None:
    machine = examine_file(path, None).machine
    trace, diagnostics = simulate_stream(stream_of(path), machine)
    assert diagnostics == []
    assert trace is not None
    report = make_report(trace, machine)
    text = "".join(report_text(report, answer_of(report, diagnostics), tables=True).partition("\n")[1:])
    golden = GOLDEN / f"{path.stem}.txt"
    if rewrite:
        golden.write_text(text, encoding="utf-8", newline="\n")
    assert golden.read_text(encoding="utf-8") == text, "run pytest --rewrite and read the diff"


@pytest.mark.parametrize("path", JOBS, ids=lambda p: p.stem)
def test_a_listing_reads_back(path: Path) -> None:
    stream = stream_of(path)
    text = "".join(listing(stream))
    source, _ = check_text(text.encode(), "x.gts")
    assert source is not None
    again, diagnostics = read_listing(source)
    assert diagnostics == []
    assert "".join(listing(again)) == text
    # What the planner meant by a call is not in it: which dark motion is a run-in, and where a mark should begin.
    first, second = (report_of(replace(s, intent=None), examine_file(path, None).machine) for s in (stream, again))
    assert first.totals == second.totals
    for name in first.columns.keys() - {"line"}:
        assert np.array_equal(
            first.columns[name], second.columns[name], equal_nan=first.columns[name].dtype.kind == "f"
        )
