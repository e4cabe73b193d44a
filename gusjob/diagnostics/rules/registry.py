"""The registry: every rule by its code, and the functions that define one."""

from __future__ import annotations

from msgspec.structs import replace

from gusjob.diagnostics.model import Rule, Severity

RULES: dict[str, Rule] = {}
"""Every rule by its code."""
VARIANTS: list[Rule] = []
"""Rules with another text for another cause of the same problem."""

ERROR, WARNING, NOTE = Severity.ERROR, Severity.WARNING, Severity.NOTE


def rule(
    code: str,
    severity: Severity,
    *,
    title: str,
    text: str,
    why: str,
    bad: str = "",
    good: str = "",
    section: str = "",
) -> Rule:
    """Define a rule and register it; the arguments are those of Rule.

    Raises:
        ValueError: The code is already in use.
    """
    if code in RULES:
        raise ValueError(f"rule {code} is defined twice")
    RULES[code] = Rule(
        code=code, severity=severity, title=title, text=text, why=why, bad=bad, good=good, section=section
    )
    return RULES[code]


def variant(rule: Rule, *, text: str) -> Rule:
    """Define another text for a rule, for another cause of the same problem."""
    VARIANTS.append(replace(rule, text=text))
    return VARIANTS[-1]
