"""The registry: every rule gives a reason, its bad example has the diagnostic and its good example has not."""

from __future__ import annotations

import json
import string
from typing import Any

import pytest
from support.faulty import bad_files, diagnostics_of_file, diagnostics_of_text

from gusjob.diagnostics.model import REMARKS, Rule, Severity
from gusjob.diagnostics.rules import RULES, VARIANTS
from gusjob.diagnostics.rules.messages import MESSAGES_PATH, example_message, to_object

WITHOUT_EXAMPLE = {
    "GJ001", "GJ002", "GJ003", "GJ005", "GJ006", "GJ147",  # The file as such.
    "GJ160",  # It needs -D: tests/frontend/test_overrides.py.
    "GJ208", "GJ509", "GJ515", "GJ518", "GJ522",  # They need a machine profile: tests/bad has them.
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


def _messages() -> dict[str, dict[str, Any]]:
    """A message of each rule: of its bad example, else of the first file in tests/bad that has it."""
    found: dict[str, dict[str, Any]] = {}
    for rule in RULES.values():
        own = [d.phrase for d in diagnostics_of_text(rule.bad, rule) if d.rule.code == rule.code] if rule.bad else []
        if own:
            found[rule.code] = to_object(own[0])
    for path in bad_files():
        for diagnostic in diagnostics_of_file(path):
            found.setdefault(diagnostic.rule.code, to_object(diagnostic.phrase))
    return dict(sorted(found.items()))


def test_the_example_messages_are_what_the_checker_reports(rewrite: bool) -> None:
    fresh = json.dumps(_messages(), indent=1, ensure_ascii=False) + "\n"
    if rewrite:
        MESSAGES_PATH.write_text(fresh, encoding="utf-8")
    assert MESSAGES_PATH.read_text(encoding="utf-8") == fresh, "run pytest --rewrite"


def test_an_example_message_has_values() -> None:
    """All but the rules of a whole file and of runs, which have no example."""
    without = {rule.code for rule in RULES.values() if example_message(rule) is None}
    assert without <= {code for code in WITHOUT_EXAMPLE if code[:3] in ("GJ0", "GJ9")} | {"GJ147", "GJ160"}
    for rule in RULES.values():
        message = example_message(rule)
        assert message is None or "{" not in message


def test_names_of_rules_are_different_words() -> None:
    names = [rule.name for rule in RULES.values()]
    assert len(set(names)) == len(RULES)
    assert all(name.replace("-", "").isalnum() and name.islower() for name in names)
    assert RULES["GJ402"].name == "jump-with-the-laser-on"
