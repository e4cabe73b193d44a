"""gusjob fmt: the layout itself, and that it changes how a job looks and nothing else."""

from __future__ import annotations

import os
import re
import stat
import sys
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest
from click.testing import CliRunner, Result
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from support.job_writer import Writer
from support.tools import MARK, ROOT

from gusjob.cli import cli
from gusjob.config.machine import Machine
from gusjob.config.profile import find_profile, read_machine
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.lower import compile_job
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import has_errors
from gusjob.frontend import Source, check_text, read_job, read_source
from gusjob.frontend.expand.program import MAX_NESTING
from gusjob.frontend.format import formatted, laid_out, layout
from gusjob.frontend.format.difference import difference
from gusjob.frontend.format.statement import canonical
from gusjob.frontend.parse.job_reader import JobText, read_job_text
from gusjob.frontend.scan import shapes
from gusjob.frontend.scan.shapes import MAX_LINE
from gusjob.kinematics.units import UNITS
from gusjob.lint import check

EXAMPLES = int(os.environ.get("PROPERTY_EXAMPLES", "30"))
FILES = sorted(p for folder in ("jobs", "tests/good", "tests/bad") for p in (ROOT / folder).rglob("*.job"))
GRAMMAR = (ROOT / "grammar" / "job.lark").read_text(encoding="utf-8")
KEYWORDS = set(re.findall(r"^([A-Z0-9]+)(?:\.\d)?: /", GRAMMAR, re.MULTILINE))


def done(text: str) -> str:
    """A text laid out that can be read."""
    result, diagnostics = formatted(text)
    assert result is not None, [diagnostic.message for diagnostic in diagnostics]
    return result


# The layout.


@pytest.mark.parametrize(
    ("written", "wanted"),
    [
        ("line x10 y=20", "LINE X 10 Y 20"),
        ("Line\tX = - 5.50Y+.5", "LINE X -5.50 Y +.5"),
        ("LINE X 1e3 Y 1E-3", "LINE X 1e3 Y 1E-3"),
        ("LINE Y 2 X 1 END 3 VEL 2", "LINE Y 2 X 1 END 3 VEL 2"),
        ("LINE X 007 Y 5.", "LINE X 007 Y 5."),
        ("VEL=18000MM/MIN", "VEL 18000mm/min"),
        ("acc 5M/S2", "ACC 5m/s2"),
        ("LASER MODE DUTY2 CARRIER20KHZ MIN 1%", "LASER MODE DUTY2 CARRIER 20kHz MIN 1%"),
        ("LASER STANDBY FREQ5hz DUTY2", "LASER STANDBY FREQ 5Hz DUTY 2"),
        ("LASER STANDBY FREQ5DUTY3 CHANNEL1", "LASER STANDBY FREQ 5 DUTY 3 CHANNEL 1"),
        ("LASER PREVOLT 400MV", "LASER PREVOLT 400mV"),
        ("laser distance ref x0y0 ratio x.1y.1 min1max 9 source=planned",
         "LASER DISTANCE REF X 0 Y 0 RATIO X .1 Y .1 MIN 1 MAX 9 SOURCE PLANNED"),
        ("SKYWRITE MODE2TIMELAG 250US nprev=auto", "SKYWRITE MODE 2 TIMELAG 250us NPREV AUTO"),
        ("LET Pitch=2*( 3-n )", "LET Pitch = 2 * (3 - n)"),
        ("let a = - b+-c--d", "LET a = -b + -c - -d"),
        ("LINE X(a*-b ** - 2/c%d) Y - ( a+1 )", "LINE X (a * -b ** -2 / c % d) Y -(a + 1)"),
        ("LET a = min ( 1,2 ,max(3, 4))", "LET a = min(1, 2, max(3, 4))"),
        ("if not(a<=1)AND b!=2 Or c==3", "IF not (a <= 1) and b != 2 or c == 3"),
        ("IF ((a))>0", "IF ((a)) > 0"),
        ("repeat n*2 as i", "REPEAT n * 2 AS i"),
        ("for I from-1 to(n) step +.5", "FOR I FROM -1 TO (n) STEP +.5"),
        ("def Box ( w,h )", "DEF Box(w, h)"),
        ("call Box( 1,- 2 )", "CALL Box(1, -2)"),
        ("call Box ()", "CALL Box()"),
        ("CALL Box", "CALL Box"),
        ('include"a  B.job"', 'INCLUDE "a  B.job"'),
        ("frame shift x1y2 rotate30DEG scale=.5", "FRAME SHIFT X 1 Y 2 ROTATE 30deg SCALE .5"),
        ("LASER ON  ;Text  as\tit is \t", "LASER ON  ;Text  as\tit is"),
        ("\t// alone", "// alone"),
        ("WAIT//", "WAIT  //"),
    ],
)  # fmt: skip
def test_a_line(written: str, wanted: str) -> None:
    assert done(written) == wanted + "\n"
    assert done(wanted + "\n") == wanted + "\n"


