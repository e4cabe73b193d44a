"""Simplified Chinese beside English: a complete catalogue in the manual's terms, used where it is chosen."""

from __future__ import annotations

import gettext
import os
import re
import string
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest
from babel.messages.mofile import read_mo
from click import Context
from click.testing import CliRunner, Result
from support import catalogue
from support.chinese import CHINESE
from support.cli import write
from support.tools import ROOT

from gusjob.cli import cli
from gusjob.diagnostics.model import NOWHERE, Diagnostic, Severity
from gusjob.diagnostics.rules import RULES
from gusjob.i18n.language import CATALOGUES, language, language_of, set_language, system_language, translated, typeset
from gusjob.i18n.phrases import Phrase, localized
from gusjob.i18n.width import width, wrapped

TEXTS = catalogue.texts(catalogue.kept())


@pytest.fixture
def chinese() -> Iterator[None]:
    set_language("zh")
    yield
    set_language("en")


def gusjob(*arguments: str, env: Mapping[str, str] | None = None) -> Result:
    return CliRunner().invoke(cli, arguments, env=env)


# The catalogue.


def test_the_catalogue_is_whole(rewrite: bool) -> None:
    """It has every text of the program with its translation, and no other."""
    now = catalogue.updated()
    if rewrite:
        catalogue.PO.write_bytes(catalogue.po_bytes(now))
        catalogue.MO.write_bytes(catalogue.mo_bytes(now))
    assert [text for text, localized in catalogue.texts(now).items() if not localized] == []
    assert list(catalogue.texts(catalogue.kept())) == list(catalogue.texts(now)), "run pytest --rewrite"


def test_what_gettext_reads_is_what_is_kept() -> None:
    with catalogue.MO.open("rb") as file:
        assert catalogue.texts(read_mo(file)) == TEXTS


def fields(text: str) -> list[str]:
    """Fields of a template, with how they are to be shown."""
    named = [
        f"{name}!{conversion}:{spec}"
        for _, name, spec, conversion in string.Formatter().parse(text)
        if name is not None
    ]
    return sorted([*named, *re.findall(r"%\(\w+\)\w", text)])


def test_fields_agree() -> None:
    assert sum(bool(fields(text)) for text in TEXTS) > 300
    assert {text: chinese for text, chinese in TEXTS.items() if fields(chinese) != fields(text)} == {}


TERMS = {
    r"\bon delays?\b": "开光延时",
    r"\boff delays?\b": "关光延时",
    r"pre-voltage": "预电压",
    r"first pulse killer": "首脉冲抑制",
    r"\bstandby\b": "维持脉冲",
    r"\bvelocity follow\b": "能量跟随",
    r"\bduty modes?\b": "占空比",
    r"\blook-ahead\b": "前瞻",
    r"\bcarrier\b": "载波",
    r"\bswitch line\b": "开关信号",
    r"\bcoordinate system": "坐标系",
    r"\bmachine profile\b": "配置文件",
    r"\bGT_ calls?\b": "指令",
}
"""Terms, and how the vendor's manual calls them."""


def test_the_manuals_terms() -> None:
    for term, meant in TERMS.items():
        about = {text: chinese for text, chinese in TEXTS.items() if re.search(term, text, re.IGNORECASE)}
        assert about, term
        assert {text: chinese for text, chinese in about.items() if meant not in chinese} == {}, term


def test_translations_are_chinese() -> None:
    """A text with words has Chinese in its translation; calls, words of the language and figures are none."""
    worded = {t: s for t, s in TEXTS.items() if re.search(r"(?<![\w{.-])[a-z]{4,}(?![\w}])", t)}
    assert {text for text, localized in worded.items() if not CHINESE.search(localized)} == set()


_MARKED = re.compile(r"\{(hint|options|values|hidden|counts)\}")
"""Fields that begin with a mark of their own, or are empty."""


def test_chinese_is_typeset() -> None:
    """Full-width marks between Chinese characters, no blank beside them, one between Chinese and other letters."""
    wrong = {
        localized
        for localized in TEXTS.values()
        if re.search(r"[\u4e00-\u9fff] ?[,;:?!.](?: |$)| [，。；：、）]|[，；、（] ", localized)
        or re.search(r"[\u4e00-\u9fff][A-Za-z0-9{]|[A-Za-z0-9}][\u4e00-\u9fff]", _MARKED.sub("", localized))
    }
    assert wrong == set()


# The language.


@pytest.mark.parametrize(
    ("locale", "used"),
    [
        ("zh_CN.UTF-8", "zh"), ("zh_CN", "zh"), ("zh", "zh"), ("zh_SG.utf8", "zh"), ("zh-Hans-CN", "zh"),
        ("zh_CN@pinyin", "zh"), ("zh_TW.UTF-8", "en"), ("zh-Hant", "en"), ("de_DE.UTF-8", "en"), ("C", "en"),
        ("", "en"),
    ],
)  # fmt: skip
def test_locales(locale: str, used: str) -> None:
    assert language_of(locale) == used


