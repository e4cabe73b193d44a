"""Documentation of keywords and calls for hovers.

It comes from the tables of forms, calls and ranges and from the language reference. Only the table of ranges by word is
here.
"""

from __future__ import annotations

import re
from functools import cache

from msgspec import Struct

from gusjob.controllers.gus import ranges
from gusjob.controllers.gus.calls import SIGNATURES
from gusjob.controllers.gus.ranges import PowerMode, Range
from gusjob.frontend.parse.forms import CHANNEL_WORD, FORMS, Word
from gusjob.frontend.parse.grammar import JOB_GRAMMAR, grammar_path, keywords
from gusjob.frontend.parse.unread_numbers import EXPECTED_KIND
from gusjob.patterns import lazy_pattern

_POWERS = tuple(ranges.POWER[mode] for mode in (PowerMode.DUTY, PowerMode.FREQUENCY, PowerMode.ANALOG))
_POWERS_NOW = tuple(ranges.POWER_NOW[mode] for mode in (PowerMode.DUTY, PowerMode.FREQUENCY, PowerMode.ANALOG))
_FOLLOW = tuple(ranges.FOLLOW[mode] for mode in (PowerMode.DUTY, PowerMode.FREQUENCY, PowerMode.ANALOG))
_DISTANCE = tuple(ranges.DISTANCE_LIMIT[mode] for mode in (PowerMode.DUTY, PowerMode.FREQUENCY, PowerMode.ANALOG))
_Words = dict[str, tuple[Range, ...]]
_XY: _Words = {"X": (ranges.COORDINATE_PULSE,), "Y": (ranges.COORDINATE_PULSE,)}
_SPEEDS: _Words = {"VEL": (ranges.VELOCITY,), "ACC": (ranges.ACCELERATION,)}
_END: _Words = {"END": (ranges.END_VELOCITY,)}
_DUTY: _Words = {
    "CARRIER": (ranges.CARRIER_KHZ,),
    "MIN": (ranges.MODE_LIMIT_PCT,),
    "MAX": (ranges.MODE_LIMIT_PCT,),
}

RANGES: dict[str, _Words] = {
    "crd": {"": (ranges.CRD,), "FIFO": (ranges.FIFO,)},
    "channel": {"": (ranges.CHANNEL,)},
    "VEL": {"": (ranges.VELOCITY,)},
    "ACC": {"": (ranges.ACCELERATION,)},
    "JUMPVEL": {"": (ranges.VELOCITY,)},
    "JUMPACC": {"": (ranges.ACCELERATION,)},
    "line": {**_XY, **_SPEEDS, **_END},
    "jump": _XY,
    "arc": {**_XY, **_SPEEDS, **_END, "R": (ranges.RADIUS_PULSE,)},
    "dwell": {"": (ranges.DWELL_MS,)},
    "lookahead": {"TIME": (ranges.LOOKAHEAD_TIME_MS,), "ACC": (ranges.ACCELERATION,)},
    "skywrite": {
        "MODE": (ranges.SKYWRITE_MODE,),
        "TIMELAG": (ranges.TIMELAG_US,),
        "SHIFT": (ranges.SHIFT_US,),
        "NPREV": (ranges.RUN_STEPS,),
        "NPOST": (ranges.RUN_STEPS,),
        "LIMIT": (ranges.CORNER_LIMIT,),
    },
    "DUTY": _DUTY,
    "DUTY2": _DUTY,
    "FREQUENCY": {
        "WIDTH": (ranges.PULSE_WIDTH_US,),
        "MIN": (ranges.MODE_LIMIT_KHZ,),
        "MAX": (ranges.MODE_LIMIT_KHZ,),
    },
    "ANALOG": {"MIN": (ranges.MODE_LIMIT_V,), "MAX": (ranges.MODE_LIMIT_V,)},
    "laser_delay": {"ON": (ranges.SWITCH_DELAY_US,), "OFF": (ranges.SWITCH_DELAY_US,)},
    "laser_standby": {"FREQ": (ranges.STANDBY_KHZ,), "DUTY": (ranges.STANDBY_PCT,)},
    "laser_prevolt": {"": (ranges.PREVOLTAGE_V,)},
    "laser_fpk": {
        "WIDTH": (ranges.FPK_WIDTH_US,),
        "GAP": (ranges.FPK_GAP_US,),
        "OFFDELAY": (ranges.FPK_OFF_DELAY_US,),
    },
    "laser_distance": {"RATIO": (ranges.DISTANCE_RATIO,), "MIN": _DISTANCE, "MAX": _DISTANCE},
    "laser_power": {"": _POWERS, "NOW": _POWERS_NOW},
    "laser_follow": {"RATIO": (ranges.FOLLOW_RATIO,), "MIN": _FOLLOW, "MAX": _FOLLOW},
}
"""Ranges by form and word ('' for the statement's number itself); a test compares them with the checks."""

_SPAN = lazy_pattern(r"`([^`]+)`")
_CELL = lazy_pattern(r"(?<!\\)\|")
_WORD = lazy_pattern(r"[A-Za-z_]+")


class StatementReference(Struct, frozen=True):
    """A row of the reference's tables of statements. `cells`: by the column's head."""

    spellings: tuple[str, ...]
    cells: dict[str, str]


@cache
def _reference() -> str:
    path = grammar_path("README.md")
    return path.read_text(encoding="utf-8") if path.is_file() else ""


