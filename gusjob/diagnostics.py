"""User faults as values: spans, rules, diagnostics. Texts are templates with named fields, in one registry."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any


class Severity(Enum):
    """What a diagnostic means for the exit code: an error fails, a warning fails with --strict, a note never."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """A place in a text: lines and columns from 1, in characters; `end_column` is the first column behind.

    `path` is '' in the text that a diagnostic is about, else the file that it includes.
    """

    line: int
    column: int = 1
    end_line: int = 0
    end_column: int = 0
    path: str = ""


NOWHERE = Span(line=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """One thing that can be wrong. `code` is stable; `text` is a template whose fields a diagnostic fills in."""

    code: str
    severity: Severity
    title: str
    text: str
    section: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Remark:
    """Another place that matters for a fault. `text` is a template of REMARKS."""

    text: str
    span: Span
    fields: dict[str, Any] = field(default_factory=dict)

    @property
    def message(self) -> str:
        """The text with the fields filled in."""
        return _filled(self.text, self.fields)


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostic:
    """One fault found: a rule, the fields of its text, and where.

    `path`: the text that it is about; `span.path`, where it is set, the file in which the place is. `count`: in how
    many rounds and calls of the same statement. `remarks`: other places, the nearest first.
    """

    rule: Rule
    span: Span
    fields: dict[str, Any] = field(default_factory=dict)
    path: str = ""
    count: int = 1
    remarks: tuple[Remark, ...] = ()

    @property
    def message(self) -> str:
        """The rule's text with the fields filled in."""
        return _filled(self.rule.text, self.fields)

    @property
    def file(self) -> str:
        """The file in which the place is."""
        return self.span.path or self.path

    @property
    def severity(self) -> Severity:
        """The rule's severity."""
        return self.rule.severity


def _filled(text: str, fields: dict[str, Any]) -> str:
    shown = {k: number(v) if isinstance(v, float) else v for k, v in fields.items()}
    return text.format_map(shown).replace("  ", " ")  # A number without a unit leaves two blanks.


def number(value: float) -> str:
    """A number as people read it: no trailing .0, at most ten significant digits."""
    if value != value or value in (float("inf"), float("-inf")):
        return str(value)
    return f"{value:.0f}" if value == int(value) and abs(value) < 1e15 else f"{value:.10g}"


def printable(text: str) -> str:
    """A user's text without control characters: a job must not steer the terminal that shows it."""
    return "".join(c if c.isprintable() else " " if c == "\t" else "�" for c in text)


def has_errors(diagnostics: Iterable[Diagnostic]) -> bool:
    """Whether any of them is an error."""
    return any(d.severity is Severity.ERROR for d in diagnostics)


RULES: dict[str, Rule] = {}
"""Every rule by its code."""


def _rule(code: str, severity: Severity, title: str, text: str, section: str = "") -> Rule:
    if code in RULES:
        raise ValueError(f"rule {code} stands twice")
    RULES[code] = Rule(code=code, severity=severity, title=title, text=text, section=section)
    return RULES[code]


VARIANTS: list[Rule] = []
"""Rules with another text for another cause of the same fault."""


def _also(rule: Rule, text: str) -> Rule:
    VARIANTS.append(replace(rule, text=text))
    return VARIANTS[-1]


_E, _W, _N = Severity.ERROR, Severity.WARNING, Severity.NOTE

# GJ0: the file as such.
UNREADABLE = _rule("GJ001", _E, "file can't be read", "can't read this file: {reason}")
NOT_TEXT = _rule("GJ002", _E, "file is not text", "this is not UTF-8 text: {reason}")
TOO_LARGE = _rule("GJ003", _E, "file is too large", "this file has {size} MB; gusjob reads up to {limit} MB")
EMPTY = _rule("GJ004", _W, "nothing in the file", "this file has no {what}: nothing would happen")
MORE = _rule("GJ005", _N, "more of the same", "{count} more of {code} are not listed; the first {shown} are")
NO_END = _rule("GJ006", _E, "line is too long", "this line has {size} characters; a statement has at most {limit}")