@pytest.mark.parametrize(
    ("written", "wanted"),
    [
        ("LET a = 5 % (n)", "LET a = 5 % (n)"),
        ("LET a = 5 % -3", "LET a = 5 % -3"),
        ("LET a = 5 % .5", "LET a = 5 % .5"),
        ("LET a = 5 % 3", "LET a = 5 % 3"),
        ("LET a = 5% + 3%", "LET a = 5% + 3%"),
        ("LET a = 5mm / min(n, 2)", "LET a = 5mm / min(n, 2)"),
        ("LET a = 5mm / s", "LET a = 5mm / s"),
        ("LET a = 5MM/S", "LET a = 5mm/s"),
        ("LET a = 5pulse / ms2", "LET a = 5pulse / ms2"),
        ("LET a = 5mm/3", "LET a = 5mm / 3"),
        ("LET a = n/s", "LET a = n / s"),
        ("LET a = 5mm / S3", "LET a = 5mm / S3"),
    ],
)
def test_operators_do_not_become_units(written: str, wanted: str) -> None:
    assert done(written) == wanted + "\n"


def test_lines_that_only_look_alike() -> None:
    """One shape, once a unit, once divided by a name."""
    wanted = {2: "LET a = 5mm/s2", 3: "LET a = 5mm / S3"}
    for order in ((2, 3), (3, 2)):
        lines = [f"LET a = 5MM/S{n}" for n in order]
        assert done("\n".join(lines)).split("\n")[:2] == [wanted[n] for n in order]
        lines = [f"LET a = 5mm / s{n}" for n in order]
        assert done("\n".join(lines)).split("\n")[:2] == lines


BEFORE = """

\t
def a
; in it
for i from 0 to 3
if i==1
      ; deep
line x(i)
  else
wait

 // of else
end


;two

end


FRAME
END
end
LASER ON
   end"""
AFTER = """DEF a
  ; in it
  FOR i FROM 0 TO 3
    IF i == 1
      ; deep
      LINE X (i)
    ELSE
      WAIT

      // of else
    END


    ;two

  END


  FRAME
  END
END
LASER ON
END
"""


def test_blocks_and_blank_lines() -> None:
    assert done(BEFORE) == AFTER
    assert done(BEFORE.replace("\n\n\n", "\n \n\n\t\n\n") + "\n\n\n") == AFTER


def test_an_end_too_many() -> None:
    assert done("END\n  END\nIF 1 == 1\nWAIT\nEND\n") == "END\nEND\nIF 1 == 1\n  WAIT\nEND\n"


def test_comments_stay_below_each_other() -> None:
    text = """VEL=5       ; kept
LINE X(1*2) ; where
WAIT
DWELL 100   // they are
LINE X   1       ; alone
LINE X -123.5 ;moved
WAIT          ;on
ACC 1 ; a
"""
    wanted = """VEL 5           ; kept
LINE X (1 * 2)  ; where
WAIT
DWELL 100       // they are
LINE X 1  ; alone
LINE X -123.5  ;moved
WAIT           ;on
ACC 1  ; a
"""
    assert done(text) == wanted
    assert done(wanted) == wanted
    assert done("VEL 5        ; a\nWAIT         ; b\n") == "VEL 5        ; a\nWAIT         ; b\n"  # There is room.


