"""GJ9: a run on hardware."""

from __future__ import annotations

from gusjob.diagnostics.rules.registry import ERROR, WARNING, rule

NO_LIBRARY = rule(
    "GJ901",
    ERROR,
    title="vendor's library can't be loaded",
    text="can't load the library {library}: {reason}",
    why="The controller is reached only through the vendor's library. gusjob devices lists the libraries that it "
    "finds.",
)
NO_SYMBOLS = rule(
    "GJ902",
    ERROR,
    title="vendor's library lacks calls of this job",
    text="the library {library}, loaded as --abi {abi}, has no {symbols}{hint}",
    why="A call that turns out to be missing during a run would stop it with the laser on.",
)
WRONG_ABI = rule(
    "GJ903",
    ERROR,
    title="library of another ABI",
    text="the library {library} does not match --abi {abi}: {reason}{hint}",
    why="Arguments in the wrong position mean wrong velocities, wrong powers, or a crash with the laser on.",
)
CALL_FAILED = rule(
    "GJ904",
    ERROR,
    title="call refused by the controller",
    text="{call} returned {code}: {meaning}; {advice}",
    why="A refused call has no effect. Everything after it would be wrong.",
)
NO_ANSWER = rule(
    "GJ905",
    ERROR,
    title="call does not return",
    text="{call} has not returned for {seconds} s: the library or the driver hangs; check cable and power, then "
    "restart the controller",
    why="A program that waits forever can't switch the laser off.",
)
FIFO_EMPTY = rule(
    "GJ906",
    ERROR,
    title="FIFO ran empty",
    text="the FIFO ran empty here and the motion stopped: {rate} calls/s were sent, which is too slow for these "
    "segments; make them longer or slower (gusjob check warns of this if the profile has host_calls_per_s)",
    why="Where the motion stops with the laser on, the part is burnt.",
)
STOPPED_FROM_OUTSIDE = rule(
    "GJ907",
    ERROR,
    title="motion stopped from outside",
    text="the motion stopped here with {queued} calls in the FIFO: something stopped the axes (emergency stop, limit "
    "switch, drive alarm, another program); remove the cause, then continue with --resume",
    why="The stop had a cause. Continuing automatically would ignore it.",
)
NO_PROGRESS = rule(
    "GJ908",
    ERROR,
    title="motion does not continue",
    text="{what} for {seconds} s: check that the axes are enabled and free, then continue with --resume",
    why="A laser that is on while the head stands still burns the part.",
)
WRONG_END_POSITION = rule(
    "GJ909",
    ERROR,
    title="wrong end position",
    text="the motion ended at X {x} Y {y} pulse, not at X {want_x} Y {want_y} pulse: calls were lost, or something "
    "moved the axes; do not use this part",
    why="A part that was marked in the wrong position is scrap, and the next one would be, too.",
)
INTERLOCK = rule(
    "GJ910",
    ERROR,
    title="interlock open",
    text="the interlock (GT_GetDi({di_type}), input {input}) reads {found}, the machine profile requires {value}: "
    "close the door or guard, then {again}",
    why="The laser must not be on while somebody can reach the beam.",
)
STOPPED_ON_REQUEST = rule(
    "GJ911",
    ERROR,
    title="run stopped on request",
    text="stopped here by {who}; continue with --resume {journal}{options}",
    why="An unfinished part must not count as finished.",
)
LASER_STATE_UNKNOWN = rule(
    "GJ912",
    ERROR,
    title="laser may be on",
    text="THE LASER OF CHANNEL {channel} MAY BE ON: {call} {why}. Use the emergency stop, then check the machine",
    why="If the link does not answer, software can't switch the laser off. Only an interlock in hardware can.",
)
MOTION_STATE_UNKNOWN = rule(
    "GJ913",
    ERROR,
    title="motion may continue",
    text="the motion may still continue: {why}. Use the emergency stop",
    why="If the link does not answer, software can't stop the motion.",
)
POSITION_UNKNOWN = rule(
    "GJ914",
    ERROR,
    title="point of interruption not known",
    text="the controller no longer knows where the job was interrupted ({why}); the last known point is here, and up "
    "to {calls} more calls may have run: check the part, then continue with --from-line N",
    why="Continuing from a guessed point leaves something out, or marks it twice.",
)
NO_JOURNAL = rule(
    "GJ915",
    ERROR,
    title="journal can't be written",
    text="can't write the journal: {reason}; free some disk space, then continue with --resume, or with --from-line if "
    "that is refused",
    why="A run can be resumed only with its journal, so none is started without it.",
)
RUN_KILLED = rule(
    "GJ916",
    WARNING,
    title="run was killed",
    text="this run was killed: it is not known whether the last {calls} calls up to here were run; they are counted "
    "as run",
    why="A controller continues with the calls in its FIFO when the program that sent them has ended.",
)
SEVERAL_SYSTEMS = rule(
    "GJ917",
    ERROR,
    title="more than one coordinate system or FIFO on hardware",
    text="a run on hardware uses one coordinate system and one FIFO; here is {what} after {first}",
    why="If two FIFOs are filled in turn, the order of their execution is not known.",
)
IN_USE = rule(
    "GJ918",
    ERROR,
    title="controller or journal in use",
    text="{what} is in use by {holder}: wait until that run has ended, or stop it",
    why="Two runs on one controller clear each other's calls. Two that continue one journal mark the rest twice.",
)
JOURNAL_DAMAGED = rule(
    "GJ919",
    WARNING,
    title="journal damaged",
    text="line {line} of this journal was changed or cut, or lines before it were removed: only the lines before it "
    "are read",
    why="The checksum of each line continues that of the line before, so lines after a wrong one can't be verified.",
)
NOT_RESET = rule(
    "GJ920",
    WARNING,
    title="laser setting can't be reset",
    text="the controller does not support {call} on channel {channel}: a value that an earlier program set can't be "
    "reset; this job does not use the setting",
    why="A delay or a follow mode that is still in force changes every mark.",
)
NOT_IN_RUN = rule(
    "GJ921",
    ERROR,
    title="call that a run on hardware does not make",
    text="{call} can't be part of a run on hardware: leave it out; gusjob stops and sets up the controller itself",
    why="After such a call gusjob no longer knows the state of the laser and the rest of the path.",
)
