"""The progress of a run as lines: JSON lines for programs, plain lines for people."""

from __future__ import annotations

import math

import orjson

from gusjob.controllers.control import Phase
from gusjob.hardware.progress import Progress
from gusjob.i18n.phrases import Phrase, localized, printable

SCHEMA = "gusjob-progress/1"
PHASES = {
    Phase.OPENING: Phrase("opening"),
    Phase.FILLING: Phrase("filling"),
    Phase.RUNNING: Phrase("running"),
    Phase.PAUSED: Phrase("paused"),
    Phase.STOPPING: Phrase("stopping"),
    Phase.STOPPED: Phrase("stopped"),
    Phase.DONE: Phrase("done"),
}


def json_line(now: Progress) -> str:
    """Return the progress for programs. Power is null without emission, and where no job is running."""
    fields = {
        "schema": SCHEMA,
        "phase": now.phase.value,
        "row": now.row,
        "rows": now.rows,
        "segment": now.segment,
        "segments": now.segments,
        "file": printable(now.location).rpartition(":")[0],
        "line": now.line,
        "x_mm": round(now.x_mm, 6),
        "y_mm": round(now.y_mm, 6),
        "queued": now.queued,
        "slots": now.slots,
        "elapsed_s": round(now.elapsed_s, 3),
        "done_ms": round(now.done_ms, 3),
        "total_ms": round(now.total_ms, 3),
        "doubling_mm": round(now.doubling_mm, 3),
        "channels": [
            {"channel": laser.channel, "unit": laser.unit, "power": None if math.isnan(laser.power) else laser.power}
            for laser in now.lasers
        ],
    }
    return orjson.dumps(fields).decode()


def plain_line(now: Progress) -> str:
    """Return the progress for people: phase, done part of the planned time, line of the job, position, FIFO."""
    # The job's own name would be in every line; that of a file that it includes must be there.
    location = printable(now.location).removeprefix(f"{printable(now.job)}:")
    parts = (
        localized(PHASES[now.phase]),
        f"{percent(now.share)} %",
        localized(Phrase("{done} of {all}", done=duration(now.done_ms / 1000), all=duration(now.total_ms / 1000))),
        localized(Phrase("line {place}", place=location)) if location else "",
        f"X {mm(now.x_mm)} Y {mm(now.y_mm)} mm",
        f"FIFO {now.queued}/{now.slots}",
        localized(doubling(now.doubling_mm)) if now.doubling_mm else "",
    )
    return "  ".join(part for part in parts if part)


def doubling(length_mm: float) -> Phrase:
    """Return a phrase with the length of the marks that are made twice at most."""
    return Phrase("up to {length} mm of marks are made twice", length=f"{length_mm:.3f}")


def percent(share: float) -> int:
    """Return whole percents, 100 only at the end."""
    return math.floor(share * 100 + 1e-9)


def duration(seconds: float) -> str:
    """Format a time as 1:02:03 or 2:03."""
    minutes, second = divmod(math.floor(seconds), 60)
    hour, minute = divmod(minutes, 60)
    return f"{hour}:{minute:02}:{second:02}" if hour else f"{minute}:{second:02}"


def mm(value: float) -> str:
    """Format a coordinate with three digits, and never as -0.000."""
    return f"{round(value, 3) + 0.0:.3f}"