@cache
def _statements() -> tuple[StatementReference, ...]:
    """Return all rows of the tables of statements."""
    found: list[StatementReference] = []
    heads: list[str] = []
    for line in _reference().splitlines():
        if not line.startswith("|"):
            heads = []
            continue
        cells = [cell.strip().replace("\\|", "|") for cell in _CELL.split(line)[1:-1]]
        if not heads:
            heads = cells
        elif heads[0] == "statement" and (spellings := _SPAN.findall(cells[0])):
            found.append(StatementReference(tuple(spellings), dict(zip(heads, cells, strict=False))))
    return tuple(found)


@cache
def _paragraphs() -> tuple[str, ...]:
    text = re.sub(r"```.*?```", "", _reference(), flags=re.DOTALL)
    return tuple(" ".join(part.split()) for part in text.split("\n\n") if not part.lstrip().startswith(("|", "#")))


def _starts_with(spelling: str, name: str) -> bool:
    """Return whether a spelling begins with a statement's name: 'LASER POWER p NOW' with 'LASER POWER'."""
    return re.match(rf"\[?{re.escape(name)}(?!\w)", spelling) is not None


def form_of(line: str) -> str:
    """Return the form of a line, which may be incomplete, from its first words; '' for none."""
    words = " ".join(re.findall(r"[A-Za-z_]+2?", line.upper()))
    if _starts_with(words, "LASER OFF"):
        return "laser_switch"
    fits = [key for key, form in FORMS.items() if _starts_with(words, form.name)]
    return max(fits, key=lambda key: len(FORMS[key].name), default="")


def statement_text(form: str, line: str) -> str:
    """Return the language reference's description of a statement (markdown)."""
    name = FORMS[form].name
    written = set(_WORD.findall(line.upper()))
    statements = [e for e in _statements() if any(_starts_with(spelling, name) for spelling in e.spellings)]
    matching = [e for e in statements if any(s.endswith("NOW") for s in e.spellings) == ("NOW" in written)]
    parts = []
    for statement in matching or statements:
        lines = [f"**{', '.join(f'`{s}`' for s in statement.spellings)}**", statement.cells.get("meaning", "")]
        lines += [
            f"{head}: {statement.cells[head]}" for head in ("range", "default", "calls") if statement.cells.get(head)
        ]
        parts.append("\n\n".join(lines))
    return "\n\n".join(parts) or _first_paragraph(name)


def _first_paragraph(name: str) -> str:
    """Return the first paragraph of the reference that shows a statement."""
    for paragraph in _paragraphs():
        if any(_starts_with(spelling, name) for spelling in _SPAN.findall(paragraph)):
            return paragraph
    return ""


def word_text(form: str, word: str) -> str:
    """Describe the value of a word: kind and units, range, section of the manual."""
    known = CHANNEL_WORD if word == "CHANNEL" and form.startswith(("laser", "DUTY", "FREQ", "ANA")) else None
    kind = known or FORMS[form].words.get(word)
    allowed = (ranges.CHANNEL,) if known else RANGES.get(form, {}).get(word, ())
    head = f"**{FORMS[form].name} {word}**".replace(" **", "**")
    parts = ([head] if kind or allowed else []) + ([_kind_description(kind)] if kind else [])
    return "\n\n".join([*parts, *(range_text(one) for one in allowed)])


def _kind_description(word: Word) -> str:
    return EXPECTED_KIND[word.kind] + (", in ms without a unit" if word.ms else "")


def range_text(one: Range) -> str:
    """Describe a range with its section and note, as the reference's table does."""
    marks = [text for text, applies in (("whole", one.whole), ("ends warn", one.ends_tolerated)) if applies]
    section = f" (manual, {one.section})" if not one.section.isascii() else f" ({one.section})"
    return f"{one.name}: {one}{', ' if marks else ''}{', '.join(marks)}{section}{f'. {one.note}' if one.note else ''}"


def keyword_text(line: str, word: str) -> str:
    """Describe a keyword in a line (markdown); '' if nothing is known."""
    form, word = form_of(line), word.upper()
    if not form or word not in keywords(JOB_GRAMMAR):
        return ""
    heads = FORMS[form].name.split()
    is_head = word in heads or (form == "laser_switch" and word in ("ON", "OFF", "NOW"))
    if is_head and word not in FORMS[form].words:
        number = word_text(form, "NOW" if "NOW" in line.upper().split() else "")
        return "\n\n".join(filter(None, (statement_text(form, line), number)))
    return word_text(form, word) or statement_text(form, line)


def function_text(name: str) -> str:
    """Return the reference's description of a function."""
    found = re.search(rf"`{re.escape(name)}\([^`]*\)`(?: \([^)]*\))?", _reference())
    return found[0] if found else ""


def call_text(name: str) -> str:
    """Describe a GT_ call: prototype, section and ranges."""
    signature = SIGNATURES.get(name)
    if signature is None:
        return ""
    ranges = [f"- `{arg.name}` {arg.range}" for arg in signature.args if arg.range is not None]
    section = signature.section
    source = f"manual, {section}" if not section.isascii() else section
    buffered = "buffered, " if signature.buffered is not None else ""
    return "\n".join([f"```c\n{signature.prototype};\n```", f"{buffered}{source}", "", *ranges])
