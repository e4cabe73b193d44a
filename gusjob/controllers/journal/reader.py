"""Read from journals where a run was interrupted, to resume it.

A run that resumes another one may be interrupted before its first part begins: what is known of the position is then in
the journals of both. They are read as one, from the journal of the last part on.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from msgspec import Struct

from gusjob.controllers.gus.ranges import FIFO_SLOTS
from gusjob.controllers.journal import JOURNAL_SCHEMA, JOURNAL_START, is_current
from gusjob.controllers.journal.lines import is_number, is_whole, journal_lines, path_of, sound_part
from gusjob.i18n.phrases import Phrase
from gusjob.inputs import open_input
from gusjob.ir.overrides import NO_OVERRIDES, Overrides
from gusjob.kinematics.units import MS_PER_S

_CHAIN = 1000
"""Maximum number of journals of runs that resume each other."""
_HEAD_BYTES = 65536
"""The first line of a journal is not longer."""


class RecordedPoll(Struct, frozen=True, kw_only=True):
    """What a poll found: rows of the part sent until then, motion in progress, free slots, position in pulse."""

    sent: int
    run: bool
    space: int
    x: float
    y: float


class RecordedPart(Struct, kw_only=True):
    """A part of a run as its journal recorded it, up to where it was interrupted.

    It began at `begin` (row, pulse along it; of the whole job) after `lead` rows of its own; what was marked before it
    ends at `marked_to` at the latest. `sent`: how many of its rows the controller took; `uncertain`: whether one more
    may have been taken.

    Of the stage that was cleared last: `first`, the rows that were sent before it; `started`: GT_CrdStart was called
    and not refused. As polled last: `slots` of its FIFO; `segment`: calls done; `line` of the job; `space`: free slots
    when `sent_at_space` rows were sent; `poll`: the last poll of the motion that found no fault.
    """

    begin: tuple[int, float]
    lead: int
    marked_to: tuple[int, float]
    sent: int = 0
    uncertain: bool = False
    first: int = 0
    started: bool = False
    slots: int | None = None
    segment: int = 0
    line: int = 0
    run: bool = True
    space: int = FIFO_SLOTS
    sent_at_space: int = 0
    poll: RecordedPoll | None = None
    newest_poll: RecordedPoll | None = None
    """One that no call of the job followed: it may have found a fault."""

    @property
    def is_over(self) -> bool:
        """Whether the last poll found the stage at its end; its FIFO may have been cleared since."""
        found = self.newest_poll
        is_empty = found is not None and found.sent == self.sent > self.first and found.space == self.slots
        return is_empty and not self.uncertain and found is not None and not found.run

    @property
    def queued(self) -> int:
        """Calls in the FIFO as polled last, with those that were sent since."""
        return (self.slots or FIFO_SLOTS) - self.space + self.sent - self.sent_at_space


class RecordedRun(Struct, frozen=True, kw_only=True):
    """A run as its journals recorded it.

    `path`: the journal to continue, with its first line `head`. `part`: the last one that began, None if none did.
    `broken`: the earliest and the latest position of the whole job at which the laser went off, if it is known: (row,
    pulse along it) each. `off`: the laser may have been switched off since; `off_ms`: from then to the confirmed rest
    of the motion, None if that is not known. `done`: the whole job was done; `torn`: the last line is incomplete.
    """

    path: Path
    head: dict[str, Any]
    part: RecordedPart | None
    broken: tuple[tuple[int, float], tuple[int, float]] | None
    off: bool
    off_ms: float | None
    done: bool
    torn: bool

    @property
    def overrides(self) -> Overrides:
        """The values of LETs that the job was run with."""
        found: Overrides = self.head.get("overrides", NO_OVERRIDES)
        return found


def read_journal(path: Path) -> RecordedRun | str:
    """Read a journal, and those of the runs that it continues as far as they are needed.

    Returns:
        The recorded run, or a phrase that says why the file is not a journal or can't be resumed.

    Raises:
        OSError: the file can't be read.
    """
    found = _read_one(path)
    if isinstance(found, str):
        return found
    if found.resumed:
        other = _last_of_chain(path, found)
        return Phrase("{name}: this run was resumed already: resume {other}", name=path.name, other=other)
    chain = [found]
    while (oldest := chain[-1]).needs_older:
        older_path = _linked(oldest.path, oldest.head["resumes"], oldest.head.get("resumes_started", ""))
        if len(chain) > _CHAIN or any(older_path == one.path for one in chain):
            return _damaged(path)
        older = _read_one(older_path)
        if isinstance(older, str):
            return older
        if not older.is_resumed_by(oldest):
            other = _last_of_chain(older_path, older) if older.resumed else older_path
            return Phrase("{name}: this run never began; resume {other} instead", name=path.name, other=other)
        chain.append(older)
    return _as_one(chain)


class _OneJournal(Struct, kw_only=True):
    """One journal: what happened since its last part began, or since its start."""

    path: Path
    head: dict[str, Any]
    torn: bool
    part: RecordedPart | None = None
    broken: tuple[tuple[int, float], tuple[int, float]] | None = None
    off_s: float | None = None
    rest_s: float | None = None
    is_moving: bool = False
    """The motion was in progress when the controller was opened."""
    is_cut: bool = False
    """Something else may have cut the laser before it was switched off."""
    done: bool = False
    resumed: str = ""
    resumed_started: str = ""

    @property
    def needs_older(self) -> bool:
        """Whether the position is in the journal of the run that this one resumes."""
        return self.head.get("resumes") is not None and self.part is None and self.broken is None and not self.done

    def is_resumed_by(self, other: _OneJournal) -> bool:
        """Return whether the last line names another journal: by the start of its run, or by its name."""
        if not self.resumed:
            return False
        if self.resumed_started:
            return self.resumed_started == other.head.get("started")
        return path_of(self.resumed).name == other.path.name

    def add(self, line: dict[str, Any]) -> None:
        """Add a line after the first one. Raises ValueError if a run does not write it there."""
        if self.resumed:
            raise ValueError(line)
        if "call" in line:
            self._add_call(line)
        elif "part" in line:
            self.part = RecordedPart(
                begin=(line["part"], float(line["run"])),
                lead=line["lead"],
                marked_to=(line["to"][0], float(line["to"][1])),
            )
            self.broken = self.off_s = self.rest_s = None
            self.is_moving = self.is_cut = self.done = False
        elif "broken" in line:
            to = line["to"]
            self.broken = (line["broken"], float(line["run"])), (to[0], float(to[1]))
        elif "off" in line:
            self._add_off(line["t"] if line["off"] else None)
        elif "starting" in line and self.part is not None:
            self.part.started = True
        elif "rest" in line:
            self.rest_s = line["t"] if self.off_s is not None else None
        elif "cut" in line:
            self.is_cut = True
        elif "moving" in line:
            self.is_moving = True
        elif "end" in line:
            self.done = line["end"] == "done"
        elif "resumed" in line:
            self.resumed, self.resumed_started = line["resumed"], line.get("started", "")

    def _add_off(self, off_s: float | None) -> None:
        """Note when the laser may have been switched off first."""
        if off_s is None:
            self.off_s = self.off_s if self.rest_s is not None else None
        elif self.off_s is None:
            self.off_s = off_s

    def _add_call(self, line: dict[str, Any]) -> None:
        part, code, args = self.part, line["code"], line["args"]
        if part is None:
            return
        if "row" in line:
            self._add_row(part, line["row"], code)
        elif line["call"] == "GT_CrdStart":
            part.started = code <= 0  # One that was not answered may have had its effect.
        elif code == 0 and line["line"] > 0:
            self._add_answer(part, line["call"], args, line["line"])

    @staticmethod
    def _add_row(part: RecordedPart, row: int, code: int) -> None:
        """Add a buffered call; the rows follow each other."""
        expected = -1 if part.sent < part.lead else part.begin[0] + part.sent - part.lead
        if row != expected:
            raise ValueError(row)
        part.sent += code == 0
        part.poll = part.newest_poll or part.poll
        part.uncertain = code < 0

    @staticmethod
    def _add_answer(part: RecordedPart, call: str, args: list[Any], line: int) -> None:
        """Add the answer of a call about the job's motion."""
        if call == "GT_CrdClear":
            part.first, part.started, part.slots = part.sent, False, None
            part.segment, part.poll, part.newest_poll = 0, None, None
        elif call == "GT_CrdSpace":
            part.space, part.sent_at_space = _whole(args[1]), part.sent
            part.slots = part.slots or part.space
        elif call == "GT_CrdStatus":
            part.run, part.segment, part.line = bool(_whole(args[1])), _whole(args[2]), line
            part.poll = part.newest_poll or part.poll
        elif call == "GT_GetCrdPos" and part.started:
            x, y = (_number(value) for value in args[1][:2])
            part.newest_poll = RecordedPoll(sent=part.sent_at_space, run=part.run, space=part.space, x=x, y=y)