# GJ1: words.
UNEXPECTED = _rule("GJ101", _E, "unexpected word", "{found} does not belong here; {expected}{hint}")
UNKNOWN_STATEMENT = _rule("GJ102", _E, "unknown statement", "no statement begins with {found}{hint}")
TWICE = _rule("GJ103", _E, "word given twice", "{word} stands twice in this statement")
MISSING = _rule("GJ104", _E, "word missing", "{statement} needs {word}{hint}")
FOREIGN = _rule("GJ105", _E, "word of another form", "{word} does not belong to {statement}: {hint}")
TOO_BIG = _rule("GJ106", _E, "number can't be held", "{value} is too large: numbers go up to {limit}")
LATER = _rule(
    "GJ107", _E, "statement of a later version", "{word} belongs to the job language, but this version can't run it yet"
)
RESERVED = _rule("GJ108", _E, "name is taken", "{word} is a word of the language and can't be a name: {hint}")
NO_FUNCTION = _rule("GJ109", _E, "unknown function", "there is no function {word}{hint}")
ARITY = _rule("GJ110", _E, "wrong number of operands", "{word} takes {wanted}, not {found}")
UNKNOWN_NAME = _rule("GJ121", _E, "unknown name", "{name} has no value here{hint}")
MISMATCH = _rule("GJ122", _E, "kinds that do not fit", "{operator} {wants}; here it has {given}")
NO_VALUE = _rule("GJ123", _E, "expression without a value", "this has no value: it comes to {value}")
COUNT = _rule("GJ124", _E, "loop that can't be counted", "{what} {value}: {hint}")
NOT_A_NUMBER = _rule("GJ125", _E, "comparison in place of a number", "{what} needs a number, not a comparison")
NOT_A_CONDITION = _rule(
    "GJ126", _E, "number in place of a condition", "IF needs a comparison, such as a > 0, not a number"
)
TOO_MANY = _rule(
    "GJ127",
    _E,
    "too much to carry out",
    "loops and routines make more than {limit} {what} here: a machine profile may allow more ([expansion] {key})",
)
TOO_SLOW = _rule(
    "GJ129",
    _E,
    "too much to carry out one by one",
    "more than {limit} statements are carried out one by one, in loops that carry a value from round to round: "
    "let the value hang on the loop's variable instead",
)
TOO_MANY_SETUPS = _rule(
    "GJ130", _E, "too many setup statements", "loops and routines make more than {limit} setup statements"
)
TOO_DEEP = _rule(
    "GJ128",
    _E,
    "too deep",
    "blocks, calls and includes stand more than {limit} deep inside each other here: a machine profile may allow more "
    "([expansion] {key})",
)
UNCLOSED = _rule("GJ131", _E, "block without END", "this {word} has no END")
STRAY = _rule(
    "GJ132", _E, "END or ELSE without a block", "{word} stands here without a block that it could belong to ({begins})"
)
DEF_INSIDE = _rule("GJ133", _E, "routine inside a block", "DEF stands in the open, not inside another block")
NESTED = _rule("GJ134", _E, "blocks too deep", "blocks stand at most {limit} deep inside each other")
DEF_TWICE = _rule("GJ135", _E, "routine defined twice", "{name} is defined already, in {where}")
NO_ROUTINE = _rule("GJ136", _E, "unknown routine", "there is no routine {name}{hint}")
CALL_VALUES = _rule("GJ137", _E, "wrong number of values", "{name}{takes} takes {wanted} values, not {found}")
INCLUDE = _rule("GJ138", _E, "file can't be included", 'can\'t include "{file}": {reason}')
FRAME_SCALE = _rule("GJ139", _E, "frame without a size", "SCALE {value} must be above 0")
FRAME_ARC = _rule(
    "GJ140",
    _E,
    "arc bent by a frame",
    "a turned FRAME makes an ellipse of an ARC in pulses, since the axes have different pulses per mm: write it in mm",
)
CALL_SYNTAX = _rule(
    "GJ111", _E, "call can't be read", "this is no GT_ call, array or comment that gusjob reads: {found}"
)
CALL_UNKNOWN = _rule("GJ112", _E, "unknown call", "{call} is not a call that gusjob knows{hint}")
CALL_ARGUMENTS = _rule(
    "GJ113", _E, "wrong number of arguments", "{call} takes {wanted} arguments ({names}), not {found}"
)
CALL_VALUE = _rule("GJ114", _E, "argument can't be read", "{argument} of {call} must be {wanted}, not {found}")
CALL_OCTAL = _rule(
    "GJ115", _E, "octal number", "{found} is an octal number in C, worth {value}: write it without the zero"
)
CALL_IGNORED = _rule("GJ116", _N, "line passed over", "{call} says nothing to the laser or the path; it is passed over")

