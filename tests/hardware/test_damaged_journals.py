"""Damaged journals are refused, or resumed on the path of the job."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest
from support.controller import needs_controller
from support.forks import harness
from support.hardware import Bench
from support.journals import bare_lines
from support.mutate import MUTATIONS, mutant_of, resealed
from support.resuming import attempt, quick_machine, request_of

from gusjob.controllers.journal.lines import sound_part

pytestmark = needs_controller


@pytest.fixture
def journal(gus: Bench, tmp_path: Path) -> bytes:
    """The journal of a whole run."""
    request = request_of(tmp_path, gus.path, quick_machine(), journal=tmp_path / "0.journal")
    assert attempt(request, gus.controller)[0].is_done
    return (tmp_path / "0.journal").read_bytes()


@pytest.mark.slow
def test_damaged_journals_do_no_harm(capsys: pytest.CaptureFixture[str]) -> None:
    done = harness("mutate", "2000", "5")
    with capsys.disabled():
        print("\n" + "\n".join(done.stdout.splitlines()[-2:]))
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_mutation_changes_a_journal(journal: bytes) -> None:
    for mutation in set(MUTATIONS):
        chance = random.Random(1)
        assert any(mutation(journal, chance) != journal for _ in range(20)), mutation
        mutation(b"", chance)


def test_a_mutant_is_the_same_for_the_same_seed(journal: bytes) -> None:
    for number in range(50):
        made = [mutant_of(3, number).apply([journal, journal]) for _ in range(2)]
        assert made[0] == made[1]


def test_a_resealed_journal_has_right_checksums(journal: bytes) -> None:
    assert resealed(journal) == journal
    lines = bare_lines(journal)
    changed = json.loads(lines[3]) | {"line": 77}
    lines[3] = json.dumps(changed, separators=(",", ":")).encode()
    made = resealed(b"\n".join(lines))
    assert made != journal
    assert sound_part(made).count == len(lines)
    assert not sound_part(made).torn