def test_columns_are_characters() -> None:
    text = 'INCLUDE "\u00e9\u00e9.job"  ; a\nWAIT              ; b\n'
    assert done(text) == text


def test_aligned_with_tabs() -> None:
    assert done("VEL 5\t\t; a\nJUMPVEL 5\t; b\n") == "VEL 5           ; a\nJUMPVEL 5       ; b\n"


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("", ""),
        (" \n\t\n", ""),
        ("\ufeff", "\ufeff"),
        ("\ufeffwait", "\ufeffWAIT\n"),
        ("wait\r\nwait\nwait", "WAIT\r\nWAIT\r\nWAIT\r\n"),
        ("wait\nwait\r\n\r\nwait\r\n", "WAIT\nWAIT\n\nWAIT\n"),
        ("vel\r5 ; a\rb\r\r\n", "VEL 5  ; a\rb\r\n"),
        ("wait ; é\nline x1;é", "WAIT  ; é\nLINE X 1  ;é\n"),
    ],
)
def test_ends(text: str, wanted: str) -> None:
    assert done(text) == wanted
    assert done(wanted) == wanted


def test_deep_blocks_do_not_run_away() -> None:
    deep = "IF 1 == 1\n" * 5000
    lines = done(deep).splitlines()
    assert lines[MAX_NESTING].index("I") == lines[-1].index("I") == 2 * MAX_NESTING


@pytest.mark.parametrize(
    "text",
    [
        "LET a = " + "1 + " * 2000 + "1 ;" + "c" * 1980,
        "VEL 5".ljust(2000)
        + ";"
        + "b" * 7900
        + "\n"
        + ("LET c=" + "1+" * 990 + "1").ljust(2000)
        + "; c\nVEL 5".ljust(2000)
        + "; d",
        "IF 1==1\n;" + "c" * (MAX_LINE - 1) + "\nEND",
        "VEL 5 ; a" + "\nVEL 5 ;" + "b" * (MAX_LINE - 20) + "\nLET c=" + "1+" * 2000 + "1",
        "VEL 5" + " " * 4500 + ";" + "b" * 5000 + "\nLET c=" + "1+" * 2246 + "1 ; a\n",
    ],
)
def test_no_line_becomes_too_long(text: str) -> None:
    once = done(text)
    assert done(once) == once
    assert comments(once) == comments(text)


