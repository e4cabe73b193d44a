"""Statements of other languages: G-code, and words that laser programs often have. What to write instead.

A hint says what a line was probably meant to be, with its own numbers. Whether light and path would be the same is not
known: in G-code it depends on the controller whether G1 marks, what S means and where a coordinate system lies.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from msgspec import Struct

from gusjob.i18n.phrases import Phrase, number
from gusjob.patterns import lazy_pattern

_MAX_READ = 200
"""Characters of a line that are read."""
_COMMENT = lazy_pattern(r"#\s*(?P<text>.*)|\((?P<inner>[^()]*)\)|(?P<tape>%)")
_LINE_NUMBER = lazy_pattern(r"N\d+\s*(?=\S)", re.IGNORECASE | re.ASCII)
_REMARK = lazy_pattern(r"\([^()]*\)")
_WORD = lazy_pattern(r"([A-Z])\s*=?\s*([-+]?(?:\d+\.?\d*|\.\d+))(?!E[-+]?\d)\s*", re.IGNORECASE | re.ASCII)
"""No exponent: 1E3 is one number, not the two words X1 E3."""
_GCODE = lazy_pattern(f"(?:{_WORD.pattern})+", re.IGNORECASE | re.ASCII)
_VALUE = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?"
_AXIS = lazy_pattern(rf"\b([XYRWHIJ])\s*=?\s*({_VALUE})", re.IGNORECASE | re.ASCII)
_QUANTITY = lazy_pattern(rf"\s*=?\s*({_VALUE})\s*([a-zA-Z%][a-zA-Z/%0-9]*)?\s*$", re.ASCII)
_ASSIGNMENT = lazy_pattern(r"(?:(?:SET|VAR|CONST|DIM)\s+)?([A-Za-z_]\w*)\s*=\s*([^=].*)", re.IGNORECASE | re.ASCII)


class Foreign(Struct, frozen=True, kw_only=True):
    """A statement of another language. `forms`: of the statements that it was meant to be; `meant`: what to write."""

    forms: tuple[str, ...]
    meant: str


def comment_of(code: str) -> str | None:
    """A line that is a comment in another language (`# a`, `(a)`, `%`) as a comment of a job, None for others."""
    found = _COMMENT.fullmatch(code.strip())
    if found is None:
        return None
    indent = code[: len(code) - len(code.lstrip())]
    return f"{indent}; {found['text'] or found['inner'] or found['tape'] or ''}".rstrip()


def foreign_of(code: str) -> Foreign | None:
    """What a line (without its comment) is in another language, None if it is none that is known."""
    code = code.strip()[:_MAX_READ]
    comment = comment_of(code)
    if comment is not None:
        return Foreign(forms=(), meant=comment[:60])
    code = _LINE_NUMBER.sub("", code, count=1)
    bare = _REMARK.sub("", code).strip()
    if "=" not in bare and _GCODE.fullmatch(bare):
        return _gcode([(letter.upper(), value) for letter, value in _WORD.findall(bare)])
    head = re.match(r"[A-Za-z]+", code)
    if head is not None and (known := _WORDS.get(head[0].upper())):
        return known(code[head.end() :])
    assigned = _ASSIGNMENT.fullmatch(code)
    if assigned is not None:
        return Foreign(forms=("let",), meant=f"LET {assigned[1]} = {assigned[2].strip()}"[:60])
    return None


# G-code.

_LEFT_OUT = Phrase("nothing: leave the line out")
_NOTHING = Foreign(forms=("wait",), meant=_LEFT_OUT)
_INCHES = ("G", 20.0)
_SCALE = Phrase("LASER ON, and LASER POWER with a unit: the scale of S is not known")


def _gcode(words: list[tuple[str, str]]) -> Foreign | None:
    codes = [(letter.upper(), float(value)) for letter, value in words if letter in "GM"]
    # F0 is no velocity, and changes none.
    values = {letter: value for letter, value in words if letter not in "GM" and (letter != "F" or float(value))}
    if not codes:
        return _without_code(values)
    if _INCHES in codes:
        return _OTHER_G[20]  # No number of the line is one that can be written.
    # What is said first is done last: controllers switch the laser and set modes before they move.
    codes.sort(key=lambda code: (code[0] == "G", code[0] == "G" and code[1] in _MOTIONS))
    moves = codes[-1][0] == "G" and codes[-1][1] in _MOTIONS
    known = [_of_code(letter, code, values, moves=moves) for letter, code in codes]
    some = [one for one in known if one is not None and one is not _NOTHING]
    if not some:
        return _NOTHING if _NOTHING in known else Foreign(forms=("",), meant=Phrase("a statement of the job language"))
    return _in_order(some)


def _in_order(several: list[Foreign]) -> Foreign:
    """One after the other."""
    meant = several[-1].meant
    for before in reversed(several[:-1]):
        meant = Phrase("{first}, then {then}", first=before.meant, then=meant)
    return Foreign(forms=tuple(form for one in several for form in one.forms), meant=meant)


def _of_code(letter: str, code: float, values: dict[str, str], *, moves: bool) -> Foreign | None:
    """What one code is, None if that is not known. `moves`: there is a motion in its line, S belongs to that."""
    if letter == "M":
        return _m_code(code, {} if moves else values)
    return _MOTIONS[code](values) if code in _MOTIONS else _OTHER_G.get(code)


def _without_code(values: dict[str, str]) -> Foreign | None:
    if set(values) == {"F"}:
        return Foreign(forms=("VEL",), meant=_feed(values["F"]))
    if set(values) == {"S"}:
        meant = Phrase("LASER POWER with a unit, such as LASER POWER 50%: the scale of S is not known")
        return Foreign(forms=("laser_power",), meant=meant)
    if set(values) == {"F", "S"}:
        return _in_order([one for letter in "FS" if (one := _without_code({letter: values[letter]}))])
    if {"X", "Y"} & values.keys():
        meant = Phrase("{line} or {jump}", line=_move("LINE", values), jump=_jump(values))
        return Foreign(forms=_mark_forms("line", values), meant=meant)
    return None


def _m_code(code: float, values: dict[str, str]) -> Foreign:
    if code in (3, 4):
        if "S" in values:
            return Foreign(forms=("laser_switch", "laser_power"), meant=_SCALE)
        return Foreign(forms=("laser_switch",), meant="LASER ON")
    if code == 5:
        return Foreign(forms=("laser_switch",), meant="LASER OFF")
    return _NOTHING


def _feed(per_min: str) -> str:
    """VEL for an F, which is in mm/min."""
    per_s = float(per_min) / 60
    return f"VEL {number(per_s)}mm/s" if round(per_s, 4) == per_s else f"VEL {per_min}mm/min"


def _words(values: dict[str, str], letters: str) -> str:
    return " ".join(f"{letter} {values[letter].lstrip('+')}" for letter in letters if letter in values)


def _move(head: str, values: dict[str, str], letters: str = "XY") -> str:
    parts = [head, _words(values, letters), _feed(values["F"]) if "F" in values else ""]
    return " ".join(part for part in parts if part)


def _jump(values: dict[str, str]) -> str:
    return f"JUMP {_words(values, 'XY')}"


def _rapid(values: dict[str, str]) -> Foreign:
    if not {"X", "Y"} & values.keys():
        return _NOTHING
    return Foreign(forms=("jump",), meant=_jump(values))


def _linear(values: dict[str, str]) -> Foreign:
    if not {"X", "Y"} & values.keys():
        return _without_code({letter: values[letter] for letter in "FS" if letter in values}) or _NOTHING
    return _mark("line", values, _move("LINE", values))


def _arc(direction: str) -> Callable[[dict[str, str]], Foreign]:
    def arc(values: dict[str, str]) -> Foreign:
        return _mark("arc", values, _move(f"ARC {direction}", values, "XYR" if "R" in values else "XYIJ"))

    return arc


def _mark(form: str, values: dict[str, str], meant: str) -> Foreign:
    """A motion that may have an F and an S."""
    if "S" in values:
        meant = Phrase("{line}, and LASER POWER before it: the scale of S is not known", line=meant)
    return Foreign(forms=_mark_forms(form, values), meant=meant)


def _mark_forms(form: str, values: dict[str, str]) -> tuple[str, ...]:
    return (form, *(one for letter, one in (("F", "VEL"), ("S", "laser_power")) if letter in values))


def _pause(values: dict[str, str]) -> Foreign:
    seconds = next((values[letter] for letter in "SXU" if letter in values), None)
    if seconds is not None:
        return Foreign(forms=("dwell",), meant=f"DWELL {seconds}s")
    time = values.get("P")
    if time is None:
        return Foreign(forms=("dwell",), meant=Phrase("DWELL and a time, such as DWELL 5ms"))
    meant = Phrase("DWELL {time}ms or DWELL {time}s: the unit of P depends on the controller", time=time)
    return Foreign(forms=("dwell",), meant=meant)


_MOTIONS: dict[float, Callable[[dict[str, str]], Foreign]] = {
    0: _rapid,
    1: _linear,
    2: _arc("CW"),
    3: _arc("CCW"),
    4: _pause,
}
_OTHER_G: dict[float, Foreign] = {
    20: Foreign(forms=("units",), meant=Phrase("all numbers in mm: there are no inches (1 inch is 25.4 mm)")),
    21: Foreign(forms=("units",), meant="UNITS MM"),
    28: Foreign(forms=("jump",), meant="JUMP X 0 Y 0"),
    90: Foreign(forms=("coords",), meant="COORDS ABS"),
    91: Foreign(forms=("coords",), meant="COORDS REL"),
    **dict.fromkeys((17, 40, 49, 50, 54, 61, 64, 80, 94), _NOTHING),
}


# Words.


def _with_unit(statement: str, unit: str, form: str) -> Callable[[str], Foreign]:
    """A statement with one number, in a unit if it has none."""

    def quantity(rest: str) -> Foreign:
        found = _QUANTITY.fullmatch(rest)
        shown = f"{found[1]}{found[2] or unit}" if found else rest.strip().lstrip("=").strip()[:40]
        return Foreign(forms=(form,), meant=f"{statement} {shown}".strip())

    return quantity


def _with_rest(statement: str, form: str) -> Callable[[str], Foreign]:
    return lambda rest: Foreign(forms=(form,), meant=f"{statement} {rest.strip()}".strip()[:60])


def _while(_rest: str) -> Foreign:
    return Foreign(
        forms=("repeat",),
        meant=Phrase("REPEAT with a number of iterations: there are no loops with a condition"),
    )


def _move_or_mark(rest: str) -> Foreign:
    values = _axes(rest)
    line, jump = _move("LINE", values) if values else "LINE", _jump(values).strip()
    meant = Phrase("{jump} (laser off) or {line} (laser unchanged)", jump=jump, line=line)
    return Foreign(forms=("line",), meant=meant)


def _axes(rest: str) -> dict[str, str]:
    return {letter.upper(): value for letter, value in _AXIS.findall(rest)}


def _circle(rest: str) -> Foreign:
    values = _axes(rest)
    if not {"X", "Y", "R"} <= values.keys():
        meant: str = Phrase(
            "JUMP to a point of the circle, LASER ON, ARC CCW I i J j (its centre relative to that point), LASER OFF"
        )
        return Foreign(forms=("arc",), meant=meant)
    x, y, r = (float(values[letter]) for letter in "XYR")
    jump, arc = f"JUMP X {number(x + r)} Y {number(y)}", f"ARC CCW I {number(-r)} J 0"
    return Foreign(forms=("arc",), meant=Phrase("{first}, LASER ON, {then} and LASER OFF", first=jump, then=arc))


def _rectangle(rest: str) -> Foreign:
    values = _axes(rest)
    if not {"X", "Y", "W", "H"} <= values.keys():
        meant: str = Phrase(
            "JUMP to a corner, LASER ON, a LINE to each of the other corners and back to the first, and LASER OFF"
        )
        return Foreign(forms=("line",), meant=meant)
    x, y, w, h = (float(values[letter]) for letter in "XYWH")
    jump = f"JUMP X {number(x)} Y {number(y)}"
    lines = f"LINE X {number(x + w)}, LINE Y {number(y + h)}, LINE X {number(x)}, LINE Y {number(y)}"
    return Foreign(forms=("line",), meant=Phrase("{first}, LASER ON, {then} and LASER OFF", first=jump, then=lines))


def _polyline(_rest: str) -> Foreign:
    meant = Phrase("JUMP to the first point, LASER ON, a LINE to each other point, and LASER OFF")
    return Foreign(forms=("line",), meant=meant)


def _end(_rest: str) -> Foreign:
    return Foreign(forms=("end",), meant="END")


_WORDS: dict[str, Callable[[str], Foreign]] = {
    **dict.fromkeys(
        ("SPEED", "VELOCITY", "FEED", "FEEDRATE", "MARKSPEED", "MARKVEL"), _with_unit("VEL", "mm/s", "VEL")
    ),
    "JUMPSPEED": _with_unit("JUMPVEL", "mm/s", "JUMPVEL"),
    **dict.fromkeys(("ACCEL", "ACCELERATION"), _with_unit("ACC", "mm/s2", "ACC")),
    "POWER": _with_unit("LASER POWER", "%", "laser_power"),
    **dict.fromkeys(("PAUSE", "DELAY", "WAITMS", "SLEEP"), _with_unit("DWELL", "ms", "dwell")),
    **dict.fromkeys(("FREQ", "FREQUENCY"), _with_unit("LASER MODE DUTY CARRIER", "kHz", "laser_mode")),
    "PULSE": _with_unit("LASER MODE FREQUENCY WIDTH", "us", "laser_mode"),
    **dict.fromkeys(("MARK", "LINETO", "DRAW", "CUT"), _with_rest("LINE", "line")),
    **dict.fromkeys(("JUMPTO", "RAPID"), _with_rest("JUMP", "jump")),
    **dict.fromkeys(("MOVE", "MOVETO", "GOTO"), _move_or_mark),
    "CIRCLE": _circle,
    **dict.fromkeys(("RECT", "RECTANGLE", "SQUARE"), _rectangle),
    **dict.fromkeys(("POLYLINE", "POLYGON"), _polyline),
    "LOOP": _with_rest("REPEAT", "repeat"),
    "WHILE": _while,
    **dict.fromkeys(("NEXT", "ENDIF", "ENDFOR", "ENDREPEAT", "ENDLOOP", "ENDWHILE", "WEND", "ENDDEF"), _end),
    **dict.fromkeys(("SUB", "PROC", "FUNCTION"), _with_rest("DEF", "def")),
}
"""By first word, what to make of the rest of the line."""
