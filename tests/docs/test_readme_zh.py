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
from support.documents import CHINESE, ENGLISH, text_of

from gusjob.cli import cli
from gusjob.i18n.width import width

HAN = "\u3400-\u9fff"
MARKS = "，。；：、？！“”（）"

_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_INDENTED = re.compile(r"(?:^    .*\n(?:\n(?=    ))?)+", re.MULTILINE)
_SPAN = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
_LINK = re.compile(r"\[[^\]\n]*\]\(([^)\n]+)\)")


@dataclass(frozen=True, slots=True)
class Section:
    """The text below one heading. `code`: kind and text of its blocks; `prose`: everything else."""

    level: int
    title: str
    code: tuple[tuple[str, str], ...]
    prose: str


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


def compared(kind: str, code: str) -> str:
    """What both have of a block: all of it, but outputs are in the user's language (test_readme.py tests them)."""
    return "" if kind == "text" else code


def headings(text: str) -> list[object]:
    return [section.level for section in sections(text)]


def code(text: str) -> list[object]:
    return [[(kind, compared(kind, block)) for kind, block in section.code] for section in sections(text)]


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


def test_both_have_the_same() -> None:
    found = {what.__name__: differences(what, text_of(CHINESE)) for what in ALIKE}
    assert {name: pairs for name, pairs in found.items() if pairs} == {}


BROKEN: tuple[tuple[Callable[[str], list[object]], str, str], ...] = (
    (headings, "\n## 命令", "\n### 命令"),
    (headings, "\n## 工作原理\n", "\n"),
    (code, "LASER POWER 40\n", "LASER POWER 41\n"),
    (code, "LASER POWER 40\n", ""),
    (code, "python -m pytest\n", "python -m pytests\n"),
    (code, "──► simulator", "──► 仿真器"),
    (code, "```text\n", "```\n"),
    (links, "](jobs)", "](job)"),
    (links, "[docs/ci.md](docs/ci.md)", "docs/ci.md"),
    (links, "](docs/report-page.png)", "](docs/report.png)"),
    (spans, "`period_us`", "`period_ms`"),
    (spans, "（加 `--strict` 时警告也算）", ""),
    (tables, "| 命令 | 用途 |", "| 命令 |"),
    (tables, "| `gusjob fmt ", "`gusjob fmt "),
    (emphasis, "仿真器读的是指令，不是作业", "**仿真器读的是指令，不是作业**"),
    (named, "--no-laser", "--nolaser"),
    (named, "gusjob devices", "gusjob device"),
)
"""What differs, and how a copy is broken so that it does."""


def test_a_broken_copy_is_seen() -> None:
    whole = text_of(CHINESE)
    unseen = [
        (old, new) for what, old, new in BROKEN if old not in whole or not differences(what, whole.replace(old, new))
    ]
    assert unseen == []


def test_each_links_to_the_other() -> None:
    assert text_of(ENGLISH).startswith("# gusjob\n\n[简体中文](README.zh-CN.md)\n\n")
    assert text_of(CHINESE).startswith("# gusjob\n\n[English](README.md)\n\n")


def badly_typeset(text: str) -> list[str]:
    """Pieces of prose that break the rules of Chinese typesetting: marks, blanks, and lines of at most 120 columns.

    A line ends after a mark, or where a blank belongs anyway: markdown makes a blank of a line end.
    """
    found = "".join(section.prose for section in sections(text))
    found = re.sub(r"!?\[[^\]\n]*\]\([^)\n]+\)|`[^`\n]+`", "a", found).replace("**", "")
    wrong = "|".join((
        rf"[{HAN}][,;:?!.()\"]", rf"[,;:?!()\"][{HAN}]", rf" [{MARKS}]", rf"[{MARKS}] (?!\|)", rf"[{HAN}] +[{HAN}]",
        rf"[{HAN}][A-Za-z0-9]", rf"[A-Za-z0-9%][{HAN}]", rf"[{HAN}]\n[{HAN}（“]", "您",
        "[\uff10-\uff19\uff21-\uff5a\u3000]",
    ))  # fmt: skip
    outputs = re.sub(r"^```text\n.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    long = [line for line in outputs.splitlines() if width(line) > 120 and not line.startswith("|")]
    return [*re.findall(rf".{{0,8}}(?:{wrong}).{{0,8}}", found), *long]


def test_the_chinese_is_typeset() -> None:
    assert badly_typeset(text_of(CHINESE)) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("在控制器上运行", "在 控制器上运行"),
        ("，不用任何硬件", ", 不用任何硬件"),
        ("，不用任何硬件", "， 不用任何硬件"),
        ("固高 GUS ", "固高GUS "),
        ("固高 GUS ", "固高 GUS"),
        ("，不用任何硬件", "，不用\n任何硬件"),
        ("，不用任何硬件", "，不用任何硬件" * 9),
        ("（Windows）", "(Windows)"),
    ],
)
def test_badly_typeset_chinese_is_seen(old: str, new: str) -> None:
    whole = text_of(CHINESE)
    assert old in whole
    assert badly_typeset(whole.replace(old, new, 1))
