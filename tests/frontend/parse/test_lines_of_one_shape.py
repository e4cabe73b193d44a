"""A line means the same, whether or not a line of its shape was before it."""

from __future__ import annotations

import pytest

from gusjob.frontend.parse.job_reader import read_job_text
from gusjob.frontend.source import Source


def codes(text: str) -> list[str]:
    return [found.rule.code for found in read_job_text(Source(name="a.job", data=text.encode())).diagnostics]


@pytest.mark.parametrize(
    ("before", "line"),
    [
        ("ACC 5mm/s2", "ACC 6mm/s02"),
        ("VEL 5m/s", "VEL 900000000000000m/s"),
        ("LINE X .5", "LINE X ."),
        ("LINE X 1e3", "LINE X 1e16"),
        ("LINE X (p1-2)", "LINE X (p01-2)"),
    ],
)
def test_a_line_alone_and_after_another(before: str, line: str) -> None:
    assert codes(before) == []
    assert codes(f"{before}\n{line}\n") == codes(line)
