"""gusjob run --backend gts: what is going to happen, the question, the run, and what became of it."""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import click
import numpy as np

from gusjob.cli.common import show, stop
from gusjob.cli.text import padded, width
from gusjob.config.machine import Abi, Machine
from gusjob.controllers.control import Control
from gusjob.controllers.gus.calls import BufferedCalls, Stream
from gusjob.controllers.gus.driver.abi import ABI_PROFILES
from gusjob.controllers.gus.driver.library import Library, load_library
from gusjob.controllers.gus.driver.link import Link
from gusjob.controllers.gus.driver.resume import find_place, recorded_place
from gusjob.controllers.gus.driver.session import Session, needed_calls, one_queue, outputs_of
from gusjob.controllers.gus.dry import frame, without_laser
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.gus.place import START, Place
from gusjob.controllers.gus.remainder import Part, rest, whole
from gusjob.controllers.journal import Journal, Recorded, mark_resumed, read_journal
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Span, has_errors
from gusjob.hardware.forecast import ChannelForecast, Forecast, forecast
from gusjob.hardware.runner import Outcome, Runner, signals
from gusjob.i18n.phrases import Phrase, localized, printable, reason_of
from gusjob.pipeline import Compiled, FileResult, Simulated, with_simulation
from gusjob.version import __version__


@dataclass(frozen=True, slots=True, kw_only=True)
class Wishes:
    """What the command line says of a run on hardware."""

    library: str | None
    abi: str | None
    yes: bool
    frame: bool
    no_laser: bool
    progress: str
    journal: Path | None
    resume: Recorded | None
    resume_path: Path | None
    from_line: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Prepared:
    """All that a run needs before the controller is opened."""

    loaded: Compiled
    machine: Machine
    stream: Stream
    forecast: Forecast
    library: Library
    wishes: Wishes


def run_on_controller(loaded: Simulated, wishes: Wishes) -> int:
    """Show what is going to happen, ask, run; the exit code."""
    prepared = _prepared(loaded, wishes)
    if not isinstance(prepared, Prepared):
        show(prepared)
        return 1
    begin = _begin(prepared)
    if not wishes.yes and not _answers():
        stop(localized(Phrase("a run on hardware asks before it starts: answer on a terminal, or say --yes")))
    journal = _journal(prepared, begin)
    try:
        link = Link(prepared.library, journal)
        if begin is None:
            assert wishes.resume is not None
            begin, outcome = _found(prepared, link, wishes.resume)
            if begin is None:
                return _closing(prepared, outcome, journal, None)
        if begin != START and begin.row >= len(prepared.stream.buffered):
            _tell(Phrase("the job was done to its end; there is nothing to go on with"))
            return 0
        click.echo(_plan(prepared, begin, journal), err=True)
        if not wishes.yes and not click.confirm(_question(prepared), err=True):
            _tell(Phrase("not started"))
            return 1
        session = _session(prepared, link)
        outcome = _watched(session, prepared, _part(prepared, begin))
        return _closing(prepared, outcome, journal, session)
    finally:
        journal.close()


def _prepared(loaded: Simulated, wishes: Wishes) -> Prepared | FileResult:
    """The stream to run, its forecast and the library; where there are faults, these."""
    stream, trace = loaded.stream, loaded.trace
    loaded = replace(loaded, diagnostics=())  # They were shown; what is shown later is about the run.
    machine, controller = loaded.machine, loaded.machine.controller
    library_path = _named_here(wishes.library) or controller.library
    abi = Abi(wishes.abi) if wishes.abi else controller.abi
    if not library_path or abi is None:
        why = Phrase(
            "a run on hardware needs the vendor's library: --library PATH and --abi {abis}, "
            "or library and abi under [controller] in the machine profile; see gusjob devices",
            abis="|".join(Abi),
        )
        stop(localized(why))
    if wishes.frame or wishes.no_laser:
        dark = frame(stream, trace) if wishes.frame else without_laser(stream)
        if dark is None:
            stop(localized(Phrase("nothing moves in this job")))
        stream = dark
        run, faults = simulate_stream(stream, machine)
        loaded = with_simulation(loaded, faults)
        if run is None or has_errors(faults):
            return loaded
        trace = run
    if faults := one_queue(stream):
        return replace(loaded, diagnostics=(*loaded.diagnostics, *_of_job(loaded, faults)))
    library, faults = load_library(library_path, abi, controller.card, needed_calls(stream, machine))
    loaded = replace(loaded, diagnostics=(*loaded.diagnostics, *_of_job(loaded, faults)))
    if library is None:
        return loaded
    expected = forecast(stream, trace, machine)
    return Prepared(loaded=loaded, machine=machine, stream=stream, forecast=expected, library=library, wishes=wishes)


def _named_here(library: str | None) -> str:
    """A library of the command line: a file that is there is meant; other bare names are the system's matter."""
    return str(Path(library).resolve()) if library and Path(library).exists() else library or ""


def _answers() -> bool:
    """Whether somebody can be asked."""
    return sys.stdin is not None and sys.stdin.isatty()