# GJ2: values.
OUT_OF_RANGE = _rule("GJ201", _E, "value out of range", "{what} {value} {unit} is outside {range}{hint}")
ON_OPEN_END = _rule(
    "GJ202",
    _W,
    "value on an excluded end",
    "{what} {value} {unit} is on an end of {range}, which the manual excludes (though its own example uses one)",
    "四.2",
)
WRONG_UNIT = _rule("GJ203", _E, "unit of the wrong kind", "{what} is {wanted}, but {unit} is {kind}{hint}")
NOT_WHOLE = _rule(
    "GJ204",
    _E,
    "not a whole number",
    "{what} {value} {unit} must be whole: the call's C type carries no fraction{hint}",
)
MIN_ABOVE_MAX = _rule("GJ205", _E, "MIN not below MAX", "{what}: MIN {low} must be below MAX {high}")
POWER_CLAMPED = _rule(
    "GJ206",
    _W,
    "power outside the mode's limits",
    "{what} {value} {unit} is outside the mode's {low}..{high} {unit}: the controller clamps it",
    "二.2",
)
PULSE_TOO_WIDE = _rule(
    "GJ207",
    _E,
    "laser pulse against its period",
    "at {value} kHz a laser pulse of {width} us stands at {duty} % of the period, outside {range}",
    "二.2",
)
CARRIER_TOO_FAST = _rule(
    "GJ208",
    _E,
    "faster than the laser",
    "{what} {value} kHz is above this laser's highest response frequency, {limit} kHz (machine profile)",
    "二.2",
)
SATURATES = _rule(
    "GJ209",
    _W,
    "following saturates",
    "at the programmed velocity following asks for {value} {unit} (velocity {velocity} pulse/ms), above "
    "its MAX {high} {unit}",
    "四.2",
)

# GJ3: modes and order.
NO_MODE = _rule(
    "GJ301", _E, "power before a mode", "{word} stands before any LASER MODE for channel {channel}: its unit is unknown"
)
WRONG_MODE = _rule(
    "GJ302",
    _E,
    "not in this mode",
    "{word} is for {wanted}; channel {channel} is in {mode} mode",
    "二.2",
)
DISTANCE_NEEDS_MODE = _rule(
    "GJ303",
    _E,
    "distance follow before its mode",
    "LASER DISTANCE stands before any LASER MODE for channel {channel}: its unit is unknown",
    "五.2",
)
NEW_STAGE = _rule(
    "GJ304",
    _N,
    "a new stage begins",
    "{word} is set at rest: motion stops here and a new stage begins",
    "二.2",
)
OFF_BELOW_ON = _rule(
    "GJ306",
    _W,
    "off delay below on delay",
    "off delay {off} us is shorter than on delay {on} us; it should usually be the longer one",
    "三.2",
)
CRD_LATE = _rule(
    "GJ307",
    _E,
    "coordinate system after motion",
    "CRD stands after the first motion or laser statement of the path: put it before",
)
DISTANCE_STALE = _rule(
    "GJ310",
    _E,
    "distance follow of another mode",
    "the limits of LASER DISTANCE in line {distance_line} are in {unit}, this mode is in {mode_unit}: "
    "set LASER DISTANCE again here, or OFF",
    "五.2",
)
LASER_UNKNOWN = _rule(
    "GJ309",
    _E,
    "channel used without a mode",
    "channel {channel} is switched on here, but no LASER MODE was given for it",
)

