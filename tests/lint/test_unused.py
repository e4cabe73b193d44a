"""What is set for a laser and never used."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.cli import write
from support.tools import MARK, diagnostics_in

from gusjob.pipeline import examine_file

HEAD = MARK + "LASER POWER 30\n"
DONE = "LASER ON\nLINE X 1\nLASER OFF\n"
SECOND = "LASER MODE ANALOG CHANNEL 1\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (HEAD + "LINE X 1\nLINE X 2\n", [(5, "GJ409")]),
        (HEAD + "JUMP X 1\nARC CW I 1 J 0\n", [(6, "GJ409")]),
        (MARK + "LASER FOLLOW MIN 1 MAX 5 AT 100\nLINE X 1\n", [(5, "GJ409")]),
        (MARK + "LASER POWER 30 NOW\nLINE X 1\n", [(5, "GJ409")]),
        (HEAD + SECOND + "LASER POWER 3 CHANNEL 1\nLINE X 1\n", [(7, "GJ409")]),  # One cause.
        (MARK + "LINE X 1\n", []),  # It only moves.
        (HEAD + "JUMP X 1\n", []),
        (HEAD, []),  # A header for others.
        (HEAD + "LASER ON NOW\nLINE X 1\nLASER OFF NOW\n", [(7, "GJ304")]),
        (HEAD + "LNE X 1\nLINE X 1\n", [(5, "GJ102")]),  # What it may contain is not missing.
        (HEAD + SECOND + DONE, []),
        (HEAD + SECOND + "LASER POWER 3 CHANNEL 1\n" + DONE, [(6, "GJ410")]),
        (HEAD + SECOND + "LASER FOLLOW MIN 1 MAX 5 AT 100 CHANNEL 1\n" + DONE, [(6, "GJ410")]),
        (HEAD + SECOND + "LASER POWER 3 CHANNEL 1\n" + DONE + DONE.replace("1\n", "5\n").replace("N\n", "N CHANNEL 1\n")
         .replace("F\n", "F CHANNEL 1\n"), []),
        (HEAD + DONE + "LASER POWER 40\n", [(8, "GJ210")]),
        (HEAD + DONE + "LASER POWER 1\n", []),  # It leaves a low power behind.
        (HEAD + DONE + "LASER FOLLOW MIN 1 MAX 5 AT 100\n", [(8, "GJ210")]),
        (HEAD + "REPEAT 2\nLASER POWER 30\n" + DONE + "LASER POWER 20\nJUMP X 5\nEND\n", [(10, "GJ210")]),
    ],
)  # fmt: skip
def test_what_nothing_uses(text: str, expected: list[tuple[int, str]]) -> None:
    assert diagnostics_in(text) == expected


@pytest.mark.parametrize("power", ["LASER POWER 3 CHANNEL 1", "LASER POWER 3 NOW CHANNEL 1"])
def test_a_channel_that_a_setup_file_prepares_for_other_jobs(tmp_path: Path, power: str) -> None:
    """What a job sets for a channel that it never uses is a mistake, but not what it shares with other jobs."""

    def channels_never_on(job: str) -> list[tuple[str, int]]:
        found = examine_file(write(tmp_path, job), None)
        return [(Path(d.file).name, d.span.line) for d in found.diagnostics if d.rule.code == "GJ410"]

    write(tmp_path, f"{HEAD}{SECOND}{power}\n", "setup.job")
    write(tmp_path, f"LINE X 2\n{power}\n", "part.job")
    assert channels_never_on(f'INCLUDE "setup.job"\n{DONE}') == []
    assert channels_never_on(f"{HEAD}{SECOND}{power}\n{DONE}") == [("x.job", 6)]
    assert channels_never_on(f'INCLUDE "setup.job"\n{power}\n{DONE}') == [("x.job", 2)]
    assert channels_never_on(f'{HEAD}{SECOND}{DONE}INCLUDE "part.job"\n') == [("part.job", 2)]
