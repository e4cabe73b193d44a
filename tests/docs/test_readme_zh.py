"""README.zh-CN.md beside README.md: the same headings, code, links and tables; only words differ."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import zip_longest

import pytest
from click import Context
from support.tools import ROOT

from gusjob.cli import cli
from gusjob.i18n.width import width

ENGLISH, CHINESE = "README.md", "README.zh-CN.md"
HAN = "\u3400-\u9fff"
MARKS = "，。；：、？！“”（）"

_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_INDENTED = re.compile(r"(?:^    .*\n(?:\n(?=    ))?)+", re.MULTILINE)
_SPAN = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
_LINK = re.compile(r"(?<!!)\[[^\]\n]*\]\(([^)\n]+)\)")
_SWITCHED_OFF = re.compile(r"^# (?=\w+ = |\[)", re.MULTILINE)
"""In front of an entry of a profile that is there as a comment; the entry itself is code."""


@dataclass(frozen=True, slots=True)
class Section:
    """What stands below one heading. `code`: kind and text of its blocks; `prose`: all else."""

    level: int
    title: str
    code: tuple[tuple[str, str], ...]
    prose: str


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


@cache
def sections(text: str) -> list[Section]:
    blocks: list[tuple[str, str]] = []

    def kept(found: re.Match[str]) -> str:
        blocks.append((found[1], found[2]) if found.re is _FENCE else ("indented", found[0]))
        return f"\n\0{len(blocks) - 1}\0\n"

    bare = _INDENTED.sub(kept, _FENCE.sub(kept, text))
    parts = re.split(r"^(#+) (.*)\n", bare, flags=re.MULTILINE)
    assert parts[0] == ""
    return [
        Section(len(level), title, tuple(blocks[int(n)] for n in re.findall("\0(\\d+)\0", body)), body)
        for level, title, body in zip(parts[1::3], parts[2::3], parts[3::3], strict=True)
    ]


def without_comments(kind: str, code: str) -> str:
    """A block with all its comments empty, but for the part of one that gusjob reads."""
    if kind in ("json", "lua"):
        return code
    if kind == "":
        return re.sub(r"(;(?: allow GJ\d+:)?).*", r"\1", code)
    return re.sub(r"(?m)(^|\s)#.*", r"\1#", _SWITCHED_OFF.sub("#\n", code))


def headings(text: str) -> list[object]:
    return [section.level for section in sections(text)]


def code(text: str) -> list[object]:
    return [[(kind, without_comments(kind, block)) for kind, block in section.code] for section in sections(text)]


def links(text: str) -> list[object]:
    return [Counter(_LINK.findall(section.prose)) - Counter((ENGLISH, CHINESE)) for section in sections(text)]


def spans(text: str) -> list[object]:
    return [Counter(_SPAN.findall(section.prose)) for section in sections(text)]


def tables(text: str) -> list[object]:
    """How many cells each row has."""
    rows = [re.findall(r"^\|.*\|$", section.prose, re.MULTILINE) for section in sections(text)]
    return [[len(re.findall(r"(?<!\\)\|", row)) for row in of_one] for of_one in rows]


def emphasis(text: str) -> list[object]:
    return [section.prose.count("**") for section in sections(text)]


def named(text: str) -> list[object]:
    """Options, commands, rules and calls, wherever they stand."""
    commands = "|".join(cli.list_commands(Context(cli)))
    pattern = rf"--[a-z][a-z-]*|\bgusjob (?:{commands})\b|\bGJ\d+\b|\bGT_\w+|\bCtrl\+\w"
    return sorted(set(re.findall(pattern, text)))


ALIKE: tuple[Callable[[str], list[object]], ...] = (headings, code, links, spans, tables, emphasis, named)


def differences(what: Callable[[str], list[object]], chinese: str) -> list[tuple[object, object]]:
    """Pairs that are to be equal and are not: in README.md, in its translation."""
    return [(a, b) for a, b in zip_longest(what(text_of(ENGLISH)), what(chinese)) if a != b]


@pytest.mark.parametrize("what", ALIKE, ids=lambda what: what.__name__)
def test_both_have_the_same(what: Callable[[str], list[object]]) -> None:
    assert differences(what, text_of(CHINESE)) == []


@pytest.mark.parametrize(
    ("what", "old", "new"),
    [
        (headings, "\n### ", "\n## "),
        (headings, "\n## 工作原理\n", "\n"),
        (code, "LASER POWER 40\n", "LASER POWER 41\n"),
        (code, "LASER POWER 40\n", ""),
        (code, "; allow GJ404:", "; allow GJ404 "),
        (code, "timeout-minutes: 15", "timeout-minutes: 5"),
        (code, "\nlink_patience_s", "\n# link_patience_s"),
        (code, "link_patience_s = 5 ", "link_patience_s = 6 "),
        (code, "# power_pct = 80 ", "# power_pct = 90 "),
        (code, "# [budget] ", "# [budgets] "),
        (code, "gusjob plot part.job --by energy", "gusjob plot part.job"),
        (code, "a.job:2:1: note: ", "a.job:2:1: 提示："),
        (code, "```lua\n", "```toml\n"),
        (code, "cmd = { 'gusjob', 'lsp' }", "cmd = { 'gusjob' }"),
        (links, "](jobs)", "](job)"),
        (links, "[pre-commit](https://pre-commit.com)", "pre-commit"),
        (spans, "`q`", "`x`"),
        (spans, "`--strict` 用于 CI", "用于 CI"),
        (tables, "| 命令 | 用途 |", "| 命令 |"),
        (tables, "| `gusjob/limits.py` |", "`gusjob/limits.py` |"),
        (emphasis, "**Helix**", "Helix"),
        (named, "--no-laser", "--nolaser"),
        (named, "gusjob devices", "gusjob device"),
        (named, "GJ515", "GJ516"),
        (named, "Ctrl+Z", "Ctrl+Y"),
    ],
)  # fmt: skip
def test_a_broken_copy_is_seen(what: Callable[[str], list[object]], old: str, new: str) -> None:
    whole = text_of(CHINESE)
    broken = whole.replace(old, new)
    assert broken != whole
    assert differences(what, broken)


def test_a_comment_may_differ() -> None:
    broken = text_of(CHINESE).replace("# 控制周期\n", "# 周期\n").replace("GJ404: 焊缝在此预热\n", "GJ404: 预热\n")
    assert broken.count("# 周期\n") == broken.count("GJ404: 预热\n") == 1
    assert differences(code, broken) == []


def test_each_links_to_the_other() -> None:
    assert text_of(ENGLISH).startswith("# gusjob\n\n[简体中文](README.zh-CN.md)\n\n")
    assert text_of(CHINESE).startswith("# gusjob\n\n[English](README.md)\n\n")


def ill_set(text: str) -> list[str]:
    """Pieces of prose that are not set as Chinese is: marks, blanks, and lines of at most 120 columns.

    A line ends behind a mark, or where a blank stands anyway: markdown makes a blank of it.
    """
    said = "".join(section.prose for section in sections(text))
    said = re.sub(r"\[[^\]\n]*\]\([^)\n]+\)|`[^`\n]+`", "a", said).replace("**", "")
    wrong = "|".join((
        rf"[{HAN}][,;:?!.()\"]", rf"[,;:?!()\"][{HAN}]", rf" [{MARKS}]", rf"[{MARKS}] (?!\|)", rf"[{HAN}] +[{HAN}]",
        rf"[{HAN}][A-Za-z0-9]", rf"[A-Za-z0-9%][{HAN}]", rf"[{HAN}]\n[{HAN}（“]", "您",
        "[\uff10-\uff19\uff21-\uff5a\u3000]",
    ))  # fmt: skip
    said = re.sub(r"[一二三四五]\.\d", "a", said)  # Sections of the manual.
    long = [line for line in text.splitlines() if width(line) > 120 and not line.startswith("|")]
    return [*re.findall(rf".{{0,8}}(?:{wrong}).{{0,8}}", said), *long]


def test_the_chinese_is_typeset() -> None:
    assert ill_set(text_of(CHINESE)) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("通过厂商库", "通过 厂商库"),
        ("，不需要任何硬件", ", 不需要任何硬件"),
        ("，不需要任何硬件", "， 不需要任何硬件"),
        ("固高 GUS ", "固高GUS "),
        ("固高 GUS ", "固高 GUS"),
        ("，不需要任何硬件", "，不需要\n任何硬件"),
        ("，不需要任何硬件", "，不需要任何硬件" * 9),
        ("（Windows）", "(Windows)"),
    ],
)
def test_ill_set_chinese_is_seen(old: str, new: str) -> None:
    whole = text_of(CHINESE)
    assert old in whole
    assert ill_set(whole.replace(old, new, 1))
