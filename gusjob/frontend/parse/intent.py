"""The statement that a line with an error was meant to be, from its first words.

Such a line still counts for the checks: what it may change is not known after it (ir.effects), its END ends a block,
and the names in it may be those that another line reads.
"""

from __future__ import annotations

import re
from functools import reduce
from operator import or_

from msgspec import Struct

from gusjob.frontend.parse.statement import RowOp, Statement
from gusjob.i18n.spelling import nearest
from gusjob.ir.effects import EVERYTHING, FRAME_EFFECTS, OF_LASER, POSITION, UNCLEAR, StateEffect
from gusjob.patterns import lazy_pattern

_HEADS = {
    **{word: word.lower() for word in ("UNITS", "COORDS", "CRD", "CHANNEL", "LINE", "JUMP", "ARC", "DWELL", "WAIT")},
    **{word: word.lower() for word in ("LOOKAHEAD", "SKYWRITE", "LET", "REPEAT", "FOR", "IF", "ELSE", "END", "DEF")},
    **{word: word.lower() for word in ("CALL", "FRAME", "INCLUDE", "LASER")},
    **{word: word for word in ("VEL", "ACC", "JUMPVEL", "JUMPACC")},
}
"""Form of a statement by its first word."""
_LASER_HEADS = {
    "MODE": "laser_mode",
    **dict.fromkeys(("DUTY", "DUTY2", "FREQUENCY", "ANALOG"), "laser_mode"),
    "DELAY": "laser_delay",
    "STANDBY": "laser_standby",
    "PREVOLT": "laser_prevolt",
    "FPK": "laser_fpk",
    "DISTANCE": "laser_distance",
    "POWER": "laser_power",
    "FOLLOW": "laser_follow",
    **dict.fromkeys(("ON", "OFF"), "laser_switch"),
}
"""Form of a LASER statement by its second word, which also tells it where LASER is missing."""
_EFFECTS = {
    "units": StateEffect.UNITS,
    "coords": StateEffect.COORDS,
    "channel": StateEffect.CHANNEL,
    "VEL": StateEffect.VEL,
    "ACC": StateEffect.ACC,
    "JUMPVEL": StateEffect.JUMPVEL,
    "JUMPACC": StateEffect.JUMPACC,
    "line": POSITION,
    "jump": POSITION,
    "arc": POSITION,
    "skywrite": StateEffect.SKY,
    **dict.fromkeys(("laser_mode", "DUTY", "DUTY2", "FREQUENCY", "ANALOG"), StateEffect.MODE | StateEffect.MODE_KIND),
    "laser_distance": StateEffect.DISTANCE,
    "laser_power": StateEffect.POWER,
    "laser_follow": StateEffect.POWER,
    "laser_switch": StateEffect.SWITCH,
    "laser": OF_LASER,
    "frame": FRAME_EFFECTS,
    **dict.fromkeys(("call", ""), UNCLEAR),
    "include": EVERYTHING,
}
"""Effects of a statement by its form; one that is not here has none."""
_EFFECTS_OF_ROWS = {
    **dict.fromkeys((RowOp.LINE, RowOp.JUMP), POSITION),
    **dict.fromkeys((RowOp.ARC_CENTRE_CW, RowOp.ARC_CENTRE_CCW, RowOp.ARC_RADIUS_CW, RowOp.ARC_RADIUS_CCW), POSITION),
    **dict.fromkeys((RowOp.POWER, RowOp.FOLLOW), StateEffect.POWER),
    **dict.fromkeys((RowOp.ON, RowOp.OFF), StateEffect.SWITCH),
    RowOp.CHANNEL: _EFFECTS["channel"],
    RowOp.FRAME: _EFFECTS["frame"],
    RowOp.VEL: StateEffect.VEL,
    RowOp.ACC: StateEffect.ACC,
    RowOp.JUMPVEL: StateEffect.JUMPVEL,
    RowOp.JUMPACC: StateEffect.JUMPACC,
}
_MAY_DEFINE = ("let", "for", "repeat", "def", "include", "")
"""Forms whose names may be those that other lines read."""
COMMENT = "comment"
"""Form of a comment of another language."""
ANY_NAME = ""
"""Among names that may be set: any name may be."""
_AS = lazy_pattern(r"\bAS?\b", re.IGNORECASE | re.ASCII)
_WORD = lazy_pattern(r"[A-Za-z_]+")
_NAME = lazy_pattern(r"[A-Za-z_]\w*")
_OWN_CHANNEL = lazy_pattern(r"\bCHANNEL\s*=?\s*([01])\b", re.IGNORECASE | re.ASCII)
_SPEED_WORDS = (
    (lazy_pattern(r"\b_?V", re.IGNORECASE | re.ASCII), StateEffect.VEL),
    (lazy_pattern(r"\b_?A", re.IGNORECASE | re.ASCII), StateEffect.ACC),
)
_MAX_READ = 200
"""Characters of a line that are read to find its statement."""


