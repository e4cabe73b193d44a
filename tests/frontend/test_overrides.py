"""Overrides of LETs: a job with an override is the job whose LET was edited by hand; what can't be set is an error."""

from __future__ import annotations

import re
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from support.tools import MARK, ROOT

from gusjob.controllers.gus.listing import listing
from gusjob.diagnostics.model import OVERRIDDEN
from gusjob.frontend.overrides import checked_overrides
from gusjob.i18n.phrases import Phrase
from gusjob.ir.overrides import NO_OVERRIDES, Overrides
from gusjob.pipeline import Checked, Rejected, Simulated, load, simulate
from gusjob.report.rows import make_report

_LET = re.compile(r"(\s*LET\s+(\w+)\s*=\s*)([^;/\n]*(?:/(?!/)[^;/\n]*)*)")


def first_lets(text: str) -> list[tuple[str, str, int, int]]:
    """Name, value, and its start and end in the text, of the first LET of each name outside of routines."""
    found: dict[str, tuple[str, str, int, int]] = {}
    blocks: list[str] = []
    position = 0
    for line in text.splitlines(keepends=True):
        words = line.split(";")[0].split("//")[0].split()
        if words and words[0] in ("DEF", "FOR", "REPEAT", "IF", "FRAME"):
            blocks.append(words[0])
        elif words and words[0] == "END":
            blocks.pop()
        let = _LET.match(line)
        if let and "DEF" not in blocks and let[2] not in found:
            value = let[3].rstrip()
            start = position + let.end(1)
            found[let[2]] = (let[2], value, start, start + len(value))
        position += len(line)
    return list(found.values())


def jobs_with_lets() -> list[Path]:
    files = (p for folder in ("jobs", "tests/good") for p in (ROOT / folder).rglob("*.job"))
    return sorted(p for p in files if first_lets(p.read_text(encoding="utf-8")))


def result_of(path: Path, text: str, overrides: Overrides = NO_OVERRIDES) -> Checked | Rejected:
    loaded = load(path, data=text.encode(), overrides=overrides)
    return simulate(loaded) if isinstance(loaded, Checked) else loaded


def outputs(result: Checked | Rejected) -> tuple[object, ...]:
    """Diagnostics, calls, and rows of the report."""
    found = [(d.rule.code, d.file, d.span.line, d.severity, d.message, d.count) for d in result.diagnostics]
    if not isinstance(result, Simulated):
        return (found,)
    report = make_report(result.trace, result.machine, result.files)
    rows = {name: np.ascontiguousarray(column).tobytes() for name, column in report.columns.items()}
    return found, "".join(listing(result.stream)), rows, report.totals


def defined(**values: str) -> Overrides:
    found = checked_overrides(values.items())
    assert not isinstance(found, Phrase), found
    return found


def test_there_are_jobs_with_lets() -> None:
    assert sum(len(first_lets(p.read_text(encoding="utf-8"))) for p in jobs_with_lets()) >= 20


