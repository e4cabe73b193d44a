"""SKYWRITE for a scanner and a job."""

from __future__ import annotations

import math

from gusjob.config.machine import Machine, ScannerModel
from gusjob.controllers.gus.ranges import RUN_STEP_US, TIMELAG_US
from gusjob.i18n.phrases import Phrase
from gusjob.ir.setup import SkyWrite, SkyWriting, auto_steps
from gusjob.tune.search import nearest_delays
from gusjob.tune.trial import (
    CLOSED_FORM,
    SEARCH,
    TuneResult,
    TuneRun,
    emitting_channel,
    first_pulse_killer_us,
    try_statement,
)

_RUN_INS = (1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Run-ins to try, in tracking errors, as long as the misses decrease; the first is that of AUTO."""
_FIXED = Phrase("TIMELAG is the scanner's lag")
MIN_GAIN_PULSE = 0.25
"""Smallest decrease of the miss that is worth a longer run-in."""


def tune_sky_writing(run: TuneRun, machine: Machine, channel: int, mode: int | None) -> TuneResult | str:
    """Tune the SKYWRITE of a job.

    Args:
        run: The job.
        machine: Its machine, with a scanner.
        channel: The channel with the marks.
        mode: Mode of SKYWRITE; None for the job's own, else 3.

    Returns:
        The result, or the reason why there is none.
    """
    emitter = emitting_channel(run, channel)
    if isinstance(emitter, str):
        return emitter
    assert machine.scanner is not None
    if not round(machine.scanner.tracking_error_us):
        scanner = str(machine.scanner)
        return Phrase("the scanner {scanner} has no lag; there is nothing to tune", scanner=scanner)
    if machine.scanner.tracking_error_us > TIMELAG_US.high:
        return Phrase(
            "the lag of scanner {scanner} exceeds the largest TIMELAG, {most} us",
            scanner=str(machine.scanner),
            most=TIMELAG_US.high,
        )
    own_settings = own_sky_writing(run)
    mode = mode or (int(own_settings.mode) if own_settings is not None else 3)
    lag_us, gap_us = round(machine.scanner.tracking_error_us), first_pulse_killer_us(emitter)[0]
    npost = math.ceil(lag_us / RUN_STEP_US)
    limit = ""
    if own_settings is not None and own_settings.limit_given and mode in (3, int(own_settings.mode)):
        limit = f" LIMIT {own_settings.limit!r}"  # Which corners are sharp is the user's choice.
    if machine.scanner.model is ScannerModel.DELAY:
        nprev = int(auto_steps("NPREV", lag_us))
        statement = _sky_statement(mode, lag_us, -gap_us, nprev, npost) + limit
        return _check_in_effect(try_statement(run, machine, SkyWrite, channel, statement, CLOSED_FORM, _FIXED))
    return _search_run_in(run, machine, channel, mode, npost, gap_us, limit)


def own_sky_writing(run: TuneRun) -> SkyWriting | None:
    """Return the settings of the job's first SKYWRITE that is not OFF."""
    statements = (s.statement for s in run.job.setups)
    return next((s.settings for s in statements if isinstance(s, SkyWrite) and s.settings), None)


def _search_run_in(
    run: TuneRun, machine: Machine, channel: int, mode: int, npost: int, gap_us: float, limit: str
) -> TuneResult | str:
    """Try longer and longer run-ins, each with the best delays, until the miss hardly decreases."""
    assert machine.scanner is not None
    lag_us = round(machine.scanner.tracking_error_us)
    best, least_mm = "", math.inf
    for share in _RUN_INS:
        nprev = math.ceil(share * lag_us / RUN_STEP_US)
        statement = _sky_statement(mode, lag_us, -gap_us, nprev, npost) + limit
        tuned = _check_in_effect(try_statement(run, machine, SkyWrite, channel, statement, SEARCH, with_marks=False))
        if best and (isinstance(tuned, str) or tuned.run.trace is None):  # There is no space for a longer run-in.
            break
        if isinstance(tuned, str) or tuned.run.trace is None:
            return tuned
        emitter = emitting_channel(tuned.run, channel)
        found = None
        if not isinstance(emitter, str):
            # slack 0: at full velocity the nearest time is unique. Later the beam may pass again, on its way back.
            found = nearest_delays(
                tuned.run.trace, machine, emitter, slack_pulse=0, most_us=min(2 * lag_us, TIMELAG_US.high)
            )
        if found is None:
            return Phrase("with {statement} channel {channel} has no mark", channel=channel, statement=tuned.statement)
        on, off = found
        if least_mm - on.miss_mm < MIN_GAIN_PULSE / min(machine.pulses_per_mm):
            break
        least_mm, lag = on.miss_mm, off.first_us
        best = _sky_statement(mode, lag, on.last_us - lag - gap_us, nprev, npost) + limit
    searched = Phrase(
        "NPREV from {least} to {most}, each with TIMELAG and SHIFT from 0 to {longest} us",
        least=math.ceil(_RUN_INS[0] * lag_us / RUN_STEP_US),
        most=math.ceil(_RUN_INS[-1] * lag_us / RUN_STEP_US),
        longest=min(2 * lag_us, TIMELAG_US.high),
    )
    return try_statement(run, machine, SkyWrite, channel, best, SEARCH, searched)


def _sky_statement(mode: int, timelag_us: float, shift_us: float, nprev: int, npost: int) -> str:
    shift = f" SHIFT {shift_us:g}us" if shift_us else ""
    return f"SKYWRITE MODE {mode} TIMELAG {timelag_us:g}us{shift} NPREV {nprev} NPOST {npost}"


def _check_in_effect(tuned: TuneResult | str) -> TuneResult | str:
    """Return the result if its SKYWRITE is in effect for any mark, else the reason."""
    if isinstance(tuned, str) or tuned.run.trace is None or tuned.run.trace.is_sky_written:
        return tuned
    return Phrase(
        "a SKYWRITE OFF before the first mark cancels a SKYWRITE after LASER MODE; write it after that by hand"
    )
