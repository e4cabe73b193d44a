"""Random text, token soup and mutated jobs: never a traceback; what passes check also compiles, reads back and runs."""

from __future__ import annotations

import random
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.tools import ROOT

from gusjob.config.machine import Machine
from gusjob.config.profile import parse_profile
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.lower import compile_job
from gusjob.controllers.gus.model import simulate_stream
from gusjob.diagnostics.formats.text import diagnostic_text
from gusjob.diagnostics.model import Diagnostic, Severity, has_errors
from gusjob.frontend import Source, check_text, read_job, read_listing
from gusjob.lint import check
from gusjob.report.answer import answer_of
from gusjob.report.files import report_csv, report_json
from gusjob.report.rows import make_report
from gusjob.report.text import report_text

MACHINES = (Machine(), Machine(pulses_per_mm=(655.36, 500.0), period_us=333.0))
JOBS = [p.read_text(encoding="utf-8") for p in sorted((ROOT / "jobs").rglob("*.job")) if p.stem != "engrave"]
ROUTINES = [p.read_text(encoding="utf-8") for p in sorted((ROOT / "tests" / "manual").glob("*.c"))]
GRAMMAR = (ROOT / "grammar" / "job.lark").read_text(encoding="utf-8")
KEYWORDS = re.findall(r"^([A-Z0-9]+)(?:\.\d)?: /", GRAMMAR, re.MULTILINE)
NUMBERS = ["0", "1", "-1", "50", "1e3", "-0.0", "1e308", "9" * 400, ".", "1.2.3", "007", "1e-320", "100%", "5kHz"]
ODD = ["0", "1", "-7", "1e4", "0.5", "99999999", "1e-9"]
CALLS = [
    "GT_LnXY",
    "GT_ArcXYC",
    "GT_ArcXYR",
    "GT_BufDelay",
    "GT_BufLaserOn",
    "GT_BufLaserPrfCmd",
    "GT_CrdStart",
    "GT_BufLaserPrfFollow",
    "GT_LaserPowerMode",
    "GT_SetLevelDelay",
    "GT_CrdStatus",
    "GT_CrdClear",
    "GT_SetCrdPrm",
]


def shown(diagnostics: list[Diagnostic], source: Source) -> None:
    for diagnostic in diagnostics[:200]:
        text = diagnostic_text(diagnostic, lambda span, _: source.line(span.line), color=False)
        assert text.startswith("x:")
        assert diagnostic.span.line >= 1


def run_all(stream: Stream, machine: Machine, *, is_listing: bool) -> list[Diagnostic]:
    with np.errstate(all="raise", under="ignore"):
        trace, diagnostics = simulate_stream(stream, machine, is_listing=is_listing)
    if trace is None:
        assert diagnostics[-1].rule.code == "GJ713"
        return diagnostics[:-1]
    with np.errstate(all="raise", under="ignore"):
        report = make_report(trace, machine)
    b"".join(report_json(report, diagnostics, summary=False))
    b"".join(report_csv(report))
    with np.errstate(all="raise", under="ignore"):
        report_text(report, answer_of(report, diagnostics), tables=True, width=80)
    for name, column in report.columns.items():
        if column.dtype.kind == "f" and not name.endswith(("power_min", "power_mean", "power_max", "joules")):
            assert np.isfinite(column).all(), name
    assert (report.columns["duration_ms"] >= 0).all()
    return diagnostics


def as_job(text: str) -> None:
    source, _ = check_text(text.encode("utf-8", "surrogatepass"), "x")
    if source is None:
        return
    for machine in MACHINES:
        job, diagnostics = read_job(source, machine)
        diagnostics += check(job, machine)
        shown(diagnostics, source)
        if has_errors(diagnostics):
            continue
        stream, more = compile_job(job, machine)
        shown(more, source)
        if has_errors(more):
            continue
        found = run_all(stream, machine, is_listing=False)
        assert [f.message for f in found if f.severity is Severity.ERROR] == []
        printed = "".join(listing(stream))
        again_source, _ = check_text(printed.encode(), "x")
        assert again_source is not None
        again, read_diagnostics = read_listing(again_source)
        assert [f.rule.code for f in read_diagnostics] in ([], ["GJ004"])
        assert "".join(listing(again)) == printed


def as_listing(text: str) -> None:
    source, _ = check_text(text.encode("utf-8", "surrogatepass"), "x")
    if source is not None:
        stream, diagnostics = read_listing(source)
        shown(diagnostics, source)
        shown(run_all(stream, MACHINES[0], is_listing=True), source)


@given(st.text(max_size=300))
@settings(max_examples=150)
def test_random_text(text: str) -> None:
    as_job(text)
    as_listing(text)


@given(st.binary(max_size=300))
@settings(max_examples=100)
def test_random_bytes(data: bytes) -> None:
    source, diagnostics = check_text(data, "x")
    assert (source is None) == bool(diagnostics)
    if source is not None:
        read_job(source, MACHINES[0])
        read_listing(source)


@pytest.mark.slow
@given(st.lists(st.lists(st.sampled_from(KEYWORDS + NUMBERS + ["(", ";", "//", '"']), max_size=9), max_size=25))
@settings(max_examples=150)
def test_token_soup(lines: list[list[str]]) -> None:
    as_job("\n".join(" ".join(line) for line in lines))


@given(
    st.lists(st.tuples(st.sampled_from(CALLS), st.lists(st.sampled_from([*NUMBERS[:9], "run", "{1,2}"]), max_size=9)))
)
@settings(max_examples=150)
def test_call_soup(calls: list[tuple[str, list[str]]]) -> None:
    as_listing("\n".join(f"{name}({','.join(args)})" for name, args in calls))


@given(st.text(max_size=200))
@settings(max_examples=100)
def test_random_profiles(text: str) -> None:
    profile = parse_profile(text)
    assert profile.machine == Machine() or not profile.diagnostics


def mutated(text: str, rng: random.Random) -> str:
    lines = text.splitlines()
    for _ in range(rng.randint(1, 4)):
        i = rng.randrange(len(lines))
        match rng.randrange(7):
            case 0:
                del lines[i]
            case 1:
                lines.insert(i, lines[rng.randrange(len(lines))])
            case 2:
                lines[i], lines[i - 1] = lines[i - 1], lines[i]
            case 3:
                lines[i] = re.sub(r"\d+(\.\d+)?", lambda _: rng.choice(ODD), lines[i], count=1)
            case 4:
                words = lines[i].split(" ")
                words[rng.randrange(len(words))] = rng.choice(KEYWORDS + NUMBERS + CALLS)
                lines[i] = " ".join(words)
            case 5:
                k = rng.randrange(len(lines[i]) + 1)
                lines[i] = lines[i][:k] + chr(rng.choice([0, 9, 13, 27, 34, 40, 0x4E8C, 0x1F600])) + lines[i][k:]
            case _:
                k = rng.randrange(len(lines[i]) + 1)
                lines[i] = lines[i][:k] + lines[i][k + 1 :]
        if not lines:
            return ""
    return "\n".join(lines)


@pytest.mark.parametrize("seed", range(120))
def test_mutated_jobs_and_routines(seed: int) -> None:
    rng = random.Random(seed)
    as_job(mutated(rng.choice(JOBS), rng))
    as_listing(mutated(rng.choice(ROUTINES), rng))
