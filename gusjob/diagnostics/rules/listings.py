"""GJ7: what the controller does with calls, found by simulating them."""

from __future__ import annotations

from gusjob.diagnostics.rules.registry import ERROR, NOTE, WARNING, rule, variant

_SETUP = (
    "GT_SetAxisMode(7,1)\nGT_LaserPowerMode(0,100,0,0)\nGT_LaserOutFrq(10,0)\n"
    "GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},10000,1000,0,1,{0,0,0,0,0,0,0,0}})\nGT_CrdClear(1,0)\n"
)
_CALLS = _SETUP + "GT_BufLaserPrfCmd(1,30,0,0)\n"
_MARK = "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,5,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"

REFUSED = rule(
    "GJ701",
    ERROR,
    title="call refused",
    text="{call} returns {code}: {reason}",
    why="The call has no effect. A program that does not check the return code continues as if the call were accepted.",
    bad=_SETUP + "GT_LaserOutFrq(0,0)\nGT_CrdStart(1,0)\n",
    good=_SETUP + "GT_LaserOutFrq(20,0)\nGT_CrdStart(1,0)\n",
    section="二.2",
)
QUESTIONABLE_CALL = rule(
    "GJ702",
    WARNING,
    title="questionable call",
    text="{call}: {reason}",
    why="The controller accepts the call, but it probably does not do what the program intends, or gusjob simulates it "
    "only in part.",
    bad="GT_SetAxisMode(7,1)\nGT_LaserPowerMode(2,10,0,0)\n",
    good="GT_LaserPowerMode(2,10,0,0)\n",
    section="三.1",
)
NEVER_STARTED = rule(
    "GJ703",
    ERROR,
    title="stage never started",
    text="{count} buffered calls in coordinate system {crd}, FIFO {fifo} are never started: GT_CrdStart is missing",
    why="Buffered calls stay in their FIFO until GT_CrdStart, or until another program starts it.",
    bad=_SETUP + "GT_LnXY(1,1000,0,50,5,0,0)\n",
    good=_SETUP + "GT_LnXY(1,1000,0,50,5,0,0)\nGT_CrdStart(1,0)\n",
)
END_VELOCITY_NOT_REACHED = rule(
    "GJ704",
    WARNING,
    title="end velocity not reached",
    text="this segment ends at {value} pulse/ms instead of {wanted} pulse/ms: length and acceleration allow no more",
    why="The next segment starts slower than planned, with more energy per mm.",
    bad=_SETUP + "GT_LnXY(1,10,0,50,2,50,0)\nGT_LnXY(1,90000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_SETUP + "GT_LnXY(1,10000,0,50,2,50,0)\nGT_LnXY(1,90000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
)
START_TOO_FAST = rule(
    "GJ705",
    WARNING,
    title="start faster than the segment",
    text="this segment starts at {value} pulse/ms, above its velocity of {velocity} pulse/ms: it slows down first",
    why="It gets less energy per mm than planned until it has slowed down.",
    bad=_SETUP + "GT_LnXY(1,10000,0,50,2,50,0)\nGT_LnXY(1,90000,0,20,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_SETUP + "GT_LnXY(1,10000,0,50,2,20,0)\nGT_LnXY(1,90000,0,20,2,0,0)\nGT_CrdStart(1,0)\n",
)
ABRUPT_STOP = rule(
    "GJ706",
    WARNING,
    title="abrupt stop",
    text="{what} at {value} pulse/ms: the axes stop abruptly",
    why="The mirrors overshoot.",
    bad=_SETUP + "GT_LnXY(1,10000,0,50,2,50,0)\nGT_CrdStart(1,0)\n",
    good=_SETUP + "GT_LnXY(1,10000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
)
SHARP_CORNER = rule(
    "GJ707",
    WARNING,
    title="corner too fast in a listing",
    text="the corner after this segment is taken at {value} pulse/ms: the velocity vector changes by {jump} "
    "pulse/ms, more than {limit} (look-ahead TIME x ACC)",
    why="The mirrors overshoot at the corner.",
    bad=_SETUP + "GT_LnXY(1,10000,0,50,2,50,0)\nGT_LnXY(1,10000,90000,50,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_SETUP + "GT_LnXY(1,10000,0,50,2,0,0)\nGT_LnXY(1,10000,90000,50,2,0,0)\nGT_CrdStart(1,0)\n",
)
LISTING_LEFT_ON = rule(
    "GJ708",
    WARNING,
    title="laser left on by a listing",
    text="these calls end with the laser of channel {channel} on; nothing switches it off",
    why="The laser stays on at the last point.",
    bad=_CALLS + "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,5,0,0)\nGT_CrdStart(1,0)\n",
    good=_CALLS + "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,5,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n",
)
LISTING_FIELD = rule(
    "GJ709",
    WARNING,
    title="outside the field in a listing",
    text="{axis} {value} mm is outside the machine's field {low}..{high} mm",
    why="The controller does not check the field: it moves there.",
    bad=_SETUP + "GT_LnXY(1,200000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_SETUP + "GT_LnXY(1,100000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
)
ASSUMED_CRD = rule(
    "GJ710",
    NOTE,
    title="coordinate system assumed",
    text="there is no GT_SetCrdPrm: the coordinate system is assumed to be set up elsewhere, at the origin",
    why="The manual's routines leave it out, too. The position of the axes is not known.",
    bad="GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
    good=_SETUP + "GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
)
TWO_SYSTEMS_AT_ONCE = rule(
    "GJ711",
    ERROR,
    title="two coordinate systems at once",
    text="coordinate systems 1 and 2 would move at the same time: gusjob can't simulate that",
    why="If two paths run at the same time, the order of their laser and motion calls is not defined.",
    bad="GT_BufDelay(1,10,0)\nGT_BufDelay(2,10,0)\nGT_CrdStart(3,0)\n",
    good="GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
)
LISTING_NO_POWER = rule(
    "GJ712",
    WARNING,
    title="laser on without a power in a listing",
    text="the laser of channel {channel} is on, but no power was set: the lowest power of the mode is assumed",
    why="The controller keeps the power of the previous program.",
    bad=_CALLS.replace("GT_BufLaserPrfCmd(1,30,0,0)\n", "")
    + "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,5,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n",
    good=_CALLS + "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,5,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n",
)
RUN_TOO_LONG = rule(
    "GJ713",
    ERROR,
    title="run too long to simulate",
    text="this run takes {duration} ms, that is {ticks} ticks; the limit is {limit}. This is its longest segment",
    why="At a velocity of almost 0, a segment takes years.",
    bad=_SETUP + "GT_LnXY(1,1000000000,0,0.0001,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_SETUP + "GT_LnXY(1,1000,0,50,5,0,0)\nGT_CrdStart(1,0)\n",
)
LISTING_ARC = rule(
    "GJ714",
    WARNING,
    title="impossible arc in a listing",
    text="{reason}; the nearest possible arc is simulated",
    why="It is not documented what the controller does with such an arc.",
    bad=_SETUP + "GT_ArcXYC(1,1000,0,300,0,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_SETUP + "GT_ArcXYC(1,1000,0,500,0,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
)
LISTING_NO_MODE = rule(
    "GJ715",
    WARNING,
    title="laser on without a mode",
    text="the laser of channel {channel} is on, but GT_LaserPowerMode was never called: duty 0..100 % is assumed",
    why="The channel keeps the mode of the previous program.",
    bad="GT_BufLaserPrfCmd(1,30,0,0)\nGT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,5,0,0)\nGT_BufLaserOff(1,0,0)\n"
    "GT_CrdStart(1,0)\n",
    good=_CALLS + "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,5,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n",
    section="二.2",
)
FIFO_FULL = rule(
    "GJ716",
    NOTE,
    title="FIFO is full before the start",
    text="this is buffered call {count} before GT_CrdStart, and a FIFO holds {slots}: the call returns 1 and is "
    "lost, unless the program starts the motion and sends it again",
    why="A program that ignores a full FIFO, or treats it as an error, loses the rest of the path.",
)
ARGUMENT_CONVERTED = rule(
    "GJ717",
    ERROR,
    title="argument converted by C",
    text="{argument} of {call} is a C {type}: {value} arrives as {arrives}",
    why="C converts an argument to the type of the call without a message. The report is of the number that arrives.",
    bad=_CALLS + "GT_SetLevelDelay(60.5,50,0)\n" + _MARK,
    good=_CALLS + "GT_SetLevelDelay(60,50,0)\n" + _MARK,
)
ARGUMENT_UNDEFINED = rule(
    "GJ718",
    ERROR,
    title="argument without a defined conversion",
    text="{argument} of {call} is a C {type}, which can't hold the floating number {value}: C does not define what "
    "arrives, and the report leaves the call out",
    why="Each compiler and processor may pass another number.",
    bad=_CALLS + "GT_LnXY(1,3e9,0,50,5,0,0)\n" + _MARK,
    good=_CALLS + "GT_LnXY(1,3e4,0,50,5,0,0)\n" + _MARK,
)
UNKNOWN_STOP = rule(
    "GJ725",
    ERROR,
    title="stop that can't be simulated",
    text="{call} stops coordinate system {crd} while it moves, and what runs then is not known: {reason}",
    why="What is marked depends on how far the motion has come at the stop.",
    bad=_SETUP + "GT_LnXY(1,1000,0,50,5,0,0)\nGT_CrdStart(1,0)\nGT_Stop(256,0)\n",
    good=_SETUP + "GT_LnXY(1,1000,0,50,5,0,0)\nGT_CrdStart(1,0)\nGT_CrdStatus(1,run,segment,0)\nGT_Stop(256,0)\n",
)
ON_AT_REST = rule(
    "GJ726",
    WARNING,
    title="laser on at rest in a listing",
    text="the laser of channel {channel} is on at rest for {time} ms ({power}): the report has no row for it",
    why="The laser burns one point, and no total counts this emission. A GT_BufDelay between GT_BufLaserOn and "
    "GT_BufLaserOff has a row. Less than a tick before GT_CrdStart or after the motion is not reported.",
    bad=_CALLS + "GT_LnXY(1,1000,0,50,5,0,0)\nGT_CrdStart(1,0)\nGT_CrdStatus(1,run,segment,0)\n"
    "GT_SetHSIOOpt(1,0)\nGT_SetHSIOOpt(0,0)\n",
    good=_CALLS + "GT_LnXY(1,1000,0,50,5,0,0)\nGT_BufLaserOn(1,0,0)\nGT_BufDelay(1,100,0)\nGT_BufLaserOff(1,0,0)\n"
    "GT_CrdStart(1,0)\n",
)
ON_AT_REST_UNTIMED = variant(
    ON_AT_REST,
    text="the laser of channel {channel} is on at rest ({power}), and this listing does not say how long: the report "
    "has no row for it",
)
