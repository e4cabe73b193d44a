"""Tricky but sound jobs: they check without a warning, and what they compile to reads back and runs without one."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.tools import ROOT, stream_in

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.model import simulate_stream
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.frontend import check_text, read_listing
from gusjob.pipeline import examine_file

FOLDER = ROOT / "tests" / "good"
GOOD = sorted(FOLDER.glob("*.job"))


def beyond_notes(diagnostics: list[Diagnostic]) -> list[str]:
    """Warnings and errors, as a person reads them."""
    return [
        f"line {f.span.line}: {f.rule.code}: {f.message}" for f in diagnostics if f.rule.severity is not Severity.NOTE
    ]


def stream_of(path: Path) -> Stream:
    stream = stream_in(examine_file(path, None))
    assert stream is not None
    return stream


def test_there_are_jobs_and_each_says_what_is_tricky() -> None:
    assert 10 <= len(GOOD) <= 20
    for path in FOLDER.rglob("*.job"):
        assert path.read_text(encoding="utf-8").startswith("; Tricky: "), path.name


@pytest.mark.parametrize("path", GOOD, ids=lambda p: p.stem)
def test_checks_without_a_warning(path: Path) -> None:
    assert beyond_notes(list(examine_file(path, None).diagnostics)) == []


@pytest.mark.parametrize("path", GOOD, ids=lambda p: p.stem)
def test_the_listing_reads_back(path: Path) -> None:
    text = "".join(listing(stream_of(path)))
    source, diagnostics = check_text(text.encode(), "x.gts")
    assert source is not None
    assert beyond_notes(list(diagnostics)) == []
    again, faults_in_calls = read_listing(source)
    assert beyond_notes(list(faults_in_calls)) == []
    assert "".join(listing(again)) == text


@pytest.mark.parametrize("path", GOOD, ids=lambda p: p.stem)
def test_runs_without_a_warning(path: Path) -> None:
    trace, diagnostics = simulate_stream(stream_of(path), Machine())
    assert trace is not None
    assert beyond_notes(list(diagnostics)) == []
