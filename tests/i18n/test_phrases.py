"""Every English text of a diagnostic can be translated: it is a Phrase, and its fields are Phrases.

The tests use a pseudo-language without Latin letters. What stays English in it cannot be translated.
"""

from __future__ import annotations

import ast
import copy
import errno
import os
import re
import string
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from support.catalogue import needed
from support.faulty import bad_files, diagnostics_of_file, diagnostics_of_text
from support.tools import ROOT

from gusjob.config.machine import Abi, Budget, ControllerSettings, Interlock, Laser, Machine, parse_scanner
from gusjob.config.profile import parse_profile, read_profile
from gusjob.controllers.gus.calls import CRD_FIELDS, HOST_CALLS, SIGNATURES, CType
from gusjob.controllers.gus.functions import functions
from gusjob.diagnostics.model import NOWHERE, Diagnostic, Remark, Rule
from gusjob.diagnostics.rules import (
    BAD_INCLUDE,
    CALL_OCTAL,
    OUT_OF_RANGE,
    PROFILE_SYNTAX,
    RULES,
    UNEXPECTED,
    VARIANTS,
)
from gusjob.frontend import check_text, read_job, read_source
from gusjob.frontend.parse.misread import END_OF_LINE
from gusjob.frontend.parse.operators import FUNCTIONS
from gusjob.i18n import language as translate
from gusjob.i18n.phrases import Phrase, all_of, any_of, both_of, did_you_mean, localized
from gusjob.kinematics.units import UNITS

PACKAGE = ROOT / "gusjob"
_FIELD = re.compile(r"\{\{|\}\}|\{[A-Za-z_]*\}|[A-Za-z]")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


class Pseudo:
    """A catalogue that has every text: its letters are dots, its fields are where they were."""

    def gettext(self, text: str) -> str:
        return _FIELD.sub(lambda found: found[0] if found[0][0] in "{}" else "·", text)


