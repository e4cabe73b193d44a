"""The registry: every rule gives a reason, its bad example has the diagnostic and its good example has not."""

from __future__ import annotations

import string

import pytest
from support.faulty import diagnostics_of_text

from gusjob.diagnostics.model import REMARKS, Rule, Severity
from gusjob.diagnostics.rules import RULES, VARIANTS

WITHOUT_EXAMPLE = {
    "GJ001", "GJ002", "GJ003", "GJ005", "GJ006", "GJ147",  # The file as such.
    "GJ160",  # It needs -D: tests/frontend/test_overrides.py.
    "GJ208", "GJ509", "GJ515",  # They need a machine profile: tests/bad has them.
    "GJ601", "GJ602", "GJ603", "GJ604", "GJ605", "GJ606", "GJ607", "GJ608", "GJ609", "GJ716", "GJ813",
    *(code for code in RULES if code[:3] == "GJ9"),  # They need a controller: tests/hardware has them.
}  # fmt: skip


@pytest.mark.parametrize("rule", RULES.values(), ids=lambda r: r.code)
def test_a_rule_has_a_title_and_a_reason(rule: Rule) -> None:
    assert rule.why.endswith(".")
    assert rule.title
    assert bool(rule.bad) == (rule.code not in WITHOUT_EXAMPLE)


@pytest.mark.parametrize("rule", [r for r in RULES.values() if r.bad], ids=lambda r: r.code)
def test_the_bad_example_has_the_diagnostic(rule: Rule) -> None:
    assert rule.code in [f.rule.code for f in diagnostics_of_text(rule.bad, rule)]


@pytest.mark.parametrize("rule", [r for r in RULES.values() if r.good], ids=lambda r: r.code)
def test_the_good_example_is_clean(rule: Rule) -> None:
    found = diagnostics_of_text(rule.good, rule)
    assert [f.message for f in found if f.severity is not Severity.NOTE] == []
    assert rule.code not in [f.rule.code for f in found]


def test_texts_are_valid_templates() -> None:
    for text in [*(r.text for r in (*RULES.values(), *VARIANTS)), *REMARKS]:
        fields = [name for _, name, _, _ in string.Formatter().parse(text) if name is not None]
        assert all(name.isidentifier() for name in fields)


def test_variants_have_a_code_of_the_registry() -> None:
    assert {v.code for v in VARIANTS} <= set(RULES)
