"""Hovers of keywords: their ranges are those of the checks."""

from __future__ import annotations

import re

import pytest

from gusjob.controllers.gus.ranges import Range
from gusjob.frontend.parse.forms import FORMS
from gusjob.lsp.reference import RANGES, form_of, keyword_text


def limits_of() -> list[tuple[str, str, Range]]:
    return [(form, word, one) for form, words in RANGES.items() for word, ranges in words.items() for one in ranges]


SAMPLES = {
    "crd": "CRD {} FIFO {FIFO}", "channel": "CHANNEL {}", "VEL": "VEL {}", "ACC": "ACC {}", "JUMPVEL": "JUMPVEL {}",
    "JUMPACC": "JUMPACC {}", "line": "LINE X {X} Y {Y} VEL {VEL} ACC {ACC} END {END}", "jump": "JUMP X {X} Y {Y}",
    "arc": "ARC CW X {X} Y {Y} R {R} VEL {VEL} ACC {ACC} END {END}", "dwell": "DWELL {}",
    "lookahead": "LOOKAHEAD TIME {TIME} ACC {ACC}",
    "skywrite": "SKYWRITE MODE {MODE} TIMELAG {TIMELAG} SHIFT {SHIFT} NPREV {NPREV} NPOST {NPOST} LIMIT {LIMIT}",
    "DUTY": "LASER MODE DUTY CARRIER {CARRIER} MIN {MIN} MAX {MAX}",
    "DUTY2": "LASER MODE DUTY2 CARRIER {CARRIER} MIN {MIN} MAX {MAX}",
    "FREQUENCY": "LASER MODE FREQUENCY WIDTH {WIDTH} MIN {MIN} MAX {MAX}",
    "ANALOG": "LASER MODE ANALOG MIN {MIN} MAX {MAX}", "laser_delay": "LASER DELAY ON {ON} OFF {OFF}",
    "laser_standby": "LASER STANDBY FREQ {FREQ} DUTY {DUTY}", "laser_prevolt": "LASER PREVOLT {}",
    "laser_fpk": "LASER FPK WIDTH {WIDTH} GAP {GAP} OFFDELAY {OFFDELAY}",
    "laser_distance": "LASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 1 MIN {MIN} MAX {MAX}",
    "laser_power": "LASER POWER {}", "laser_follow": "LASER FOLLOW RATIO {RATIO} MIN {MIN} MAX {MAX}",
}  # fmt: skip


GOOD = {
    "": "1", "FIFO": "0", "X": "1000", "Y": "1000", "VEL": "10", "ACC": "1", "END": "0", "R": "9000", "TIME": "5",
    "MODE": "2", "TIMELAG": "100", "SHIFT": "0", "NPREV": "20", "NPOST": "20", "LIMIT": "0.5", "CARRIER": "20",
    "MIN": "1", "MAX": "9", "WIDTH": "20", "ON": "1", "OFF": "1", "FREQ": "5", "DUTY": "5", "GAP": "5", "OFFDELAY": "5",
    "RATIO": "1",
}  # fmt: skip


MODES = {"%": "DUTY CARRIER 20", "kHz": "FREQUENCY WIDTH 0", "V": "ANALOG"}


@pytest.mark.parametrize(("form", "word", "limit"), limits_of(), ids=str)
def test_a_hover_names_the_range_that_the_check_knows(form: str, word: str, limit: Range) -> None:
    """A value far outside is refused with the very range that the hover shows."""
    from gusjob.config.machine import Machine
    from gusjob.frontend import check_text, read_job
    from gusjob.lint import check

    now = word == "NOW"
    value = "1e9" if limit.high < 1e9 else "2e9" if limit.high < 2e9 else "-5" if limit.low >= 0 else None
    if value is None or (form == "laser_distance" and word == "RATIO"):
        assert limit.high == float("inf")
        return
    field = (-1e7, 1e7)  # Larger than the range of a call: otherwise the field is what is left.
    machine = Machine(field_x_mm=field, field_y_mm=field)
    words = {**GOOD, ("" if now else word): value}
    sample = re.sub(r"\{(\w*)\}", lambda m: words[m[1]], SAMPLES[form]) + (" NOW" if now else "")
    mode = "ANALOG" if form in ("laser_prevolt", "ANALOG") else "DUTY CARRIER 20"
    if form in ("laser_power", "laser_follow", "laser_distance"):
        mode = {"%": "DUTY CARRIER 20", "kHz": "FREQUENCY WIDTH 1", "V": "ANALOG", "": "DUTY CARRIER 20"}[limit.unit]
    head = "UNITS PULSE\nVEL 100\nACC 5\n" + ("" if form in MODES or form.isupper() else f"LASER MODE {mode}\n")
    source, _ = check_text(f"{head}{sample}\nLASER POWER 5\nLASER ON\nLINE X 5000\nLASER OFF\n".encode(), "a.job")
    assert source is not None
    job, diagnostics = read_job(source, machine)
    reply = [
        str(f.fields.get("range")) for f in [*diagnostics, *check(job, machine)] if f.rule.code in ("GJ201", "GJ504")
    ]
    assert str(limit) in reply or (limit.unit.startswith("pulse/ms") and reply), (sample, reply)


def test_every_word_has_a_hover() -> None:
    for form in FORMS.values():
        assert keyword_text(form.name, form.name.split()[0]), form.name
        for word in form.words:
            if word:
                assert keyword_text(f"{form.name} {word} 1", word), (form.name, word)
    assert keyword_text("LINE X10Y20", "Y")
    assert "二.2" in keyword_text("LASER DELAY ON 5 OFF 9", "ON")
    assert "not in DUTY2" in keyword_text("LASER FPK WIDTH 5", "FPK")
    assert form_of("LASER OFF NOW") == form_of("laser on") == "laser_switch"