@pytest.mark.parametrize(
    ("environment", "used"),
    [
        ({"LANG": "zh_CN.UTF-8"}, "zh"),
        ({"LANG": "en_US.UTF-8", "LC_MESSAGES": "zh_CN.UTF-8"}, "zh"),
        ({"LC_ALL": "C", "LANG": "zh_CN.UTF-8"}, "en"),
        ({"LC_ALL": "C", "LANGUAGE": "zh_CN:zh", "LANG": "zh_CN.UTF-8"}, "en"),
        ({"LC_ALL": "POSIX", "LANGUAGE": "zh"}, "en"),
        ({"LC_ALL": "C.UTF-8", "LANGUAGE": "zh"}, "zh"),
        ({"LANGUAGE": "en:zh_CN", "LANG": "zh_CN.UTF-8"}, "en"),
        ({"LANGUAGE": "fr:zh:en", "LANG": "fr_FR.UTF-8"}, "zh"),
        ({"LANGUAGE": "fr", "LANG": "zh_CN.UTF-8"}, "zh"),
        ({"LANGUAGE": "", "LANG": "zh_CN.UTF-8"}, "zh"),
    ],
)
def test_the_systems_language(environment: dict[str, str], used: str) -> None:
    assert system_language(environment) == used


def test_one_language_after_the_other() -> None:
    for _ in range(2):
        set_language("zh")
        assert (language(), translated("error")) == ("zh", "错误")
        set_language("en")
        assert (language(), translated("error")) == ("en", "error")


def test_an_unknown_language_changes_nothing(chinese: None) -> None:
    for wrong in ("fr", "zh_CN", ""):
        with pytest.raises(ValueError, match="en, zh"):
            set_language(wrong)
        assert language() == "zh"


def test_a_command_restores_the_language_of_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LANGUAGE", "fr")
    gettext.textdomain("host")
    try:
        for arguments in (["explain", "GJ401", "--lang", "zh"], ["--lang", "zh", "check"], ["--help", "--lang", "zh"]):
            assert CHINESE.search(CliRunner().invoke(cli, arguments).output)
            assert (language(), os.environ["LANGUAGE"], gettext.textdomain()) == ("en", "fr", "host")
    finally:
        gettext.textdomain("messages")


@pytest.mark.parametrize(
    ("encoding", "chosen", "used"),
    [("utf-8", False, True), ("gbk", False, True), ("cp1252", False, False), ("cp1252", True, True)],
)
def test_an_encoding_without_chinese_gets_english(encoding: str, chosen: bool, used: bool) -> None:
    """Unless --lang zh is given. Tables and messages are in one encoding."""
    line = [
        sys.executable,
        "-m",
        "gusjob",
        *(["--lang", "zh"] if chosen else []),
        "run",
        str(ROOT / "jobs/co2_cut.job"),
    ]
    env = {**os.environ, "LANGUAGE": "", "LC_ALL": "zh_CN.UTF-8", "PYTHONIOENCODING": encoding}
    done = subprocess.run(line, env=env, capture_output=True, timeout=60, check=False)
    text = (done.stdout + done.stderr).decode(encoding)
    assert bool(CHINESE.search(text)) is (used and encoding != "cp1252")
    assert ("\\u" in text) is (used and encoding == "cp1252")


def test_phrases(chinese: None) -> None:
    assert localized(Phrase("; did you mean {near}?", near="LINE")) == "；是否想写 LINE？"
    assert localized("error") == "error"  # A user's name may be a word of the catalogue.
    assert localized(Phrase("no such text {a}", a=Phrase("error"))) == "no such text 错误"


def test_blanks_beside_fields(chinese: None) -> None:
    template = "在 {a} 时 {b}，为 {c} us"
    assert typeset(template, {"a": "运动", "b": "x", "c": 2.5}) == "在{a}时 {b}，为 {c} us"
    assert typeset(template, {"a": "LINE", "b": "开", "c": 1}) == "在 {a} 时{b}，为 {c} us"


# What people see.

SYSTEM = {"LC_ALL": "", "LC_MESSAGES": "", "LANG": "zh_CN.UTF-8", "LANGUAGE": ""}

JOB = """LASER MODE DUTY CARRIER 10kHz
LASER DELAY ON 80us OFF 50us
VEL 100
ACC 5000
LASER POWER 130
LASER ON
LINE X 10
LNE X 20
"""
WANTED = """{path}:2:25: 警告[GJ306]: 关光延时 50 us 短于开光延时 80 us；通常关光延时应更长
    2 | LASER DELAY ON 80us OFF 50us
      |                         ^^^^
{path}:5:13: 错误[GJ201]: LASER POWER 130 % 超出范围 (0, 100) %
    5 | LASER POWER 130
      |             ^^^
{path}:6:1: 错误[GJ401]: 作业结束时通道 0 的激光仍开着：补上 LASER OFF
    6 | LASER ON
      | ^^^^^^^^
{path}:8:1: 错误[GJ102]: 没有以 'LNE' 开头的语句；是否想写 LINE？
    8 | LNE X 20
      | ^^^
"""


