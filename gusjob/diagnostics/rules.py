"""The registry of rules: each thing that can be wrong, its text, why it hurts, a bad and a good example.

Texts are templates with named fields. grammar/README.md's table and `gusjob explain` are made from here, and the tests
run every example. Codes are stable: a code is never given to another diagnostic.

GJ0 the file, GJ1 words and the carrying out of a job, GJ2 values, GJ3 modes and order, GJ4 light, GJ5 motion, GJ6 the
machine profile, GJ7 what the controller would say to a listing, GJ8 sky writing, GJ9 a run on hardware.
"""

from __future__ import annotations

from dataclasses import replace

from gusjob.diagnostics.model import Rule, Severity

RULES: dict[str, Rule] = {}
"""Every rule by its code."""
VARIANTS: list[Rule] = []
"""Rules with another text for another cause of the same diagnostic."""

_E, _W, _N = Severity.ERROR, Severity.WARNING, Severity.NOTE


def _rule(
    code: str, severity: Severity, title: str, text: str, why: str, bad: str = "", good: str = "", section: str = ""
) -> Rule:
    if code in RULES:
        raise ValueError(f"rule {code} stands twice")
    RULES[code] = Rule(
        code=code, severity=severity, title=title, text=text, why=why, bad=bad, good=good, section=section
    )
    return RULES[code]


def _also(rule: Rule, text: str) -> Rule:
    VARIANTS.append(replace(rule, text=text))
    return VARIANTS[-1]


_HEAD = "LASER MODE DUTY CARRIER 10kHz\nVEL 100\nACC 5000\n"
_LIT = _HEAD + "LASER POWER 30\nLASER ON\n"

# GJ0: the file as such.
UNREADABLE = _rule(
    "GJ001", _E, "file can't be read", "can't read this file: {reason}",
    "Nothing is known of a file that can't be read, so nothing is run.",
)  # fmt: skip
NOT_TEXT = _rule(
    "GJ002", _E, "file is not text", "this is not UTF-8 text: {reason}",
    "A byte that is no text may stand for any character, a digit or a sign among them.",
)  # fmt: skip
TOO_LARGE = _rule(
    "GJ003", _E, "file is too large", "this file has {size} MB; gusjob reads up to {limit} MB",
    "A file of this size would not fit into memory with all that is made of it. Split the job.",
)  # fmt: skip
EMPTY = _rule(
    "GJ004", _W, "nothing in the file", "this file has no {what}: nothing would happen",
    "A job without statements is more often a wrong file than a wish.",
    bad="; LINE X 10\n", good="WAIT\n",
)  # fmt: skip
MORE = _rule(
    "GJ005", _N, "more of the same", "{count} more of {code} are not listed: of a rule up to {shown} are",
    "The first faults of a kind say what is wrong with all of them.",
)  # fmt: skip
NO_END = _rule(
    "GJ006", _E, "line is too long", "this line has {size} characters; a statement has at most {limit}",
    "A line without end is a file of another kind, or line ends that were lost on the way.",
)  # fmt: skip

