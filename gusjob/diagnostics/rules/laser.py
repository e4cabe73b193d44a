"""GJ4: the laser on at the wrong time, or without effect."""

from __future__ import annotations

from gusjob.diagnostics.rules.examples import HEAD, LASER_ON
from gusjob.diagnostics.rules.registry import ERROR, WARNING, rule, variant

LEFT_ON = rule(
    "GJ401",
    ERROR,
    title="laser left on",
    text="the job ends with the laser of channel {channel} on: add LASER OFF{hint}",
    why="Nothing switches a laser off at the end of a job: it stays on at the last point.",
    bad=LASER_ON + "LINE X 1\n",
    good=LASER_ON + "LINE X 1\nLASER OFF\n",
)
JUMP_WITH_LASER_ON = rule(
    "GJ402",
    ERROR,
    title="jump with the laser on",
    text="JUMP with the laser of channel {channel} on: put LASER OFF before it",
    why="The jump would be marked across the part. A move that is to be marked is a LINE.",
    bad=LASER_ON + "LINE X 1\nJUMP X 5\nLASER OFF\n",
    good=LASER_ON + "LINE X 1\nLASER OFF\nJUMP X 5\n",
)
NO_POWER = rule(
    "GJ403",
    ERROR,
    title="laser on without a power",
    text="the laser of channel {channel} is on here, but no power was set since its LASER MODE",
    why="The controller keeps the power of the previous job.",
    bad=HEAD + "LASER ON\nLINE X 1\nLASER OFF\n",
    good=LASER_ON + "LINE X 1\nLASER OFF\n",
    section="二.2",
)
DWELL_WITH_LASER_ON = rule(
    "GJ404",
    WARNING,
    title="dwell with the laser on",
    text="{word} with the laser of channel {channel} on, after the motion of the mark has begun",
    why="The head stands still and the laser burns one point, also at the end of a mark: put LASER OFF before it. "
    "A pierce directly after LASER ON, before any motion, is not reported.",
    bad=LASER_ON + "LINE X 1\nDWELL 100\nLINE X 2\nLASER OFF\n",
    good=LASER_ON + "DWELL 100\nLINE X 1\nLINE X 2\nLASER OFF\n",
)
WAIT_WITH_LASER_ON = rule(
    "GJ405",
    WARNING,
    title="laser on between stages",
    text="the motion ends at {word} with the laser of channel {channel} on: it stays on until the next stage moves",
    why="The time between two stages is not known, and the laser burns one point for all of it.",
    bad=LASER_ON + "LINE X 1\nWAIT\nLINE X 2\nLASER OFF\n",
    good=LASER_ON + "LINE X 1\nLASER OFF\nWAIT\nLASER ON\nLINE X 2\nLASER OFF\n",
)
LASER_ON_WITHOUT_MOTION = rule(
    "GJ406",
    WARNING,
    title="laser on without motion",
    text="the laser of channel {channel} is switched on and off without motion in between",
    why="Either the mark is missing, or the delays alone burn a point.",
    bad=LASER_ON + "LASER OFF\nLINE X 1\n",
    good=LASER_ON + "LINE X 1\nLASER OFF\n",
)
MARKED_TWICE = rule(
    "GJ407",
    WARNING,
    title="same mark twice",
    text="this mark was made before, with the same power and velocity",
    why="Doubled lines of a drawing are marked twice as deep. Write intended passes as a REPEAT. Both directions, any "
    "start point of a circle, and parts that overlap by more than 0.1 mm on one line or circle count.",
    bad=LASER_ON + "LINE X 5\nLINE X 0\nLASER OFF\n",
    good=HEAD + "LASER POWER 30\nREPEAT 2\nJUMP X 0\nLASER ON\nLINE X 5\nLASER OFF\nEND\n",
)
PARTLY_MARKED_TWICE = variant(
    MARKED_TWICE,
    text="{length} mm of this mark were made before, with the same power and velocity",
)
ALREADY_ON = rule(
    "GJ408",
    WARNING,
    title="laser already on",
    text="the laser of channel {channel} is already on: is a {word} missing?",
    why="A second LASER ON has no effect. Often the LASER OFF between two marks is missing.",
    bad=LASER_ON + "LINE X 5\nLASER ON\nLINE X 6\nLASER OFF\n",
    good=LASER_ON + "LINE X 5\nLASER OFF\nJUMP X 6\nLASER ON\nLINE X 7\nLASER OFF\n",
)
NOTHING_MARKED = rule(
    "GJ409",
    WARNING,
    title="nothing is marked",
    text="channel {channel} has a power, but no laser is ever switched on: nothing is marked",
    why="The head moves, and the laser stays off. Put LASER ON before the marks and LASER OFF after them; a move that "
    "marks nothing is a JUMP.",
    bad=HEAD + "LASER POWER 30\nLINE X 1\n",
    good=LASER_ON + "LINE X 1\nLASER OFF\n",
)
UNUSED_CHANNEL = rule(
    "GJ410",
    WARNING,
    title="channel never on",
    text="the laser of channel {channel} is never switched on: its {word} has no effect",
    why="A power was set for a channel that nothing uses. Often CHANNEL is missing at LASER ON, or is wrong. Not "
    "reported: powers that an included file sets before the first motion, for any of several jobs.",
    bad=LASER_ON + "LINE X 1\nLASER OFF\nLASER MODE ANALOG CHANNEL 1\nLASER POWER 3 CHANNEL 1\n",
    good=LASER_ON + "LINE X 1\nLASER OFF\n",
)