def _read_one(path: Path) -> _OneJournal | str:
    """Read one journal as far as its lines are sound."""
    with open_input(path) as file:
        data = file.read(len(JOURNAL_START))
        if data == JOURNAL_START:  # Of another file no more is read: a device may have no end.
            data += file.read()
    if not data:
        return Phrase("{name} is empty: its run ended before it began; start the job again", name=path.name)
    if not data.startswith(JOURNAL_START):
        return Phrase("{name} is not a journal of gusjob run ({schema})", name=path.name, schema=JOURNAL_SCHEMA)
    if not is_current(data):
        return Phrase(
            "{name} was written by another version of gusjob, not as {schema}: continue with --from-line N",
            name=path.name,
            schema=JOURNAL_SCHEMA,
        )
    sound = sound_part(data)
    if sound.damaged or not sound.count:
        return _damaged(path, sound.count + 1)
    number = 1
    try:
        lines = journal_lines(data[: sound.size])
        head = next(lines)
        if not {"job", "calls", "rows", "options", "begin", "resumes"} <= head.keys():
            return _damaged(path)
        found = _OneJournal(path=path, head=head, torn=sound.torn)
        for number, line in enumerate(lines, 2):  # noqa: B007  (named in the message)
            found.add(line)
    except (ValueError, KeyError, IndexError, TypeError):
        return _damaged(path, number)
    return found


