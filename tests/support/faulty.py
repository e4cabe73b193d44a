"""What is wrong with a text: diagnostics of the rules' own examples, and of the files in tests/bad."""

from __future__ import annotations

from pathlib import Path

from support.tools import ROOT, find_diagnostics

from gusjob.config.machine import Machine
from gusjob.config.profile import read_profile
from gusjob.controllers.gus.lower import compile_job
from gusjob.diagnostics.model import Diagnostic, Rule, has_errors
from gusjob.frontend import check_text, is_listing, read_job, read_listing
from gusjob.lint import check
from gusjob.pipeline import Checked, examine, examine_file, load

BAD = ROOT / "tests" / "bad"
COMMENTS = ("GJ144", "GJ145")
"""Rules of comments, which need all other diagnostics."""


def diagnostics_of_text(text: str, rule: Rule) -> list[Diagnostic]:
    """All diagnostics of a job, or of a listing if the rule is one of calls."""
    source, diagnostics = check_text(text.encode(), "example")
    assert source is not None
    machine = Machine()
    if rule.code in COMMENTS:
        loaded = load(Path("example.job"), None, data=text.encode())
        assert isinstance(loaded, Checked)
        return list(examine(loaded).diagnostics)
    if is_listing(source):
        stream, diagnostics = read_listing(source)
        return [*diagnostics, *find_diagnostics(stream, machine)]
    job, diagnostics = read_job(source, machine)
    diagnostics += check(job, machine)
    return diagnostics if has_errors(diagnostics) else [*diagnostics, *compile_job(job, machine)[1]]


def bad_files() -> list[Path]:
    """The files in tests/bad, without their machine profiles."""
    return sorted(p for p in BAD.iterdir() if ".machine" not in p.name)


def diagnostics_of_file(path: Path) -> list[Diagnostic]:
    """All diagnostics of a file in tests/bad, with the profile beside it."""
    if path.suffix == ".toml":
        return list(read_profile(path).diagnostics)
    profile = path.with_suffix(".machine.toml")
    return list(examine_file(path, profile if profile.exists() else None).diagnostics)
