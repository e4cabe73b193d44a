"""A journal that can't be written any more."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.controller import needs_controller
from support.hardware import (
    EVERYTHING,
    Bench,
    fresh,
    is_safe,
)
from support.tools import stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.journal.writer import Journal

pytestmark = needs_controller


def test_a_full_disk_ends_the_run_dark(gus: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The journal can't be written any more, at each of its lines: no light is left on for want of a journal."""
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine())
    lines = gus.run(stream, machine).journal.read_bytes().count(b"\n")
    whole = gus.controller.rows()
    for full_at in range(2, lines, 3):
        fresh(gus)
        journals: list[_Full] = []

        def full_journal(path: Path, head: dict[str, object], at: int = full_at, made: list[_Full] = journals) -> _Full:
            made.append(_Full(path, head, at))
            return made[0]

        monkeypatch.setattr("support.hardware.Journal", full_journal)
        ran = gus.run(stream, machine)
        assert is_safe(gus), full_at
        if ran.codes:
            assert ran.codes == ["GJ915"], full_at
        else:  # Full behind the last look at the motion: what is left is the way out.
            assert journals[0].missed <= 7, full_at
            assert gus.controller.rows().shape == whole.shape, full_at


class _Full(Journal):
    """On a disk that is full after so many lines; `missed` counts those that found no room."""

    def __init__(self, path: Path, head: dict[str, object], lines: int) -> None:
        super().__init__(path, head)
        self.missed = 0
        written, real = [0], self.write

        def write(line: bytes) -> int:
            written[0] += 1
            if written[0] > lines:
                self.missed += 1
                raise OSError(28, "No space left on device")
            return real(line)

        self.write = write

    def give_up(self, error: OSError) -> None:
        super().give_up(error)
        self.write = self._miss

    def _miss(self, line: bytes) -> int:
        self.missed += 1
        return len(line)