def test_a_faulty_job_in_chinese(tmp_path: Path) -> None:
    path = write(tmp_path, JOB)
    done = gusjob("check", "--lang", "zh", str(path))
    assert done.stdout == WANTED.format(path=path)
    assert done.exit_code == 1


def test_how_chinese_is_chosen(tmp_path: Path) -> None:
    path, system = str(write(tmp_path, JOB)), SYSTEM
    for chosen in (("--lang", "zh", "check", path), ("check", path, "--lang=zh"), ("check", "--lang", "zh", path)):
        assert "错误[GJ102]" in gusjob(*chosen).output
    assert "错误[GJ102]" in gusjob("check", path, env=system).output
    assert "error[GJ102]" in gusjob("check", "--lang", "en", path, env=system).output


def test_the_last_lang_counts_and_a_wrong_one_is_refused(tmp_path: Path) -> None:
    path = str(write(tmp_path, JOB))
    assert "error[GJ102]" in gusjob("--lang", "zh", "check", "--lang", "en", path).output
    done = gusjob("check", "--lang", "fr", path)
    assert done.exit_code == 2
    assert "'fr' is not one of 'en', 'zh'" in done.output
    assert "'fr' 不是 'en', 'zh' 之一" in gusjob("check", "--lang", "fr", path, env=SYSTEM).output


def test_what_programs_read_is_english(tmp_path: Path) -> None:
    path = str(write(tmp_path, JOB))
    for arguments in (("check", "--format", "json"), ("compile",), ("report", "--format", "json")):
        done = gusjob(*arguments, path, "--lang", "zh")
        assert done.stdout == gusjob(*arguments, path).stdout
        assert not CHINESE.search(done.stdout)


def test_explain_in_chinese() -> None:
    for code in RULES:
        head, text, why, *_ = gusjob("explain", code, "--lang", "zh").stdout.split("\n\n")
        assert CHINESE.search(head) and CHINESE.search(text) and CHINESE.search(why), code
        assert max(width(line) for line in (text + "\n" + why).split("\n")) <= 102
    rows = gusjob("explain", "--lang", "zh").stdout.splitlines()
    assert len(rows) == len(RULES)
    assert {row.split()[1] for row in rows} == {"错误", "警告", "提示"}
    assert len({width(row[: row.index(row.split()[2])]) for row in rows}) == 1  # Titles begin in one column.


def test_help_in_chinese() -> None:
    """No English sentence is left, no line is wider than a terminal, and the language is English again afterwards."""
    for command in ([], *([name] for name in cli.list_commands(Context(cli)))):
        before = gusjob(*command, "--help").output
        text = gusjob(*command, "--help", "--lang", "zh").output
        assert max(map(width, text.splitlines())) <= 80, command
        assert "用法" in text.splitlines()[0], command
        # Lower-case words in a row are English; names of formats and options have no other word beside them.
        assert re.findall(r"(?<![\w.\[|/-])[a-z]{3,} [a-z]{2,} [a-z]{2,}", text) == [], command
        assert gusjob(*command, "--help").output == before, command


def test_wrong_usage_in_chinese() -> None:
    assert "没有此选项" in gusjob("check", "--foo", "--lang", "zh").output
    assert "缺少参数" in gusjob("compile", "--lang", "zh").output


@pytest.mark.parametrize(
    ("text", "columns", "lines"),
    [
        ("激光通道的占空比", 8, ["激光通道", "的占空比"]),
        ("激光通道，占空", 8, ["激光通", "道，占空"]),  # A line does not begin with a comma.
        ("见 LASER POWER 一节", 10, ["见 LASER", "POWER 一节"]),
        ("plain words only", 11, ["plain words", "only"]),
        ("（激光）通道", 5, ["（激", "光）", "通道"]),
        ("toolongforaline x", 5, ["toolongforaline", "x"]),
    ],
)
def test_wrapping(text: str, columns: int, lines: list[str]) -> None:
    assert wrapped(text, columns).split("\n") == lines


def test_counts_and_severities(chinese: None) -> None:
    diagnostic = Diagnostic(rule=RULES["GJ102"], span=NOWHERE, fields={"found": "'X'", "hint": ""}, count=1234)
    assert diagnostic.localized_with_count == "没有以 'X' 开头的语句（1,234 次）"
    assert [s.localized for s in Severity] == ["错误", "警告", "提示"]
    assert diagnostic.message == "no statement begins with 'X'"


def test_the_catalogue_is_in_the_package() -> None:
    assert catalogue.MO.is_file() and CATALOGUES.is_relative_to(ROOT / "gusjob")
