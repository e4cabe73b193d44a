"""LASER DELAY for a scanner and a job."""

from __future__ import annotations

from gusjob.config.machine import Machine, ScannerModel
from gusjob.controllers.gus.ranges import SWITCH_DELAY_US
from gusjob.i18n.phrases import Phrase
from gusjob.ir.setup import LaserDelay
from gusjob.tune.search import Band, longest_us, nearest_delays
from gusjob.tune.trial import (
    CLOSED_FORM,
    SEARCH,
    TuneResult,
    TuneRun,
    emitting_channel,
    first_pulse_killer_us,
    try_statement,
)


def tune_delays(run: TuneRun, machine: Machine, channel: int) -> TuneResult | str:
    """Tune the LASER DELAY of a channel.

    Returns:
        The result, or the reason why there is none.
    """
    if run.job.has_sky_writing:
        return Phrase("this job uses sky writing, which replaces LASER DELAY; tune it with --skywrite")
    undelayed = _without_delays(run, machine, channel)
    if isinstance(undelayed, str):
        return undelayed
    emitter = emitting_channel(undelayed, channel)
    if isinstance(emitter, str):
        return emitter
    gap_us, late_us = first_pulse_killer_us(emitter)
    assert undelayed.trace is not None and machine.scanner is not None
    lag_us = machine.scanner.tracking_error_us
    if lag_us > SWITCH_DELAY_US.high:
        return Phrase(
            "the lag of scanner {scanner} exceeds the largest delay, {most} us",
            scanner=str(machine.scanner),
            most=SWITCH_DELAY_US.high,
        )
    is_closed_form = machine.scanner.model is ScannerModel.DELAY or not round(lag_us)
    most_us = 0 if is_closed_form else SWITCH_DELAY_US.high + max(gap_us, late_us)
    found = nearest_delays(undelayed.trace, machine, emitter, slack_pulse=1, most_us=most_us)
    if found is None:
        return Phrase("no mark of channel {channel} is switched by LASER ON and LASER OFF", channel=channel)
    most = SWITCH_DELAY_US.high if is_closed_form else min(SWITCH_DELAY_US.high, longest_us(machine, most_us))
    searched = Phrase("ON and OFF from 0 to {most} us, OFF not below ON", most=most)
    on, off, how = *found, SEARCH
    if is_closed_form:
        on = off = Band(first_us=round(lag_us), last_us=round(lag_us), miss_mm=0)
        how = CLOSED_FORM
    on_us, off_us = _choose_delays(_as_delays(on, gap_us), _as_delays(off, late_us), lag_us - gap_us, lag_us - late_us)
    tuned = try_statement(
        run, machine, LaserDelay, channel, _delay_statement(run, channel, on_us, off_us), how, searched
    )
    if isinstance(tuned, TuneResult) and tuned.run.trace is not None and not (run.ends or tuned.run.ends):
        return Phrase(
            "no mark of channel {channel} has a length: delays change only how long it burns", channel=channel
        )
    return tuned


def _without_delays(run: TuneRun, machine: Machine, channel: int) -> TuneRun | str:
    """Return the job without delays of a channel: wrong delays may suppress its marks."""
    if not any(isinstance(s.statement, LaserDelay) and s.channel == channel for s in run.job.setups):
        return run
    statement = _delay_statement(run, channel, 0, 0)
    trial = try_statement(run, machine, LaserDelay, channel, statement, SEARCH, with_marks=False)
    if isinstance(trial, str):
        return trial
    return trial.run if trial.run.trace is not None else run


def _delay_statement(run: TuneRun, channel: int, on_us: int, off_us: int) -> str:
    return f"LASER DELAY ON {on_us}us OFF {off_us}us" + _channel_word(run, channel)


def _as_delays(band: Band, killer_us: float) -> tuple[int, int]:
    """Return a band as delays of the controller, less the time that the first pulse killer already takes."""
    max_us = int(SWITCH_DELAY_US.high)
    first, last = (_within(us - round(killer_us), 0, max_us) for us in (band.first_us, band.last_us))
    return first, last


def _choose_delays(on: tuple[int, int], off: tuple[int, int], on_target: float, off_target: float) -> tuple[int, int]:
    """Choose the on and off delay from their bands.

    These are the last on and the first off delay. If off would be below on, they are the delays nearest to the lag
    within the bands, so that both ends get equally much. If off is still below on, which the controller refuses
    (M 二.2), both are the same delay: one within both bands if possible, else at the beginning of the on band.
    """
    if on[1] <= off[0]:
        return on[1], off[0]
    on_us, off_us = _within(round(on_target), *on), _within(round(off_target), *off)
    if off_us < on_us:
        low, high = max(on[0], off[0]), min(on[1], off[1])
        on_us = off_us = _within(on_us, low, high) if low <= high else on[0]
    return on_us, off_us


def _within(value: int, low: int, high: int) -> int:
    return min(max(value, low), high)


def _channel_word(run: TuneRun, channel: int) -> str:
    """Return the word CHANNEL if the job uses several channels or names one, or `channel` is not the default."""
    others = any(s.channel != channel for s in run.job.setups) or bool((run.job.path.channel != channel).any())
    return f" CHANNEL {channel}" if channel or others or b"CHANNEL" in run.source.data.upper() else ""