# GJ4: light.
LEFT_ON = _rule(
    "GJ401", _E, "light left on", "the job ends with the laser of channel {channel} on: add LASER OFF{hint}"
)
JUMP_LIT = _rule(
    "GJ402",
    _E,
    "jump with light",
    "JUMP with the laser of channel {channel} on: put LASER OFF before it",
)
NO_POWER = _rule(
    "GJ403",
    _E,
    "light without a power",
    "the laser of channel {channel} is on here, but no power was set since its LASER MODE",
)

# GJ5: motion.
NO_VELOCITY = _rule("GJ501", _E, "no velocity", "{word} needs a velocity: write VEL before it")
NO_ACCELERATION = _rule("GJ502", _E, "no acceleration", "{word} needs an acceleration: write ACC before it")
OUTSIDE_FIELD = _rule(
    "GJ503", _E, "outside the field", "{axis} {value} mm is outside the machine's field {low}..{high} mm{hint}"
)
TOO_FAST = _rule("GJ504", _E, "too fast", "{what} {value} {unit} is above the machine's {limit} {unit}")
BAD_ARC = _rule("GJ505", _E, "arc that does not close", "{reason}")
ARC_OFF = _also(
    BAD_ARC,
    "the end is {end} mm from the centre, the start {start} mm: they must be the same within {limit} mm",
)
ARC_SHORT = _also(
    BAD_ARC, "the radius {value} mm is too small: the end is {chord} mm away, R must be at least {least} mm"
)
END_UNREACHABLE = _rule(
    "GJ506",
    _E,
    "END can't be reached",
    "END {value} pulse/ms can't be reached: length and acceleration here and behind allow {high} pulse/ms",
)
END_ABOVE_VEL = _rule(
    "GJ507", _E, "END above VEL", "END {value} pulse/ms is above this segment's VEL {velocity} pulse/ms"
)
ARC_TOO_FAST = _rule(
    "GJ508",
    _W,
    "arc too fast",
    "VEL {velocity} pulse/ms on a radius of {radius} pulse needs {value} pulse/ms2, above the machine's "
    "{limit}: the planner slows it down",
)
END_AT_STOP = _rule(
    "GJ510",
    _W,
    "END where motion stops",
    "motion stops behind this segment, at once from END {value} pulse/ms",
)
FOLLOW_SCALES = _rule(
    "GJ509",
    _E,
    "following in mm with unequal axes",
    "velocity follow in mm needs the same pulses per mm on X and Y; write it under UNITS PULSE",
)

# GJ6: the machine profile.
PROFILE_SYNTAX = _rule("GJ601", _E, "machine profile is not TOML", "this machine profile is not valid TOML: {reason}")
PROFILE_UNKNOWN = _rule(
    "GJ602", _E, "unknown entry in the machine profile", "{key} is not an entry of a machine profile{hint}"
)
PROFILE_TYPE = _rule("GJ603", _E, "wrong kind of value in the machine profile", "{key} must be {wanted}, not {found}")
PROFILE_RANGE = _rule("GJ604", _E, "value out of range in the machine profile", "{key} is {value}; it must be {range}")