@pytest.mark.parametrize("path", jobs_with_lets(), ids=lambda p: p.stem)
def test_an_override_is_the_let_edited_by_hand(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    changed = 0
    for name, value, start, end in first_lets(text):
        for new in (f"({value}) * 1.25", f"-1.5e0 + {value}", value, "3"):
            by_hand = outputs(result_of(path, text[:start] + new + text[end:]))
            assert outputs(result_of(path, text, defined(**{name: new}))) == by_hand, (name, new)
            changed += by_hand != outputs(result_of(path, text))
    assert changed


def test_several_at_once() -> None:
    path = ROOT / "jobs" / "hatched_star.job"
    text = path.read_text(encoding="utf-8")
    by_hand = text.replace("LET points = 6", "LET points = 5").replace("LET inner = 7", "LET inner = outer / 3")
    assert by_hand.count("LET points = 5") == by_hand.count("LET inner = outer / 3") == 1
    overrides = defined(points="5", inner="outer / 3")
    assert outputs(result_of(path, text, overrides)) == outputs(result_of(path, by_hand))


_POWER = MARK + "LASER POWER (p)\nLASER ON\nLINE X 5\nLASER OFF\n"


@pytest.mark.parametrize(
    ("text", "overrides", "powers"),
    [
        # A later LET of the name sets it as ever; a LET that reads an overridden name sees the override.
        ("LET p = 10\n" + _POWER + "LET p = 20\n" + _POWER, {"p": "30%"}, [30, 20]),
        ("LET q = 10\nLET p = q * 2\n" + _POWER, {"q": "30"}, [60]),
        ("LET p = 10\n" + _POWER + "LET p = p + 1\n" + _POWER, {"p": "30"}, [30, 31]),
        # The first in the text counts, though another one runs first or it does not run at all.
        ("LET n = 1\nIF n == 2\nLET p = 10\nELSE\nLET p = 20\nEND\n" + _POWER, {"p": "30"}, [20]),
        ("LET n = 1\nIF n == 2\nLET p = 10\nELSE\nLET p = 20\nEND\n" + _POWER, {"p": "30", "n": "2"}, [30]),
        ("LET n = 1\nREPEAT 2\nLET p = n * 10\nLET n = n + 1\n" + _POWER + "END\n", {"p": "n * 7"}, [7, 14]),
        # In a routine a name of the same spelling is its own.
        ("DEF r()\nLET p = 5\n" + _POWER + "END\nLET p = 10\nCALL r()\n" + _POWER, {"p": "30"}, [5, 30]),
        ("DEF r(p)\n" + _POWER + "END\nLET p = 10\nCALL r(p)\nCALL r(8)\n", {"p": "30"}, [30, 8]),
        # Of lines of one shape only the first is another one.
        ("".join(f"LET p{i} = {i}\n" for i in range(1, 30)) + _POWER.replace("(p)", "(p7 + p8)"), {"p7": "90"}, [98]),
    ],
)  # fmt: skip
def test_which_let_is_set(text: str, overrides: dict[str, str], powers: list[float]) -> None:
    result = result_of(Path("x.job"), text, defined(**overrides))
    assert isinstance(result, Simulated), [d.message for d in result.diagnostics]
    calls = "".join(listing(result.stream))
    assert [float(p) for p in re.findall(r"GT_BufLaserPrfCmd\(1,([^,]+)", calls)] == powers


_LOOPS = "FOR v FROM 1 TO 2 STEP 1\nEND\nREPEAT 2 AS i\nEND\n"
_OF_THE_JOB = "LET depth = 1\nLET speed = 100\nDEF r(side)\nLET inside = 2\nEND\n" + _LOOPS


@pytest.mark.parametrize(
    ("name", "line", "said"),
    [
        ("sped", 1, "does not set sped with LET; it sets depth, speed; did you mean speed?"),
        ("zzzzz", 1, "does not set zzzzz with LET; it sets depth, speed"),
        ("inside", 4, "this LET is in a DEF, where names are local"),
        ("side", 3, "side is a parameter, which CALL sets"),
        ("v", 6, "the loop sets v in each iteration"),
        ("i", 8, "the loop sets i in each iteration"),
        ("spare", 1, "this LET is in an included file"),
    ],
)
def test_names_that_can_not_be_set(tmp_path: Path, name: str, line: int, said: str) -> None:
    (tmp_path / "part.job").write_text("LET spare = 1\n", encoding="utf-8")
    text = _OF_THE_JOB + 'INCLUDE "part.job"\n'
    result = result_of(tmp_path / "x.job", text, defined(**{name: "5"}))
    (found,) = [d for d in result.diagnostics if d.rule.code == "GJ160"]
    assert said in found.message
    assert found.message.startswith(f"-D {name}: ")
    assert found.span.line == line
    assert found.span.path.endswith("part.job" if name == "spare" else "")
    assert not isinstance(result, Simulated)


def test_many_names_are_not_all_listed() -> None:
    text = "".join(f"LET n_{i} = {i}\n" for i in range(40))
    (found,) = [d for d in result_of(Path("x.job"), text, defined(z="1")).diagnostics if d.rule.code == "GJ160"]
    assert found.message.endswith("; it sets n_0, n_1, n_2, n_3, n_4, n_5, n_6, n_7, n_8, n_9, n_10, n_11 and 28 more")


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("x.job", MARK + "LINE X 5\n", "-D p: the job does not set p with LET; it has no LET"),
        ("x.gts", "GT_CrdClear(1,0)\nGT_BufDelay(1,10,0)\nGT_CrdStart(1,0)\n", "-D is for jobs: a listing has no LET"),
    ],
)
def test_files_without_lets(name: str, text: str, said: str) -> None:
    result = result_of(Path(name), text, defined(p="1"))
    assert said in [d.message for d in result.diagnostics if d.rule.code == "GJ160"]
    assert not isinstance(result, Simulated)


def test_a_let_that_can_not_be_read_is_one_error() -> None:
    for text in ("LET p = = 5\nLET q = 1\n", "LET p = = 5\n"):
        codes = [d.rule.code for d in result_of(Path("x.job"), text, defined(p="1")).diagnostics]
        assert "GJ101" in codes
        assert "GJ160" not in codes


@pytest.mark.parametrize(
    ("pairs", "said"),
    [
        ([("p", "")], "p has no value: a value is a number (60)"),
        ([("p", "6x")], "p=6x can't be read: 'x' is not allowed here"),
        ([("p", "5 ; LASER ON")], "p=5 ; LASER ON is not a value"),
        ([("p", "5 // a")], "p=5 // a is not a value"),
        ([("p", "5\nLASER ON NOW")], "is not a value"),
        ([("p", "5\x1b[2J")], "is not a value"),
        ([("p", "__import__('os')")], "can't be read"),
        ([("p", "1e16")], "too large"),
        ([("p", "sine(3)")], "there is no function sine"),
        ([("p", "9" * 20_000)], "has more than 10000 characters"),
        ([("p", "(" * 500 + "1")], "can't be read"),
        ([("power", "5")], "power is a keyword and can't be a name"),
        ([("", "5")], "'' is not a name"),
        ([("1p", "5")], "1p is not a name"),
        ([("größe", "5")], "größe is not a name"),
        ([("p q", "5")], "p q is not a name"),
        ([("p", "5"), ("q", "6"), ("p", "7")], "p is given twice: 5 and 7"),
    ],
)
def test_what_is_no_override(pairs: list[tuple[str, str]], said: str) -> None:
    found = checked_overrides(pairs)
    assert isinstance(found, Phrase)
    assert said in found
    assert len(found) < 500
    assert found.isprintable()


