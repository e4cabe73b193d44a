"""A run of more than 10^10 ticks is refused by report and run, and so by check. A tick is 250 us: 2,500,000 s."""

from __future__ import annotations

from pathlib import Path

import pytest

from gusjob.diagnostics.model import has_errors
from gusjob.pipeline import Checked, Simulated, examine, load, simulate

HEAD = "LASER MODE DUTY CARRIER 10\nLASER POWER 30\nACC 1000\n"
MARK = "LASER ON\nLINE X 10\nLASER OFF\n"


@pytest.mark.parametrize(
    ("text", "is_too_long"),
    [
        # 10 mm at 4 nm/s.
        (HEAD + "VEL 4.01e-6\n" + MARK, False),
        (HEAD + "VEL 3.99e-6\n" + MARK, True),
        (HEAD + "VEL 1e-6\n" + MARK, True),
        # From rest to rest 2 * sqrt(10 mm / ACC): 6.4e-12 mm/s2.
        (HEAD + "VEL 10\nACC 6.5e-12\n" + MARK, False),
        (HEAD + "VEL 10\nACC 6.3e-12\n" + MARK, True),
        # 152,597 * 16.383 s = 2,499,997 s.
        ("REPEAT 152597\nDWELL 16383\nEND\n", False),
        ("REPEAT 152598\nDWELL 16383\nEND\n", True),
    ],
)
def test_check_reports_what_report_refuses(text: str, is_too_long: bool) -> None:
    loaded = load(Path("x.job"), None, data=text.encode())
    assert isinstance(loaded, Checked)
    assert not has_errors(loaded.diagnostics)
    checked, simulated = examine(loaded), simulate(loaded)
    assert isinstance(simulated, Simulated) != is_too_long
    for result in (checked, simulated):
        assert [d.rule.code for d in result.diagnostics if d.severity.name == "ERROR"] == ["GJ713"] * is_too_long
