"""GJ5: motion: velocities, accelerations, arcs, the field."""

from __future__ import annotations

from gusjob.diagnostics.rules.examples import HEAD, LASER_ON
from gusjob.diagnostics.rules.registry import ERROR, NOTE, WARNING, rule, variant

_CURVE = (
    "LASER MODE DUTY CARRIER 10kHz\nLASER POWER 30\nVEL 300\nACC 1000000\nJUMP X 5 Y -1\nLASER ON\nREPEAT 300 AS i\n"
    "LINE X ({x}) Y ({y})\nEND\nLASER OFF\n"
)

NO_VELOCITY = rule(
    "GJ501",
    ERROR,
    title="no velocity",
    text="{word} needs a velocity: write VEL before it",
    why="No velocity is right for every laser and material.",
    bad="ACC 5000\nLINE X 1\n",
    good="ACC 5000\nVEL 100\nLINE X 1\n",
)
NO_ACCELERATION = rule(
    "GJ502",
    ERROR,
    title="no acceleration",
    text="{word} needs an acceleration: write ACC before it",
    why="Only the builder of the machine knows the highest acceleration of its mirrors.",
    bad="VEL 100\nLINE X 1\n",
    good="VEL 100\nACC 5000\nLINE X 1\n",
)
OUTSIDE_FIELD = rule(
    "GJ503",
    ERROR,
    title="outside the field",
    text="{axis} {value} mm is outside the machine's field {low}..{high} mm{hint}",
    why="Outside the field the beam is clipped or hits something else. Arcs are checked with their whole curve.",
    bad=HEAD + "LINE X 200\n",
    good=HEAD + "LINE X 100\n",
)
TOO_FAST = rule(
    "GJ504",
    ERROR,
    title="too fast",
    text="{what} {value} {unit} is above the machine's limit of {limit} {unit}",
    why="Mirrors that can't follow leave the path.",
    bad="VEL 20m/s\n",
    good="VEL 2m/s\n",
)
TOO_FAST_IN_CALLS = variant(
    TOO_FAST,
    text="{what} is {value} {unit}, above the machine's limit of {limit} {unit}: calls take pulse/ms, not pulse/s",
)
BAD_ARC = rule(
    "GJ505",
    ERROR,
    title="impossible arc",
    text="{reason}",
    why="Start, end and centre are not on one circle: the controller would jump or refuse the call.",
    bad=HEAD + "ARC CW X 10 Y 0 I 3 J 0\n",
    good=HEAD + "ARC CW X 10 Y 0 I 5 J 0\n",
)
ARC_RADII_DIFFER = variant(
    BAD_ARC,
    text="the end is {end} mm from the centre, the start {start} mm: the difference must be at most {limit} mm",
)
ARC_RADIUS_TOO_SMALL = variant(
    BAD_ARC,
    text="the radius {value} mm is too small: the end is {chord} mm away, R must be at least {least} mm",
)
END_UNREACHABLE = rule(
    "GJ506",
    ERROR,
    title="END can't be reached",
    text="END {value} {speed} can't be reached: length and acceleration of this and the next segments allow at most "
    "{high} {speed}",
    why="The controller would stop abruptly or leave the path.",
    bad=HEAD + "LINE X 0.001 END 100\nLINE X 10\n",
    good=HEAD + "LINE X 5 END 100\nLINE X 10\n",
)
END_ABOVE_VEL = rule(
    "GJ507",
    ERROR,
    title="END above VEL",
    text="END {value} {speed} is above this segment's VEL {velocity} {speed}",
    why="A segment can't end faster than its own velocity.",
    bad=HEAD + "LINE X 5 END 200\nLINE X 10\n",
    good=HEAD + "LINE X 5 END 100\nLINE X 10\n",
)
ARC_TOO_FAST = rule(
    "GJ508",
    WARNING,
    title="arc too fast",
    text="VEL {velocity} {speed} on a radius of {radius} {length} needs {value} {acceleration}, above the machine's "
    "limit of {limit} {acceleration}: the planner reduces the velocity",
    why="On a small circle the mirrors need more acceleration than the machine has.",
    bad="VEL 5000\nACC 100000\nARC CW I 1 J 0\n",
    good="VEL 500\nACC 100000\nARC CW I 1 J 0\n",
)
ARC_TOO_FAST_IN_CALLS = variant(
    ARC_TOO_FAST,
    text="{velocity} pulse/ms on a radius of {radius} pulse need {value} pulse/ms2, above the machine's limit of "
    "{limit} pulse/ms2: no planner reduces the velocity",
)
FOLLOW_UNEQUAL_AXES = rule(
    "GJ509",
    ERROR,
    title="velocity follow in mm with unequal axes",
    text="velocity follow in mm needs the same pulses per mm on X and Y; write it under UNITS PULSE",
    why="The controller follows the velocity in pulses. The same velocity in pulses is a different one in mm "
    "in each direction.",
    section="四.2",
)
END_AT_STOP = rule(
    "GJ510",
    WARNING,
    title="END before a stop",
    text="the motion stops after this segment: from END {value} {speed} it stops abruptly",
    why="The axes stop abruptly, and the mirrors overshoot.",
    bad=HEAD + "LINE X 5 END 50\n",
    good=HEAD + "LINE X 5 END 50\nLINE X 10\n",
)
MARK_WITHOUT_LENGTH = rule(
    "GJ513",
    WARNING,
    title="mark without length",
    text="this {word} ends where it starts, with the laser on",
    why="It marks nothing, or burns a point. Often a coordinate is missing or repeated.",
    bad=LASER_ON + "LINE X 5\nLINE X 5\nLASER OFF\n",
    good=LASER_ON + "LINE X 5\nLINE X 6\nLASER OFF\n",
)
ARC_WITHOUT_LENGTH = rule(
    "GJ517",
    WARNING,
    title="arc without length",
    text="this arc is {value} {length} long and ends in the pulse in which it starts: it moves nothing{hint}",
    why="Often a full circle is meant, but its end is not computed exactly.",
    bad=HEAD + "ARC CCW X 0.0004 Y 0 I 0 J 5\n",
    good=HEAD + "ARC CCW I 0 J 5\n",
)
ARC_IN_TWO_UNITS = rule(
    "GJ518",
    ERROR,
    title="arc in two units",
    text="I is in {first} and J in {second}, and X and Y have different pulses per mm: write I and J in one unit, in "
    "which the arc is a circle",
    why="An arc is a circle in the unit of its I and J, or R. Where X and Y have different pulses per mm, a circle in "
    "mm is an ellipse in pulses.",
)
CORNER_TOO_FAST = rule(
    "GJ514",
    WARNING,
    title="corner too fast",
    text="END takes the corner after this segment at {value} {speed}: the velocity vector changes by {jump} {speed}, "
    "more than the {limit} {speed} that look-ahead allows (TIME x ACC)",
    why="The mirrors overshoot at the corner.",
    bad=HEAD + "LINE X 5 END 100\nLINE Y 5\n",
    good=HEAD + "LINE X 5\nLINE Y 5\n",
)
FIFO_MAY_RUN_EMPTY = rule(
    "GJ515",
    WARNING,
    title="FIFO may run empty",
    text="the segments of the {calls} calls up to here are too short: a host that sends {rate} calls/s (machine "
    "profile) can't keep the FIFO of {slots} slots filled",
    why="A FIFO that runs empty stops the motion in the middle of a mark.",
)
MARK_TOO_SHORT = rule(
    "GJ516",
    WARNING,
    title="mark too short for its velocity",
    text="{what} reaches only {value} of {velocity} {speed}: {actual} {length} is too short for this acceleration; "
    "{least} {length} or {remedy} would be enough",
    why="The whole mark gets more energy per mm than its power and velocity set. With sky writing (SKYWRITE) every "
    "mark has its full velocity from start to end. Not reported: marks that reach 90 % of their velocity somewhere, "
    "marks that are as fast as their corners allow, and marks whose power follows the velocity (LASER FOLLOW).",
    bad="LASER MODE DUTY CARRIER 10kHz\nLASER POWER 30\nVEL 400\nACC 30000\nLASER ON\nLINE X 0.5\nLASER OFF\n",
    good="LASER MODE DUTY CARRIER 10kHz\nLASER POWER 30\nVEL 400\nACC 30000\nLASER ON\nLINE X 6\nLASER OFF\n",
)
ROUNDED_COORDINATES = rule(
    "GJ521",
    NOTE,
    title="corners by rounded coordinates",
    text="coordinates rounded to {step} {length} make corners between these short lines: on average they reach {value} "
    "of {velocity} {speed}; round to {finer} {length}, or write lines of at least {least} {length}, or ARC",
    why="Look-ahead slows down at every corner, so a curve is marked too deep. One note for the whole job, where this "
    "holds for a quarter of the length of its lines or more.",
    bad=_CURVE.format(x="round(5000*cos(0.12*i))/1000", y="round(5000*sin(0.12*i))/1000"),
    good=_CURVE.format(x="5*cos(0.12*i)", y="5*sin(0.12*i)"),
)
TOO_MANY_CHORDS = rule(
    "GJ522",
    ERROR,
    title="too many chords",
    text="up to here arcs become {chords} lines, more than {limit}; the machine profile can raise the limit "
    "([expansion] max_statements)",
    why="Where X and Y have different pulses per mm, most arcs are sent as short lines. A few lines of text could ask "
    "for more of them than memory holds.",
)
END_ABOVE_NEXT_VEL = rule(
    "GJ520",
    ERROR,
    title="END above the next velocity",
    text="END {value} {speed} is above the velocity of the next motion, {velocity} {speed}: it would begin too fast, "
    "and slow down first",
    why="While it slows down, the next segment gets less energy per mm than its power and velocity set.",
    bad=HEAD + "LINE X 5 END 90\nLINE X 10 VEL 50\n",
    good=HEAD + "LINE X 5 END 50\nLINE X 10 VEL 50\n",
)