# GJ7: what the controller would say to a call (interpreter).
REFUSED = _rule("GJ701", _E, "call refused", "{call} returns {code}: {reason}")
ACCEPTED_ODD = _rule("GJ702", _W, "accepted, but", "{call}: {reason}")
NEVER_STARTED = _rule(
    "GJ703",
    _E,
    "stage never started",
    "{count} buffered calls in coordinate system {crd}, FIFO {fifo} are never started: GT_CrdStart is missing",
)
END_NOT_MET = _rule(
    "GJ704",
    _W,
    "end velocity not met",
    "this segment ends at {value} pulse/ms, not at its {wanted}: length and acceleration allow no more",
)
START_TOO_FAST = _rule(
    "GJ705",
    _W,
    "start faster than the segment",
    "this segment starts at {value} pulse/ms, above its velocity {velocity}: it slows down first",
)
STOPS_HARD = _rule("GJ706", _W, "motion stops at once", "{what} at {value} pulse/ms: the axes stop at once")
SHARP_CORNER = _rule(
    "GJ707",
    _W,
    "corner at speed",
    "the corner after this segment is taken at {value} pulse/ms: the velocity vector changes by {jump} "
    "pulse/ms, more than {limit} (look-ahead TIME x ACC)",
)
LISTING_LEFT_ON = _rule(
    "GJ708", _W, "light left on", "these calls end with the laser of channel {channel} on; nothing switches it off"
)
LISTING_FIELD = _rule(
    "GJ709", _W, "outside the field", "{axis} {value} mm is outside the machine's field {low}..{high} mm"
)
ASSUMED_CRD = _rule(
    "GJ710",
    _N,
    "coordinate system assumed",
    "no GT_SetCrdPrm: the coordinate system is taken as built elsewhere, at the origin",
)
CRDS_AT_ONCE = _rule(
    "GJ711",
    _E,
    "two coordinate systems at once",
    "coordinate systems 1 and 2 would move at the same time: gusjob can't interpret that",
)
LIT_UNPOWERED = _rule(
    "GJ712",
    _W,
    "light without a power",
    "the laser of channel {channel} is on, but no power was set: it is taken as the lowest that the mode allows",
)
LISTING_ARC = _rule("GJ714", _W, "arc that does not close", "{reason}; it is taken as the nearest arc that does")
LISTING_NO_MODE = _rule(
    "GJ715",
    _W,
    "light without a mode",
    "the laser of channel {channel} is on, but GT_LaserPowerMode was never called: duty 0..100 % is assumed",
)
TOO_LONG = _rule(
    "GJ713",
    _E,
    "too long to be interpreted",
    "this run would take {duration} ms, that is {ticks} ticks; gusjob interprets up to {limit}. This is "
    "its longest segment",
)


# What is said of other places.
CALLED = "called here{values}"
ROUND = "in the round where {values}"
INCLUDED = "included here"
SET_HERE = "{name} is set here"
MODE_HERE = "the mode is set here: {mode}"
ON_HERE = "the laser is switched on here"
FIRST_HERE = "the first one is here"
REMARKS = (CALLED, ROUND, INCLUDED, SET_HERE, MODE_HERE, ON_HERE, FIRST_HERE)
"""Every text of a Remark."""


MAX_PER_RULE = 1000
"""So many faults of one rule are listed; the rest is counted."""


@dataclass(slots=True)
class Collector:
    """Gathers faults of one text; of each rule it lists so many and counts the rest."""

    path: str
    found: list[Diagnostic] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    listed: dict[str, int] = field(default_factory=dict)

    def room(self, rule: Rule) -> int:
        """How many more faults of a rule will be listed."""
        return MAX_PER_RULE - self.listed.get(rule.code, 0)

    def add(
        self, rule: Rule, span: Span, fields: dict[str, Any], count: int = 1, remarks: tuple[Remark, ...] = ()
    ) -> None:
        """One fault, perhaps of many rounds."""
        if self.room(rule):
            self.found.append(
                Diagnostic(rule=rule, span=span, fields=fields, path=self.path, count=count, remarks=remarks)
            )
            self.listed[rule.code] = self.listed.get(rule.code, 0) + 1
        self.uncounted(rule, 1)

    def again(self, index: int, count: int) -> None:
        """The fault at an index of `found` was met so many times more."""
        self.found[index] = replace(self.found[index], count=self.found[index].count + count)

    def uncounted(self, rule: Rule, more: int) -> None:
        """Faults that were found and are not worth making, since they would not be listed."""
        self.counts[rule.code] = self.counts.get(rule.code, 0) + more

    def done(self) -> list[Diagnostic]:
        """All that are listed, and for each rule how many more there are."""
        more = [
            Diagnostic(
                rule=MORE,
                span=NOWHERE,
                fields={"count": count - MAX_PER_RULE, "code": code, "shown": MAX_PER_RULE},
                path=self.path,
            )
            for code, count in self.counts.items()
            if count > MAX_PER_RULE
        ]
        return [*self.found, *more]