# GJ1: words, and the carrying out of a job.
UNEXPECTED = _rule(
    "GJ101", _E, "unexpected word", "{found} does not belong here; {expected}{hint}",
    "A word that is passed over would change what is burnt: X1O is not X10.",
    bad=_HEAD + "LINE X1O Y20\n", good=_HEAD + "LINE X10 Y20\n",
)  # fmt: skip
UNKNOWN_STATEMENT = _rule(
    "GJ102", _E, "unknown statement", "no statement begins with {found}{hint}",
    "A statement that nobody knows may have been the one that turns the light off.",
    bad=_HEAD + "LNE X 10\n", good=_HEAD + "LINE X 10\n",
)  # fmt: skip
TWICE = _rule(
    "GJ103", _E, "word given twice", "{word} stands twice in this statement",
    "Which of the two would hold is a guess.",
    bad=_HEAD + "LINE X 10 X 20\n", good=_HEAD + "LINE X 10 Y 20\n",
)  # fmt: skip
MISSING = _rule(
    "GJ104", _E, "word missing", "{statement} needs {word}{hint}",
    "There is no safe value to put in its place.",
    bad="LASER MODE DUTY\n", good="LASER MODE DUTY CARRIER 10kHz\n",
)  # fmt: skip
FOREIGN = _rule(
    "GJ105", _E, "word of another form", "{word} does not belong to {statement}: {hint}",
    "The statement would do something else than the word asks for.",
    bad=_HEAD + "JUMP X 10 VEL 500\n", good=_HEAD + "JUMPVEL 500\nJUMP X 10\n",
)  # fmt: skip
TOO_BIG = _rule(
    "GJ106", _E, "number can't be held", "{value} is too large: numbers go up to {limit}",
    "Beyond this size whole numbers are not told apart any more.",
    bad=_HEAD + "LINE X 1e300\n", good=_HEAD + "LINE X 100\n",
)  # fmt: skip
RESERVED = _rule(
    "GJ108", _E, "name is taken", "{word} is a word of the language and can't be a name: {hint}",
    "A name that reads like a keyword is taken for one, by people first.",
    bad="LET power = 30\n", good="LET power_1 = 30\n",
)  # fmt: skip
NO_FUNCTION = _rule(
    "GJ109", _E, "unknown function", "there is no function {word}{hint}",
    "An expression with an unknown function has no value.",
    bad=_HEAD + "LINE X (sine(30))\n", good=_HEAD + "LINE X (sin(30))\n",
)  # fmt: skip
ARITY = _rule(
    "GJ110", _E, "wrong number of operands", "{word} takes {wanted}, not {found}",
    "A function that gets too few or too many numbers was meant to be another one.",
    bad=_HEAD + "LINE X (hypot(3))\n", good=_HEAD + "LINE X (hypot(3, 4))\n",
)  # fmt: skip
CALL_SYNTAX = _rule(
    "GJ111", _E, "call can't be read", "this is no GT_ call, array or comment that gusjob reads: {found}",
    "A listing is read call by call; what else a C program does to the calls (loops, conditions) is not known.",
    bad="for (;;) GT_CrdStart(1,0);\n", good="GT_CrdClear(1,0);\nGT_CrdStart(1,0);\n",
)  # fmt: skip
CALL_UNKNOWN = _rule(
    "GJ112", _E, "unknown call", "{call} is not a call that gusjob knows{hint}",
    "A call that is not known may switch the light.",
    bad="GT_BufLaserOnn(1,0,0)\n", good="GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
CALL_ARGUMENTS = _rule(
    "GJ113", _E, "wrong number of arguments", "{call} takes {wanted} arguments ({names}), not {found}",
    "With an argument left out, FIFO and channel change places.",
    bad="GT_BufLaserOff(1,0)\n", good="GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n", section="四.2",
)  # fmt: skip
CALL_VALUE = _rule(
    "GJ114", _E, "argument can't be read", "{argument} of {call} must be {wanted}, not {found}",
    "A value that is worked out elsewhere in the program is not known here.",
    bad="GT_BufDelay(1,pause,0)\n", good="GT_BufDelay(1,100,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
CALL_OCTAL = _rule(
    "GJ115", _E, "octal number", "{found} is an octal number in C, worth {value}: write it without the zero",
    "In C a zero in front makes a number octal: 010 is 8.",
    bad="GT_BufDelay(1,010,0)\n", good="GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
CALL_IGNORED = _rule(
    "GJ116", _N, "line passed over", "{call} says nothing to the laser or the path; it is passed over",
    "What is left out of the report should be known.",
    bad="GT_AxisOn(1)\nGT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n", good="GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
UNKNOWN_NAME = _rule(
    "GJ121", _E, "unknown name", "{name} has no value here{hint}",
    "A statement without a value is not carried out.",
    bad=_HEAD + "LINE X (pitch)\n", good=_HEAD + "LET pitch = 0.5\nLINE X (pitch)\n",
)  # fmt: skip
MISMATCH = _rule(
    "GJ122", _E, "kinds that do not fit", "{operator} {wants}; here it has {given}",
    "A sum of a length and a plain number has a hidden unit in it; 2*pitch is fine, pitch+2 is not.",
    bad=_HEAD + "LET pitch = 0.5mm\nLINE X (pitch + 2)\n", good=_HEAD + "LET pitch = 0.5mm\nLINE X (pitch + 2mm)\n",
)  # fmt: skip
NO_VALUE = _rule(
    "GJ123", _E, "expression without a value", "this has no value: it comes to {value}",
    "Nothing safe can be made of a division by zero or the root of a negative number.",
    bad=_HEAD + "LET n = 0\nLINE X (10 / n)\n", good=_HEAD + "LET n = 2\nLINE X (10 / n)\n",
)  # fmt: skip
COUNT = _rule(
    "GJ124", _E, "loop that can't be counted", "{what} {value}: {hint}",
    "Rounds are counted before the first of them: a loop that never ends would never stop burning.",
    bad="FOR i FROM 0 TO 10 STEP 0\nDWELL 1\nEND\n", good="FOR i FROM 0 TO 10 STEP 1\nDWELL 1\nEND\n",
)  # fmt: skip
NOT_A_NUMBER = _rule(
    "GJ125", _E, "comparison in place of a number", "{what} needs a number, not a comparison",
    "A comparison is true or false; it has no length and no power.",
    bad=_HEAD + "LINE X (1 < 2)\n", good=_HEAD + "IF 1 < 2\nLINE X 1\nEND\n",
)  # fmt: skip
NOT_A_CONDITION = _rule(
    "GJ126", _E, "number in place of a condition", "IF needs a comparison, such as a > 0, not a number",
    "Which numbers count as true is a guess that differs from language to language.",
    bad="LET n = 2\nIF n\nDWELL 1\nEND\n", good="LET n = 2\nIF n != 0\nDWELL 1\nEND\n",
)  # fmt: skip
TOO_MANY = _rule(
    "GJ127", _E, "too much to carry out",
    "loops and routines make more than {limit} {what} here: a machine profile may allow more ([expansion] {key})",
    "A slip in a loop's bounds can make a job of any length; nobody would wait for it.",
    bad="REPEAT 100000\nREPEAT 100000\nDWELL 1\nEND\nEND\n", good="REPEAT 100\nREPEAT 100\nDWELL 1\nEND\nEND\n",
)  # fmt: skip
TOO_DEEP = _rule(
    "GJ128", _E, "too deep",
    "blocks, calls and includes stand more than {limit} deep inside each other here: a machine profile may allow more "
    "([expansion] {key})",
    "A routine that calls itself needs an IF that ends it.",
    bad="DEF f(n)\nCALL f(n - 1)\nEND\nCALL f(3)\n",
    good="DEF f(n)\nDWELL 1\nIF n > 0\nCALL f(n - 1)\nEND\nEND\nCALL f(3)\n",
)  # fmt: skip
TOO_SLOW = _rule(
    "GJ129", _E, "too much work to carry out",
    "more than {limit} steps of work here, in loops that carry a value from round to round, in routines that call "
    "themselves or in long expressions: let values hang on the loop's variable instead",
    "A loop in which a round needs what the round before has set can't be carried out at once.",
    bad="LET a = 0\nREPEAT 4000001\nLET a = a + 1\nEND\n", good="REPEAT 1000001 AS i\nLET a = i + 1\nEND\n",
)  # fmt: skip
TOO_MANY_SETUPS = _rule(
    "GJ130", _E, "too many setup statements", "loops and routines make more than {limit} setup statements",
    "Each setup statement behind motion is a stage of its own: the machine stops for it.",
    bad="REPEAT 50001\nWAIT\nEND\n", good="REPEAT 10\nWAIT\nEND\n",
)  # fmt: skip
UNCLOSED = _rule(
    "GJ131", _E, "block without END", "this {word} has no END",
    "Where the block was meant to end is a guess.",
    bad="REPEAT 3\nDWELL 1\n", good="REPEAT 3\nDWELL 1\nEND\n",
)  # fmt: skip
STRAY = _rule(
    "GJ132", _E, "END or ELSE without a block",
    "{word} stands here without a block that it could belong to ({begins})",
    "An END too many closes a block too early.",
    bad="DWELL 1\nEND\n", good="REPEAT 1\nDWELL 1\nEND\n",
)  # fmt: skip
DEF_INSIDE = _rule(
    "GJ133", _E, "routine inside a block", "DEF stands in the open, not inside another block",
    "A routine is the same for the whole job; it can't hang on a round or a condition.",
    bad="REPEAT 2\nDEF f()\nDWELL 1\nEND\nEND\n", good="DEF f()\nDWELL 1\nEND\nREPEAT 2\nCALL f()\nEND\n",
)  # fmt: skip
NESTED = _rule(
    "GJ134", _E, "blocks too deep", "blocks stand at most {limit} deep inside each other",
    "Nobody reads a job of this depth; put the inner blocks into a routine.",
    bad="REPEAT 1\n" * 33 + "END\n" * 33, good="REPEAT 1\n" * 3 + "DWELL 1\n" + "END\n" * 3,
)  # fmt: skip
DEF_TWICE = _rule(
    "GJ135", _E, "routine defined twice", "{name} is defined already",
    "Which of the two a CALL means is a guess.",
    bad="DEF f()\nEND\nDEF f()\nEND\n", good="DEF f()\nEND\nDEF g()\nEND\n",
)  # fmt: skip
NO_ROUTINE = _rule(
    "GJ136", _E, "unknown routine", "there is no routine {name}{hint}",
    "What it should have done would be missing from the part.",
    bad="DEF pause(t)\nDWELL (t)\nEND\nCALL paus(3)\n", good="DEF pause(t)\nDWELL (t)\nEND\nCALL pause(3)\n",
)  # fmt: skip
CALL_VALUES = _rule(
    "GJ137", _E, "wrong number of values", "{name}{takes} takes {wanted} values, not {found}",
    "A value that is left out has no default.",
    bad="DEF pause(t)\nDWELL (t)\nEND\nCALL pause()\n", good="DEF pause(t)\nDWELL (t)\nEND\nCALL pause(3)\n",
)  # fmt: skip
INCLUDE = _rule(
    "GJ138", _E, "file can't be included", 'can\'t include "{file}": {reason}',
    "A job is data from anywhere: it reads nothing outside its own folder.",
    bad='INCLUDE "../secret.job"\n',
)  # fmt: skip
FRAME_SCALE = _rule(
    "GJ139", _E, "frame without a size", "SCALE {value} must be above 0",
    "A frame of size 0 makes a point of everything; a negative one is a rotation by 180 degrees: write that.",
    bad=_HEAD + "FRAME SCALE 0\nLINE X 1\nEND\n", good=_HEAD + "FRAME SCALE 2\nLINE X 1\nEND\n",
)  # fmt: skip
NEVER_CALLED = _rule(
    "GJ141", _N, "routine never called", "{name} is never called",
    "A routine that is not called does not burn what it was written for.",
    bad="DEF f()\nDWELL 1\nEND\nDWELL 2\n", good="DEF f()\nDWELL 1\nEND\nCALL f()\n",
)  # fmt: skip
NEVER_READ = _rule(
    "GJ142", _N, "name never read", "{name} is set here and never read",
    "A name that is set and not used is often a misspelling of another one.",
    bad="LET pause = 5\nDWELL 1\n", good="LET pause = 5\nDWELL (pause)\n",
)  # fmt: skip
SMALL = _rule(
    "GJ143", _N, "word in small letters", "{word} is a word of the language in small letters: write {meant}",
    "The language takes it; people who read a job look for words in capitals, and for names in small letters.",
    bad="wait\n", good="WAIT\n",
)  # fmt: skip
ALLOWED_IN_VAIN = _rule(
    "GJ144", _W, "allow that is not followed", "{code} is not allowed by this comment: {why}",
    "A comment that looks as if it allowed something misleads who reads it. What it may allow are warnings and notes "
    "of its own line, with the reason behind a colon.",
    bad="WAIT\nLET pause = 5 ; allow GJ142\n", good="WAIT\nLET pause = 5 ; allow GJ142: read by the next version\n",
)  # fmt: skip
ALLOWS_NOTHING = _rule(
    "GJ145", _W, "allow that allows nothing", "{code} is not found in this line: take its allow away",
    "A comment that outlives its reason would hide the next fault of the same rule.",
    bad="DWELL 5 ; allow GJ404: it only warms up\n", good="DWELL 5\n",
)  # fmt: skip

# GJ2: values.
OUT_OF_RANGE = _rule(
    "GJ201", _E, "value out of range", "{what} {value} {unit} is outside {range}{hint}",
    "The controller refuses the call or does something that nobody has documented.",
    bad="LASER MODE DUTY CARRIER 3MHz\n", good="LASER MODE DUTY CARRIER 20kHz\n", section="二.2",
)  # fmt: skip
ON_OPEN_END = _rule(
    "GJ202", _W, "value on an excluded end",
    "{what} {value} {unit} is on an end of {range}, which the manual excludes (though its own example uses one)",
    "The manual prints an open interval for the buffered power and uses its end in an example of its own.",
    bad=_LIT.replace("POWER 30", "POWER 100") + "LINE X 1\nLASER OFF\n",
    good=_LIT.replace("POWER 30", "POWER 99.9") + "LINE X 1\nLASER OFF\n", section="四.2",
)  # fmt: skip
WRONG_UNIT = _rule(
    "GJ203", _E, "unit of the wrong kind", "{what} is {wanted}, but {unit} is {kind}{hint}",
    "20 kHz in a duty mode would be taken as 20 %.",
    bad=_HEAD + "LASER POWER 20kHz\n", good=_HEAD + "LASER POWER 20%\nLASER ON\nLINE X 1\nLASER OFF\n",
)  # fmt: skip
NOT_WHOLE = _rule(
    "GJ204", _E, "not a whole number",
    "{what} {value} {unit} must be whole: the call's C type carries no fraction{hint}",
    "The C type of the argument cuts the fraction off without a word.",
    bad="LASER DELAY ON 10.5us OFF 20us\n", good="LASER DELAY ON 10us OFF 20us\n", section="二.2",
)  # fmt: skip
MIN_ABOVE_MAX = _rule(
    "GJ205", _E, "MIN not below MAX", "{what}: MIN {low} must be below MAX {high}",
    "Limits that are the wrong way round leave no power at all.",
    bad="LASER MODE DUTY CARRIER 10 MIN 50 MAX 20\n", good="LASER MODE DUTY CARRIER 10 MIN 20 MAX 50\n", section="二.2",
)  # fmt: skip
POWER_CLAMPED = _rule(
    "GJ206", _W, "power outside the mode's limits",
    "{what} {value} {unit} is outside the mode's {low}..{high} {unit}: the controller clamps it",
    "The part gets another power than the job says.",
    bad="LASER MODE ANALOG MAX 5\nVEL 100\nACC 5000\nLASER POWER 6\nLASER ON\nLINE X 1\nLASER OFF\n",
    good="LASER MODE ANALOG MAX 8\nVEL 100\nACC 5000\nLASER POWER 6\nLASER ON\nLINE X 1\nLASER OFF\n", section="二.2",
)  # fmt: skip
PULSE_TOO_WIDE = _rule(
    "GJ207", _E, "laser pulse against its period",
    "at {value} kHz a laser pulse of {width} us stands at {duty} % of the period, outside {range}",
    "A laser pulse must fit its period, for every frequency that the job commands.",
    bad="LASER MODE FREQUENCY WIDTH 100us\nVEL 100\nACC 5000\nLASER POWER 20kHz\nLASER ON\nLINE X 1\nLASER OFF\n",
    good="LASER MODE FREQUENCY WIDTH 10us\nVEL 100\nACC 5000\nLASER POWER 20kHz\nLASER ON\nLINE X 1\nLASER OFF\n",
    section="二.2",
)  # fmt: skip
CARRIER_TOO_FAST = _rule(
    "GJ208", _E, "faster than the laser",
    "{what} {value} kHz is above this laser's highest response frequency, {limit} kHz (machine profile)",
    "A laser that can't follow the carrier gives a power that nobody knows.", section="二.2",
)  # fmt: skip
SATURATES = _rule(
    "GJ209", _W, "following saturates",
    "at the programmed velocity, {velocity} {speed}, following asks for {value} {unit}, above "
    "its MAX {high} {unit}",
    "Above that velocity the power no longer follows: the energy per mm falls.",
    bad=_HEAD + "LASER FOLLOW RATIO 1 MIN 5 MAX 50\nLASER ON\nLINE X 1\nLASER OFF\n",
    good=_HEAD + "LASER FOLLOW MIN 5 MAX 50 AT 100mm/s\nLASER ON\nLINE X 1\nLASER OFF\n", section="四.2",
)  # fmt: skip
POWER_UNUSED = _rule(
    "GJ210", _W, "power that nothing uses", "no light comes between this {word} and what sets the power next",
    "A power that nothing uses was meant for a mark that now has another one.",
    bad=_LIT + "LINE X 1\nLASER POWER 40\nLASER POWER 50\nLINE X 2\nLASER OFF\n",
    good=_LIT + "LINE X 1\nLASER POWER 50\nLINE X 2\nLASER OFF\n",
)  # fmt: skip

# GJ3: modes and order.
NO_MODE = _rule(
    "GJ301", _E, "power before a mode",
    "{word} stands before any LASER MODE for channel {channel}: its unit is unknown",
    "30 may be percent, kHz or volts.",
    bad="LASER POWER 30\nLASER MODE DUTY CARRIER 10\n", good=_LIT + "LINE X 1\nLASER OFF\n", section="二.2",
)  # fmt: skip
WRONG_MODE = _rule(
    "GJ302", _E, "not in this mode", "{word} is for {wanted}; channel {channel} is in {mode} mode",
    "The controller does not put it out in this mode.",
    bad="LASER MODE ANALOG\nLASER STANDBY FREQ 5kHz DUTY 1\n",
    good="LASER MODE DUTY CARRIER 10\nLASER STANDBY FREQ 5kHz DUTY 1\n", section="二.2",
)  # fmt: skip
DISTANCE_NEEDS_MODE = _rule(
    "GJ303", _E, "distance follow before its mode",
    "LASER DISTANCE stands before any LASER MODE for channel {channel}: its unit is unknown",
    "Its limits are in the mode's unit.",
    bad="LASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 1 MIN 0 MAX 50\n",
    good="LASER MODE DUTY CARRIER 10\nLASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 1 MIN 0 MAX 50\n", section="五.2",
)  # fmt: skip
NEW_STAGE = _rule(
    "GJ304", _N, "a new stage begins", "{word} is set at rest: motion stops here and a new stage begins",
    "Stopping takes time; if it was not meant, put the statement before the path.",
    bad=_HEAD + "LINE X 1\nLASER DELAY ON 10 OFF 20\nLINE X 2\n",
    good=_HEAD + "LASER DELAY ON 10 OFF 20\nLINE X 1\nLINE X 2\n", section="二.2",
)  # fmt: skip
OFF_BELOW_ON = _rule(
    "GJ306", _W, "off delay below on delay",
    "off delay {off} us is shorter than on delay {on} us; it should usually be the longer one",
    "The mark would end before it should: the mirrors lag at its end as they do at its start.",
    bad="LASER DELAY ON 60us OFF 50us\n", good="LASER DELAY ON 50us OFF 60us\n", section="三.2",
)  # fmt: skip
CRD_LATE = _rule(
    "GJ307", _E, "coordinate system after motion",
    "CRD stands after the first motion or laser statement of the path: put it before",
    "A job runs in one coordinate system and FIFO.",
    bad=_HEAD + "LINE X 1\nCRD 2\n", good="CRD 2\n" + _HEAD + "LINE X 1\n",
)  # fmt: skip
LASER_UNKNOWN = _rule(
    "GJ309", _E, "channel used without a mode",
    "channel {channel} is switched on here, but no LASER MODE was given for it",
    "The channel keeps the mode of whatever ran before.",
    bad="VEL 100\nACC 5000\nLASER ON\nLINE X 1\nLASER OFF\n", good=_LIT + "LINE X 1\nLASER OFF\n", section="二.2",
)  # fmt: skip
DISTANCE_STALE = _rule(
    "GJ310", _E, "distance follow of another mode",
    "the limits of LASER DISTANCE are in {unit}, this mode is in {mode_unit}: "
    "set LASER DISTANCE again here, or OFF",
    "Percent would be taken as volts.",
    bad="LASER MODE DUTY CARRIER 10\nLASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 1 MIN 0 MAX 50\nLASER MODE ANALOG\n",
    good="LASER MODE DUTY CARRIER 10\nLASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 1 MIN 0 MAX 50\nLASER DISTANCE OFF\n"
    "LASER MODE ANALOG\n",
    section="五.2",
)  # fmt: skip
FPK_SWITCH = _rule(
    "GJ311", _E, "first pulse killer without a switch line",
    "with FPK the switch line carries the FPK pulse, but DUTY2 holds that line high (channel {channel})",
    "Mode and first pulse killer want the same line: what comes out is not documented.",
    bad="LASER MODE DUTY2 CARRIER 10\nLASER FPK WIDTH 20 GAP 15 OFFDELAY 10\n",
    good="LASER MODE DUTY CARRIER 10\nLASER FPK WIDTH 20 GAP 15 OFFDELAY 10\n", section="一.2, 二.2",
)  # fmt: skip
DELAY_TOO_LONG = _rule(
    "GJ312", _W, "delay longer than its mark",
    "the on delay of {on} us is longer than this mark, which takes at most {most} us: {lost}",
    "The delays move the switch, motion does not wait: a short mark is over before the light comes.",
    bad="LASER DELAY ON 1000us OFF 1000us\nLASER MODE DUTY CARRIER 10\nVEL 1000\nACC 1000000\nLASER POWER 30\n"
    "LASER ON\nLINE X 0.1\nLASER OFF\n",
    good="LASER DELAY ON 50us OFF 60us\nLASER MODE DUTY CARRIER 10\nVEL 1000\nACC 1000000\nLASER POWER 30\n"
    "LASER ON\nLINE X 1\nLASER OFF\n",
    section="二.2",
)  # fmt: skip

DELAY_BRIDGES = _rule(
    "GJ313", _W, "delay that bridges a jump",
    "the off delay of {off} us outlasts the way to the next LASER ON, which takes at most {most} us: the light does "
    "not go off between",
    "What should be dark is burnt: the jump between the two marks.",
    bad="LASER DELAY ON 50us OFF 50ms\nLASER MODE DUTY CARRIER 10\nVEL 1000\nACC 1000000\nLASER POWER 30\nLASER ON\n"
    "LINE X 90\nLASER OFF\nJUMP X 91\nLASER ON\nLINE X 0\nLASER OFF\n",
    good="LASER DELAY ON 50us OFF 60us\nLASER MODE DUTY CARRIER 10\nVEL 1000\nACC 1000000\nLASER POWER 30\nLASER ON\n"
    "LINE X 90\nLASER OFF\nJUMP X 91\nLASER ON\nLINE X 0\nLASER OFF\n",
    section="二.2",
)  # fmt: skip

# GJ4: light.
LEFT_ON = _rule(
    "GJ401", _E, "light left on", "the job ends with the laser of channel {channel} on: add LASER OFF{hint}",
    "Nothing switches a laser off when a job ends: it burns on at the last point.",
    bad=_LIT + "LINE X 1\n", good=_LIT + "LINE X 1\nLASER OFF\n",
)  # fmt: skip
JUMP_LIT = _rule(
    "GJ402", _E, "jump with light", "JUMP with the laser of channel {channel} on: put LASER OFF before it",
    "The jump would be burnt across the part. A move that is to be marked is a LINE.",
    bad=_LIT + "LINE X 1\nJUMP X 5\nLASER OFF\n", good=_LIT + "LINE X 1\nLASER OFF\nJUMP X 5\n",
)  # fmt: skip
NO_POWER = _rule(
    "GJ403", _E, "light without a power",
    "the laser of channel {channel} is on here, but no power was set since its LASER MODE",
    "The controller keeps whatever power the last job has left.",
    bad=_HEAD + "LASER ON\nLINE X 1\nLASER OFF\n", good=_LIT + "LINE X 1\nLASER OFF\n", section="二.2",
)  # fmt: skip
DWELL_LIT = _rule(
    "GJ404", _W, "dwell with light", "DWELL with the laser of channel {channel} on, in the middle of a mark",
    "The head stands still and the light burns one point. A pierce at the start, right behind LASER ON, is not meant.",
    bad=_LIT + "LINE X 1\nDWELL 100\nLINE X 2\nLASER OFF\n",
    good=_LIT + "DWELL 100\nLINE X 1\nLINE X 2\nLASER OFF\n",
)  # fmt: skip
WAIT_LIT = _rule(
    "GJ405", _W, "light in the wait between stages",
    "{word} ends the motion while the laser of channel {channel} is on: the light stays on until the next stage moves",
    "How long a program takes between two stages is not known, and the light burns one point all the time.",
    bad=_LIT + "LINE X 1\nWAIT\nLINE X 2\nLASER OFF\n",
    good=_LIT + "LINE X 1\nLASER OFF\nWAIT\nLASER ON\nLINE X 2\nLASER OFF\n",
)  # fmt: skip
LIT_NOTHING = _rule(
    "GJ406", _W, "light with nothing to mark",
    "the laser of channel {channel} is switched on and off with no motion between",
    "Either the mark is missing, or a point is burnt by the delays alone.",
    bad=_LIT + "LASER OFF\nLINE X 1\n", good=_LIT + "LINE X 1\nLASER OFF\n",
)  # fmt: skip
BURNT_TWICE = _rule(
    "GJ407", _W, "the same mark burnt twice", "this mark was burnt before, with the same power and velocity",
    "Drawings with doubled lines burn twice as deep there. Passes that are meant are a REPEAT.",
    bad=_LIT + "LINE X 5\nLINE X 0\nLASER OFF\n",
    good=_HEAD + "LASER POWER 30\nREPEAT 2\nJUMP X 0\nLASER ON\nLINE X 5\nLASER OFF\nEND\n",
)  # fmt: skip
ALREADY_ON = _rule(
    "GJ408", _W, "laser is on already", "the laser of channel {channel} is on already: is a LASER OFF missing?",
    "A second LASER ON changes nothing; often the LASER OFF between two marks was forgotten.",
    bad=_LIT + "LINE X 5\nLASER ON\nLINE X 6\nLASER OFF\n",
    good=_LIT + "LINE X 5\nLASER OFF\nJUMP X 6\nLASER ON\nLINE X 7\nLASER OFF\n",
)  # fmt: skip

# GJ5: motion.
NO_VELOCITY = _rule(
    "GJ501", _E, "no velocity", "{word} needs a velocity: write VEL before it",
    "There is no velocity that is right for every laser and material.",
    bad="ACC 5000\nLINE X 1\n", good="ACC 5000\nVEL 100\nLINE X 1\n",
)  # fmt: skip
NO_ACCELERATION = _rule(
    "GJ502", _E, "no acceleration", "{word} needs an acceleration: write ACC before it",
    "How hard the mirrors may be driven is for the machine builder to say.",
    bad="VEL 100\nLINE X 1\n", good="VEL 100\nACC 5000\nLINE X 1\n",
)  # fmt: skip
OUTSIDE_FIELD = _rule(
    "GJ503", _E, "outside the field", "{axis} {value} mm is outside the machine's field {low}..{high} mm{hint}",
    "Outside the field the beam is clipped, or burns what stands there. Arcs are judged with all of their bulge.",
    bad=_HEAD + "LINE X 200\n", good=_HEAD + "LINE X 100\n",
)  # fmt: skip
TOO_FAST = _rule(
    "GJ504", _E, "too fast", "{what} {value} {unit} is above the machine's {limit} {unit}",
    "Mirrors that can't follow leave the path.",
    bad="VEL 20m/s\n", good="VEL 2m/s\n",
)  # fmt: skip
BAD_ARC = _rule(
    "GJ505", _E, "arc that does not close", "{reason}",
    "Start, end and centre do not lie on one circle: the controller would jump or refuse.",
    bad=_HEAD + "ARC CW X 10 Y 0 I 3 J 0\n", good=_HEAD + "ARC CW X 10 Y 0 I 5 J 0\n",
)  # fmt: skip
ARC_OFF = _also(
    BAD_ARC,
    "the end is {end} mm from the centre, the start {start} mm: they must be the same within {limit} mm",
)
ARC_SHORT = _also(
    BAD_ARC, "the radius {value} mm is too small: the end is {chord} mm away, R must be at least {least} mm"
)
END_UNREACHABLE = _rule(
    "GJ506", _E, "END can't be reached",
    "END {value} {speed} can't be reached: length and acceleration here and behind allow {high} {speed}",
    "The controller would stop hard or leave the path.",
    bad=_HEAD + "LINE X 0.001 END 100\nLINE X 10\n", good=_HEAD + "LINE X 5 END 100\nLINE X 10\n",
)  # fmt: skip
END_ABOVE_VEL = _rule(
    "GJ507", _E, "END above VEL", "END {value} {speed} is above this segment's VEL {velocity} {speed}",
    "A segment can't end faster than it may go.",
    bad=_HEAD + "LINE X 5 END 200\nLINE X 10\n", good=_HEAD + "LINE X 5 END 100\nLINE X 10\n",
)  # fmt: skip
ARC_TOO_FAST = _rule(
    "GJ508", _W, "arc too fast",
    "VEL {velocity} {speed} on a radius of {radius} {length} needs {value} {acceleration}, above the machine's "
    "{limit} {acceleration}: the planner slows it down",
    "On a small circle the mirrors need more acceleration than the machine has.",
    bad="VEL 5000\nACC 100000\nARC CW I 1 J 0\n", good="VEL 500\nACC 100000\nARC CW I 1 J 0\n",
)  # fmt: skip
FOLLOW_SCALES = _rule(
    "GJ509", _E, "following in mm with unequal axes",
    "velocity follow in mm needs the same pulses per mm on X and Y; write it under UNITS PULSE",
    "The controller follows the velocity in pulses, which has another mm value in each direction.", section="四.2",
)  # fmt: skip
END_AT_STOP = _rule(
    "GJ510", _W, "END where motion stops", "motion stops behind this segment, at once from END {value} {speed}",
    "The axes stop at once, and the mirrors overshoot.",
    bad=_HEAD + "LINE X 5 END 50\n", good=_HEAD + "LINE X 5 END 50\nLINE X 10\n",
)  # fmt: skip
NO_LENGTH = _rule(
    "GJ513", _W, "mark of no length", "this {word} ends where it begins, with the light on",
    "It marks nothing, or burns a point; often a coordinate was left out or written twice.",
    bad=_LIT + "LINE X 5\nLINE X 5\nLASER OFF\n", good=_LIT + "LINE X 5\nLINE X 6\nLASER OFF\n",
)  # fmt: skip
CORNER_TOO_FAST = _rule(
    "GJ514", _W, "corner too fast",
    "END takes the corner behind this segment at {value} {speed}: the velocity vector changes by {jump} {speed}, "
    "more than the {limit} {speed} that look-ahead would allow (TIME x ACC)",
    "The mirrors overshoot at the corner.",
    bad=_HEAD + "LINE X 5 END 100\nLINE Y 5\n", good=_HEAD + "LINE X 5\nLINE Y 5\n",
)  # fmt: skip
STARVES = _rule(
    "GJ515", _W, "FIFO that would starve",
    "in the {calls} calls up to here segments are so short that a host which sends {rate} calls/s (machine profile) "
    "can't keep the FIFO of {slots} slots filled",
    "A FIFO that runs empty stops the motion in the middle of a mark.",
)  # fmt: skip

# GJ6: the machine profile.
PROFILE_SYNTAX = _rule(
    "GJ601", _E, "machine profile is not TOML", "this machine profile is not valid TOML: {reason}",
    "A profile that can't be read would leave the field and the speeds unchecked.",
)  # fmt: skip
PROFILE_UNKNOWN = _rule(
    "GJ602", _E, "unknown entry in the machine profile", "{key} is not an entry of a machine profile{hint}",
    "A misspelt limit is no limit.",
)  # fmt: skip
PROFILE_TYPE = _rule(
    "GJ603", _E, "wrong kind of value in the machine profile", "{key} must be {wanted}, not {found}",
    "A limit that is no number limits nothing.",
)  # fmt: skip
PROFILE_RANGE = _rule(
    "GJ604", _E, "value out of range in the machine profile", "{key} is {value}; it must be {range}",
    "Beyond what the controller can do a limit protects nothing.",
)  # fmt: skip

# The profile's [budget]: a gate for a process.
BUDGET_DURATION = _rule(
    "GJ605", _E, "longer than the budget", "the run takes {value} s; the budget is {limit} s, and it is over here",
    "The machine's time is planned with this limit (machine profile, [budget]).",
)  # fmt: skip
BUDGET_POWER = _rule(
    "GJ606", _E, "power above the budget", "channel {channel} emits {value} {unit}; the budget is {limit} {unit}",
    "More than the process was proved with burns the part (machine profile, [budget]).",
)  # fmt: skip
BUDGET_ENERGY = _rule(
    "GJ607", _E, "energy per mm above the budget",
    "this mark of channel {channel} comes to {value} {unit}; the budget is {limit} {unit}",
    "Where the beam is slow at the same power it burns deeper (machine profile, [budget]).",
)  # fmt: skip
BUDGET_HELD = _rule(
    "GJ608", _E, "power held by a limit longer than the budget",
    "a limit holds the power of channel {channel} for {value} ms; the budget is {limit} ms",
    "Power that is held does not follow: what was proved elsewhere is not what burns here (machine profile, [budget]).",
)  # fmt: skip
BUDGET_ON_ERROR = _rule(
    "GJ609", _E, "light comes too far off",
    "the light of channel {channel} comes {value} um off; the budget is {limit} um",
    "A mark that begins too early or too late does not join the others (machine profile, [budget]).",
)  # fmt: skip

# GJ7: what the controller would say to a call (interpreter).
_CALLS = (
    "GT_SetAxisMode(7,1)\nGT_LaserPowerMode(0,100,0,0)\nGT_LaserOutFrq(10,0)\n"
    "GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},10000,1000,0,1,{0,0,0,0,0,0,0,0}})\nGT_CrdClear(1,0)\n"
    "GT_BufLaserPrfCmd(1,30,0,0)\n"
)
REFUSED = _rule(
    "GJ701", _E, "call refused", "{call} returns {code}: {reason}",
    "The call has no effect, and a program that does not read its return value goes on as if it had.",
    bad=_CALLS + "GT_LaserOutFrq(0,0)\nGT_CrdStart(1,0)\n", good=_CALLS + "GT_LaserOutFrq(20,0)\nGT_CrdStart(1,0)\n",
    section="二.2",
)  # fmt: skip
ACCEPTED_ODD = _rule(
    "GJ702", _W, "accepted, but", "{call}: {reason}",
    "The controller takes the call; what it does is not what the manual describes.",
    bad="GT_SetAxisMode(7,1)\nGT_LaserPowerMode(2,10,0,0)\n", good="GT_LaserPowerMode(2,10,0,0)\n", section="三.1",
)  # fmt: skip
NEVER_STARTED = _rule(
    "GJ703", _E, "stage never started",
    "{count} buffered calls in coordinate system {crd}, FIFO {fifo} are never started: GT_CrdStart is missing",
    "Buffered calls wait in their FIFO until GT_CrdStart, or until another program starts it.",
    bad=_CALLS + "GT_LnXY(1,1000,0,50,2,0,0)\n", good=_CALLS + "GT_LnXY(1,1000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
END_NOT_MET = _rule(
    "GJ704", _W, "end velocity not met",
    "this segment ends at {value} pulse/ms, not at its {wanted}: length and acceleration allow no more",
    "The next segment starts slower than planned, with more light per mm.",
    bad=_CALLS + "GT_LnXY(1,10,0,50,2,50,0)\nGT_LnXY(1,90000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_CALLS + "GT_LnXY(1,10000,0,50,2,50,0)\nGT_LnXY(1,90000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
START_TOO_FAST = _rule(
    "GJ705", _W, "start faster than the segment",
    "this segment starts at {value} pulse/ms, above its velocity {velocity}: it slows down first",
    "It gets less light per mm than planned until it has slowed down.",
    bad=_CALLS + "GT_LnXY(1,10000,0,50,2,50,0)\nGT_LnXY(1,90000,0,20,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_CALLS + "GT_LnXY(1,10000,0,50,2,20,0)\nGT_LnXY(1,90000,0,20,2,0,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
STOPS_HARD = _rule(
    "GJ706", _W, "motion stops at once", "{what} at {value} pulse/ms: the axes stop at once",
    "The mirrors overshoot.",
    bad=_CALLS + "GT_LnXY(1,10000,0,50,2,50,0)\nGT_CrdStart(1,0)\n",
    good=_CALLS + "GT_LnXY(1,10000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
SHARP_CORNER = _rule(
    "GJ707", _W, "corner at speed",
    "the corner after this segment is taken at {value} pulse/ms: the velocity vector changes by {jump} "
    "pulse/ms, more than {limit} (look-ahead TIME x ACC)",
    "The mirrors overshoot at the corner.",
    bad=_CALLS + "GT_LnXY(1,10000,0,50,2,50,0)\nGT_LnXY(1,10000,90000,50,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_CALLS + "GT_LnXY(1,10000,0,50,2,0,0)\nGT_LnXY(1,10000,90000,50,2,0,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
LISTING_LEFT_ON = _rule(
    "GJ708", _W, "light left on", "these calls end with the laser of channel {channel} on; nothing switches it off",
    "The laser burns on at the last point.",
    bad=_CALLS + "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_CALLS + "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,2,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
LISTING_FIELD = _rule(
    "GJ709", _W, "outside the field", "{axis} {value} mm is outside the machine's field {low}..{high} mm",
    "The controller does not know the field: it goes there.",
    bad=_CALLS + "GT_LnXY(1,200000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_CALLS + "GT_LnXY(1,100000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
ASSUMED_CRD = _rule(
    "GJ710", _N, "coordinate system assumed",
    "no GT_SetCrdPrm: the coordinate system is taken as built elsewhere, at the origin",
    "The manual's routines leave it out, too; where the axes stand is not known.",
    bad="GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n", good=_CALLS + "GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
CRDS_AT_ONCE = _rule(
    "GJ711", _E, "two coordinate systems at once",
    "coordinate systems 1 and 2 would move at the same time: gusjob can't interpret that",
    "Two paths at once have no single order of light and motion.",
    bad="GT_BufDelay(1,10,0)\nGT_BufDelay(2,10,0)\nGT_CrdStart(3,0)\n", good="GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
LIT_UNPOWERED = _rule(
    "GJ712", _W, "light without a power",
    "the laser of channel {channel} is on, but no power was set: it is taken as the lowest that the mode allows",
    "The controller keeps whatever power the last program has left.",
    bad=_CALLS.replace("GT_BufLaserPrfCmd(1,30,0,0)\n", "")
    + "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,2,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n",
    good=_CALLS + "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,2,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
TOO_LONG = _rule(
    "GJ713", _E, "too long to be interpreted",
    "this run would take {duration} ms, that is {ticks} ticks; gusjob interprets up to {limit}. This is "
    "its longest segment",
    "A velocity of almost nothing makes a segment of years.",
    bad=_CALLS + "GT_LnXY(1,1000000000,0,0.0001,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_CALLS + "GT_LnXY(1,1000,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
LISTING_ARC = _rule(
    "GJ714", _W, "arc that does not close", "{reason}; it is taken as the nearest arc that does",
    "What the controller makes of such an arc is not documented.",
    bad=_CALLS + "GT_ArcXYC(1,1000,0,300,0,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
    good=_CALLS + "GT_ArcXYC(1,1000,0,500,0,0,50,2,0,0)\nGT_CrdStart(1,0)\n",
)  # fmt: skip
LISTING_NO_MODE = _rule(
    "GJ715", _W, "light without a mode",
    "the laser of channel {channel} is on, but GT_LaserPowerMode was never called: duty 0..100 % is assumed",
    "The channel keeps the mode of whatever ran before.",
    bad="GT_BufLaserPrfCmd(1,30,0,0)\nGT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,2,0,0)\nGT_BufLaserOff(1,0,0)\n"
    "GT_CrdStart(1,0)\n",
    good=_CALLS + "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,2,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n",
    section="二.2",
)  # fmt: skip
FIFO_FULL = _rule(
    "GJ716", _N, "FIFO is full before the start",
    "this is buffered call {count} before GT_CrdStart, and a FIFO holds {slots}: it would return 1 and be lost, unless "
    "the program starts and sends it again",
    "A program that takes a full FIFO for an error, or does not look, drops the rest of the path.",
)  # fmt: skip

# GJ8: sky writing.
_SKY = "SKYWRITE MODE 2 TIMELAG 250us\n"
_MARK = "LASER ON\nLINE X 5\nLASER OFF\n"
_SLOW = (
    "LASER MODE DUTY CARRIER 10kHz\nLASER POWER 30\nVEL 500\nACC 1000000\n"
    "SKYWRITE MODE 2 TIMELAG 470us NPOST 48\nLASER ON\nLINE X 5\nLASER OFF\nJUMP X 0\n"
)
SKY_LIT = _rule(
    "GJ801", _E, "light that sky writing can't place",
    "SKYWRITE with the laser of channel {channel} on: a mark is sky-written as a whole or not at all",
    "Sky writing begins and ends a mark at speed; light that is on at rest can't be moved along the path.",
    bad=_HEAD + "LASER POWER 30\nLASER ON\nLINE X 5\n" + _SKY + "LINE X 9\nLASER OFF\n",
    good=_HEAD + _SKY + "LASER POWER 30\nLASER ON\nLINE X 5\nLINE X 9\nLASER OFF\n", section="RTC5",
)  # fmt: skip
SKY_NOW = _also(
    SKY_LIT, "LASER ON NOW under SKYWRITE: it lights the run-in; write LASER ON, which goes along with the path"
)
SKY_STAGE = _also(
    SKY_LIT,
    "{word} ends the motion under SKYWRITE while the laser of channel {channel} is on: put LASER OFF before it",
)
SKY_DWELL = _also(
    SKY_LIT,
    "DWELL with the laser of channel {channel} on under SKYWRITE, which begins and ends every mark at speed: put it "
    "between SKYWRITE OFF and SKYWRITE",
)
SKY_END = _rule(
    "GJ802", _E, "END under sky writing",
    "END under SKYWRITE: a mark is run at its VEL from its first to its last point",
    "An end velocity of its own would brake inside the mark, which sky writing is there to prevent.",
    bad=_HEAD + _SKY + "LASER POWER 30\nLASER ON\nLINE X 5 END 0\nLASER OFF\n",
    good=_HEAD + _SKY + "LASER POWER 30\n" + _MARK, section="RTC5",
)  # fmt: skip
SKY_SHIFT = _rule(
    "GJ803", _W, "SHIFT before the run-in",
    "SHIFT {value} us would switch the light on {early} us before the run-in is at mark speed: it is taken as {least} "
    "us; raise NPREV",
    "Light on the way up to speed burns deeper, in front of the mark.",
    bad=_HEAD + "SKYWRITE MODE 2 TIMELAG 100us SHIFT -400us NPREV 11\nLASER POWER 30\n" + _MARK,
    good=_HEAD + "SKYWRITE MODE 2 TIMELAG 100us SHIFT -100us NPREV 11\nLASER POWER 30\n" + _MARK, section="RTC5",
)  # fmt: skip
SKY_SHIFT_RAMP = _also(
    SKY_SHIFT,
    "SHIFT {value} us switches the light on {early} us before the beam, TIMELAG behind, is in its run-in at mark "
    "speed: raise NPREV to {least}",
)
SKY_STEP = _rule(
    "GJ804", _E, "SHIFT between its steps", "SHIFT {value} us is no multiple of 0.5 us",
    "LaserOnShift is a whole number of half microseconds.",
    bad=_HEAD + "SKYWRITE MODE 2 TIMELAG 100us SHIFT -0.3us\n",
    good=_HEAD + "SKYWRITE MODE 2 TIMELAG 100us SHIFT -0.5us\n", section="RTC5",
)  # fmt: skip
SKY_OFF = _rule(
    "GJ805", _W, "TIMELAG that switches sky writing off",
    "TIMELAG {value} us is below 1/8 us: sky writing is off; write SKYWRITE OFF if that is meant",
    "The marks have neither run-in nor run-out.",
    bad="SKYWRITE MODE 2 TIMELAG 0.1us\n", good="SKYWRITE OFF\n", section="RTC5",
)  # fmt: skip
SKY_NO_LIMIT = _rule(
    "GJ806", _W, "LIMIT without corners to decide", "LIMIT has no effect in mode {mode}: modes 1 and 2 begin and end "
    "at every corner",
    "Mode 3 may have been meant.",
    bad="SKYWRITE MODE 2 TIMELAG 250us LIMIT 0.8\n", good="SKYWRITE MODE 3 TIMELAG 250us LIMIT 0.8\n",
    section="RTC5",
)  # fmt: skip
SKY_RUN_OUT = _rule(
    "GJ807", _N, "run-out shorter than TIMELAG",
    "the run-out of {run_out} us is over before the light goes off, TIMELAG {timelag} us behind the mark's end: "
    "velocity follow reads the braking; NPOST {least} would cover it",
    "Power that follows the velocity goes down while the beam is still marking its last point.",
    bad=_HEAD + "LASER FOLLOW MIN 5 MAX 45 AT 100mm/s\nSKYWRITE MODE 2 TIMELAG 174us NPREV 11 NPOST 9\n" + _MARK,
    good=_HEAD + "LASER FOLLOW MIN 5 MAX 45 AT 100mm/s\nSKYWRITE MODE 2 TIMELAG 174us NPREV 11 NPOST 18\n" + _MARK,
    section="RTC5",
)  # fmt: skip
SKY_FIELD = _rule(
    "GJ808", _E, "run-in or run-out outside the field",
    "the {what} of this mark reaches {axis} {value} mm, {over} mm outside the machine's field {low}..{high} mm: shift "
    "the mark, or make it shorter with less VEL, more ACC or a smaller {word}",
    "Outside the field the mirrors stand still or the beam hits what stands there.",
    bad=_HEAD + _SKY + "LASER POWER 30\nJUMP X 149\nLASER ON\nLINE X 150\nLASER OFF\n",
    good=_HEAD + _SKY + "LASER POWER 30\nJUMP X 147\nLASER ON\nLINE X 148\nLASER OFF\n", section="RTC5",
)  # fmt: skip
SKY_ROOM = _rule(
    "GJ809", _E, "no motion left for the switch",
    "the light of channel {channel} would have to be switched {what} {early} us {where}: {mend}",
    "A GUS switches between two motions; where there is none the light would come or go at the wrong point.",
    bad=_HEAD + "LASER DELAY ON 50000us OFF 50000us\n" + _SKY + "LASER POWER 30\n" + _MARK,
    good=_HEAD + "LASER DELAY ON 20us OFF 20us\n" + _SKY + "LASER POWER 30\n" + _MARK, section="RTC5",
)  # fmt: skip
SKY_SLOW = _rule(
    "GJ811", _W, "mark that is not at speed at its end",
    "this mark {what} at {value} {speed}, not at its {velocity} {speed}: it has to be slow too near by, at a corner "
    "that LIMIT calls flat or in another VEL; a larger LIMIT begins anew at the corner",
    "The end is burnt deeper, as without sky writing, and the beam is not where TIMELAG has it.",
    bad=_HEAD + "SKYWRITE MODE 3 TIMELAG 250us LIMIT 0.5\nLASER POWER 30\nLASER ON\nLINE X 0.1\nLINE X 0.2 Y 0.1\n"
    "LASER OFF\n",
    good=_HEAD + "SKYWRITE MODE 3 TIMELAG 250us\nLASER POWER 30\nLASER ON\nLINE X 0.1\nLINE X 0.2 Y 0.1\nLASER OFF\n",
    section="RTC5",
)  # fmt: skip
SKY_COARSE = _rule(
    "GJ812", _W, "light switched in slow motion",
    "the light goes {what} where the motion is nearly at rest: a whole pulse there is up to {error} um at mark speed; "
    "raise {word} to {least}",
    "A GUS switches at whole pulses, and the slower the motion, the longer a pulse takes.",
    bad=_SLOW.replace("NPOST 48", "NPOST 0"), good=_SLOW, section="RTC5",
)  # fmt: skip
SKY_LAG = _rule(
    "GJ813", _W, "TIMELAG of another scanner",
    "TIMELAG is {value} us, but the machine's scanner lags {lag} us: marks begin and end {off} us off",
    "TIMELAG is there to make up for just that lag; gusjob tune --skywrite finds it.",
)  # fmt: skip
SKY_DARK = _rule(
    "GJ810", _E, "mark that stays dark",
    "the light of this mark would go off where it comes, or {late} us before: the mark is shorter than SHIFT, or than "
    "a pulse",
    "The mark is not burnt at all, or a point is burnt by the delays alone.",
    bad=_HEAD + "SKYWRITE MODE 2 TIMELAG 100us SHIFT 5000us\nLASER POWER 30\nLASER ON\nLINE X 0.1\nLASER OFF\n",
    good=_HEAD + "SKYWRITE MODE 2 TIMELAG 100us SHIFT 50us\nLASER POWER 30\nLASER ON\nLINE X 0.1\nLASER OFF\n",
    section="RTC5",
)  # fmt: skip

# GJ9: a run on hardware.
NO_LIBRARY = _rule(
    "GJ901", _E, "vendor's library can't be loaded", "can't load the library {library}: {reason}",
    "Without the vendor's library there is no way to the controller. gusjob devices lists what was found.",
)  # fmt: skip
NO_SYMBOLS = _rule(
    "GJ902", _E, "vendor's library lacks calls of this job",
    "the library {library}, taken as --abi {abi}, has no {symbols}{hint}",
    "A job that finds out in its middle that a call is missing stands there with the light on.",
)  # fmt: skip
WRONG_ABI = _rule(
    "GJ903", _E, "library of another ABI",
    "the library {library} is not what --abi {abi} says: {reason}{hint}",
    "Arguments in the wrong place mean other speeds, other powers, or a crash with the light on.",
)  # fmt: skip
CALL_FAILED = _rule(
    "GJ904", _E, "call refused by the controller", "{call} returned {code}: {meaning}; {advice}",
    "What the controller refused it did not do; all that follows would be done wrongly.",
)  # fmt: skip
NO_ANSWER = _rule(
    "GJ905", _E, "call that does not return",
    "{call} has not returned for {seconds} s: the library or the driver hangs; check cable and power, then start the "
    "controller anew",
    "A program that waits for ever can't switch the light off.",
)  # fmt: skip
STARVED = _rule(
    "GJ906", _E, "FIFO ran dry",
    "the FIFO ran dry here and the motion stopped: {rate} calls/s were sent, the segments want more; make them longer "
    "or slower (gusjob check warns of this if the profile has host_calls_per_s)",
    "Where the motion stops with the light on the part is burnt.",
)  # fmt: skip
HALTED = _rule(
    "GJ907", _E, "motion stopped from outside",
    "the motion stopped here with {queued} calls in the FIFO: something stopped the axes (emergency stop, limit "
    "switch, drive alarm, another program); clear the cause, then go on with --resume",
    "What stopped the axes had a reason; going on by itself would ignore it.",
)  # fmt: skip
NO_PROGRESS = _rule(
    "GJ908", _E, "motion that does not go on",
    "{what} for {seconds} s: look whether the axes are enabled and free, then go on with --resume",
    "Light on a head that stands still burns the part.",
)  # fmt: skip
WRONG_END = _rule(
    "GJ909", _E, "head not where the job ends",
    "the motion ended at X {x} Y {y} pulse, not at X {want_x} Y {want_y} pulse: calls were lost, or something moved "
    "the axes; do not trust this part",
    "A part that was marked somewhere else is scrap, and the next one would be too.",
)  # fmt: skip
INTERLOCK = _rule(
    "GJ910", _E, "interlock open",
    "the interlock (GT_GetDi({di_type}), input {input}) reads {found}, the machine profile wants {value}: close the "
    "door or guard, then {again}",
    "Light must not be on while somebody can reach the beam.",
)  # fmt: skip
STOPPED = _rule(
    "GJ911", _E, "run stopped on request", "stopped here by {who}; go on with --resume {journal}{options}",
    "A part that was not finished must not count as done.",
)  # fmt: skip
LIGHT_UNKNOWN = _rule(
    "GJ912", _E, "light may be on",
    "THE LIGHT OF CHANNEL {channel} MAY BE ON: {call} {why}. Use the emergency stop, then look at the machine",
    "Over a link that does not answer nothing can be switched off. That takes an interlock in hardware.",
)  # fmt: skip
MOTION_UNKNOWN = _rule(
    "GJ913", _E, "motion may go on", "the motion may still go on: {why}. Use the emergency stop",
    "Over a link that does not answer nothing can be stopped.",
)  # fmt: skip
NO_JOURNAL = _rule(
    "GJ915", _E, "journal that can't be written", "can't write the journal any more: {reason}; make room, then go on "
    "with --from-line",
    "What is not in the journal can't be gone on with; a run that nobody can go on with is not begun.",
)  # fmt: skip
RAN_ON = _rule(
    "GJ916", _W, "run that was killed",
    "this run was killed: of the last {calls} calls up to here nobody knows whether they were run; they are counted as "
    "if they were",
    "A controller goes on with what is in its FIFO when the program that fed it is gone.",
)  # fmt: skip
TWO_SYSTEMS = _rule(
    "GJ917", _E, "more than one coordinate system or FIFO on hardware",
    "a run on hardware takes calls of one coordinate system and one FIFO; here is {what} behind {first}",
    "Of two queues that fill in turn nobody could say any more what runs when.",
)  # fmt: skip
PLACE_UNKNOWN = _rule(
    "GJ914", _E, "where the job broke is not known",
    "the controller does not know any more where the job broke ({why}); it was last seen here, and up to "
    "{calls} more calls may have run: look at the part, then go on with --from-line N",
    "Going on from a place that is only guessed leaves something out, or burns it twice.",
)  # fmt: skip