def _begin(prepared: Prepared) -> Place | None:
    """Where to begin; None if only the controller can tell."""
    wishes, stream = prepared.wishes, prepared.stream
    if wishes.from_line is not None:
        return Place(row=row_of_line(stream, prepared.loaded, wishes.from_line))
    if wishes.resume is None:
        return START
    if (options := str(wishes.resume.head.get("options", ""))) != _options(wishes):
        again = Phrase("say {options} again", options=printable(options))
        how = again if options else Phrase("leave --no-laser out")
        why = Phrase("this is the journal of another kind of run: {how}", how=how)
        stop(f"{wishes.resume_path}: {localized(why)}")
    if wishes.resume.head.get("calls") != fingerprint(stream):
        why = Phrase(
            "this is the journal of other calls: the job or its profile have changed; go on with --from-line N"
        )
        stop(f"{wishes.resume_path}: {localized(why)}")
    return recorded_place(wishes.resume)


def row_of_line(stream: Stream, loaded: Compiled, place: str) -> int:
    """The first row of a line, or of the first line behind it that has one; stops if there is none.

    `place`: N in the job's own file, FILE:N in one that it includes, as messages name them.
    """
    name, _, number = place.rpartition(":")
    line = int(number) if number.isascii() and number.isdigit() else 0
    lines, first = np.unique(stream.buffered.line, return_index=True)
    spans = [_located(loaded, int(found)) for found in lines.tolist()]

    def meant(span: Span) -> bool:
        own = not name or Path(name).name == loaded.path.name
        return span.line >= line and (not span.path if own else Path(span.path).name == Path(name).name)

    rows = [(span.line, int(row)) for span, row in zip(spans, first, strict=True) if meant(span)]
    if not rows or line < 1:
        why = Phrase("the job has no motion or laser call at or behind this line")
        stop(f"--from-line {place}: {localized(why)}")
    return min(rows)[1]


def _options(wishes: Wishes) -> str:
    """What makes other calls of a job."""
    return "--frame" if wishes.frame else "--no-laser" if wishes.no_laser else ""


def fingerprint(stream: Stream) -> str:
    """What tells two streams apart."""
    digest = hashlib.sha256()
    for name in BufferedCalls.__slots__:
        digest.update(np.ascontiguousarray(stream.buffered.column(name)).tobytes())
    digest.update(repr([(c.name, c.args, c.at) for c in stream.calls]).encode())
    return digest.hexdigest()


def _journal(prepared: Prepared, begin: Place | None) -> Journal:
    """The journal's file, which must be there before anything else."""
    wishes, path = prepared.wishes, prepared.loaded.path
    now = datetime.now(UTC)
    journal = wishes.journal or path.with_name(f"{path.stem}.{now:%Y%m%d-%H%M%S-%f}.journal")
    head = {
        "gusjob": __version__,
        "job": str(path.resolve()),
        "calls": fingerprint(prepared.stream),
        "rows": len(prepared.stream.buffered),
        "library": prepared.library.path,
        "abi": prepared.library.abi,
        "started": now.isoformat(),
        "options": _options(wishes),
        "begin": None if begin is None else [begin.row, begin.run_pulse],
        "resumes": str(wishes.resume_path.resolve()) if wishes.resume_path else None,
    }
    try:
        return Journal(journal, head)
    except FileExistsError:
        why = Phrase("this file exists already; name another one with --journal")
        stop(f"{journal}: {localized(why)}")
    except OSError as error:
        why = Phrase("can't write the journal: {reason}; name another --journal", reason=reason_of(error))
        stop(f"{journal}: {localized(why)}")


def _session(prepared: Prepared, link: Link) -> Session:
    return Session(
        link=link,
        machine=prepared.machine,
        control=Control(),
        stream=prepared.stream,
        options=" --no-laser" if prepared.wishes.no_laser else "",
        outputs=outputs_of(prepared.stream),
    )


def _found(prepared: Prepared, link: Link, recorded: Recorded) -> tuple[Place | None, Outcome]:
    """Where a run broke, as the controller knows it."""
    found: list[Place] = []

    def ask(session: Session) -> None:
        found.append(find_place(session, recorded))

    session = _session(prepared, link)
    with signals(session.control):
        outcome = Runner(session).run(ask)
    return (found[0] if found and not outcome.faults else None), outcome


def _part(prepared: Prepared, begin: Place) -> Callable[[Session], Part]:
    """What to run, once it is known where the head is."""
    stream, wishes = prepared.stream, prepared.wishes

    def made(session: Session) -> Part:
        if wishes.resume_path is not None:
            with suppress(OSError):  # A journal that can't be written to stays as it is.
                mark_resumed(wishes.resume_path, session.link.journal.path)
        head = session.head()
        return whole(stream, head) if begin == START else rest(stream, begin, head)

    return made


