"""The registry: every rule gives a reason, its bad example has the diagnostic and its good example has not."""

from __future__ import annotations

import string
from pathlib import Path

import pytest

from gusjob.config.machine import Machine
from gusjob.controllers.gus.lower import compile_job
from gusjob.controllers.gus.model import find_diagnostics
from gusjob.diagnostics.model import REMARKS, Diagnostic, Rule, Severity, has_errors
from gusjob.diagnostics.rules import RULES, VARIANTS
from gusjob.frontend import check_text, read_job, read_listing
from gusjob.lint import check
from gusjob.pipeline import Checked, examine, load

WITHOUT_EXAMPLE = {
    "GJ001", "GJ002", "GJ003", "GJ005", "GJ006",  # The file as such.
    "GJ208", "GJ509", "GJ515",  # They need a machine profile: tests/bad has them.
    "GJ601", "GJ602", "GJ603", "GJ604", "GJ605", "GJ606", "GJ607", "GJ608", "GJ609", "GJ716", "GJ813",
    *(f"GJ9{number:02}" for number in range(1, 18)),  # They need a controller: test_hardware.py has them.
}  # fmt: skip
COMMENTS = ("GJ144", "GJ145")
"""Rules of comments, which are checked after everything else."""
LISTINGS = ("GJ7", "GJ111", "GJ112", "GJ113", "GJ114", "GJ115", "GJ116")


def diagnostics_of(text: str, rule: Rule) -> list[Diagnostic]:
    source, diagnostics = check_text(text.encode(), "example")
    assert source is not None
    machine = Machine()
    if rule.code in COMMENTS:
        loaded = load(Path("example.job"), None, data=text.encode())
        assert isinstance(loaded, Checked)
        return list(examine(loaded).diagnostics)
    if rule.code.startswith(LISTINGS):
        stream, diagnostics = read_listing(source)
        return [*diagnostics, *find_diagnostics(stream, machine)]
    job, diagnostics = read_job(source, machine)
    diagnostics += check(job, machine)
    return diagnostics if has_errors(diagnostics) else [*diagnostics, *compile_job(job, machine)[1]]


@pytest.mark.parametrize("rule", RULES.values(), ids=lambda r: r.code)
def test_a_rule_has_a_title_and_a_reason(rule: Rule) -> None:
    assert rule.why.endswith(".")
    assert rule.title
    assert bool(rule.bad) == (rule.code not in WITHOUT_EXAMPLE)


@pytest.mark.parametrize("rule", [r for r in RULES.values() if r.bad], ids=lambda r: r.code)
def test_the_bad_example_has_the_diagnostic(rule: Rule) -> None:
    assert rule.code in [f.rule.code for f in diagnostics_of(rule.bad, rule)]


@pytest.mark.parametrize("rule", [r for r in RULES.values() if r.good], ids=lambda r: r.code)
def test_the_good_example_is_clean(rule: Rule) -> None:
    found = diagnostics_of(rule.good, rule)
    assert [f.message for f in found if f.severity is not Severity.NOTE] == []
    assert rule.code not in [f.rule.code for f in found]


def test_texts_are_valid_templates() -> None:
    for text in [*(r.text for r in (*RULES.values(), *VARIANTS)), *REMARKS]:
        fields = [name for _, name, _, _ in string.Formatter().parse(text) if name is not None]
        assert all(name.isidentifier() for name in fields)


def test_variants_have_a_code_of_the_registry() -> None:
    assert {v.code for v in VARIANTS} <= set(RULES)
