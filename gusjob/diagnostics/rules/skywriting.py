"""GJ8: sky writing."""

from __future__ import annotations

from gusjob.diagnostics.rules.examples import HEAD
from gusjob.diagnostics.rules.registry import (
    ERROR,
    NOTE,
    WARNING,
    rule,
    variant,
)

_SKY = "SKYWRITE MODE 2 TIMELAG 250us\n"
_MARK = "LASER ON\nLINE X 5\nLASER OFF\n"
_SLOW = (
    "LASER MODE DUTY CARRIER 10kHz\nLASER POWER 30\nVEL 500\nACC 1000000\n"
    "SKYWRITE MODE 2 TIMELAG 470us NPOST 48\nLASER ON\nLINE X 5\nLASER OFF\nJUMP X 0\n"
)

SKY_LASER_ON = rule(
    "GJ801",
    ERROR,
    title="SKYWRITE with the laser on",
    text="SKYWRITE with the laser of channel {channel} on: sky writing applies to whole marks, put LASER OFF before it",
    why="Sky writing starts and ends a mark at full velocity. Emission that began at rest can't be moved along the "
    "path.",
    bad=HEAD + "LASER POWER 30\nLASER ON\nLINE X 5\n" + _SKY + "LINE X 9\nLASER OFF\n",
    good=HEAD + _SKY + "LASER POWER 30\nLASER ON\nLINE X 5\nLINE X 9\nLASER OFF\n",
    section="RTC5",
)
SKY_NOW = variant(
    SKY_LASER_ON,
    text="LASER ON NOW under SKYWRITE emits during the run-in: write LASER ON, which is switched along the path",
)
SKY_STAGE = variant(
    SKY_LASER_ON,
    text="{word} ends the motion under SKYWRITE while the laser of channel {channel} is on: put LASER OFF before it",
)
SKY_DWELL = variant(
    SKY_LASER_ON,
    text="DWELL with the laser of channel {channel} on under SKYWRITE, which starts and ends every mark at full "
    "velocity: put it between SKYWRITE OFF and SKYWRITE",
)
SKY_END = rule(
    "GJ802",
    ERROR,
    title="END under sky writing",
    text="END is not allowed under SKYWRITE: a mark runs at its VEL from its first to its last point",
    why="An end velocity would reduce the velocity inside the mark, which sky writing keeps constant.",
    bad=HEAD + _SKY + "LASER POWER 30\nLASER ON\nLINE X 5 END 0\nLASER OFF\n",
    good=HEAD + _SKY + "LASER POWER 30\n" + _MARK,
    section="RTC5",
)
SKY_SHIFT = rule(
    "GJ803",
    WARNING,
    title="SHIFT before the run-in",
    text="SHIFT {value} us would switch the laser on {early} us before the run-in reaches the velocity of the mark: "
    "{least} us is used; increase NPREV",
    why="Emission during the acceleration marks deeper, before the start of the mark.",
    bad=HEAD + "SKYWRITE MODE 2 TIMELAG 100us SHIFT -400us NPREV 11\nLASER POWER 30\n" + _MARK,
    good=HEAD + "SKYWRITE MODE 2 TIMELAG 100us SHIFT -100us NPREV 11\nLASER POWER 30\n" + _MARK,
    section="RTC5",
)
SKY_SHIFT_RAMP = variant(
    SKY_SHIFT,
    text="SHIFT {value} us switches the laser on {early} us before the beam, which lags by TIMELAG, reaches the "
    "velocity of the mark in its run-in: increase NPREV to {least}",
)
SKY_STEP = rule(
    "GJ804",
    ERROR,
    title="SHIFT not a multiple of 0.5 us",
    text="SHIFT {value} us is not a multiple of 0.5 us",
    why="LaserOnShift is a whole number of half microseconds.",
    bad=HEAD + "SKYWRITE MODE 2 TIMELAG 100us SHIFT -0.3us\n",
    good=HEAD + "SKYWRITE MODE 2 TIMELAG 100us SHIFT -0.5us\n",
    section="RTC5",
)
SKY_OFF = rule(
    "GJ805",
    WARNING,
    title="TIMELAG switches sky writing off",
    text="TIMELAG {value} us is below 1/8 us, which switches sky writing off: write SKYWRITE OFF if that is intended",
    why="The marks get neither run-in nor run-out.",
    bad="SKYWRITE MODE 2 TIMELAG 0.1us\n",
    good="SKYWRITE OFF\n",
    section="RTC5",
)
SKY_NO_LIMIT = rule(
    "GJ806",
    WARNING,
    title="LIMIT without effect",
    text="LIMIT has no effect in mode {mode}: modes 1 and 2 end a mark and start a new one at every corner",
    why="Perhaps mode 3 was intended.",
    bad="SKYWRITE MODE 2 TIMELAG 250us LIMIT 0.8\n",
    good="SKYWRITE MODE 3 TIMELAG 250us LIMIT 0.8\n",
    section="RTC5",
)
SKY_RUN_OUT = rule(
    "GJ807",
    NOTE,
    title="run-out shorter than TIMELAG",
    text="the run-out of {run_out} us ends before the laser goes off, TIMELAG {timelag} us after the end of the "
    "mark: velocity follow reduces the power while the axes slow down; NPOST {least} is enough",
    why="Power that follows the velocity falls while the beam still marks its last points.",
    bad=HEAD + "LASER FOLLOW MIN 5 MAX 45 AT 100mm/s\nSKYWRITE MODE 2 TIMELAG 174us NPREV 11 NPOST 9\n" + _MARK,
    good=HEAD + "LASER FOLLOW MIN 5 MAX 45 AT 100mm/s\nSKYWRITE MODE 2 TIMELAG 174us NPREV 11 NPOST 18\n" + _MARK,
    section="RTC5",
)
SKY_FIELD = rule(
    "GJ808",
    ERROR,
    title="run-in or run-out outside the field",
    text="the {what} of this mark reaches {axis} {value} mm, {over} mm outside the machine's field {low}..{high} mm: "
    "move the mark, or shorten the {what} by a lower VEL, a higher ACC or a smaller {word}",
    why="Outside the field the mirrors stop, or the beam hits something else.",
    bad=HEAD + _SKY + "LASER POWER 30\nJUMP X 149\nLASER ON\nLINE X 150\nLASER OFF\n",
    good=HEAD + _SKY + "LASER POWER 30\nJUMP X 147\nLASER ON\nLINE X 148\nLASER OFF\n",
    section="RTC5",
)
SKY_NO_MOTION = rule(
    "GJ809",
    ERROR,
    title="no motion at the switch point",
    text="the laser of channel {channel} would have to be switched {what} {early} us {where}: {mend}",
    why="A GUS switches between two motions. Where there is no motion, the mark would start or end at the wrong point.",
    bad=HEAD + "LASER DELAY ON 50000us OFF 50000us\n" + _SKY + "LASER POWER 30\n" + _MARK,
    good=HEAD + "LASER DELAY ON 20us OFF 20us\n" + _SKY + "LASER POWER 30\n" + _MARK,
    section="RTC5",
)
SKY_NO_EMISSION = rule(
    "GJ810",
    ERROR,
    title="mark without emission",
    text="the laser of this mark would have to be switched off where it is switched on: {cause}",
    why="The mark is missing, or the delays alone burn a point.",
    bad=HEAD + "SKYWRITE MODE 2 TIMELAG 100us SHIFT 5000us\nLASER POWER 30\nLASER ON\nLINE X 0.1\nLASER OFF\n",
    good=HEAD + "SKYWRITE MODE 2 TIMELAG 100us SHIFT 50us\nLASER POWER 30\nLASER ON\nLINE X 0.1\nLASER OFF\n",
    section="RTC5",
)
SKY_OFF_BEFORE_ON = variant(
    SKY_NO_EMISSION,
    text="the laser of this mark would have to be switched off {late} us before it is switched on: {cause}",
)
SKY_NOT_AT_SPEED = rule(
    "GJ811",
    WARNING,
    title="mark not at full velocity at its ends",
    text="this mark {what} at {value} {speed} instead of {velocity} {speed}: a corner near its end that LIMIT "
    "treats as flat, or another VEL, slows it down; with a larger LIMIT sky writing starts again at the "
    "corner",
    why="The end is marked deeper, as without sky writing, and the beam is not where TIMELAG assumes it.",
    bad=HEAD + "SKYWRITE MODE 3 TIMELAG 250us LIMIT 0.5\nLASER POWER 30\nLASER ON\nLINE X 0.1\nLINE X 0.2 Y 0.1\n"
    "LASER OFF\n",
    good=HEAD + "SKYWRITE MODE 3 TIMELAG 250us\nLASER POWER 30\nLASER ON\nLINE X 0.1\nLINE X 0.2 Y 0.1\nLASER OFF\n",
    section="RTC5",
)
SKY_COARSE = rule(
    "GJ812",
    WARNING,
    title="laser switched in slow motion",
    text="the laser goes {what} while the motion is very slow: rounding the switch point to a whole pulse "
    "shifts it by up to {error} um on the mark; increase {word} to {least}",
    why="A GUS switches only at whole pulses. The slower the motion is, the longer a pulse takes.",
    bad=_SLOW.replace("NPOST 48", "NPOST 0"),
    good=_SLOW,
    section="RTC5",
)
SKY_TIMELAG_MISMATCH = rule(
    "GJ813",
    WARNING,
    title="TIMELAG differs from the scanner's lag",
    text="TIMELAG is {value} us, but the machine's scanner lags by {lag} us: the switch times are wrong by {off} us",
    why="TIMELAG compensates for this lag; gusjob tune --skywrite finds it.",
)