class LineIntent(Struct, frozen=True, kw_only=True):
    """The probable statement of a line.

    `form`: its form, 'laser' where only LASER is clear, '' where nothing is; `guessed`: the first word is misspelt.
    `channel`: the CHANNEL at its end, -1 if it may be any. `names`: names that it may set, with ANY_NAME where they
    can't be told.
    """

    form: str
    guessed: bool
    effects: StateEffect
    channel: int
    names: frozenset[str]


def intent_of(code: str) -> LineIntent:
    """Find the statement that a line (without its comment) was meant to be."""
    code = code[:_MAX_READ]
    form, guessed = _form_of([word.upper() for word in _WORD.findall(code)[:2]])
    effects = _EFFECTS.get(form, StateEffect.NONE)
    foreign = None
    if guessed:
        from gusjob.frontend.parse.foreign import foreign_of  # Start-up time: most jobs have no such line.

        foreign = foreign_of(code)
    if foreign is not None:
        form = foreign.forms[0] if foreign.forms else COMMENT
        effects = StateEffect(reduce(or_, (int(_EFFECTS.get(one, StateEffect.NONE)) for one in foreign.forms), 0))
    if form in ("line", "arc"):
        for word, effect in _SPEED_WORDS:
            effects |= effect if word.search(code.lstrip()[4:]) else StateEffect.NONE
    own = _OWN_CHANNEL.search(code) if form.startswith("laser") else None
    names = set(_NAME.findall(code)) if form in _MAY_DEFINE else set()
    if form in ("for", "include") or (form == "repeat" and _AS.search(code)):
        names.add(ANY_NAME)
    channel = int(own[1]) if own else -1
    return LineIntent(form=form, guessed=guessed, effects=effects, channel=channel, names=frozenset(names))


def effects_of(op: RowOp, statement: Statement | None) -> StateEffect:
    """Effects of a row that has no value; `statement`: of a setup row."""
    form_effects = StateEffect.NONE if statement is None else _EFFECTS.get(statement.form, StateEffect.NONE)
    return form_effects if op is RowOp.SETUP else _EFFECTS_OF_ROWS.get(op, StateEffect.NONE)


def setup_effects(statement: Statement) -> StateEffect:
    """Effects of a setup statement."""
    return _EFFECTS.get(statement.form, StateEffect.NONE)


def _form_of(words: list[str]) -> tuple[str, bool]:
    """The form by the first two words of a line, and whether the first one is misspelt."""
    if not words:
        return "", True
    first = words[0]
    if first in _LASER_HEADS:
        return _LASER_HEADS[first], True
    head = first if first in _HEADS else nearest(first, _HEADS)
    if head != "LASER":
        return _HEADS.get(head, ""), head != first
    second = words[1] if len(words) > 1 else ""
    kind = second if second in _LASER_HEADS else nearest(second, _LASER_HEADS)
    return _LASER_HEADS.get(kind, "laser"), head != first
