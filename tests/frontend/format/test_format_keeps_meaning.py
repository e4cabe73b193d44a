"""Formatting changes how a job looks and nothing else."""

from __future__ import annotations

import os
import re
from pathlib import Path
from random import Random

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.formatting import code, comment_of, comments, formatted, letters, numbers
from support.job_writer import Writer
from support.tools import ROOT

from gusjob.config.machine import Machine
from gusjob.config.profile import find_profile, read_profile
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.lower import compile_job
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import has_errors
from gusjob.frontend import Source, check_text, read_job, read_source
from gusjob.frontend.format import format_source, format_text
from gusjob.frontend.parse.job_reader import read_job_text
from gusjob.kinematics.units import UNITS
from gusjob.lint import check

EXAMPLES = int(os.environ.get("PROPERTY_EXAMPLES", "30"))
FILES = sorted(p for folder in ("jobs", "tests/good", "tests/bad") for p in (ROOT / folder).rglob("*.job"))
GRAMMAR = (ROOT / "grammar" / "job.lark").read_text(encoding="utf-8")
KEYWORDS = set(re.findall(r"^([A-Z0-9]+)(?:\.\d)?: /", GRAMMAR, re.MULTILINE))


def filled_lines(text: str) -> list[int]:
    """The lines that are not blank."""
    return [n for n, line in enumerate(text.split("\n"), 1) if line.strip(" \t\r")]


Calls = tuple[str, list[int], list[tuple[str, int]]]


def compiled(source: Source, machine: Machine) -> Calls:
    """The calls, their lines, and the diagnostics; blank lines are not counted."""
    number = {line: i for i, line in enumerate(filled_lines(source.data.decode()))}
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
        diagnostic for diagnostic in diagnostics if diagnostic.rule is not rules.LOWERCASE_KEYWORD
    ]  # fmt writes upper case.
    found = [(f.rule.code, -f.span.line if f.span.path else number.get(f.span.line, -1)) for f in diagnostics]
    return calls, lines, found


def keeps_meaning(source: Source, machine: Machine) -> Source:
    """Check all that must hold for a text that can be parsed; returns the formatted text."""
    data, diagnostics = format_source(source)
    assert data is not None, [diagnostic.message for diagnostic in diagnostics]
    after = replace(source, data=data, written=None)
    assert format_source(after) == (data, [])
    old, new = source.data.decode(), data.decode()
    assert comments(new) == comments(old)
    assert numbers(new) == numbers(old)
    assert letters(new) == letters(old)
    assert compiled(after, machine) == compiled(source, machine)
    return after


NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?"
UNIT = "|".join(sorted(map(re.escape, UNITS), key=len, reverse=True))
TOKEN = re.compile(
    rf"(?P<measured>{NUMBER}(?:{UNIT})(?![a-z0-9_]))|(?P<number>{NUMBER})|(?P<word>duty2(?= )|[a-z_]+)|(?P<blank> +)|.",
    re.IGNORECASE,
)
CONTROL_WORDS = ("LET", "REPEAT", "FOR", "IF", "DEF", "CALL")


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
    parts_ = [(str(m.lastgroup), m[0]) for m in TOKEN.finditer(text)]
    result = ""
    for i, (kind, token) in enumerate(parts_):
        before = parts_[i - 1] if i else ("", "")
        after = parts_[i + 1] if i + 1 < len(parts_) else ("", "")
        if kind == "word":
            token = cased(rng, token)
        elif kind == "measured":
            token = re.sub(rf"(?:{UNIT})$", lambda m: cased(rng, m[0]), token, flags=re.IGNORECASE)
        elif kind == "blank":
            value = after[0] in ("number", "measured") or (after[0] == "None" and after[1] in "-+(.")
            if before[0] == "word" and before[1].upper() in KEYWORDS and before[1][-1] != "2" and value:
                token = rng.choice((" ", "\t", "=", " = ", "", ""))
            elif before[0] == "number" and after[0] == "word":
                token = rng.choice(("", blanks(rng)))
            else:
                token = blanks(rng)
        elif token == "-" and before[0] in ("blank", "word"):
            token += blanks(rng, 0)
        result += token
    return result


def scrambled_line(rng: Random, line: str) -> str:
    """A line of job_writer.py with the same meaning."""
    comment = comment_of(line)
    text = line[: len(line) - len(comment)].strip()
    head, _, rest = text.partition(" ")
    if head.upper() in CONTROL_WORDS:
        rest = re.sub(r"\b(FROM|TO|STEP|AS)\b", lambda m: cased(rng, m[0]), rest, flags=re.IGNORECASE)
        text = cased(rng, head) + blanks(rng) + scrambled_expression(rng, rest)
    else:
        parts, start, depth = [], 0, 0
        for i, c in enumerate(text):  # Inside and outside of parentheses.
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
    """A job of job_writer.py in another spelling."""
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
def test_random_jobs_keep_their_meaning(seed: int) -> None:
    rng = Random(seed)
    machine = Machine()
    text = Writer(rng, odd=rng.choice((0, 0, 60))).job()
    if read_job_text(source_of(text)).diagnostics:  # A line that can't be parsed.
        assert format_text(text)[0] is None
        return
    other = scrambled(rng, text)
    after = keeps_meaning(source_of(other), machine)
    # The result does not depend on the spelling: except for comments and blank lines it is the same.
    plain = [line for line in code(formatted(text)).split("\n") if line.strip()]
    again = [line.rstrip() for line in code(after.data.decode().replace("\r", "")).split("\n") if line.strip()]
    assert again == [line.rstrip() for line in plain]


def test_most_random_jobs_are_formatted() -> None:
    """Otherwise the test above tests little."""
    texts = [Writer(Random(seed), odd=60).job() for seed in range(20)]
    assert sum(format_text(scrambled(Random(1), text))[0] is not None for text in texts) > 10


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_files_keep_their_meaning(path: Path) -> None:
    source, _ = read_source(path)
    assert source is not None
    profile = path.with_suffix(".machine.toml")
    found = profile if profile.exists() else find_profile(path)
    machine = read_profile(found).machine if found else Machine()
    unparsed = {f.span.line for f in read_job_text(source).diagnostics}
    if unparsed:  # The rest must still hold without those lines.
        data, diagnostics = format_source(source)
        assert data is None
        assert {f.span.line for f in diagnostics} == unparsed
        assert {f.path for f in diagnostics} == {source.name}
        lines = source.data.split(b"\n")
        source = replace(source, data=b"\n".join(lines[i] for i in range(len(lines)) if i + 1 not in unparsed))
    keeps_meaning(source, machine)


@given(st.lists(st.sampled_from(["LINE", "X", "1", "-", "(", ")", "a", "%", "/", "mm", "5mm", " ", "IF", "==", "s2"])))
@settings(max_examples=150)
def test_junk(parts_: list[str]) -> None:
    for joint in ("", " "):
        text = "IF " + joint.join(parts_)
        result, diagnostics = format_text(text)
        assert (result is None) == bool(diagnostics)
        if result is not None:
            assert formatted(result) == result
            assert letters(result) == letters(text)
