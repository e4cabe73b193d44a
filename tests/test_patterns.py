"""Patterns are compiled when they are first used, and then are those of re."""

from __future__ import annotations

import re

import pytest

from gusjob.patterns import lazy_pattern


def test_a_pattern_is_compiled_once_when_it_is_first_used(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = re.compile
    given: list[str] = []

    def noted(text: str, flags: re.RegexFlag) -> re.Pattern[str]:
        given.append(text)
        return compiled(text, flags)

    monkeypatch.setattr(re, "compile", noted)
    pattern = lazy_pattern("a(b+)", re.IGNORECASE)
    assert given == []
    found = pattern.search("xABB")
    assert found is not None
    assert found[1] == "BB"
    assert given == ["a(b+)"]
    assert pattern.search("abb") is not None
    assert len(given) == 1


def test_it_has_all_that_a_pattern_has() -> None:
    lazy, compiled = lazy_pattern(rb"(?P<n>\d)x"), re.compile(rb"(?P<n>\d)x")
    assert (lazy.pattern, lazy.flags, lazy.groupindex) == (compiled.pattern, compiled.flags, compiled.groupindex)
    assert lazy.sub(b"-", b"1x2x3") == b"--3"
    assert lazy.findall(b"1x2x3") == [b"1", b"2"]


def test_a_wrong_pattern_is_an_error_when_it_is_used() -> None:
    pattern = lazy_pattern("(")
    with pytest.raises(re.error):
        pattern.match("x")