def test_what_is_too_long_stays() -> None:
    text = "  LET  a=" + "1+" * ((MAX_LINE - 11) // 2) + "1"
    assert done(text + " \nvel 5\n") == text + "\nVEL 5\n"


@pytest.mark.parametrize("text", ["LINE X 1\nQQ\n", "LINE X\n", "VEL 1e16\n", "wait\nLINE X 1 X 2\n", "a\0", "\ud800"])
def test_what_can_not_be_read_has_errors(text: str) -> None:
    result, diagnostics = formatted(text)
    assert result is None
    assert has_errors(diagnostics)


def test_many_faults_are_counted() -> None:
    _, diagnostics = formatted("QQ\n" * 3000)
    assert [f.rule.code for f in diagnostics] == ["GJ102"] * 1000 + ["GJ005"]


# Nothing else changes.


def comment_of(line: str) -> str:
    places = [i for i in (line.find(";"), line.find("//")) if i >= 0]
    return line[min(places) :].rstrip(" \t\r") if places else ""


def comments(text: str) -> list[str]:
    return [c for c in map(comment_of, text.split("\n")) if c]


def code(text: str) -> str:
    """A text without its comments."""
    return "\n".join(line[: len(line.rstrip(" \t\r")) - len(comment_of(line))] for line in text.split("\n"))


def numbers(text: str) -> list[str]:
    return re.findall(r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", code(text))


def letters(text: str) -> str:
    """All that is neither blank nor =, keywords and units in capitals."""
    return re.sub(r"[\s=]", "", code(text)).upper()


def told(text: str) -> list[int]:
    """The lines that are not blank."""
    return [n for n, line in enumerate(text.split("\n"), 1) if line.strip(" \t\r")]


Calls = tuple[str, list[int], list[tuple[str, int]]]


def compiled(source: Source, machine: Machine) -> Calls:
    """The calls, their lines, and what was found; lines counted without blank ones."""
    number = {line: i for i, line in enumerate(told(source.data.decode()))}
    job, diagnostics = read_job(source, machine)
    diagnostics += check(job, machine)
    calls, lines = "", []
    if not has_errors(diagnostics):
        stream, more = compile_job(job, machine)
        diagnostics += more
        calls = "".join(listing(stream))
        spans = [job.locate(line, "") for line in (*stream.buffered.line.tolist(), *(c.line for c in stream.calls))]
        lines = [-span.line if span.path else number.get(span.line, -1) for span in spans]
    diagnostics = [
        diagnostic for diagnostic in diagnostics if diagnostic.rule is not rules.SMALL
    ]  # fmt writes capitals.
    found = [(f.rule.code, -f.span.line if f.span.path else number.get(f.span.line, -1)) for f in diagnostics]
    return calls, lines, found


def changes_only_looks(source: Source, machine: Machine) -> Source:
    """All that must hold for a text that can be read; the text as it is laid out."""
    data, diagnostics = laid_out(source)
    assert data is not None, [diagnostic.message for diagnostic in diagnostics]
    after = replace(source, data=data, _ends=None)
    assert laid_out(after) == (data, [])
    old, new = source.data.decode(), data.decode()
    assert comments(new) == comments(old)
    assert numbers(new) == numbers(old)
    assert letters(new) == letters(old)
    assert compiled(after, machine) == compiled(source, machine)
    return after


NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?"
UNIT = "|".join(sorted(map(re.escape, UNITS), key=len, reverse=True))
PIECE = re.compile(
    rf"(?P<measured>{NUMBER}(?:{UNIT})(?![a-z0-9_]))|(?P<number>{NUMBER})|(?P<word>duty2(?= )|[a-z_]+)|(?P<blank> +)|.",
    re.IGNORECASE,
)
STEERING = ("LET", "REPEAT", "FOR", "IF", "DEF", "CALL")


def blanks(rng: Random, least: int = 1) -> str:
    return "".join(rng.choice("  \t") for _ in range(rng.choice((least, 1, 1, 3))))


def cased(rng: Random, word: str) -> str:
    return rng.choice((word.upper(), word.lower(), word.title()))


def scrambled_expression(rng: Random, text: str) -> str:
    """An expression with other blanks."""
    text = re.sub(r" *(<=|>=|==|!=|<|>|,|\(|\)) *", lambda m: blanks(rng, 0) + m[1] + blanks(rng, 0), text)
    text = re.sub(r" (\+|-) ", lambda m: blanks(rng, 0) + m[1] + blanks(rng, 0), text)
    text = re.sub(r" ?(?<!\*)(\*)(?!\*) ?", lambda m: blanks(rng, 0) + m[1] + blanks(rng, 0), text)
    return re.sub(r"(?<=[a-z)]) % ", lambda m: blanks(rng, 0) + "%" + blanks(rng, 0), text)


def scrambled_words(rng: Random, text: str) -> str:
    """Keywords and numbers with other cases, blanks and signs between them."""
    pieces = [(str(m.lastgroup), m[0]) for m in PIECE.finditer(text)]
    result = ""
    for i, (kind, piece) in enumerate(pieces):
        before = pieces[i - 1] if i else ("", "")
        after = pieces[i + 1] if i + 1 < len(pieces) else ("", "")
        if kind == "word":
            piece = cased(rng, piece)
        elif kind == "measured":
            piece = re.sub(rf"(?:{UNIT})$", lambda m: cased(rng, m[0]), piece, flags=re.IGNORECASE)
        elif kind == "blank":
            value = after[0] in ("number", "measured") or (after[0] == "None" and after[1] in "-+(.")
            if before[0] == "word" and before[1].upper() in KEYWORDS and before[1][-1] != "2" and value:
                piece = rng.choice((" ", "\t", "=", " = ", "", ""))
            elif before[0] == "number" and after[0] == "word":
                piece = rng.choice(("", blanks(rng)))
            else:
                piece = blanks(rng)
        elif piece == "-" and before[0] in ("blank", "word"):
            piece += blanks(rng, 0)
        result += piece
    return result


def scrambled_line(rng: Random, line: str) -> str:
    """A line of job_writer.py that says the same."""
    comment = comment_of(line)
    text = line[: len(line) - len(comment)].strip()
    head, _, rest = text.partition(" ")
    if head.upper() in STEERING:
        rest = re.sub(r"\b(FROM|TO|STEP|AS)\b", lambda m: cased(rng, m[0]), rest, flags=re.IGNORECASE)
        text = cased(rng, head) + blanks(rng) + scrambled_expression(rng, rest)
    else:
        parts, start, depth = [], 0, 0
        for i, c in enumerate(text):  # What stands in parentheses, and what does not.
            depth += (c == "(") - (c == ")")
            if (c == "(" and depth == 1) or (c == ")" and depth == 0):
                end = i if c == "(" else i + 1
                parts.append(text[start:end])
                start = end
        parts.append(text[start:])
        text = "".join(
            scrambled_expression(rng, part) if part.startswith("(") else scrambled_words(rng, part) for part in parts
        )
    if not comment and rng.random() < 0.2:
        comment = rng.choice(("; ", ";", "//", " // x=1 ;")) + rng.choice(("", "VEL 5", "é\tü", "1e3 "))
    return blanks(rng, 0) + text + blanks(rng, 0) + comment + blanks(rng, 0)


def scrambled(rng: Random, text: str) -> str:
    """A job of job_writer.py, spelled otherwise."""
    lines: list[str] = []
    for line in text.splitlines():
        lines.append(scrambled_line(rng, line))
        match rng.randrange(12):
            case 0:
                lines += [blanks(rng, 0)] * rng.randrange(5)
            case 1:
                lines.append(blanks(rng, 0) + rng.choice((";", "// ")) + f" a comment ({rng.random()})")
            case _:
                pass
    return rng.choice(("\n", "\n", "\r\n")).join(lines) + rng.choice(("\n", "", "\n\n \n"))


def source_of(text: str) -> Source:
    source, diagnostics = check_text(text.encode(), "x.job")
    assert source is not None, diagnostics
    return source


@given(st.integers(0, 2**32))
@settings(max_examples=EXAMPLES, phases=(Phase.explicit, Phase.reuse, Phase.generate))
def test_random_jobs_stay_what_they_are(seed: int) -> None:
    rng = Random(seed)
    machine = Machine()
    text = Writer(rng, odd=rng.choice((0, 0, 60))).job()
    if read_job_text(source_of(text)).diagnostics:  # Something off that can't be read at all.
        assert formatted(text)[0] is None
        return
    other = scrambled(rng, text)
    after = changes_only_looks(source_of(other), machine)
    # What is said does not hang on the spelling either: but for comments, blanks and lines, it is the same layout.
    plain = [line for line in code(done(text)).split("\n") if line.strip()]
    again = [line.rstrip() for line in code(after.data.decode().replace("\r", "")).split("\n") if line.strip()]
    assert again == [line.rstrip() for line in plain]


def test_most_random_jobs_are_laid_out() -> None:
    """Else the test above would test little."""
    texts = [Writer(Random(seed), odd=60).job() for seed in range(20)]
    assert sum(formatted(scrambled(Random(1), text))[0] is not None for text in texts) > 10


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_files_stay_what_they_are(path: Path) -> None:
    source, _ = read_source(path)
    assert source is not None
    profile = path.with_suffix(".machine.toml")
    found = profile if profile.exists() else find_profile(path)
    machine, _ = read_machine(found) if found else (Machine(), [])
    unread = {f.span.line for f in read_job_text(source).diagnostics}
    if unread:  # What is left without those lines must hold.
        data, diagnostics = laid_out(source)
        assert data is None
        assert {f.span.line for f in diagnostics} == unread
        assert {f.path for f in diagnostics} == {source.name}
        lines = source.data.split(b"\n")
        source = replace(source, data=b"\n".join(lines[i] for i in range(len(lines)) if i + 1 not in unread))
    changes_only_looks(source, machine)


@given(st.lists(st.sampled_from(["LINE", "X", "1", "-", "(", ")", "a", "%", "/", "mm", "5mm", " ", "IF", "==", "s2"])))
@settings(max_examples=150)
def test_junk(pieces: list[str]) -> None:
    for joint in ("", " "):
        text = "IF " + joint.join(pieces)
        result, diagnostics = formatted(text)
        assert (result is None) == bool(diagnostics)
        if result is not None:
            assert done(result) == result
            assert letters(result) == letters(text)


def test_a_shape_is_laid_out_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a job of a million lines would take minutes."""
    asked: list[str] = []

    def counted(text: str) -> tuple[str, str]:
        asked.append(text)
        return canonical(text)

    monkeypatch.setattr(layout, "canonical", counted)
    count, localized = 20_000, "; " + "more than a chunk " * 6 + "."
    lines = [f"line x{i}.5y-{i}  acc{i}mm/s2 {localized}\nLASER on" for i in range(count)]
    result = done("\n".join(lines)).splitlines()
    assert len(asked) == 2
    assert [line.split(";")[0].rstrip() for line in result[::2]] == [
        f"LINE X {i}.5 Y -{i} ACC {i}mm/s2" for i in range(count)
    ]
    assert comments("\n".join(result)) == [localized] * count
    assert len("\n".join(lines)) > shapes._CHUNK


# The diff.


def patched(before: bytes, diff: bytes) -> bytes:
    """What a diff makes of a text; every line that it names must be there."""
    old, result, at = before.split(b"\n"), list[bytes](), 0
    old = [line + b"\n" for line in old[:-1]] + ([old[-1]] if old[-1] else [])
    rows = diff.replace(b"\n\\ No newline at end of file\n", b"\0").split(b"\n")[2:]
    for row in (r for joined in rows if joined for r in re.findall(rb"[^\0]+\0?", joined)):
        line = row[1:-1] if row.endswith(b"\0") else row[1:] + b"\n"
        head = re.match(rb"@@ -(\d+),(\d+) \+(\d+),(\d+) @@", row)
        if head:
            start = int(head[1]) - (head[2] != b"0")
            result += old[at:start]
            assert len(result) == int(head[3]) - (head[4] != b"0")
            at = start
        elif row[:1] == b"+":
            result.append(line)
        else:
            assert old[at] == line
            result += [line] if row[:1] == b" " else []
            at += 1
    return b"".join([*result, *old[at:]])


@given(st.integers(0, 2**32))
@settings(max_examples=EXAMPLES, phases=(Phase.explicit, Phase.reuse, Phase.generate))
def test_the_diff_leads_to_the_layout(seed: int) -> None:
    rng = Random(seed)
    lines = ["WAIT", "WAIT", "WAIT", "WAIT", "wait", "", "", " ", "; c"]
    before = "\n".join(rng.choice(lines) for _ in range(rng.randrange(40))) + rng.choice(("", "\n"))
    after = done(before)
    diff = b"".join(difference("a", before.encode(), after.encode()))
    assert bool(diff) == (before != after)
    if diff:
        assert patched(before.encode(), diff) == after.encode()


def test_the_diff_has_three_lines_around() -> None:
    before = b"\n".join([b"WAIT"] * 10 + [b"wait"] + [b"WAIT"] * 10) + b"\n"
    diff = b"".join(difference("a", before, before.upper())).decode()
    assert diff == "--- a\n+++ a\n@@ -8,7 +8,7 @@\n WAIT\n WAIT\n WAIT\n-wait\n+WAIT\n WAIT\n WAIT\n WAIT\n"
    for between, hunks in ((6, 1), (7, 2)):
        before = b"wait\n" + b"WAIT\n" * between + b"wait\n"
        assert b"".join(difference("a", before, before.upper())).count(b"@@ -") == hunks


# The command.


def gusjob(*args: object, given: bytes = b"") -> Result:
    return CliRunner().invoke(cli, ["fmt", *map(str, args)], input=given, catch_exceptions=False)


UGLY = MARK.lower() + "laser power=50\nlaser on\nline x10\nlaser off\n"
PRETTY = MARK + "LASER POWER 50\nLASER ON\nLINE X 10\nLASER OFF\n"


def put(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.parent.mkdir(exist_ok=True, parents=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def seen(folder: Path) -> dict[str, bytes]:
    """Every file of a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_files_and_folders(tmp_path: Path) -> None:
    ugly, pretty = put(tmp_path, "in/ugly.job", UGLY), put(tmp_path, "in/pretty.JOB", PRETTY)
    put(tmp_path, "in/.hidden/a.job", UGLY)
    listed = put(tmp_path, "in/a.gts", "gt_lnxy(1,2);\n")
    alone = put(tmp_path, "other.txt", UGLY)
    os.utime(pretty, (1, 1))
    ran = gusjob(tmp_path / "in", listed, alone)
    assert (ran.exit_code, ran.stdout) == (0, "")
    last = "4 files: 2 changed, 1 unchanged, 1 listing not formatted"
    assert ran.stderr == f"{listed}: listings are not formatted\n{last}\n"
    assert ugly.read_text() == alone.read_text() == PRETTY
    assert pretty.stat().st_mtime == 1
    assert (tmp_path / "in/.hidden/a.job").read_text() == UGLY
    assert listed.read_text() == "gt_lnxy(1,2);\n"
    for option in ("--check", "--diff"):
        ran = gusjob(option, tmp_path / "in", alone)
        assert (ran.exit_code, ran.stdout, ran.stderr) == (0, "", "3 files: 3 unchanged\n")


def test_check_and_diff_write_nothing(tmp_path: Path) -> None:
    ugly, crlf = put(tmp_path, "a.job", UGLY), put(tmp_path, "b.job", b"\xef\xbb\xbfwait\r\n\r\n")
    put(tmp_path, "c.job", PRETTY)
    before = seen(tmp_path)
    ran = gusjob("--check", tmp_path)
    assert (ran.exit_code, ran.stdout) == (1, f"{ugly}\n{crlf}\n")
    assert ran.stderr == "3 files: 2 would change, 1 unchanged\n"
    ran = gusjob("--diff", tmp_path)
    assert ran.exit_code == 1
    first, second = ran.stdout_bytes.split(f"--- {crlf}".encode())
    assert patched(UGLY.encode(), first) == PRETTY.encode()
    assert second.endswith(b"\n-\xef\xbb\xbfwait\r\n-\r\n+\xef\xbb\xbfWAIT\r\n")
    assert seen(tmp_path) == before
    assert gusjob("--check", "--diff", tmp_path).stdout == ran.stdout
    assert gusjob(tmp_path).stderr == "3 files: 2 changed, 1 unchanged\n"
    assert crlf.read_bytes() == b"\xef\xbb\xbfWAIT\r\n"
    assert gusjob("--check", tmp_path).exit_code == 0


def test_a_job_with_errors_is_not_touched(tmp_path: Path) -> None:
    path = put(tmp_path, "bad.job", UGLY + "QQ 1\n")
    ran = gusjob(path, put(tmp_path, "a.job", UGLY))
    assert ran.exit_code == 1
    assert f"{path}:8:1: error[GJ102]" in ran.stderr
    assert "    8 | QQ 1\n" in ran.stderr
    assert ran.stderr.endswith("\n2 files: 1 changed, 1 failed\n")
    assert path.read_text() == UGLY + "QQ 1\n"


def test_what_can_not_be_read(tmp_path: Path) -> None:
    good = put(tmp_path, "a.job", UGLY)
    ran = gusjob(tmp_path / "none.job", put(tmp_path, "b.job", b"\xff\xfe"), good)
    assert ran.exit_code == 2
    assert ran.stderr.endswith("3 files: 1 changed, 2 failed\n")
    put(tmp_path, "empty/a.gts", "")
    good.write_text(UGLY)
    ran = gusjob(good, tmp_path / "empty")
    assert ran.exit_code == 2
    assert "there is no .job file in this folder" in ran.stderr
    assert good.read_text() == UGLY  # Nothing is done by halves.
    assert gusjob().exit_code == 2


def test_standard_input() -> None:
    ran = gusjob("-", given=b"\xef\xbb\xbfwait\r\nline x1")
    assert (ran.exit_code, ran.stdout_bytes) == (0, b"\xef\xbb\xbfWAIT\r\nLINE X 1\r\n")
    assert gusjob("-", given=PRETTY.encode()).stdout == PRETTY
    ran = gusjob("-", "--check", given=b"wait\n")
    assert (ran.exit_code, ran.stdout) == (1, "<stdin>\n")
    ran = gusjob("-", "--diff", given=b"wait")
    assert (ran.exit_code, ran.stdout.splitlines()[3:]) == (1, ["-wait", "\\ No newline at end of file", "+WAIT"])
    ran = gusjob("-", given=b"QQ\n")
    assert (ran.exit_code, ran.stdout_bytes) == (1, b"")
    assert ran.stderr.startswith("<stdin>:1:1: error[")
    assert gusjob("-", given=b"a\0").exit_code == 2
    listed = b"GT_LnXY(1,2,3,4,5,6,7,8);\n"
    assert gusjob("-", given=listed).stdout_bytes == listed


@pytest.mark.skipif(sys.platform == "win32", reason="links and permissions of POSIX")
def test_links_and_permissions_stay(tmp_path: Path) -> None:
    path = put(tmp_path, "far/a.job", UGLY)
    path.chmod(0o640)
    link = tmp_path / "link.job"
    link.symlink_to(path)
    assert gusjob(link).exit_code == 0
    assert link.is_symlink()
    assert path.read_text() == PRETTY
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert seen(tmp_path).keys() == {"far/a.job", "link.job"}


def test_a_job_is_never_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = put(tmp_path, "a.job", UGLY)
    asked: list[tuple[bytes, bytes]] = []

    def fails(self: Path, target: Path) -> None:
        asked.append((self.read_bytes(), Path(target).read_bytes()))
        assert self.parent == path.parent
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fails)
        ran = gusjob(path)
    assert asked == [(PRETTY.encode(), UGLY.encode())]
    assert ran.exit_code == 2
    assert ran.stderr == f"gusjob: {path}: can't write: no space left on device\n1 file: 1 failed\n"
    assert seen(tmp_path) == {"a.job": UGLY.encode()}


def test_a_job_saved_in_the_meantime_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = put(tmp_path, "a.job", UGLY)

    def saves(source: Source) -> JobText:
        path.write_text("; mine\n")
        return read_job_text(source)

    monkeypatch.setattr(layout, "read_job_text", saves)
    ran = gusjob(path)
    assert ran.exit_code == 2
    assert "the file was changed in the meantime" in ran.stderr
    assert path.read_text() == "; mine\n"


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="who may write all can't be refused")
def test_no_permission(tmp_path: Path) -> None:
    path = put(tmp_path, "a.job", UGLY)
    path.chmod(0o400)
    ran = gusjob(path)
    assert (ran.exit_code, path.read_text()) == (2, UGLY)


def test_the_jobs_here_are_laid_out() -> None:
    for path in (ROOT / "jobs").rglob("*.job"):
        assert done(path.read_text(encoding="utf-8")) == path.read_text(encoding="utf-8"), path
