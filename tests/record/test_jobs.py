"""Each job as a C program, compiled, run with the stand-in and read back: the report is that of the job's own calls."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from support.cli import gusjob
from support.recorded import compiled, needs_compiler
from support.tools import ROOT

from gusjob.record.recording import Recording, RecordOptions, record

pytestmark = needs_compiler

JOBS = sorted((ROOT / "jobs").glob("*.job")) + sorted((ROOT / "jobs" / "skywriting").glob("*.job"))


def report_of(path: Path) -> dict[str, Any]:
    """The report of calls, without what names lines and files."""
    ran = gusjob("report", "--format", "json", path)
    found: dict[str, Any] = json.loads(ran.stdout)
    for name in ("job", "diagnostics", "marks"):
        found.pop(name, None)
    del found["segments"]["line"]
    return found


@pytest.mark.parametrize("job", JOBS, ids=lambda path: path.stem)
def test_a_recorded_job_has_the_report_of_its_calls(job: Path, tmp_path: Path) -> None:
    own = tmp_path / "own.gts"
    assert gusjob("compile", job, "-o", own).exit_code == 0
    code = gusjob("compile", job, "--format", "c").stdout
    program = compiled(tmp_path, code)
    profile = job.parent / "gusjob.toml"
    if profile.exists():
        (tmp_path / "gusjob.toml").write_bytes(profile.read_bytes())
    listing = tmp_path / "calls.gts"
    recording = record(RecordOptions(command=(str(program),), output=listing))
    assert isinstance(recording, Recording), recording
    theirs, ours = report_of(listing), report_of(own)
    assert len(ours["segments"]["kind"]) > 0
    assert theirs == ours