@pytest.fixture
def pseudo(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use the pseudo-language."""
    monkeypatch.setattr(translate, "_catalogue", Pseudo())


# The code: what Babel takes from it.


def phrases(path: Path) -> list[ast.Call]:
    """Every Phrase(...) in a file."""
    calls = [n for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Call)]
    return [n for n in calls if ast.unparse(n.func).split(".")[-1] == "Phrase"]


def odd_phrase(call: ast.Call) -> str:
    """Why a Phrase(...) is not a literal with the fields that it names; '' if it is."""
    text = call.args[0] if len(call.args) == 1 else None
    if not isinstance(text, ast.Constant) or not isinstance(text.value, str):
        return "no literal"
    named = {name for _, name, _, _ in string.Formatter().parse(text.value) if name is not None}
    given = {keyword.arg for keyword in call.keywords}
    return "" if named == given else f"{named} in the text, {given} given"


RULE_TEXTS = {
    "Phrase(found['text'], **fields)", "Phrase(self.rule.text, **self.fields)",
    "Phrase(self.text, **self.fields)", "Phrase(diagnostic.rule.title)",
}  # fmt: skip
"""Texts of rules and remarks, which the catalogue knows from their registries."""


def test_phrases_are_literals_with_their_fields() -> None:
    odd = [
        (str(path.relative_to(PACKAGE)), call.lineno, wrong)
        for path in PACKAGE.rglob("*.py")
        for call in phrases(path)
        if ast.unparse(call) not in RULE_TEXTS and (wrong := odd_phrase(call))
    ]
    assert odd == []


def test_planted_phrases_are_seen() -> None:
    def odd(code: str) -> bool:
        call = ast.parse(code, mode="eval").body
        assert isinstance(call, ast.Call)
        return bool(odd_phrase(call))

    assert odd('Phrase(f"{a} is odd")')
    assert odd("Phrase(text)")
    assert odd('Phrase("one" if one else "two")')
    assert odd('Phrase("{a} is odd")')
    assert odd('Phrase("{a} is odd", b=1)')
    assert odd('Phrase("{a} is odd", **given)')
    assert odd('Phrase("is " + "odd")')
    assert not odd('Phrase("{a} is "\n"odd {{ }}", a=1)')


def test_babel_finds_what_the_parser_finds() -> None:
    texts = {c.args[0].value for p in PACKAGE.rglob("*.py") for c in phrases(p) if isinstance(c.args[0], ast.Constant)}
    assert texts <= {message.id for message in needed()}


TEXT_FIELDS = {"hint", "reason", "wanted", "wants", "expected", "given", "found", "what", "mend", "lost", "begins"}
"""Fields of diagnostics that hold a text of the program, or a word of the user's."""
OF_DIAGNOSTICS = ("frontend", "lint", "planner", "simulate", "controllers", "config", "kinematics", "ir")


def is_bare(value: ast.expr | None) -> bool:
    """Whether a value is English that is no Phrase; words of the language are in capitals, calls begin with GT_."""
    match value:
        case ast.IfExp(body=body, orelse=other):
            return is_bare(body) or is_bare(other)
        case ast.BoolOp(values=values):
            return any(map(is_bare, values))
        case ast.BinOp(left=left, right=right):
            return is_bare(left) or is_bare(right)
        case ast.JoinedStr(values=values):
            return any(is_bare(v) for v in values if isinstance(v, ast.Constant))
        case ast.Constant(value=str(text)):
            return re.search("[a-z]{2}", re.sub(r"GT_\w+", "", text)) is not None
        case _:
            return False


def bare_fields(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of every field of a diagnostic that is bare English: in a call, a dict or a variable."""
    for node in ast.walk(tree):
        named: list[tuple[str | None, ast.expr]] = []
        match node:
            case ast.Call(keywords=keywords):
                named = [(k.arg, k.value) for k in keywords]
            case ast.Dict(keys=keys, values=values):
                named = [
                    (ast.literal_eval(k), v) for k, v in zip(keys, values, strict=True) if isinstance(k, ast.Constant)
                ]
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                named = [(name, value)]
        yield from ((value.lineno, name) for name, value in named if name in TEXT_FIELDS and is_bare(value))


def test_no_field_of_a_diagnostic_is_bare_english() -> None:
    paths = {package: sorted((PACKAGE / package).rglob("*.py")) for package in OF_DIAGNOSTICS}
    assert all(paths.values())
    bare = [
        (str(path.relative_to(PACKAGE)), *field)
        for of_package in paths.values()
        for path in of_package
        for field in bare_fields(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert bare == []


def test_planted_bare_fields_are_seen() -> None:
    for code in (
        'f(hint="; say it")',
        'd = {"reason": f"{a} is odd"}',
        'what = "LINE" if a else "a line"',
        'hint = a + "b c de"',
    ):
        assert list(bare_fields(ast.parse(code)))
    for code in ('f(hint="")', 'f(what="LASER ON")', 'f(name="a b")', 'hint = Phrase("; say it")', 'found = "GT_Open"'):
        assert not list(bare_fields(ast.parse(code)))


# The pseudo-language: what is left of English in what a user reads.


def words_of(*texts: str) -> set[str]:
    return {word for text in texts for word in _WORD.findall(text)}


@cache
def entries_of_the_profile() -> set[str]:
    """Keys, tables and choices of the machine profile."""
    tables = (Machine, Laser, ControllerSettings, Interlock, Budget)
    names = {name for table in tables for name in table.__struct_fields__}
    inner = {name.removeprefix(head) for name in names for head in ("lookahead_", "expansion_")}
    return names | inner | {"laser", "interlock", "expansion", "lookahead"} | words_of(*Abi)


UNITS_SHOWN = words_of(*UNITS, "kHz Hz MHz mV J/mm 1/s pulse/mm")
"""They are written so in Chinese, too."""
FIGURES = {"inf", "nan", "e"}
"""No end, no number, 1e+15."""
OPERATORS = {*FUNCTIONS, "and", "or", "not"}
"""Functions and operators of the job language are in small letters."""
_CALLS = {**SIGNATURES, **HOST_CALLS}
ARGUMENTS = {*functions(), *(a.name for s in _CALLS.values() for a in s.args), *(f[0] for f in CRD_FIELDS)}
ARGUMENTS |= words_of(*CType)
"""Calls that are passed over (printf), arguments of calls, fields of their structs, types of C."""
OF_CALLS = ("GJ7", "GJ152", *(f"GJ11{number}" for number in range(1, 7)))
CODEC_TEXTS = {"invalid start byte", "invalid continuation byte", "unexpected end of data"}
SYSTEM_TEXTS = {os.strerror(number).lower() for number in errno.errorcode}


def allowed_by(rule: Rule, fields: dict[str, Any]) -> set[str]:
    """Words that may stay as they are in a diagnostic of a rule."""
    allowed = UNITS_SHOWN | FIGURES
    if rule.code.startswith(OF_CALLS) or str(fields.get("what", "")).startswith("GT_"):
        allowed = allowed | ARGUMENTS
    if rule.code.startswith("GJ1"):
        allowed = allowed | OPERATORS
    if "key" in fields:
        allowed = allowed | entries_of_the_profile()
    reason = fields.get("reason", "")
    # The texts of Python's TOML reader, its codecs and the operating system are not translated.
    if reason and (rule is PROFILE_SYNTAX or reason in CODEC_TEXTS or reason.lower() in SYSTEM_TEXTS):
        allowed = allowed | words_of(reason)
    return allowed


_NAMING = re.compile(r"\b(?:LET|DEF|FOR|REPEAT)\b.*", re.IGNORECASE)


def code_of(line: str) -> str:
    """A line without its comment."""
    return re.split(r";|//|#", line)[0]


def allowed_in(diagnostic: Diagnostic, text: str) -> set[str]:
    """Words that may stay as they are in a diagnostic of a text."""
    lines = [code_of(line) for line in text.split("\n")]
    spans = [diagnostic.span, *(remark.span for remark in diagnostic.remarks)]
    allowed = words_of(*(lines[s.line - 1] for s in spans if s.line <= len(lines)))
    # A user's names: they may be set in another line than the one that uses them.
    allowed |= words_of(*(found[0] for line in lines for found in _NAMING.finditer(line)))
    # A file's name.
    allowed |= words_of(diagnostic.path, *(s.path for s in spans))
    # A name that is free, made from the user's: power_1.
    return allowed | {f"{word}_1" for word in allowed}


def english_in(diagnostic: Diagnostic, text: str) -> set[str]:
    """Words of a localized diagnostic that should be in the user's language."""
    words = words_of(diagnostic.localized_with_count, *(remark.localized for remark in diagnostic.remarks))
    left = {word for word in words if re.search("[a-z]", word)}
    left -= allowed_by(diagnostic.rule, diagnostic.fields) | allowed_in(diagnostic, text)
    return {word for word in left if not word.startswith("GT_") and not re.fullmatch("x[0-9a-f]+", word)}


def untranslated(found: Iterable[Diagnostic], text: str) -> list[tuple[str, set[str]]]:
    """Messages that keep English words, with these words."""
    return [(diagnostic.message, words) for diagnostic in found if (words := english_in(diagnostic, text))]


def wrong_of(texts: Iterable[str], rule: Rule) -> dict[str, object]:
    """Texts without a diagnostic, or with one that keeps English words."""
    found = {text: diagnostics_of_text(text, rule) for text in texts}
    return {
        text: untranslated(of_text, text)
        for text, of_text in found.items()
        if not of_text or untranslated(of_text, text)
    }


@pytest.mark.usefixtures("pseudo")
def test_examples_of_rules_leave_no_english() -> None:
    examples = [(rule, rule.bad) for rule in RULES.values() if rule.bad]
    assert len(examples) > 100
    wrong = {rule.code: untranslated(diagnostics_of_text(text, rule), text) for rule, text in examples}
    assert {code: found for code, found in wrong.items() if found} == {}


@pytest.mark.usefixtures("pseudo")
def test_bad_files_leave_no_english() -> None:
    wrong = {p.name: untranslated(diagnostics_of_file(p), p.read_text(encoding="utf-8")) for p in bad_files()}
    assert len(wrong) > 40
    assert {name: found for name, found in wrong.items() if found} == {}


ODD_LINES = (
    "LINE", "LINE X 1 Y", "LINE X a", "LINE X 1 2", "LINE R 5", "LINE X 1 X 2", "LINE X 5 mm", "LINE X 3*4", "END 1",
    "ARC CW X 5", "ARC CW R 3", "ARC CW R 3 I 2 X 1", "JUMP X 1 VEL 5", "JUMP X 1 END 5", "ELSE 3", "WAIT 3",
    "IF 1 = 2", "LET a = sine(3)", "LET a = sqrt(1, 2)", "LET a = min()", "LET a = 1mm + 1s + 3", "LET a = 1 < 2",
    "LET a = 1mm + 3pulse", "LET a = qqqq", "LET a = 1/0", "LET a = 10 ** 400", "LET a = sqrt(1 < 2)",
    "LET a = sin(3mm)", "LET a = (1 < 2) + 1", "LET a = hypot(1, 2mm)", "LET a = 1mm * 2mm", "LET a = not 3",
    "REPEAT 1.5\nEND", "REPEAT 1mm\nEND", "REPEAT (1 < 2)\nEND", "FOR i = 1 TO 2 STEP 0\nEND",
    "FOR i = 1 TO 2mm\nEND", "FRAME SHIFT\nEND", "FRAME SCALE 0\nEND", "INCLUDE a", 'INCLUDE "a"', "CALL f(1)",
    "DEF f(LINE)\nEND", "DEF f(a, a)\nEND", "DEF f(a)\nEND\nCALL f(1, 2)", "LASER POWER (1s)", "LASER POWER 5mm",
    "LASER FOLLOW MIN 1 MAX 2", "LASER FOLLOW RATIO 1 AT 3 MIN 1 MAX 2", "LASER DISTANCE REF X 1 RATIO X 1 MIN 1 MAX 2",
    "LASER MODE FREQUENCY CARRIER 10", "LASER MODE ANALOG WIDTH 3", "LASER MODE ANALOG CARRIER 3",
    "LASER MODE DUTY WIDTH 3", "LASER MODE DUTY", "LASER FPK WIDTH 1", "DWELL 5 VEL", "COORDS", "UNITS MM 3",
    "IF 1\nEND", "LET LINE = 3", "LINE X 1e300", "LASER ON CHANNEL 5", "LINE X (1 < 2)", "LIEN X 1", "?", "LINE X 1 ?",
    "LET a = abs(1 < 2)", "LET a = 1mm / 1s", "LET a = atan2(1, 2mm)", "LET a = 1 < 2mm", 'INCLUDE ""', 'INCLUDE "."',
    "VEL 3s", "ACC 3mm", "LASER MODE DUTY CARRIER 3s", "LASER STANDBY FREQ 3 DUTY 3s", "LASER PREVOLT 3s", "CRD 3mm",
    "FRAME ROTATE 3mm\nEND", "LET a = qqqqqqq(3)", "SKYWRITE MODE 1 TIMELAG 5 VEL 3", "WAIT VEL 3",
    "LASER FPK WIDTH 5mm",
    "IF 1 < 2\nLET a = 1\nEND\nIF 2 < 1\nLET b = 1\nEND\nVEL (b)", "LET a = 3deg\nVEL (a)", "VEL (3mm/s2)",
    "IF 1 < (2 < 3)\nEND", "LASER POWER (3mm)", "FOR i = 1 TO 4\nIF i > 2\nLET b = 1\nEND\nVEL (b)\nEND",
)  # fmt: skip


@pytest.mark.usefixtures("pseudo")
def test_odd_lines_leave_no_english() -> None:
    assert wrong_of(ODD_LINES, UNEXPECTED) == {}


ODD_JOBS = (
    "LASER MODE ANALOG\nLASER PREVOLT 11",
    "LASER MODE DUTY CARRIER 10 MIN -1 MAX 101",
    "LASER DELAY ON 5 OFF -1",
    "LASER MODE DUTY CARRIER 10\nLASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 1 MIN -1 MAX 5V",
    "VEL 10\nACC 100\nARC CW X 1 R 0\nARC CCW X 1 Y 0 R 5\nARC CW X 5 I 0 J 0",
    "SKYWRITE MODE 1 TIMELAG 10 NPREV -1 NPOST -1",
    "LASER MODE DUTY CARRIER 10\nLASER DELAY ON 9000 OFF 9000\nVEL 100\nACC 50000\nLASER POWER 5\nLASER ON\n"
    "LINE X 0.1\nLASER OFF",
    "LASER MODE DUTY CARRIER 10\nLASER DELAY ON 9000 OFF 1\nVEL 100\nACC 50000\nLASER POWER 5\nLASER ON\n"
    "LINE X 0.1\nLASER OFF",
    "QQ\n" * 1100,
)


@pytest.mark.usefixtures("pseudo")
def test_odd_jobs_leave_no_english() -> None:
    assert wrong_of(ODD_JOBS, UNEXPECTED) == {}


ODD_PROFILES = (
    "laser = 3", "lookahead = 3", "[controller]\naxes_off_after = 3\nlibrary = 3\nabi = 'x'", "scanner = 3",
    "scanner = 'x'", "scanner = 'delay:20s'", "name = [1]", "name = {}", "name = true", "name = 1979-05-27",
    "name = 07:32:00", "name = 1979-05-27T07:32:00", "field_x_mm = 3", "[[laser]]\n[[laser]]", "q",
)  # fmt: skip


@pytest.mark.usefixtures("pseudo")
def test_odd_profiles_leave_no_english() -> None:
    found = {text: parse_profile(text, "gusjob.toml").diagnostics for text in ODD_PROFILES}
    assert [text for text, of_text in found.items() if not of_text] == []
    assert [wrong for text, of_text in found.items() if (wrong := untranslated(of_text, text))] == []


@pytest.mark.usefixtures("pseudo")
def test_a_scanner_that_is_none_leaves_no_english() -> None:
    for text in ("slow:3", "delay:20s"):
        found = parse_scanner(text)
        assert isinstance(found, str)
        assert set(re.findall("[a-z]+", localized(found))) <= words_of(text, *UNITS)


ODD_CALLS = (
    "GT_LnXY(1,0,0,1,1,0,0", "GT_LnXY(1)", "GT_LnXY(1,0,0,1,1,0,{1})", "GT_LnXY(1,0,0,1,1,0,09)", "GT_Lnxy(1)",
    "GT_SetCrdPrm(1,3)", "GT_SetLaserDisMode(1,0,3,4,0)", "GT_CrdStatus(1,2,3,0)", "GT_BufLaserPrfFollow(1,1,5,2,0,0)",
    "GT_SetPulseWidth(3,0)", "GT_LaserOutFrq(3000,0)", "GT_LaserPowerMode(2,5,6,0)", "GT_CrdStart(0,0)", "? ?",
    "GT_LaserPowerMode(1,100,0,0);GT_LaserOutFrq(10,0)", "GT_LaserPowerMode(2,10,0,0);GT_EnaFPK(1,1,1,0)",
    "GT_LnXY(1,0,0,1,1,0,{})", "{}", "// GT_", "? ?\n" * 1100,
    "GT_SetAxisMode(7,1)\nGT_LaserPowerMode(0,100,0,0)\nGT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},10000,1000,0,1,"
    "{0,0,0,0,0,0,0,0}})\nGT_CrdClear(1,0)\nGT_BufLaserPrfCmd(1,30,0,0)\nGT_BufLaserOn(1,0,0)\n"
    "GT_LnXY(1,1000,0,10,1,0,0)\nGT_CrdStart(1,0)",
)  # fmt: skip


@pytest.mark.usefixtures("pseudo")
def test_odd_calls_leave_no_english() -> None:
    assert wrong_of(ODD_CALLS, CALL_OCTAL) == {}


@pytest.mark.usefixtures("pseudo")
def test_files_that_are_no_text_leave_no_english(tmp_path: Path) -> None:
    contents = (b"LINE\0", b"\xff\xfea", b"LINE X 1\nLINE \xff")
    found = [f for data in contents for f in check_text(data, "a.job")[1]]
    assert len(found) == len(contents)
    found += read_source(tmp_path / "none.job")[1]  # With the system's own text.
    found += read_source(Path("a\0b"))[1]
    (tmp_path / "gusjob.toml").write_bytes(b'name = "caf\xe9"')
    found += [*read_profile(tmp_path / "gusjob.toml").diagnostics, *read_profile(tmp_path).diagnostics]
    assert len(found) == len(contents) + 4
    assert untranslated(found, "") == []


@pytest.mark.usefixtures("pseudo")
def test_includes_leave_no_english(tmp_path: Path) -> None:
    (tmp_path / "no_text.job").write_bytes(b"WAIT\0")
    text = "".join(
        f'INCLUDE "{name}"\n' for name in ("", "a\\b", ".", "../a.job", "a.job", "no_text.job", "/a", "x" * 300)
    )
    (tmp_path / "a.job").write_text(text, encoding="utf-8")
    source, _ = read_source(tmp_path / "a.job", "a.job")
    assert source is not None
    found = [f for f in read_job(source, Machine())[1] if f.rule is BAD_INCLUDE]
    assert len(found) == 8
    assert untranslated(found, text) == []


@pytest.mark.usefixtures("pseudo")
def test_glued_english_is_seen() -> None:
    fields = {"what": "on delay", "value": 1.0, "unit": "us", "range": "[2, 3]", "hint": ""}
    assert english_in(Diagnostic(rule=OUT_OF_RANGE, span=NOWHERE, fields=fields), "LASER DELAY") == {"on", "delay"}
    whole = {**fields, "what": Phrase("on delay")}
    assert english_in(Diagnostic(rule=OUT_OF_RANGE, span=NOWHERE, fields=whole), "LASER DELAY") == set()
    glued = {**fields, "what": Phrase("{what} of it", what="on delay")}
    assert english_in(Diagnostic(rule=OUT_OF_RANGE, span=NOWHERE, fields=glued), "LASER DELAY") == {"on", "delay"}


# Phrase itself.


def use_catalogue(monkeypatch: pytest.MonkeyPatch, texts: dict[str, str]) -> None:
    """A catalogue of a few texts."""

    class Some:
        def gettext(self, text: str) -> str:
            return texts.get(text, text)

    monkeypatch.setattr(translate, "_catalogue", Some())


def test_a_phrase_is_its_english_text() -> None:
    text = Phrase("the {what} of {word}", what="size", word="LINE")
    assert text == "the size of LINE"
    assert hash(text) == hash("the size of LINE")
    assert (text.template, text.fields) == ("the {what} of {word}", {"what": "size", "word": "LINE"})


def test_without_a_catalogue_all_is_english() -> None:
    inner = Phrase("{count} marks", count=3)
    assert localized(Phrase("{what}: {marks}", what="a", marks=inner)) == "a: 3 marks"
    assert localized("plain") == "plain"
    assert localized(Phrase("")) == ""


def test_fields_that_are_phrases_are_localized(monkeypatch: pytest.MonkeyPatch) -> None:
    use_catalogue(monkeypatch, {"{what} of {word}": "{word} 的{what}", "the {size}": "{size}", "size": "大小"})
    inner = Phrase("the {size}", size=Phrase("size"))
    assert localized(Phrase("{what} of {word}", what=inner, word="LINE")) == "LINE 的大小"


def test_floats_are_shown_as_number_shows_them(monkeypatch: pytest.MonkeyPatch) -> None:
    text = Phrase("at {value} of {count}", value=2.0, count=3)
    assert text == "at 2 of 3"
    use_catalogue(monkeypatch, {"at {value} of {count}": "{count} 之 {value}"})
    assert localized(text) == "3 之 2"
    assert localized(Phrase("at {value} of {count}", value=float("inf"), count=0.1 + 0.2)) == "0.3 之 inf"


def test_a_users_name_that_is_a_key_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    use_catalogue(monkeypatch, {"statements": "语句", "{name} is set": "已设置 {name}", "size": "大小"})
    assert localized("statements") == "statements"
    assert localized(Phrase("{name} is set", name="size")) == "已设置 size"
    fields = {"name": "size", "hint": ""}
    remark = Remark(text="{name} is set", span=NOWHERE, fields=fields)
    assert remark.localized == "已设置 size"
    assert remark.message == "size is set"


def test_a_users_braces_are_no_fields(monkeypatch: pytest.MonkeyPatch) -> None:
    text = Phrase("{found} does not belong here", found="{hint} {0} {")
    assert text == "{hint} {0} { does not belong here"
    use_catalogue(monkeypatch, {"{found} does not belong here": "此处不应有 {found}"})
    assert localized(text) == "此处不应有 {hint} {0} {"
    assert localized(copy.deepcopy(text)) == localized(copy.copy(text)) == localized(text)


def test_lists_are_localized_part_by_part(monkeypatch: pytest.MonkeyPatch) -> None:
    assert any_of(("A", "B", "C")) == "A, B or C"
    assert all_of(("A", "B", "C")) == "A, B, C"
    assert both_of(("A", "B", "C")) == "A and B and C"
    assert (any_of(("A",)), all_of(("A",)), all_of(()), both_of(("A",))) == ("A", "A", "", "A")
    assert (did_you_mean("LINE"), did_you_mean("")) == ("; did you mean LINE?", "")
    use_catalogue(
        monkeypatch, {"{first} or {last}": "{first}或{last}", "{first}, {second}": "{first}、{second}", "a b": "甲"}
    )
    assert localized(any_of((Phrase("a b"), "B", END_OF_LINE))) == "甲、B或the end of the line"


def test_texts_of_rules_and_remarks_are_no_phrases_of_the_code() -> None:
    """`Phrase(self.rule.text, ...)` is no literal: the catalogue takes these texts from the registry."""
    texts = {message.id for message in needed()}
    assert {r.text for r in (*RULES.values(), *VARIANTS)} <= texts