def _watched(session: Session, prepared: Prepared, part: Callable[[Session], Part]) -> Outcome:
    """The run, with a panel or lines, and keys."""
    from gusjob.cli.panel import watch

    def line_of(row: int) -> str:
        lines = prepared.stream.buffered.line
        return _place_text(prepared.loaded, int(lines[min(row, len(lines) - 1)])) if len(lines) else ""

    with (
        signals(session.control),
        watch(
            prepared.wishes.progress, session.control, prepared.forecast, prepared.stream, prepared.machine, line_of
        ) as watcher,
    ):
        return Runner(session, watcher.tick).run(part)


def _place_text(loaded: Compiled, line: int) -> str:
    span = _located(loaded, line)
    return printable(f"{span.path or loaded.path.name}:{span.line}")


def _located(loaded: Compiled, line: int) -> Span:
    return loaded.job.locate(line, "") if loaded.job is not None else Span(line=line)


def _of_job(loaded: Compiled, faults: list[Diagnostic]) -> list[Diagnostic]:
    """Faults of a run, which know the calls' lines, at their places in the job."""
    return [replace(fault, span=_located(loaded, fault.span.line), path=str(loaded.path)) for fault in faults]


def _plan(prepared: Prepared, begin: Place, journal: Journal) -> str:
    """What is going to happen."""
    expected, library, wishes = prepared.forecast, prepared.library, prepared.wishes
    left_ms, number = expected.duration_ms - expected.done_ms(begin.row), expected.number(begin.row)
    head = Phrase(
        "{job} on the controller: {library}, --abi {abi} ({title})",
        job=printable(prepared.loaded.path.name),
        library=printable(library.path),
        abi=library.abi,
        title=ABI_PROFILES[library.abi].title,
    )
    rows: list[tuple[str, str]] = []
    if expected.box_mm is not None:
        x_low, x_high, y_low, y_high = (f"{edge:.3f}" for edge in expected.box_mm)
        box = Phrase(
            "X {x_low} to {x_high} mm, Y {y_low} to {y_high} mm", x_low=x_low, x_high=x_high, y_low=y_low, y_high=y_high
        )
        rows.append((Phrase("field"), box))
    rows.append((Phrase("time"), f"{left_ms / 1000:.2f} s"))
    rows += [(Phrase("laser {channel}", channel=c.channel), _light_left(c, number)) for c in expected.channels]
    if not expected.channels:
        rows.append((Phrase("laser"), Phrase("off: once round the marks") if wishes.frame else Phrase("off")))
    if begin != START:
        place = _place_text(prepared.loaded, int(prepared.stream.buffered.line[begin.row]))
        rows.append((Phrase("from"), Phrase("{place}; the head goes there with the light off", place=place)))
    rows.append((Phrase("journal"), printable(str(journal.path))))
    widest = max(width(localized(label)) for label, _ in rows)
    lines = [f"  {padded(localized(label), widest)}  {localized(text)}" for label, text in rows]
    return "\n".join([localized(head), *lines])


def _light_left(channel: ChannelForecast, number: int) -> Phrase:
    """Power and time of a laser's light from a timed call on."""
    lit_ms, highest, watts = channel.left(number)
    if not lit_ms:
        return Phrase("stays off")
    return Phrase(
        "up to {power} {unit}{watts}, light on for {time} s",
        power=f"{highest:.4g}",
        unit=channel.unit,
        watts="" if math.isnan(watts) else f" = {watts:.3g} W",
        time=f"{lit_ms / 1000:.2f}",
    )


def _question(prepared: Prepared) -> str:
    lit = any(channel.emission_ms.any() for channel in prepared.forecast.channels)
    return localized(
        Phrase("The laser will be on. Is everybody safe? Start") if lit else Phrase("The axes will move. Start")
    )


def _tell(text: str) -> None:
    click.echo(f"gusjob: {localized(text)}", err=True)


def _closing(prepared: Prepared, outcome: Outcome, journal: Journal, session: Session | None) -> int:
    """What became of it."""
    loaded = prepared.loaded
    show(replace(loaded, diagnostics=tuple(_of_job(loaded, outcome.faults))))
    if outcome.faults:
        safe = not any(f.rule in (rules.LIGHT_UNKNOWN, rules.MOTION_UNKNOWN, rules.WRONG_ABI) for f in outcome.faults)
        state = Phrase("the light is off and the motion stopped") if safe else Phrase("LOOK AT THE MACHINE")
        if session:
            place = _place_text(loaded, session.line)
            state = Phrase("{state}; the job was reached at {place}", state=state, place=place)
        _tell(Phrase("{state}; journal: {journal}", state=state, journal=printable(str(journal.path))))
        return 1
    time = f"{journal.now_s():.2f}"
    _tell(Phrase("done in {time} s; journal: {journal}", time=time, journal=printable(str(journal.path))))
    return 0


def read_resume(path: Path) -> Recorded:
    """A journal to go on with; stops if it can't be used."""
    try:
        found = read_journal(path)
    except OSError as error:
        why = Phrase("can't read the journal: {reason}", reason=reason_of(error))
        stop(f"{path}: {localized(why)}")
    if isinstance(found, str):
        stop(localized(found))
    return found
