"""Whole random jobs: what passes check plans, compiles, reads back and is interpreted, all without an error."""

from __future__ import annotations

import os
import traceback
from random import Random

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from support.job_writer import Writer

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.lower import compile_job
from gusjob.controllers.gus.model import simulate_stream
from gusjob.diagnostics.model import Diagnostic, Severity, has_errors
from gusjob.frontend import check_text, read_job, read_listing
from gusjob.lint import check
from gusjob.report.rows import Report, make_report
from gusjob.simulate import Trace

MACHINES = (
    Machine(),
    Machine(pulses_per_mm=(655.36, 500.0), period_us=333.0),
    Machine(period_us=1000.0, max_acceleration_mm_s2=1e5, lookahead_acc_pulse_per_ms2=30.0, chord_tolerance_um=50.0),
)
EXAMPLES = int(os.environ.get("PROPERTY_EXAMPLES", "60"))
"""Of each machine. Set it high to search for long."""
HARD = {"GJ704", "GJ705", "GJ706"}
"""What our planner must not ask of the path."""
SEEDS = 120
PASSING = 0.5
"""At least this part of the jobs passes check; measured: four fifths."""


def written(rng: Random, machine: Machine) -> str:
    """A job; in half of them something may be off."""
    return Writer(rng, odd=rng.choice((0, 60)), unequal=not machine.equal_axes).job()


def errors(diagnostics: list[Diagnostic]) -> list[str]:
    """Codes and texts of the errors; a run of years is none."""
    wrong = (f for f in diagnostics if f.severity is Severity.ERROR and f.rule.code != "GJ713")
    return [f"{f.span.line}: {f.rule.code} {f.message}" for f in wrong]


def interpreted(stream: Stream, machine: Machine, *, is_listing: bool) -> Trace | None:
    """A run without an error, whose laser has a mode and a power and is switched off; None if it is too long."""
    with np.errstate(all="raise", under="ignore"):
        trace, diagnostics = simulate_stream(stream, machine, is_listing=is_listing)
        assert errors(diagnostics) == []
        assert not {"GJ708", "GJ712", "GJ715"} & {f.rule.code for f in diagnostics}
        if trace is not None:
            columns = make_report(trace, machine).columns
            for name in ("start_ms", "duration_ms", "length_mm", "x_mm", "y_mm"):
                assert np.isfinite(columns[name]).all(), name
            assert (columns["duration_ms"] >= 0).all()
    return trace


def check_no_emission_in_jumps(text: str, report: Report) -> None:
    """No emission in a JUMP, in a job that does not delay emission (as sky writing does)."""
    lines = text.upper().splitlines()
    if any("DELAY" in line or "SKYWRITE" in line for line in lines):
        return
    jumps = [lines[line - 1].lstrip().startswith("JUMP") for line in report.columns["line"].tolist()]
    for name, column in report.columns.items():
        if name.endswith("emission_ms"):
            assert not column[np.array(jumps, dtype=np.bool_)].any()


def holds(text: str, machine: Machine) -> bool:
    """See that a job keeps the promise; False if check finds an error in it."""
    source, diagnostics = check_text(text.encode(), "x.job")
    assert source is not None, diagnostics
    job, diagnostics = read_job(source, machine)
    diagnostics += check(job, machine)
    for diagnostic in diagnostics:
        assert diagnostic.message
        assert diagnostic.span.line >= 0
    if has_errors(diagnostics):
        return False
    stream, diagnostics = compile_job(job, machine)
    if has_errors(diagnostics):  # An END that can't be reached, a run-in outside the field; `gusjob check` plans too.
        assert {f.rule.code for f in diagnostics if f.severity is Severity.ERROR} <= {
            "GJ506",
            "GJ808",
            "GJ809",
            "GJ810",
        }
        return False
    own = interpreted(stream, machine, is_listing=False)
    if not job.has_forced_ends:
        assert {f.rule.code for f in simulate_stream(stream, machine, coarse=True)[1]} & HARD == set()
    printed = "".join(listing(stream))
    source, _ = check_text(printed.encode(), "x.gts")
    assert source is not None
    again, diagnostics = read_listing(source)
    assert [f.rule.code for f in diagnostics] in ([], ["GJ004"])
    assert "".join(listing(again)) == printed
    theirs = interpreted(again, machine, is_listing=True)
    assert (own is None) == (theirs is None)
    if own is not None and theirs is not None:
        check_no_emission_in_jumps(text, make_report(own, machine))
        mine, other = make_report(own, machine).columns, make_report(theirs, machine).columns
        assert mine.keys() == other.keys()
        # A listing does not have the intended ends of marks, only the switches that sky writing has moved.
        for name in mine.keys() - ({"line", "kind"} if own.is_sky_written else {"line"}):
            assert np.array_equal(mine[name], other[name], equal_nan=mine[name].dtype.kind == "f"), name
    return True


