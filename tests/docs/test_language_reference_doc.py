"""grammar/README.md: generated tables equal the code, every example runs."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from support.tools import ROOT, calls_of, stream_in

from gusjob.controllers.gus.calls import SIGNATURES
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.gus.ranges import CONTRADICTIONS, TABLE, Range
from gusjob.diagnostics.model import Severity
from gusjob.diagnostics.rules import RULES
from gusjob.pipeline import examine_file

REFERENCE = ROOT / "grammar" / "README.md"


def table(head: list[str], rows: list[list[str]]) -> str:
    """A markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def ranges() -> str:
    def words(limit: Range) -> str:
        marks = (("whole", limit.whole), ("ends warn", limit.ends_tolerated))
        return ", ".join(text for text, is_so in marks if is_so)

    rows = [[r.name, str(r), words(r), r.section, r.note] for r in TABLE]
    return table(["what", "range", "", "section", "note"], rows)


def contradictions() -> str:
    return table(["section", "M", "here"], [list(row) for row in CONTRADICTIONS])


def calls() -> str:
    rows = [
        [f"`{s.name}({', '.join(a.name for a in s.args)})`", "buffered" if s.buffered is not None else "", s.section]
        for s in SIGNATURES.values()
    ]
    return table(["call", "", "section"], rows)


def rules() -> str:
    rows = [[r.code, r.severity.value, r.title, r.why, r.section] for r in RULES.values()]
    return table(["code", "severity", "what", "reason", "section"], rows)


TABLES: dict[str, Callable[[], str]] = {
    "ranges": ranges,
    "contradictions": contradictions,
    "calls": calls,
    "rules": rules,
}


def test_tables_equal_the_code(rewrite: bool) -> None:
    text = REFERENCE.read_text(encoding="utf-8")
    fresh = text
    for name, make in TABLES.items():
        pattern = re.compile(rf"(<!-- table: {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        assert pattern.search(fresh)
        made = make()
        fresh = pattern.sub(lambda m, made=made: m[1] + made + m[2], fresh)  # type: ignore[misc]
    if rewrite:
        REFERENCE.write_text(fresh, encoding="utf-8", newline="\n")
    else:
        assert text == fresh, "run pytest --rewrite"


def examples(kind: str) -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", REFERENCE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("example", examples("job"))
def test_examples_check_clean_and_run(example: str, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "jobs" / "shared", tmp_path / "shared")
    path = tmp_path / "example.job"
    path.write_text(example, encoding="utf-8")
    loaded = examine_file(path, None)
    assert [f.message for f in loaded.diagnostics if f.severity is not Severity.NOTE] == []
    stream = stream_in(loaded)
    assert stream is not None
    trace, diagnostics = simulate_stream(stream, loaded.machine)
    assert trace is not None
    assert diagnostics == []


def test_the_reference_names_every_statement() -> None:
    """Each keyword that begins a statement has an example."""
    written = "\n".join(examples("job")).upper()
    laser = "MODE DUTY,MODE FREQUENCY,MODE ANALOG,DELAY,STANDBY,PREVOLT,FPK,DISTANCE,POWER,FOLLOW,ON NOW,OFF"
    others = (
        "UNITS,COORDS,CRD,LINE,JUMP,ARC CW,ARC CCW,DWELL,WAIT,LOOKAHEAD OFF,LOOKAHEAD TIME,LET,REPEAT,FOR,IF,ELSE,DEF,"
        "CALL,FRAME,INCLUDE,VEL,ACC,JUMPVEL,CHANNEL,SKYWRITE MODE 2,SKYWRITE MODE 3,SKYWRITE OFF"
    )
    for word in [*(f"LASER {w}" for w in laser.split(",")), *others.split(",")]:
        assert word in written, word


def test_the_compiled_example_is_what_compile_prints() -> None:
    job = next(e for e in examples("job") if e.startswith("UNITS PULSE\nLOOKAHEAD OFF"))
    assert calls_of(job) == examples("calls")[0].splitlines()