def _as_one(chain: list[_OneJournal]) -> RecordedRun | str:
    """Join the journals of runs that resume each other, the newest first."""
    newest, oldest = chain[0], chain[-1]
    off, off_ms = False, None
    for one in reversed(chain):
        if one.off_s is not None and not off:
            off, off_ms = True, None if one.rest_s is None else (one.rest_s - one.off_s) * MS_PER_S
        elif one.is_moving:
            off_ms = None  # It moved on without laser for an unknown time.
    if any(one.is_cut or one.torn for one in chain):
        off, off_ms = True, None
    broken = oldest.broken
    if broken is None and oldest.part is None and oldest.head["begin"] is not None:
        row, along, *latest = oldest.head["begin"]
        broken = (row, float(along)), (latest[0], float(latest[1])) if latest else (row, float(along))
    if broken is None and oldest.part is None:
        return _damaged(newest.path)
    return RecordedRun(
        path=newest.path,
        head=newest.head,
        part=oldest.part,
        broken=broken,
        off=off,
        off_ms=off_ms,
        done=oldest.done,
        torn=newest.torn,
    )


def _last_of_chain(path: Path, journal: _OneJournal) -> Path:
    """Return the journal of the run that resumed a run last."""
    seen = {path}
    while journal.resumed and len(seen) < _CHAIN:
        path = _linked(path, journal.resumed, journal.resumed_started)
        if path in seen:
            break
        seen.add(path)
        try:
            found = _read_one(path)
        except OSError:
            break
        if isinstance(found, str):
            break
        journal = found
    return path


def _linked(path: Path, named: str, started: str) -> Path:
    """Return the journal that another one names, where it was or beside it: both may have been moved together.

    Another journal of that name may be there now: `started` is when the run of the right one started, '' if unknown.
    """
    found = path_of(named)
    candidates = [one for one in (found, path.parent / found.name) if one.is_file()]
    right = [one for one in candidates if started and _started(one) == started]
    return next(iter(right or candidates), found)


def _started(path: Path) -> str:
    """Return when the run of a journal started, '' if that can't be read."""
    try:
        with open_input(path) as file:
            return str(next(journal_lines(file.readline(_HEAD_BYTES))).get("started", ""))
    except (OSError, ValueError, StopIteration):
        return ""


def _damaged(path: Path, line: int = 0) -> str:
    if line:
        return Phrase(
            "{name} is damaged: line {line} was changed, or lines before it were removed; check the part, then "
            "continue with --from-line N",
            name=path.name,
            line=line,
        )
    return Phrase("{name} is damaged: it can't be read as {schema}", name=path.name, schema=JOURNAL_SCHEMA)


def _whole(value: Any) -> int:
    if not is_whole(value):
        raise ValueError(value)
    return int(value)


def _number(value: Any) -> float:
    if not is_number(value):
        raise ValueError(value)
    return float(value)