HEAD = "LASER MODE DUTY CARRIER 10\nVEL 100\nACC 1000\n"


@pytest.mark.parametrize(
    "text",
    [
        HEAD + "LASER DISTANCE REF X (1) Y 1 RATIO X 0 Y (0.5) MIN 2 MAX 9\n",
        HEAD + "LASER POWER 50\nLASER MODE ANALOG\nLASER POWER 5\nLASER ON\nLINE X 1\nLASER OFF\n",
        HEAD + "LASER POWER 50\nLASER ON\nLASER OFF NOW\nJUMP X 1\nJUMP X 5\n",
        HEAD + "LASER FOLLOW RATIO 1 MIN -0.0 MAX 9\nLASER POWER -0.0\nDWELL -0.0\n",
        HEAD + "VEL -0.0\nLASER DELAY ON 1 OFF 2\nLASER POWER 50\nLASER ON\nLINE X 1\nLINE X 2\nLASER OFF\n",
    ],
    ids=["expression in an axis", "power before a mode", "off at rest", "minus nothing", "no velocity"],
)
def test_jobs_found_by_search(text: str) -> None:
    """Small jobs that once broke the promise."""
    holds(text, MACHINES[0])


def broken(text: str, machine: Machine) -> str:
    """How a job breaks the promise; '' if it does not."""
    try:
        holds(text, machine)
    except Exception as diagnostic:  # noqa: BLE001 (whatever it is, it is the finding)
        at = traceback.extract_tb(diagnostic.__traceback__)[-1]
        return f"{type(diagnostic).__name__} in {at.name}, line {at.lineno}"
    return ""


def smallest(text: str, machine: Machine, how: str) -> str:
    """The job without the lines that are not needed to break the promise in the same way."""
    lines = text.splitlines(keepends=True)
    size = len(lines) // 2
    while size:
        at = 0
        while at < len(lines):
            rest = [*lines[:at], *lines[at + size :]]
            if broken("".join(rest), machine) == how:
                lines = rest
            else:
                at += size
        size //= 2
    return "".join(lines)


@pytest.mark.parametrize("machine", MACHINES, ids=["default", "unequal", "coarse"])
@given(st.integers(0, 2**32))
@settings(max_examples=EXAMPLES, phases=(Phase.explicit, Phase.reuse, Phase.generate))
def test_what_passes_check_runs(machine: Machine, seed: int) -> None:
    text = written(Random(seed), machine)
    how = broken(text, machine)
    assert not how, f"{how}:\n{smallest(text, machine, how)}"


def test_most_jobs_pass_check() -> None:
    """Otherwise the test above tests little."""
    passed = 0
    for seed in range(SEEDS):
        machine = MACHINES[seed % len(MACHINES)]
        source, _ = check_text(written(Random(seed), machine).encode(), "x.job")
        assert source is not None
        job, diagnostics = read_job(source, machine)
        passed += not has_errors([*diagnostics, *check(job, machine)])
    assert passed >= PASSING * SEEDS, f"{passed} of {SEEDS}"