def test_overrides_can_not_be_changed() -> None:
    found = checked_overrides([("p", " 5% ")])
    assert isinstance(found, MappingProxyType)
    assert dict(found) == {"p": "5%"}


def notes(text: str, **values: str) -> list[tuple[str, int, list[tuple[str, int]]]]:
    """Code and line of each error, with the notes about overrides: their message and line."""
    result = result_of(Path("x.job"), text, defined(**values))
    return [
        (d.rule.code, d.span.line, [(r.message, r.span.line) for r in d.remarks if r.text == OVERRIDDEN])
        for d in result.diagnostics
        if d.severity.value == "error"
    ]


P_500 = ("p is 500 by -D, not as written here", 1)


@pytest.mark.parametrize(
    ("text", "values", "expected"),
    [
        # Directly, through other LETs, through a call, in a loop's bounds.
        ("LET p = 10\n" + _POWER, {"p": "500"}, [("GJ201", 5, [P_500])]),
        ("LET p = 10\n" + _POWER, {"p": "5mm"}, [("GJ203", 5, [("p is 5mm by -D, not as written here", 1)])]),
        ("LET p = 1\nLET q = p\n" + _POWER.replace("(p)", "(q + 1)"), {"p": "500"}, [("GJ201", 6, [P_500])]),
        ("LET p = 1\nDEF r(a)\n" + _POWER.replace("(p)", "(a)") + "END\nCALL r(2 * p)\n", {"p": "500"},
         [("GJ201", 6, [P_500])]),
        ("LET p = 10\n" + MARK + "REPEAT 2 * p\nLINE X 5\nEND\n", {"p": "1e7"},
         [("GJ127", 5, [("p is 1e7 by -D, not as written here", 1)])]),
        # At the LET itself: its text is not what was read.
        ("LET p = 10\n" + _POWER, {"p": "q + 1"}, [("GJ121", 1, [("p is q + 1 by -D, not as written here", 1)])]),
        # Not at a diagnostic of the whole file, whose line 1 happens to be a LET.
        ("LET p = 10\n" + _POWER, {"p": "20", "zz": "3"}, [("GJ160", 1, [])]),
        # Not where the value is another one.
        ("LET p = 10\nLET p = 500\n" + _POWER, {"p": "20"}, [("GJ201", 6, [])]),
        ("LET p = 10\nDEF r(p)\n" + _POWER + "END\nCALL r(600)\n", {"p": "20"}, [("GJ201", 6, [])]),
        ("LET p = 10\nDEF r()\nLET p = 500\n" + _POWER + "END\nCALL r()\n", {"p": "20"}, [("GJ201", 7, [])]),
        ("LET p = 10\nFOR p FROM 500 TO 500 STEP 1\n" + _POWER + "END\n", {"p": "20"}, [("GJ201", 6, [])]),
        ("LET p = 10\n" + MARK + "LINE X 500 Y (p)\n", {"p": "20"}, [("GJ503", 5, [])]),
        # A routine's own name does not hide the job's after it.
        ("LET p = 10\nDEF r()\nLET p = 50\n" + _POWER + "END\nCALL r()\n" + _POWER, {"p": "500"},
         [("GJ201", 16, [P_500])]),
    ],
)  # fmt: skip
def test_diagnostics_name_the_overrides_that_they_depend_on(
    text: str, values: dict[str, str], expected: list[tuple[str, int, list[tuple[str, int]]]]
) -> None:
    found = [one for one in notes(text, **values) if one[0] in {code for code, _, _ in expected}]
    assert found == expected


def test_an_included_file_that_sets_the_name_again(tmp_path: Path) -> None:
    (tmp_path / "part.job").write_text("LET p = 500\n" + _POWER, encoding="utf-8")
    text = "LET p = 10\n" + _POWER + 'INCLUDE "part.job"\n' + _POWER
    result = result_of(tmp_path / "x.job", text, defined(p="400"))
    found = [(d.file[-8:], d.span.line, [r.text for r in d.remarks].count(OVERRIDDEN)) for d in result.diagnostics]
    assert [one for one in found if one[1] in (5, 13)] == [
        (str(tmp_path / "x.job")[-8:], 5, 1),
        (str(tmp_path / "x.job")[-8:], 13, 0),
        ("part.job", 5, 0),
    ]
