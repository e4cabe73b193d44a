"""GJ1: the words of a job or listing, and the expansion of a job."""

from __future__ import annotations

from gusjob.diagnostics.rules.examples import HEAD
from gusjob.diagnostics.rules.registry import ERROR, NOTE, WARNING, rule, variant

UNEXPECTED = rule(
    "GJ101",
    ERROR,
    title="unexpected word",
    text="{found} is not allowed here; {expected}{hint}",
    why="A skipped word would change what is marked: X1O is not X10.",
    bad=HEAD + "LINE X1O Y20\n",
    good=HEAD + "LINE X10 Y20\n",
)
UNKNOWN_UNIT = variant(UNEXPECTED, text="{found} is not a unit: {units}")
MISSING = variant(UNEXPECTED, text="{words} is missing after {word}")
UNKNOWN_STATEMENT = rule(
    "GJ102",
    ERROR,
    title="unknown statement",
    text="no statement begins with {found}{hint}",
    why="The unknown statement may be the one that switches the laser off.",
    bad=HEAD + "LNE X 10\n",
    good=HEAD + "LINE X 10\n",
)
DUPLICATE_WORD = rule(
    "GJ103",
    ERROR,
    title="duplicate word",
    text="{word} occurs twice in this statement",
    why="It is not clear which of the two values applies.",
    bad=HEAD + "LINE X 10 X 20\n",
    good=HEAD + "LINE X 10 Y 20\n",
)
MISSING_WORD = rule(
    "GJ104",
    ERROR,
    title="missing word",
    text="{statement} needs {word}{hint}",
    why="There is no safe default for this value.",
    bad="LASER MODE DUTY\n",
    good="LASER MODE DUTY CARRIER 10kHz\n",
)
WORD_NOT_ALLOWED = rule(
    "GJ105",
    ERROR,
    title="word not allowed in this statement",
    text="{word} is not allowed in {statement}: {hint}",
    why="The statement has no such setting: the job would not do what is intended.",
    bad=HEAD + "JUMP X 10 VEL 500\n",
    good=HEAD + "JUMPVEL 500\nJUMP X 10\n",
)
NUMBER_TOO_LARGE = rule(
    "GJ106",
    ERROR,
    title="number too large",
    text="{value} is too large: the largest number is {limit}",
    why="Above this limit not every whole number can be represented.",
    bad=HEAD + "LINE X 1e300\n",
    good=HEAD + "LINE X 100\n",
)
NUMBER_TOO_SMALL = rule(
    "GJ158",
    ERROR,
    title="number too small",
    text="{value} is too close to 0: the smallest number is {limit}",
    why="What is divided by such a number has no value.",
    bad=HEAD + "LINE X 1e-300\n",
    good=HEAD + "LINE X 0\n",
)
RESERVED_NAME = rule(
    "GJ108",
    ERROR,
    title="reserved name",
    text="{word} is a keyword and can't be a name: {hint}",
    why="A name that looks like a keyword is easily misread.",
    bad="LET power = 30\n",
    good="LET power_1 = 30\n",
)
UNKNOWN_FUNCTION = rule(
    "GJ109",
    ERROR,
    title="unknown function",
    text="there is no function {word}{hint}",
    why="An expression with an unknown function has no value.",
    bad=HEAD + "LINE X (sine(30))\n",
    good=HEAD + "LINE X (sin(30))\n",
)
OPERAND_COUNT = rule(
    "GJ110",
    ERROR,
    title="wrong number of operands",
    text="{word} takes {wanted}, not {found}",
    why="Too few or too many operands usually mean that another function was intended.",
    bad=HEAD + "LINE X (hypot(3))\n",
    good=HEAD + "LINE X (hypot(3, 4))\n",
)
CALL_SYNTAX = rule(
    "GJ111",
    ERROR,
    title="call can't be read",
    text="this can't be read: {found}",
    why="Only GT_ calls, assignments, declarations and comments are read. What can't be read could change the calls.",
    bad="GT_CrdClear(1,0);\nMOVE GT_CrdStart(1,0);\n",
    good="GT_CrdClear(1,0);\nGT_CrdStart(1,0);\n",
)
CALL_UNKNOWN = rule(
    "GJ112",
    ERROR,
    title="unknown call",
    text="{call} is not a known call{hint}",
    why="An unknown call may switch the laser.",
    bad="GT_BufLaserOnn(1,0,0)\n",
    good="GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n",
)
CALL_ARGUMENTS = rule(
    "GJ113",
    ERROR,
    title="wrong number of arguments",
    text="{call} takes {wanted} arguments ({names}), not {found}",
    why="If an argument is missing, those after it are read as others: a FIFO number becomes a channel number.",
    bad="GT_BufLaserPrfCmd(1)\n",
    good="GT_BufLaserPrfCmd(1,50,0,0)\nGT_CrdStart(1,0)\n",
    section="四.2",
)
CALL_VALUE = rule(
    "GJ114",
    ERROR,
    title="argument can't be read",
    text="{argument} of {call} must be {wanted}, not {found}",
    why="A value that the program computes elsewhere is not known here. Write the number instead.",
    bad="GT_BufDelay(1,pause,0)\n",
    good="GT_BufDelay(1,100,0)\nGT_CrdStart(1,0)\n",
)
CALL_OCTAL = rule(
    "GJ115",
    ERROR,
    title="octal number",
    text="{found} is an octal number in C; its value is {value}: remove the leading zero",
    why="In C, a leading zero makes a number octal: 010 is 8.",
    bad="GT_BufDelay(1,010,0)\n",
    good="GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
)
CALL_IGNORED = rule(
    "GJ116",
    NOTE,
    title="call ignored",
    text="{call} affects neither the laser nor the path and is ignored",
    why="The report does not show the effect of ignored calls.",
    bad="GT_AxisOn(1)\nGT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
    good="GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
)
CONTROL_FLOW = rule(
    "GJ117",
    ERROR,
    title="control flow in a listing",
    text="{what}: gusjob reads straight-line code only; cut the calls out, or run the program with `gusjob record`",
    why="gusjob reads a listing call by call, from the first to the last. Only checks of return codes that end the "
    "program after an error are ignored.",
    bad="while (parts > 0) GT_CrdStart(1,0);\n",
    good="GT_CrdClear(1,0);\nGT_CrdStart(1,0);\n",
)
UNREAD_FUNCTION = rule(
    "GJ118",
    ERROR,
    title="function is not read",
    text="{call}() is not read, so its GT_ calls would be missing: replace it by its calls, or run the program with "
    "`gusjob record`",
    why="A function of the program can make calls that the report does not show. `gusjob record` sees them.",
    bad="StartPosition();\nGT_BufDelay(1,10,0);\nGT_CrdStart(1,0);\n",
    good="GT_BufDelay(1,10,0);\nGT_CrdStart(1,0);\n",
)
WHOLE_PROGRAM = rule(
    "GJ119",
    ERROR,
    title="whole program",
    text="this is a whole program ({kind}), not a listing: run it with `gusjob record`, or cut the calls out",
    why="Which calls a program makes is known when it runs. `gusjob record` runs it without hardware and writes the "
    "calls down.",
    bad="int main(void) {\n    GT_CrdClear(1,0);\n    GT_CrdStart(1,0);\n}\n",
    good="GT_CrdClear(1,0);\nGT_CrdStart(1,0);\n",
)
NO_MODEL = rule(
    "GJ120",
    ERROR,
    title="call can't be simulated",
    text="{call} can't be simulated: {reason}; leave it out if that does not matter",
    why="The report would not show what the call does to the laser or the path.",
    bad="GT_LnXYZ(1,100,0,5,50,1,0,0)\nGT_CrdStart(1,0)\n",
    good="GT_LnXY(1,100,0,50,1,0,0)\nGT_CrdStart(1,0)\n",
    section="sister",
)
UNKNOWN_NAME = rule(
    "GJ121",
    ERROR,
    title="unknown name",
    text="{name} has no value here{hint}",
    why="A statement with an unknown value can't run.",
    bad=HEAD + "LINE X (pitch)\n",
    good=HEAD + "LET pitch = 0.5\nLINE X (pitch)\n",
)
UNIT_MISMATCH = rule(
    "GJ122",
    ERROR,
    title="incompatible units",
    text="{operator} {wants}; here it has {given}",
    why="The sum of a length and a plain number would hide a unit: 2*pitch is correct, pitch+2 is not.",
    bad=HEAD + "LET pitch = 0.5mm\nLINE X (pitch + 2)\n",
    good=HEAD + "LET pitch = 0.5mm\nLINE X (pitch + 2mm)\n",
)
NO_VALUE = rule(
    "GJ123",
    ERROR,
    title="expression without a value",
    text="this expression has no value: the result is {value}",
    why="A division by zero or the root of a negative number has no usable result.",
    bad=HEAD + "LET n = 0\nLINE X (10 / n)\n",
    good=HEAD + "LET n = 2\nLINE X (10 / n)\n",
)
LOOP_COUNT = rule(
    "GJ124",
    ERROR,
    title="number of iterations can't be determined",
    text="{what} {value}: {hint}",
    why="The number of iterations is computed before the first one: a loop that never ends would never switch the "
    "laser off.",
    bad="FOR i FROM 0 TO 10 STEP 0\nDWELL 1\nEND\n",
    good="FOR i FROM 0 TO 10 STEP 1\nDWELL 1\nEND\n",
)
NOT_A_NUMBER = rule(
    "GJ125",
    ERROR,
    title="comparison instead of a number",
    text="{what} needs a number, not a comparison",
    why="A comparison is true or false. It has no length and no power.",
    bad=HEAD + "LINE X (1 < 2)\n",
    good=HEAD + "IF 1 < 2\nLINE X 1\nEND\n",
)
NOT_A_CONDITION = rule(
    "GJ126",
    ERROR,
    title="number instead of a condition",
    text="IF needs a comparison, such as a > 0, not a number",
    why="Which numbers count as true differs between programming languages.",
    bad="LET n = 2\nIF n\nDWELL 1\nEND\n",
    good="LET n = 2\nIF n != 0\nDWELL 1\nEND\n",
)
EXPANSION_TOO_LARGE = rule(
    "GJ127",
    ERROR,
    title="expansion too large",
    text="loops and routines produce more than {limit} {what} here; the machine profile can raise the limit "
    "([expansion] {key})",
    why="A wrong loop bound can produce a job of any length.",
    bad="REPEAT 100000\nREPEAT 100000\nDWELL 1\nEND\nEND\n",
    good="REPEAT 100\nREPEAT 100\nDWELL 1\nEND\nEND\n",
)
EXPANSION_TOO_DEEP = rule(
    "GJ128",
    ERROR,
    title="nesting too deep",
    text="blocks, calls and includes are nested more than {limit} deep here; the machine profile can raise the limit "
    "([expansion] {key})",
    why="A routine that calls itself needs an IF that ends the recursion.",
    bad="DEF f(n)\nCALL f(n - 1)\nEND\nCALL f(3)\n",
    good="DEF f(n)\nDWELL 1\nIF n > 0\nCALL f(n - 1)\nEND\nEND\nCALL f(3)\n",
)
EXPANSION_TOO_SLOW = rule(
    "GJ129",
    ERROR,
    title="expansion too slow",
    text="the expansion takes more than {limit} steps here, in loops that carry a value from one iteration to the "
    "next, in routines that call themselves or in long expressions: compute the values from the loop variable "
    "instead",
    why="Iterations that need the result of the previous one can't be expanded together.",
    bad="LET a = 0\nREPEAT 4000001\nLET a = a + 1\nEND\n",
    good="REPEAT 300000 AS i\nLET a = i + 1\nEND\n",
)
TOO_MANY_SETUPS = rule(
    "GJ130",
    ERROR,
    title="too many setup statements",
    text="loops and routines produce more than {limit} setup statements",
    why="Each setup statement after motion starts a new stage: the machine stops for it.",
    bad="REPEAT 50001\nWAIT\nEND\n",
    good="REPEAT 10\nWAIT\nEND\n",
)
MISSING_END = rule(
    "GJ131",
    ERROR,
    title="block without END",
    text="this {word} has no END",
    why="It is not clear where the block ends.",
    bad="REPEAT 3\nDWELL 1\n",
    good="REPEAT 3\nDWELL 1\nEND\n",
)
UNMATCHED_END = rule(
    "GJ132",
    ERROR,
    title="END or ELSE without a block",
    text="{word} has no block to which it belongs ({begins})",
    why="An extra END closes a block too early.",
    bad="DWELL 1\nEND\n",
    good="REPEAT 1\nDWELL 1\nEND\n",
)
NESTED_DEF = rule(
    "GJ133",
    ERROR,
    title="routine inside a block",
    text="DEF is not allowed inside another block",
    why="A routine is the same for the whole job. It can't depend on an iteration or a condition.",
    bad="REPEAT 2\nDEF f()\nDWELL 1\nEND\nEND\n",
    good="DEF f()\nDWELL 1\nEND\nREPEAT 2\nCALL f()\nEND\n",
)
BLOCKS_TOO_DEEP = rule(
    "GJ134",
    ERROR,
    title="blocks nested too deep",
    text="blocks are nested too deep: the limit is {limit}",
    why="A job of this depth is hard to read. Move the inner blocks into a routine.",
    bad="REPEAT 1\n" * 33 + "END\n" * 33,
    good="REPEAT 1\n" * 3 + "DWELL 1\n" + "END\n" * 3,
)
DUPLICATE_DEF = rule(
    "GJ135",
    ERROR,
    title="routine defined twice",
    text="{name} is already defined",
    why="It is not clear which of the two a CALL means.",
    bad="DEF f()\nEND\nDEF f()\nEND\n",
    good="DEF f()\nEND\nDEF g()\nEND\n",
)
UNKNOWN_ROUTINE = rule(
    "GJ136",
    ERROR,
    title="unknown routine",
    text="there is no routine {name}{hint}",
    why="What the routine should do would be missing from the part.",
    bad="DEF pause(t)\nDWELL (t)\nEND\nCALL paus(3)\n",
    good="DEF pause(t)\nDWELL (t)\nEND\nCALL pause(3)\n",
)
ROUTINE_VALUES = rule(
    "GJ137",
    ERROR,
    title="wrong number of routine values",
    text="{name}{takes} takes {wanted} values, not {found}",
    why="A value of a routine has no default.",
    bad="DEF pause(t)\nDWELL (t)\nEND\nCALL pause()\n",
    good="DEF pause(t)\nDWELL (t)\nEND\nCALL pause(3)\n",
)
BAD_INCLUDE = rule(
    "GJ138",
    ERROR,
    title="file can't be included",
    text='can\'t include "{file}": {reason}',
    why="A job may come from an unknown source, so it can't read files outside its own folder.",
    bad='INCLUDE "../secret.job"\n',
)
FRAME_SCALE = rule(
    "GJ139",
    ERROR,
    title="frame scale not above 0",
    text="SCALE {value} must be above 0",
    why="A scale of 0 maps everything to one point. Instead of a negative scale, write a rotation by 180 degrees.",
    bad=HEAD + "FRAME SCALE 0\nLINE X 1\nEND\n",
    good=HEAD + "FRAME SCALE 2\nLINE X 1\nEND\n",
)
FRAME_SCALE_RANGE = variant(
    FRAME_SCALE, text="the scale of this frame, with that of the frames around it, is {value}; it must be {range}"
)
UNUSED_ROUTINE = rule(
    "GJ141",
    NOTE,
    title="routine never called",
    text="{name} is never called",
    why="The job does not do what the routine was written for.",
    bad="DEF f()\nDWELL 1\nEND\nDWELL 2\n",
    good="DEF f()\nDWELL 1\nEND\nCALL f()\n",
)
UNUSED_NAME = rule(
    "GJ142",
    NOTE,
    title="unused name",
    text="{name} is set here but never used",
    why="An unused name is often a misspelling of another one.",
    bad="LET pause = 5\nDWELL 1\n",
    good="LET pause = 5\nDWELL (pause)\n",
)
LOWERCASE_KEYWORD = rule(
    "GJ143",
    NOTE,
    title="keyword in lower case",
    text="the keyword {word} is in lower case: write {meant}",
    why="The language accepts it, but upper-case keywords and lower-case names make a job easier to read.",
    bad="wait\n",
    good="WAIT\n",
)
INVALID_SUPPRESSION = rule(
    "GJ144",
    WARNING,
    title="allow comment without effect",
    text="this comment does not suppress {code}: {why}",
    why="A comment without effect misleads the reader. It can suppress warnings and notes of its own line, with the "
    "reason after a colon.",
    bad="WAIT\nLET pause = 5 ; allow GJ142\n",
    good="WAIT\nLET pause = 5 ; allow GJ142: read by the next version\n",
)
UNUSED_SUPPRESSION = rule(
    "GJ145",
    WARNING,
    title="unused allow comment",
    text="{code} does not occur on this line: remove its allow comment",
    why="A comment that is no longer needed would hide the next diagnostic of the same rule.",
    bad="DWELL 5 ; allow GJ404: it only warms up\n",
    good="DWELL 5\n",
)
ERROR_CHECKS = rule(
    "GJ146",
    NOTE,
    title="checks of return codes",
    text="ignored checks of return codes (every call is assumed to work): {count}",
    why="The simulation reports the calls that the controller would refuse.",
    bad="rtn = GT_CrdClear(1,0);\nif (rtn) return rtn;\nGT_BufDelay(1,10,0);\nGT_CrdStart(1,0);\n",
    good="rtn = GT_CrdClear(1,0);\nGT_BufDelay(1,10,0);\nGT_CrdStart(1,0);\n",
)
RECODED = rule(
    "GJ147",
    NOTE,
    title="other encoding",
    text="the file is not UTF-8; it is read as {encoding}",
    why="Such characters should occur only in comments and strings; the calls are the same in both encodings.",
    good="GT_CrdClear(1,0)\nGT_CrdStart(1,0)\n",
)
LEADING_CARD = rule(
    "GJ148",
    NOTE,
    title="calls for a card",
    text="the calls are read as those of a library for several cards (abi gts-multi), card {card}",
    why="Such calls have the number of the card before all other arguments. `abi` in the machine profile names the "
    "library.",
    bad="GT_CrdClear(0,1,0)\nGT_BufDelay(0,1,10,0)\nGT_CrdStart(0,1,0)\n",
    good="GT_CrdClear(1,0)\nGT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
    section="sister",
)
EITHER_ABI = rule(
    "GJ149",
    ERROR,
    title="with or without a card number",
    text="all calls can be read with and without a leading card number: set abi under [controller] in the machine "
    "profile",
    why="Read the wrong way, each argument would be taken for another.",
    bad="GT_LnXY(1,1,20000,30,5,1,0)\n",
    good="GT_CrdClear(1,0)\nGT_LnXY(1,1,20000,30,5,0,0)\nGT_CrdStart(1,0)\n",
    section="sister",
)
SEVERAL_CARDS = rule(
    "GJ150",
    ERROR,
    title="calls for several cards",
    text="the calls are for several cards or cores: {cards}; write those of each into a file of its own",
    why="Each card is a controller of its own, with its own lasers and axes.",
    bad="GT_CrdClear(0,1,0)\nGT_CrdClear(1,1,0)\nGT_CrdStart(0,1,0)\n",
    good="GT_CrdClear(0,1,0)\nGT_BufDelay(0,1,10,0)\nGT_CrdStart(0,1,0)\n",
    section="sister",
)
RECORDED_REFUSALS = rule(
    "GJ151",
    NOTE,
    title="calls without effect when recorded",
    text="ignored calls with a return code other than 0, which had no effect: {count}",
    why="The program made them, and the controller refused them.",
    bad="[0] GT_CrdClear(1,0) = 1\n[0.1] GT_BufDelay(1,10,0) = 0\n[0.2] GT_CrdStart(1,0) = 0\n",
    good="[0] GT_CrdClear(1,0) = 0\n[0.1] GT_BufDelay(1,10,0) = 0\n[0.2] GT_CrdStart(1,0) = 0\n",
)
UNKNOWN_FIELD = rule(
    "GJ152",
    ERROR,
    title="unknown field",
    text="TCrdPrm has no field {field}{hint}",
    why="What was meant for another field would be lost.",
    bad="TCrdPrm crd = {0};\ncrd.synVelMx = 500;\nGT_CrdStart(1,0);\n",
    good="TCrdPrm crd = {0};\ncrd.synVelMax = 500;\nGT_CrdStart(1,0);\n",
    section="sister",
)
OUTPUT_CALL = rule(
    "GJ153",
    WARNING,
    title="output is not simulated",
    text="{call} sets an output, which the report does not show: if it switches the laser, the report is wrong; "
    "otherwise leave it out",
    why="gusjob simulates the laser channels only.",
    bad="GT_SetDoBit(12,1,0)\nGT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
    good="GT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n",
    section="sister",
)
NOT_SIMULATED = rule(
    "GJ154",
    WARNING,
    title="recorded call is not simulated",
    text="{call} was recorded but is not simulated: {reason}",
    why="The report shows the calls without this one. In a listing that is not recorded it is an error (GJ120).",
    bad="[0] GT_SetOverride(1,0.5) = 0\n[0.1] GT_BufDelay(1,10,0) = 0\n[0.2] GT_CrdStart(1,0) = 0\n",
    good="[0.1] GT_BufDelay(1,10,0) = 0\n[0.2] GT_CrdStart(1,0) = 0\n",
    section="sister",
)
FUNCTION_OF_VALUES = rule(
    "GJ155",
    WARNING,
    title="function with a result is not read",
    text="{call}() is not read; gusjob assumes that it makes no GT_ calls: if it does, run the program with "
    "`gusjob record`",
    why="Its result is not known either: using it in a call is an error (GJ114).",
    bad="power = ReadPower();\nGT_BufDelay(1,10,0);\nGT_CrdStart(1,0);\n",
    good="GT_BufDelay(1,10,0);\nGT_CrdStart(1,0);\n",
)
RECORDING_CUT = rule(
    "GJ156",
    WARNING,
    title="recording is not complete",
    text="the recording is not complete: calls may be missing after its last line; record it again, and let the "
    "program end, or raise --limit",
    why="The program was killed, still runs, or the listing reached its limit. The report shows only what was "
    "recorded.",
    bad="// recorded by gusjob record, ABI gus, time fast\n[0] GT_BufDelay(1,10,0) = 0\n[0.1] GT_CrdStart(1,0) = 0\n",
    good="// recorded by gusjob record, ABI gus, time fast\n[0] GT_BufDelay(1,10,0) = 0\n[0.1] GT_CrdStart(1,0) = 0\n"
    "// ended with exit code 0\n",
)
NOT_DECIMAL = rule(
    "GJ157",
    ERROR,
    title="number is not decimal",
    text="{found} is not a decimal number{hint}",
    why="Read as two words, Y 0x10 would be Y 0 and X 10.",
    bad=HEAD + "LINE Y 0x10\n",
    good=HEAD + "LINE Y 16\n",
)
OVERRIDE_UNKNOWN = rule(
    "GJ160",
    ERROR,
    title="-D sets no LET",
    text="-D {name}: the job does not set {name} with LET{names}{hint}",
    why="A misspelt name would have no effect, without any message. -D gives another value to the first LET "
    "of a name in the job's own file.",
)
OVERRIDE_IN_INCLUDE = variant(
    OVERRIDE_UNKNOWN, text="-D {name}: this LET is in an included file; -D sets names of the job's own file only"
)
OVERRIDE_IN_ROUTINE = variant(
    OVERRIDE_UNKNOWN, text="-D {name}: this LET is in a DEF, where names are local; -D sets names outside of routines"
)
OVERRIDE_OF_LOOP = variant(
    OVERRIDE_UNKNOWN, text="-D {name}: the loop sets {name} in each iteration; -D sets names of LETs only"
)
OVERRIDE_OF_PARAMETER = variant(
    OVERRIDE_UNKNOWN, text="-D {name}: {name} is a parameter, which CALL sets; -D sets names of LETs only"
)
OVERRIDE_OF_CALLS = variant(OVERRIDE_UNKNOWN, text="-D is for jobs: {what} has no LET")
