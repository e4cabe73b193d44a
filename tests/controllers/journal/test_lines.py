"""Checksums of a journal's lines."""

from __future__ import annotations

import pytest
from support.journals import bare_lines, with_checksums

from gusjob.controllers.journal.lines import journal_lines, sound_part

LINES = [b'{"schema":"gusjob-journal/2","job":"a.job"}', *(b'{"t":%d,"off":true}' % number for number in range(5))]
WHOLE = with_checksums(LINES)


def lines() -> list[bytes]:
    return WHOLE.splitlines(keepends=True)


def test_a_whole_journal() -> None:
    found = sound_part(WHOLE)
    assert (found.count, found.size, found.torn, found.damaged) == (6, len(WHOLE), False, False)
    assert bare_lines(WHOLE) == LINES


@pytest.mark.parametrize("number", range(6))
def test_a_line_that_was_changed_removed_or_doubled(number: int) -> None:
    made = lines()
    changed = [*made[:number], made[number].replace(b'"', b"'", 1), *made[number + 1 :]]
    removed = [*made[:number], *made[number + 1 :]]
    doubled = [*made[:number], made[number], *made[number:]]
    found = sound_part(b"".join(changed))
    assert (found.count, found.torn, found.damaged) == (number, True, number < 5)
    found = sound_part(b"".join(removed))  # Without its end it is that of a run that was killed.
    assert (found.count, found.torn) == (number, number < 5)
    assert sound_part(b"".join(doubled)).count == number + 1


def test_lines_in_another_order() -> None:
    made = lines()
    made[2], made[3] = made[3], made[2]
    assert (sound_part(b"".join(made)).count, sound_part(b"".join(made)).damaged) == (2, True)


@pytest.mark.parametrize("count", range(1, len(WHOLE)))
def test_a_journal_that_was_cut(count: int) -> None:
    found = sound_part(WHOLE[:count])
    assert found.count == WHOLE[:count].count(b"\n")
    assert found.torn == (WHOLE[count - 1] != 0x0A)
    assert not found.damaged


def test_zeros_behind_the_end() -> None:
    """A file system may have reserved room that was not written when the power failed."""
    found = sound_part(WHOLE + bytes(512))
    assert (found.count, found.torn, found.damaged) == (6, True, False)


@pytest.mark.parametrize(
    "line",
    [
        b'{"t":1,"part":-1,"run":0,"lead":0,"to":[0,0]}',
        b'{"t":1,"part":1.5,"run":0,"lead":0,"to":[0,0]}',
        b'{"t":1,"part":true,"run":0,"lead":0,"to":[0,0]}',
        b'{"t":1,"part":0,"run":-1,"lead":0,"to":[0,0]}',
        b'{"t":1,"part":0,"run":1e999,"lead":0,"to":[0,0]}',
        b'{"t":1,"part":0,"run":"0","lead":0,"to":[0,0]}',
        b'{"t":1,"broken":99999999999999999999,"run":0,"to":[0,0]}',
        b'{"t":1,"broken":1,"run":0,"to":[0]}',
        b'{"t":1,"broken":1,"run":0,"to":null}',
        b'{"t":-1,"off":true}',
        b'{"t":1,"off":1}',
        b'{"t":1,"end":"perhaps"}',
        b'{"t":1,"code":0,"line":1,"call":"system","args":[]}',
        b'{"t":1,"code":0,"line":1,"call":"GT_Open"}',
        b'{"t":1,"code":0,"line":-1,"call":"GT_Open","args":[]}',
        b'{"t":1,"code":0,"line":1,"call":"GT_Open","args":{}}',
        b'{"t":1,"code":"0","line":1,"call":"GT_Open","args":[]}',
        b'{"t":1,"resumed":7}',
        b"[1]",
        b"null",
        b"[" * 5000 + b"]" * 5000,
        b"\xff",
        b"",
    ],
)
def test_what_a_run_does_not_write(line: bytes) -> None:
    with pytest.raises(ValueError):
        list(journal_lines(line + b"\n"))
