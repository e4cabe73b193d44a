"""gusjob run --backend gts: show the plan, confirm it, and show the result. hardware/run.py runs the job."""

from __future__ import annotations

import math
import sys
from functools import partial
from pathlib import Path

import click
from msgspec.structs import replace

from gusjob.cli.common import show, stop
from gusjob.cli.progress_lines import doubling
from gusjob.cli.quiet import is_quiet, summarize
from gusjob.cli.run_display import run_display
from gusjob.controllers.journal.reader import RecordedRun
from gusjob.hardware.forecast import ChannelForecast
from gusjob.hardware.outcome import Ending, MachineState, RunOutcome
from gusjob.hardware.request import Refusal, RunMode, RunOptions, read_recorded_run
from gusjob.hardware.run import Confirm, RunPlan, run_on
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.i18n.width import padded, width
from gusjob.ir.overrides import overrides_text
from gusjob.pipeline import Simulated, run_request


def run_on_controller(result: Simulated, options: RunOptions, *, yes: bool, progress: str) -> int:
    """Show the plan, confirm it, and run.

    Args:
        result: the job.
        options: the options of the run.
        yes: start without a question.
        progress: how progress is shown; see run_display.

    Returns:
        The exit code.
    """
    outcome = run_on(run_request(result, options), confirm=_confirm(yes=yes), watch=run_display(progress))
    return _exit_code(result, outcome)


def _confirm(*, yes: bool) -> Confirm:
    """Return a function that shows the plan and requests confirmation; False if there is no terminal."""
    if not yes and not _can_ask():
        return False

    def confirm(plan: RunPlan) -> bool:
        if not (yes and is_quiet()):  # It is what the question is about.
            click.echo(_plan_text(plan), err=True)
        return yes or click.confirm(_question(plan), err=True)

    return confirm


def _can_ask() -> bool:
    """Return whether somebody can answer on standard input."""
    return sys.stdin is not None and sys.stdin.isatty()


def _exit_code(result: Simulated, outcome: RunOutcome) -> int:
    """Show how a run ended; return the exit code."""
    if outcome.ending is Ending.UNCONFIRMED:
        stop(Phrase("a run on hardware must be confirmed: answer on a terminal, or use --yes"))
    if outcome.refusal is not None:
        stop(outcome.refusal.localized)
    show(replace(result, diagnostics=outcome.diagnostics))
    is_complete = outcome.ending in (Ending.DONE, Ending.NOTHING_LEFT)
    if message := _closing_message(outcome):
        echo = summarize if is_complete else partial(click.echo, err=True)
        echo(f"gusjob: {localized(message)}")
    return 2 if outcome.is_library_unusable else int(not is_complete)


def _closing_message(outcome: RunOutcome) -> str:
    """Return how a run ended; '' if its diagnostics say it."""
    journal = printable(str(outcome.journal))
    match outcome.ending:
        case Ending.DECLINED if outcome.is_journal_needed:
            return Phrase("not started; continue with --resume {journal}", journal=journal)
        case Ending.DECLINED | Ending.BUSY:
            return Phrase("not started")
        case Ending.NOTHING_LEFT:
            return Phrase("the job was run to its end; there is nothing to resume")
        case Ending.FAILED:
            state = _state_text(outcome)
            if outcome.location:
                state = Phrase("{state}; the run reached {place}", state=state, place=outcome.location)
            return Phrase("{state}; journal: {journal}", state=state, journal=journal)
        case Ending.DONE:
            return Phrase("done in {time} s; journal: {journal}", time=f"{outcome.elapsed_s:.2f}", journal=journal)
        case _:
            return ""


def _state_text(outcome: RunOutcome) -> Phrase:
    """Return what calls confirmed about laser and motion, and no more."""
    if outcome.state is MachineState.OFF:
        return Phrase("the laser is off and the motion stopped")
    if outcome.state is MachineState.UNKNOWN:
        return Phrase("CHECK THE MACHINE")
    if outcome.off_tried:
        return Phrase(
            "IT IS NOT CONFIRMED THAT THE LASER IS OFF ({tried}): check the machine",
            tried=outcome.off_tried,
        )
    return Phrase("NOTHING WAS SWITCHED: laser and axes are as they were before the run; check the machine")


def _plan_text(plan: RunPlan) -> str:
    """Describe what will happen."""
    expected, number = plan.forecast, plan.forecast.number(plan.begin.row)
    head = Phrase(
        "{job} on the controller: {library}, --abi {abi} ({title})",
        job=printable(plan.job.name),
        library=printable(plan.library),
        abi=plan.abi,
        title=plan.abi_title,
    )
    rows: list[tuple[str, str]] = [("-D", printable(overrides_text(plan.overrides)))] if plan.overrides else []
    if expected.box_mm is not None:
        x_low, x_high, y_low, y_high = (f"{edge:.3f}" for edge in expected.box_mm)
        box = Phrase(
            "X {x_low} to {x_high} mm, Y {y_low} to {y_high} mm", x_low=x_low, x_high=x_high, y_low=y_low, y_high=y_high
        )
        rows.append((Phrase("field"), box))
    rows.append((Phrase("time"), f"{plan.remaining_ms / 1000:.2f} s"))
    rows += [(Phrase("laser {channel}", channel=c.channel), _laser_text(c, number)) for c in expected.channels]
    if not expected.channels:
        is_frame = plan.mode is RunMode.FRAME
        rows.append((Phrase("laser"), Phrase("off: once around the marks") if is_frame else Phrase("off")))
    if plan.begin_location:
        begin = Phrase("{place}; the head moves there with the laser off", place=plan.begin_location)
        rows.append((Phrase("from"), begin))
    if plan.doubling_mm:
        rows.append((Phrase("doubling"), doubling(plan.doubling_mm)))
    if plan.is_torn:
        rows.append((Phrase("resumes"), Phrase("a journal whose last line is incomplete; that line is not used")))
    rows.append((Phrase("journal"), printable(str(plan.journal))))
    widest = max(width(localized(label)) for label, _ in rows)
    lines = [f"  {padded(localized(label), widest)}  {localized(text)}" for label, text in rows]
    return "\n".join([localized(head), *lines])


def _laser_text(channel: ChannelForecast, number: int) -> Phrase:
    """Describe power and emission of a laser from a timed call on."""
    emission_ms, highest, watts = channel.remaining(number)
    if not emission_ms:
        return Phrase("stays off")
    return Phrase(
        "up to {power} {unit}{watts}, laser on for {time} s",
        power=f"{highest:.4g}",
        unit=channel.unit,
        watts="" if math.isnan(watts) else f" = {watts:.3g} W",
        time=f"{emission_ms / 1000:.2f}",
    )


def _question(plan: RunPlan) -> str:
    if plan.forecast.emits:
        return localized(Phrase("The laser will be on. Is everybody safe? Start"))
    return localized(Phrase("The axes will move. Start"))


def recorded_run(path: Path) -> RecordedRun:
    """Read the journal of a run that is to be continued; stop if it can't be used."""
    found = read_recorded_run(path)
    if isinstance(found, Refusal):
        stop(found.localized)
    return found
