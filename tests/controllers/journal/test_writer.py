"""A journal that can't be written any more."""

from __future__ import annotations

import io
import threading
from pathlib import Path
from typing import Any

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
from gusjob.controllers.journal.lines import journal_lines, sound_part
from gusjob.controllers.journal.writer import Journal, mark_resumed

pytestmark = needs_controller


def test_a_full_disk_ends_the_run_dark(gus: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The journal can't be written from each of its lines on: the laser must not stay on because of that."""
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
        else:  # Full after the last poll of the motion: only the shutdown is left.
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


def test_a_disk_that_hangs_ends_the_run_dark(gus: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a network drive does: the laser must not stay on because a line can't be written."""
    stream, machine, released = stream_of(EVERYTHING), gus.machine(Machine(), call_timeout_s=0.1), threading.Event()

    class Hanging(Journal):
        def __init__(self, path: Path, head: dict[str, object]) -> None:
            super().__init__(path, head)
            written, real = [0], self.write

            def write(line: bytes) -> int:
                written[0] += 1
                if written[0] == 60:
                    released.wait(10)
                return real(line)

            self.write = write

    monkeypatch.setattr("support.hardware.Journal", Hanging)
    ran = gus.run(stream, machine)
    assert ran.codes == ["GJ915"]
    assert "a line has not been written for" in ran.faults[0].message
    assert is_safe(gus)
    assert ran.session.is_off
    released.set()


def test_a_journal_that_was_given_up_is_incomplete(tmp_path: Path) -> None:
    """A full disk takes no line that records it."""
    made = Journal(tmp_path / "a.journal", {"job": "a.job"})
    made.mark(part=0, run=0.0, lead=0, to=[0, 0.0])
    made.give_up(OSError(28, "No space left on device"))
    made.mark(off=True)
    made.close()
    found = sound_part(made.path.read_bytes())
    assert (found.count, found.torn, found.damaged) == (2, True, False)
    # A writer that adds lines first records that something is missing.
    mark_resumed(made.path, tmp_path / "b.journal")
    found = sound_part(made.path.read_bytes())
    assert (found.count, found.torn) == (4, False)
    assert [list(line)[1] for line in journal_lines(made.path.read_bytes())] == ["job", "part", "cut", "resumed"]


def test_a_journal_without_room_for_a_byte_loses_the_end_of_its_last_line(tmp_path: Path) -> None:
    class Full(io.BytesIO):
        def write(self, line: Any) -> int:
            if self.tell() == len(self.getvalue()):
                raise OSError(28, "No space left on device")
            return super().write(line)

    file = Full(b'{"schema"}\n{"t":0}\n')
    file.seek(0, 2)
    Journal._make_incomplete(file)
    assert file.getvalue() == b'{"schema"}\n{"t":0}\0'


def test_a_line_that_is_written_in_part_is_an_error(tmp_path: Path) -> None:
    made = Journal(tmp_path / "a.journal", {"job": "a.job"})
    made.write = lambda line: len(line) - 1
    made.mark(off=True)
    assert made.lost == "no space left on device"
    made.close()
