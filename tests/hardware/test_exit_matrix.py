"""Each call of a job fails, and the job is resumed until it is done: a sample of support.exit_matrix.

Nothing is left out, no more is marked twice than the plans announced, nothing is marked elsewhere or with another
power, and no message says that the laser is off while it may be on.
"""

from __future__ import annotations

import pytest
from support.controller import needs_controller
from support.exit_matrix import CODES, COUNTS, all_cases, sampled
from support.forks import harness

pytestmark = needs_controller

CASES = 240


@pytest.mark.slow
def test_each_call_fails_in_each_way(capsys: pytest.CaptureFixture[str]) -> None:
    done = harness("exit_matrix", str(CASES), "5")
    with capsys.disabled():
        print("\nexit matrix: " + "\n".join(done.stdout.splitlines()[-4:]))
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_runs_that_are_killed(capsys: pytest.CaptureFixture[str]) -> None:
    """A few of what support.kill does by the hundred."""
    done = harness("kill", "30", "1")
    with capsys.disabled():
        print("\nkilled runs: " + "\n".join(done.stdout.splitlines()[-4:]))
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_sample_has_every_code_and_every_count() -> None:
    cases = all_cases(["GT_Open", "GT_Close"])
    assert len(cases) == len(CODES) * len(COUNTS) * 2 * 2 * (2 + 3 * 30)
    chosen = sampled(cases, CASES, 5)
    assert len({case.number for case in chosen}) == CASES
    assert {case.code for case in chosen} == set(CODES)
    assert {case.count for case in chosen} == set(COUNTS)
    assert sampled(cases, CASES, 5) == chosen
